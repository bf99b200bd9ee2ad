"""From states to numbers: columns, systems, priors and the evidence for them, intervals, errors."""
