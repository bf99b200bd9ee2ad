"""Whether a name that is likely holds on parts of the data, and against what acts on its joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.trials import N_SMALL, Value, blocks, helps, shows_everywhere, whole_runs
from dynid_rs.model.placed import CATALOGUE

OF_TIME = {"step", "temperature"}
"""Signals of what changes while the motion returns."""


def holds(belief: Belief, beside: Beside, tried: Value, unlike: Sequence[Value], need: float) -> bool:
    """Whether a name that is likely holds on parts of the data too, and against what is `unlike` it at its joints."""
    at_times = _changes_in_time(tried.hypothesis)
    phase = np.arange(len(belief.phase)) if at_times else belief.phase
    parts, runs = blocks(phase), whole_runs(phase, belief.run_lengths)
    after = beside.with_columns(tried.columns)
    return (
        helps(beside, after, belief.reach(tried.hypothesis), parts, runs)
        # What changes in time does so once, where it begins.
        and (at_times or shows_everywhere(beside, after, belief.reach(tried.hypothesis), blocks(phase, N_SMALL)))
        # What tells the same with more right, and does not hold, makes the next best no more likely.
        and all(after.evidence_for(v.hypothesis)[0] > need for v in unlike if v.value > tried.value + SURE)
    )


def _changes_in_time(hypothesis: Hypothesis) -> bool:
    """Whether what is left out of a name has to be times, for it changes though the motion returns."""
    return hypothesis.kind in CATALOGUE and bool(OF_TIME & set(CATALOGUE[hypothesis.kind]["signals"]))


def shares(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses act on a common joint, so that one may explain what the other does."""
    return bool(set(one.columns) & set(other.columns))
