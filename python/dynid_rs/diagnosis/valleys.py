"""A cylinder's shape has several valleys: where a search begins, and which others explain the same."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dynid_rs.diagnosis.beside import Beside, Gain, independent_rows
from dynid_rs.diagnosis.candidate import RunColumns, joined, stacked
from dynid_rs.diagnosis.hypothesis import Hypothesis, bounds_of
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.shape_search import refined_shape

KIND = "counterbalance"
N_WORKERS = 2
"""Threads that search; results do not depend on their number."""
N_VALLEYS, NEXT_VALLEY = 3, 0.6
"""Starts of the search for a cylinder's shape, and by how much [rad] their phases differ."""
AS_LIKELY = 1.92
"""Logarithm of the likelihood ratio up to which a shape lies within 95 % of the best one's."""


def best_shape(beside: Beside, kinds: Kinds, hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis with the shape that takes off most, from every valley's start."""

    def end(start: Hypothesis) -> Hypothesis:
        return refined_shape(kinds, start, lambda columns: _gain(beside, columns, hypothesis).power)

    starts = valleys(beside, kinds, hypothesis)
    if len(starts) == 1:
        return end(starts[0])
    with ThreadPoolExecutor(N_WORKERS) as pool:  # the core evaluates without the interpreter's lock
        ends = list(pool.map(end, starts))
    return max(ends, key=lambda end: _taken(beside, kinds, end))


def valleys(beside: Beside, kinds: Kinds, hypothesis: Hypothesis) -> list[Hypothesis]:
    """Where a search of the shape begins: the hypothesis, and for a cylinder the best ones that stand elsewhere."""
    if hypothesis.kind != KIND:
        return [hypothesis]
    starts = [hypothesis]
    for other in _best_first(beside, kinds, hypothesis, pulling=pulls(hypothesis)):
        turned = [dict(other.shape)["phase"] - dict(start.shape)["phase"] for start in starts]
        if len(starts) < N_VALLEYS and np.all(np.cos(turned) < np.cos(NEXT_VALLEY)):
            starts.append(other)
    return starts


def mirrored(beside: Beside, kinds: Kinds, hypothesis: Hypothesis) -> Hypothesis | None:
    """The best cylinder that pushes where this one pulls (or the other way), if it explains as much; else None.

    With a short lever both are little more than one sine of the joint's angle, half a turn apart.
    """
    if hypothesis.kind != KIND:
        return None
    others = _best_first(beside, kinds, hypothesis, pulling=not pulls(hypothesis))
    if not others:
        return None
    other = refined_shape(kinds, others[0], lambda columns: _gain(beside, columns, others[0]).power)
    lost = _taken(beside, kinds, hypothesis) - _taken(beside, kinds, other)
    rows = float(np.mean(independent_rows(beside.residual, beside.blocks)))
    return other if 0.5 * lost * rows / beside.n_rows < AS_LIKELY else None


def pulls(h: Hypothesis) -> bool:
    """Whether a cylinder's gas pulls: one that pulls and one that pushes are two valleys of one search."""
    return dict(h.shape).get("gas_length", 1.0) > 0


def _best_first(beside: Beside, kinds: Kinds, hypothesis: Hypothesis, *, pulling: bool) -> Sequence[Hypothesis]:
    """Cylinders of the grid at the same joint that pull, or push, the one that takes off most first."""
    same = [h for h in kinds.grid([KIND]) if h.joints == hypothesis.joints and pulls(h) == pulling]
    columns = [stacked(c) for c in kinds.columns(same)]
    groups = [slice(k, k + 1) for k in range(len(same))]
    gains = beside.gains(joined(columns), groups, [bounds_of(h) for h in same])
    return [same[k] for k in np.argsort([-gain.power for gain in gains], kind="stable")]


def _taken(beside: Beside, kinds: Kinds, h: Hypothesis) -> float:
    return _gain(beside, stacked(kinds.columns([h])[0]), h).power


def _gain(beside: Beside, columns: RunColumns, h: Hypothesis) -> Gain:
    return beside.gains(columns, [slice(None)], [bounds_of(h)])[0]
