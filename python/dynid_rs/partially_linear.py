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

    def elsewhere(self, y: FloatArray, columns: FloatArray | None) -> FloatArray:
        """The same coefficients on other rows: `columns` (m, n_columns) -> (m,)."""
        if self._q is None or columns is None:
            return np.zeros(0 if columns is None else len(columns))
        beta = np.linalg.solve(self._r, self._q.T @ y)
        part: FloatArray = (columns[:, self._used] / self._norms) @ beta
        return part


def fit_beside(
    make: Callable[[Any], Any], u: FloatArray, e: FloatArray, linear: LinearTerms, last: Any = None, thin: int = 1
) -> Any:
    """Fit a regressor of `e` (n_rows,) on `u` (n_rows, n_inputs) beside linear terms.

    Parameters
    ----------
    make : callable
        Fresh regressor, given the last one fitted or None.
    last : estimator, optional
        To start from.
    thin : int
        Every how many rows are fitted.
    """
    g = _linear_start(u, e, linear)
    for _ in range(ROUNDS):
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


def left_out_power(
    make: Callable[[Any], Any],
    u: Sequence[FloatArray],
    e: Sequence[FloatArray],
    columns: Sequence[FloatArray | None],
    last: Any,
    thin: int,
) -> FloatArray:
    """Squares left on every block with and without g, linear terms and g fitted to the other blocks: (n_blocks, 2)."""
    power = np.zeros((len(u), 2))
    for k in range(len(u)):
        others = [i for i in range(len(u)) if i != k]
        e_others, u_others = (np.concatenate([part[i] for i in others]) for part in (e, u))
        known = [c for i in others if (c := columns[i]) is not None]
        linear = LinearTerms(np.concatenate(known) if known else None)
        g = fit_beside(make, u_others, e_others, linear, last, thin)
        without, with_g = e[k], e[k] - g.predict(u[k])
        if columns[k] is not None:
            without = without - linear.elsewhere(e_others, columns[k])
            with_g = with_g - linear.elsewhere(e_others - g.predict(u_others), columns[k])
        power[k] = np.sum(with_g**2), np.sum(without**2)
    return power
