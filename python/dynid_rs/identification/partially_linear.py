"""Regression beside linear terms: ``e = C beta + g(u) + noise``, g any regressor (Robinson 1988, Econometrica 56).

Friction and link dynamics have been fitted before the third loop, and have taken with them what of its torque looks
like theirs. Fitted to what they leave, g is too small, and where the two are alike it finds nothing. Fitted beside
them it does not matter who was first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

RIDGE = 3e-2
"""Directions of the normalised columns that are weaker than this hardly move: the data does not tell them."""
ROUNDS = 3
"""Rounds of g and linear terms in turn, after a start in which u enters linearly."""


class LinearTerms:
    """The span of columns C (n_rows, n_columns), which other terms may move in; None or no columns: nothing moves."""

    def __init__(self, columns: FloatArray | None) -> None:
        self._q: FloatArray | None = None
        if columns is None or columns.shape[1] == 0:
            return
        norms = np.linalg.norm(columns, axis=0)
        self._used = norms > 1e-12 * norms.max(initial=0.0)
        self._norms = norms[self._used]
        n = len(self._norms)
        padded = np.concatenate([columns[:, self._used] / self._norms, RIDGE * np.eye(n)])
        q, self._r = np.linalg.qr(padded)
        self._q = q[: len(columns)]

    @property
    def present(self) -> bool:
        """Whether there are any."""
        return self._q is not None

    def fitted(self, y: FloatArray) -> FloatArray:
        """Part of `y` (n_rows,) or (n_rows, k) that the columns explain."""
        if self._q is None:
            return np.zeros_like(y)
        part: FloatArray = self._q @ (self._q.T @ y)
        return part

    def elsewhere(self, y: FloatArray, columns: FloatArray) -> FloatArray:
        """The same coefficients on other rows: `columns` (m, n_columns) -> (m,)."""
        if self._q is None:
            return np.zeros(len(columns))
        beta = np.linalg.solve(self._r, self._q.T @ y)
        part: FloatArray = (columns[:, self._used] / self._norms) @ beta
        return part


def fit_beside(
    make: Callable[[Any], Any],
    u: FloatArray,
    e: FloatArray,
    linear: LinearTerms,
    *,
    last: Any = None,
    thin: int = 1,
    rounds: int = ROUNDS,
) -> Any:
    """Fit a regressor of `e` (n_rows,) on `u` (n_rows, n_inputs) beside linear terms.

    Parameters
    ----------
    make : callable
        Fresh regressor, given the last one fitted or None.
    last : estimator, optional
        To start from: an earlier answer of `make`.
    thin : int
        Every how many rows are fitted.
    rounds : int
        Of g and linear terms in turn.
    """
    g = _linear_start(u, e, linear) if last is None else last.predict(u)
    for _ in range(rounds):
        target = e - linear.fitted(e - g)
        last = make(last).fit(u[::thin], target[::thin])
        if not linear.present:
            return last  # nothing moves with it
        g = last.predict(u)
    return last


def _linear_start(u: FloatArray, e: FloatArray, linear: LinearTerms) -> FloatArray:
    """What u explains linearly once the linear terms are taken out of both (Frisch and Waugh)."""
    spread = u.std(axis=0)
    scaled = (u - u.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    own = scaled - linear.fitted(scaled)
    slope, *_ = np.linalg.lstsq(own, e - linear.fitted(e), rcond=1e-6)
    start: FloatArray = scaled @ slope
    return start


class LeftOut:
    """Blocks left out in turn; linear terms and g are fitted to the others.

    Parameters
    ----------
    u, e : sequence of ndarray
        Inputs (n_rows, n_inputs) and what is to be explained (n_rows,), per block.
    columns : sequence of ndarray (n_rows, n_columns) or None
        Of the linear terms.
    """

    def __init__(self, u: Sequence[FloatArray], e: Sequence[FloatArray], columns: Sequence[FloatArray | None]) -> None:
        self._u, self._e, self._columns = u, e, columns
        self._linear = [
            LinearTerms(np.concatenate(known) if known else None)
            for k in range(len(u))
            for known in [[c for i, c in enumerate(columns) if i != k and c is not None]]
        ]
        self.without = np.array([np.sum(self._left(k, None) ** 2) for k in range(len(u))])
        """Squares that the linear terms by themselves leave on every block, (n_blocks,)."""

    def with_g(self, make: Callable[[Any], Any], thin: int) -> FloatArray:
        """Squares that they leave together with g, (n_blocks,). One round each: where to stop is not chosen here."""
        power = np.zeros(len(self._u))
        for k, linear in enumerate(self._linear):
            u, e = _others(self._u, k), _others(self._e, k)
            power[k] = np.sum(self._left(k, fit_beside(make, u, e, linear, thin=thin, rounds=1)) ** 2)
        return power

    def _left(self, k: int, g: Any) -> FloatArray:
        left, others = self._e[k], _others(self._e, k)
        if g is not None:
            left, others = left - g.predict(self._u[k]), others - g.predict(_others(self._u, k))
        columns = self._columns[k]
        return left if columns is None else left - self._linear[k].elsewhere(others, columns)


def _others(parts: Sequence[FloatArray], k: int) -> FloatArray:
    return np.concatenate([part for i, part in enumerate(parts) if i != k])
