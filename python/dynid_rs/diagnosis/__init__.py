"""The diagnosis: what a model lacks, found by one rule, added, and tested on runs that chose nothing."""
