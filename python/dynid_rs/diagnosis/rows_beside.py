"""What the declared model can still take of one joint's rows, with blocks left out in turn.

Of the four modules of this kind only this one looks at one joint at a time and whitens its rows for the model's own
uncertainty, so that flexible functions of signals, which have no physical columns, can be scored on rows left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.columns import Observations
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.links import LinkDynamicsIdentifier, weighted_system
from dynid_rs.systems import stack_one

FloatArray = NDArray[np.float64]

PARTS = 3
"""Parts of the training blocks, each left out once."""
STRETCHES = 15
"""Stretches of a block over which squares are summed up to see how they scatter."""
MOST_ROWS = 1200
"""More rows of a joint are thinned: a search needs no more."""
NOTICED = 0.1
"""Directions in which the declared model's prediction is surer than this part of the noise need no whitening."""
WEAK = 1e-10
"""Directions of the declared columns below this relative singular value are rounding."""


@dataclass(frozen=True, eq=False)
class Split:
    """Rows of one joint that are fitted and rows that are left out, beside the declared model of all joints.

    Columns B added to the joint's rows move the declared coefficients. Of B is then left ``B - taken @ (taken.T @ B)``
    on the fitted rows, and ``weighed(B') - elsewhere @ (taken.T @ B)`` on the others. Combinations of the rows left
    out that the declared model itself predicts badly, because the fitted rows hardly show them, count for less: the
    prediction's own covariance whitens them.

    `fitted`, `left` are indices of rows; `taken` (n_fitted, rank), `elsewhere` (n_left, rank), weighed; `e_fitted`,
    `e_left` the residuals of the declared model of the fitted rows, the latter weighed; `unsure` (n_left, n_unsure)
    and `cut` (n_unsure,) the directions that count for less, and by how much.
    """

    fitted: NDArray[np.intp]
    left: NDArray[np.intp]
    taken: FloatArray
    elsewhere: FloatArray
    e_fitted: FloatArray
    e_left: FloatArray
    unsure: FloatArray
    cut: FloatArray

    def weighed(self, x: FloatArray) -> FloatArray:
        """Whitened `x` (n_left, k) of rows that were left out."""
        return np.asarray(x - self.unsure @ (self.cut[:, None] * (self.unsure.T @ x)))


@dataclass(frozen=True, eq=False)
class JointRows:
    """One joint's rows, thinned, and its splits.

    `rows` their indices among all blocks' rows; `block` (n_rows,) which one each belongs to; `residual` (n_rows,) of
    the fit; `splits` one per part; `whole` the one that leaves nothing out.
    """

    rows: NDArray[np.intp]
    block: NDArray[np.intp]
    residual: FloatArray
    splits: tuple[Split, ...]
    whole: Split


class Beside:
    """Declared columns of a fit, ready to have others put beside them."""

    def __init__(self, fit: ThreeLoopIdentifier) -> None:
        self._observations: Observations = fit.observations_
        self._links: LinkDynamicsIdentifier = fit.links_
        blocks = self._observations.blocks
        sizes = [block.n_rows for block in blocks]
        self._thin = max(1, -(-sum(sizes) // MOST_ROWS))
        block = np.repeat(np.arange(len(blocks)), sizes)
        self._rows = np.arange(len(block))[:: self._thin]
        self._block = block[self._rows]
        parts = np.array_split(np.arange(len(blocks)), min(PARTS, len(blocks)))
        everything = np.arange(len(blocks))
        self._kept = [np.setdiff1d(everything, part) for part in parts] + [everything]
        self._systems = [self._orthonormal(kept) for kept in self._kept]

    def of_joint(self, j: int) -> JointRows:
        """Rows and splits of joint j."""
        wide = [
            stack_one(self._observations.plan, j, block.rows[j], self._links.torque_scale_)
            for block in self._observations.blocks
        ]
        rows = np.concatenate(wide)[self._rows]
        splits = [self._split(j, rows, kept, *system) for kept, system in zip(self._kept, self._systems, strict=True)]
        residual = rows[:, -1] - rows[:, :-1] @ self._links.x_
        return JointRows(self._rows, self._block, residual, tuple(splits[:-1]), splits[-1])

    def _orthonormal(self, kept: Sequence[int] | NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Coefficients (n_columns, rank) that make the weighted columns of some blocks orthonormal; the solution."""
        plan = self._observations.plan
        some = Observations(plan, [self._observations.blocks[k] for k in kept])
        system = weighted_system(some, self._links)
        norms = np.linalg.norm(system[:, :-1], axis=0)
        used = plan.estimable() & (norms > WEAK * norms.max(initial=0.0))
        u, s, vt = np.linalg.svd(system[:, :-1][:, used] / norms[used], full_matrices=False)
        good = s > WEAK * s[0]
        inverse = np.zeros((plan.n_columns, int(good.sum())))
        inverse[used] = (vt[good].T / s[good]) / norms[used][:, None]
        return inverse, inverse @ (u[:, good].T @ system[:, -1])

    def _split(self, j: int, rows: FloatArray, kept: NDArray[np.intp], inverse: FloatArray, x: FloatArray) -> Split:
        weight = np.sqrt(self._thin * self._links.worth_[j]) / max(self._links.noise_std_[j], 1e-300)
        seen = np.isin(self._block, kept)
        left = rows[:, -1] - rows[:, :-1] @ x
        columns = weight * (rows[:, :-1] @ inverse)
        u, s, vt = np.linalg.svd(columns[seen], full_matrices=False)
        good = s > 1e-9
        s = np.minimum(s, 1.0)  # thinned rows may hold more of a direction than their share, and no model takes more
        fitted, others = np.flatnonzero(seen), np.flatnonzero(~seen)
        unsure, size, _ = np.linalg.svd(columns[others], full_matrices=False)
        unsure, size = unsure[:, size > NOTICED], size[size > NOTICED]
        none = np.zeros((len(others), 0))
        split = Split(
            fitted,
            others,
            u[:, good] * s[good],
            none,
            left[fitted],
            left[others],
            unsure,
            1 - 1 / np.sqrt(1 + size**2),
        )
        return replace(
            split,
            elsewhere=split.weighed(columns[others] @ vt[good].T),
            e_left=split.weighed(left[others, None])[:, 0],
        )


def spread_of_sum(x: FloatArray, block: NDArray[np.intp]) -> float:
    """Standard error of the sum of `x` (n_rows,), which remembers, from stretches of about a second of each block."""
    parts = [part for k in np.unique(block) for part in np.array_split(np.flatnonzero(block == k), STRETCHES)]
    sums = np.array([x[part].sum() - len(part) * x.mean() for part in parts])
    return float(np.sqrt(np.sum(sums**2)))
