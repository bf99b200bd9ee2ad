"""A cylinder's shape has several valleys: where a search begins, and which others explain the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside, Gain, independent_rows
from dynid_rs.diagnosis.candidate import RunColumns, joined, stacked
from dynid_rs.diagnosis.dead_point import KIND
from dynid_rs.diagnosis.hypothesis import Hypothesis, bounds_of
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.shape_search import refined_shape

FloatArray = NDArray[np.float64]

N_WORKERS = 2
"""Threads that search; results do not depend on their number."""
N_VALLEYS, NEXT_VALLEY = 3, 0.6
"""Starts of the search for a cylinder's shape, and by how much [rad] their phases differ."""
AS_LIKELY = 1.92
"""Logarithm of the likelihood ratio up to which a shape lies within 95 % of the best one's."""


def best_shape(beside: Beside, kinds: Kinds, hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis with the shape that takes off most, from every valley's start."""
    power = explained(beside, kinds, hypothesis, bounds_of(hypothesis))

    def end(start: Hypothesis) -> Hypothesis:
        return refined_shape(kinds, start, power)

    starts = valleys(beside, kinds, hypothesis)
    if len(starts) == 1:
        return end(starts[0])
    with ThreadPoolExecutor(N_WORKERS) as pool:  # the core evaluates without the interpreter's lock
        ends = list(pool.map(end, starts))
    return max(ends, key=lambda end: power(stacked(kinds.columns([end])[0])) - kinds.doubt(end))


def explained(
    beside: Beside, kinds: Kinds, hypothesis: Hypothesis, bounds: FloatArray
) -> Callable[[RunColumns], float]:
    """What columns explain: weighted power, or its logarithmic likelihood where a belief stands against a shape.

    The likelihood counts rows by what the hypothesis' own shape leaves, so that all shapes are measured alike.
    """

    def gain(columns: RunColumns) -> Gain:
        return beside.gains(columns, [slice(None)], [bounds])[0]

    if kinds.belief is None or hypothesis.kind != KIND:
        return lambda columns: gain(columns).power

    def left(columns: RunColumns) -> FloatArray:
        return beside.with_columns(columns, gain(columns).coefficients)

    rows = independent_rows(left(kinds.once(hypothesis)), beside.blocks)
    before = np.maximum(np.sum(beside.residual**2, axis=0), 1e-300)
    return lambda columns: 0.5 * float(rows @ np.log(before / np.maximum(np.sum(left(columns) ** 2, axis=0), 1e-300)))


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
    other = refined_shape(kinds, others[0], explained(beside, kinds, others[0], bounds_of(others[0])))
    lost = _taken(beside, kinds, hypothesis) - _taken(beside, kinds, other)
    rows = float(np.mean(independent_rows(beside.residual, beside.blocks)))
    less_likely = 0.5 * lost * rows / beside.n_rows + kinds.doubt(other) - kinds.doubt(hypothesis)
    return other if less_likely < AS_LIKELY else None


def pulls(h: Hypothesis) -> bool:
    """Whether a cylinder's gas pulls: one that pulls and one that pushes are two valleys of one search."""
    return dict(h.shape).get("gas_length", 1.0) > 0


def _best_first(beside: Beside, kinds: Kinds, hypothesis: Hypothesis, *, pulling: bool) -> Sequence[Hypothesis]:
    """Cylinders of the grid at the same joint that pull, or push, the one that takes off most first."""
    same = [h for h in kinds.grid([KIND]) if h.joints == hypothesis.joints and pulls(h) == pulling]
    if not same:
        return []
    columns = [stacked(c) for c in kinds.columns(same)]
    groups = [slice(k, k + 1) for k in range(len(same))]
    gains = beside.gains(joined(columns), groups, [bounds_of(h) for h in same])
    return [same[k] for k in np.argsort([-gain.power for gain in gains], kind="stable")]


def _taken(beside: Beside, kinds: Kinds, h: Hypothesis) -> float:
    return _gain(beside, stacked(kinds.columns([h])[0]), h).power


def _gain(beside: Beside, columns: RunColumns, h: Hypothesis) -> Gain:
    return beside.gains(columns, [slice(None)], [bounds_of(h)])[0]
