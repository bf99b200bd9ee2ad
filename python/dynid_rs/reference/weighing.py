"""Possible changes weighed against each other: least squares on Gram matrices, blocks left out, honest covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.regression.noise_spectrum import grid_noise_products
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
Places = NDArray[np.intp]

BLOCK = 5.0
"""Stretch [s] that is left out as a whole; residuals remember less."""
LEAST_BLOCKS = 4
"""A lone short run is cut finer."""
ROUNDING = 1e-12
"""Size of a column over the largest below which it is rounding."""


@dataclass(frozen=True, eq=False)
class Weighing:
    """Rows of all changes' columns and of what they should explain.

    Parameters
    ----------
    runs : sequence of States
        Where the rows are.
    columns : per run (n_rows, n_joints, p)
        Torque per unit of every change.
    error : per run (n_rows, n_joints)
        Measured less believed torque.
    weights : ndarray (n_joints,)
        One over the noise.
    precision, weak : ndarray (p,)
        Of the prior around zero on columns that are held, as day-to-day freedom, and that are free: zero for most.
    """

    runs: Sequence[States]
    columns: Sequence[FloatArray]
    error: Sequence[FloatArray]
    weights: FloatArray
    precision: FloatArray
    weak: FloatArray

    @cached_property
    def _grams(self) -> FloatArray:
        """(n_blocks, n_joints, p + 1, p + 1) of ``[columns | error]``."""
        grams = []
        least = -(-LEAST_BLOCKS // len(self.runs))
        for states, columns, error in zip(self.runs, self.columns, self.error, strict=True):
            wide = np.concatenate([columns, error[:, :, None]], axis=2)
            n_blocks = max(least, int(len(wide) * states.step / states.rate / BLOCK))
            for part in np.array_split(wide, n_blocks):
                grams.append(np.einsum("njp,njq->jpq", part, part, optimize=True))
        return np.array(grams)

    def beside(self, columns: Sequence[FloatArray], precision: FloatArray) -> Weighing:
        """Return the same rows with more columns (n_rows, n_joints, k) behind the others, and their prior (k,)."""
        wide = [np.concatenate(parts, axis=2) for parts in zip(self.columns, columns, strict=True)]
        prior = np.append(self.precision, precision)
        return replace(self, columns=wide, precision=prior, weak=np.append(self.weak, np.zeros(len(precision))))

    def solve(self, free: Places, held: Places, left_out: int | None = None) -> FloatArray:
        """Coefficients (p,) of `free` columns beside `held` ones, each with its prior; zeros elsewhere."""
        used = np.concatenate([free, held]).astype(np.intp)
        x = np.zeros(self._grams.shape[2] - 1)
        if not len(used):
            return x
        grams = self._total if left_out is None else self._total - self._grams[left_out]
        gram = np.einsum("j,jpq->pq", self.weights**2, grams)
        normal = gram[np.ix_(used, used)]
        normal += np.diag(np.concatenate([self.weak[free], self.precision[held]]))
        scale = _scale(normal)
        inverse = np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-13, hermitian=True)
        x[used] = scale * (inverse @ (scale * gram[used, -1]))
        return x

    def gram(self, places: Places) -> FloatArray:
        """Weighted products of the columns at `places`, (len, len)."""
        gram: FloatArray = np.einsum("j,jpq->pq", self.weights**2, self._total)[np.ix_(places, places)]
        return gram

    def left_out_power(self, free: Places, held: Places) -> FloatArray:
        """Squared error per block and joint when the other blocks are fitted, (n_blocks, n_joints)."""
        power = []
        for k, gram in enumerate(self._grams):
            x = np.append(-self.solve(free, held, left_out=k), 1.0)
            power.append(np.einsum("p,jpq,q->j", x, gram, x))
        return np.maximum(power, 0.0)

    def left(self, x: FloatArray) -> list[FloatArray]:
        """Error that coefficients `x` leave, per run (n_rows, n_joints)."""
        return [error - columns @ x for error, columns in zip(self.error, self.columns, strict=True)]

    def covariance(self, free: Places, held: Places) -> FloatArray:
        """Covariance of the `free` coefficients beside `held` ones, honest under residuals that remember."""
        used = np.concatenate([free, held]).astype(np.intp)
        prior = np.diag(np.concatenate([self.weak[free], self.precision[held]]))
        normal = np.einsum("j,jpq->pq", self.weights**2, self._total)[np.ix_(used, used)] + prior
        scale = _scale(normal)
        bread = np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-13, hermitian=True) * np.outer(scale, scale)
        residuals, masks = [], []
        for states, left in zip(self.runs, self.left(self.solve(free, held)), strict=True):
            masks.append(_on_grid(states, states.counted.astype(np.float64)))
            residuals.append(_on_grid(states, left))
        columns = [
            [_on_grid(states, part[:, j, used]) for states, part in zip(self.runs, self.columns, strict=True)]
            for j in range(len(self.weights))
        ]
        breads = [w**2 * bread for w in self.weights]
        products = grid_noise_products(residuals, masks, columns, breads, power=2)
        meat = prior + sum(w**4 * product for w, product in zip(self.weights, products, strict=True))
        covariance: FloatArray = (bread @ meat @ bread)[: len(free), : len(free)]
        return covariance

    @cached_property
    def _total(self) -> FloatArray:
        total: FloatArray = self._grams.sum(axis=0)
        return total


def _scale(normal: FloatArray) -> FloatArray:
    """One over the columns' sizes; nothing for columns of nothing: of joints that rest, of motion that is not there."""
    diagonal = np.diag(normal)
    shown = diagonal > ROUNDING**2 * diagonal.max(initial=0.0)
    scale: FloatArray = np.where(shown, 1 / np.sqrt(np.where(shown, diagonal, 1.0)), 0.0)
    return scale


def _on_grid(states: States, rows: FloatArray) -> FloatArray:
    grid = np.zeros((len(states.grid), rows.shape[1]))
    grid[states.moving[states.grid]] = rows
    return grid
