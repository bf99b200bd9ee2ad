"""Rows of all joints side by side, reduced to one triangular factor: lossless for everything quadratic.

A rotation of the samples leaves every product of two columns as it is, those of different joints too. The factor R of
``[rows of joint 0 | rows of joint 1 | ...]`` is such a rotation of all samples, so its rows, cut at the joints again,
can stand for them: same factors per joint, same covariance between joints (Eq. 24), same whitened system (Eq. 25).
Only time is lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.regression.columns import Block, Observations, Plan

FloatArray = NDArray[np.float64]


def wide_factor(joints: Sequence[FloatArray]) -> FloatArray:
    """Factor of the joints' rows (n_rows, width_j) side by side, (sum of widths)^2, upper triangular."""
    return _core.triangular_factor(np.ascontiguousarray(np.concatenate(list(joints), axis=1)))


def cut_at_joints(factor: FloatArray, widths: Sequence[int]) -> list[FloatArray]:
    """Columns of every joint again, (sum of widths, width_j) each."""
    return np.split(factor, np.cumsum(widths)[:-1], axis=1)


def observations_of(
    plan: Plan, joints: Sequence[FloatArray], n_rows: int, n_counted: NDArray[np.int64]
) -> Observations:
    """Observations of one block that stands for `n_rows` rows; `joints` as `columns.run_rows` gives them.

    `n_counted` (n_joints,): in how many of them every joint moves.
    """
    rows = [np.ascontiguousarray(joint) for joint in joints]
    return Observations(plan, [Block(0, rows, [_core.triangular_factor(joint) for joint in rows], (n_rows, n_counted))])


class FactorTree:
    """Factors merged as they come, in the tree of `_core.merge_factors`; holds one per level, log2 of their number."""

    def __init__(self) -> None:
        self._levels: list[FloatArray | None] = []

    def add(self, factor: FloatArray) -> None:
        """Take in the next factor; the answer depends on their order."""
        for level, there in enumerate(self._levels):
            if there is None:
                self._levels[level] = factor
                return
            factor = _core.merge_factors([there, factor])
            self._levels[level] = None
        self._levels.append(factor)

    def total(self) -> FloatArray:
        """Factor of everything so far; needs at least one."""
        later, *earlier = [factor for factor in self._levels if factor is not None]
        for factor in earlier:
            later = _core.merge_factors([factor, later])
        return later
