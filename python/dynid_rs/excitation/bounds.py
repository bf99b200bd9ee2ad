"""Bounds on the real, sampled motion: smooth for the search, exact for the answer.

Eq. 17 bounds a motion by the sum of its amplitudes, which is sufficient and wasteful. Here the greatest share of a
limit over a grid of times is bounded by its p-norm, which is smooth in the coefficients; the motion is scaled exactly
afterwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.excitation.limits import ExcitationLimits, share
from dynid_rs.excitation.series import FourierSeries

FloatArray = NDArray[np.float64]

POWER = 40
"""Of the norm that stands for the maximum."""
GRID = 24
"""Grid points of the smooth bounds per period of the highest harmonic."""
STEP = 1e-3
"""Grid of the exact bounds [s]."""

_WAVE = np.abs(np.sin(np.linspace(0.0, np.pi, 1000, endpoint=False)))
_SINE = float(np.mean(_WAVE**POWER) ** (1 / POWER))
"""p-norm of a sine, which is made to count as its maximum."""


def smooth_peak(shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Smooth maximum over the first axis of non-negative `shares` (m, n): (n,), and its slope in each entry (m, n)."""
    largest = np.maximum(shares.max(axis=0), 1e-300)
    relative = shares / largest
    lower = _lower_power(relative)
    mean = (lower * relative).sum(axis=0) / len(shares)
    peak = largest * mean ** (1 / POWER) / _SINE
    slope = lower * mean ** (1 / POWER - 1) / (_SINE * len(shares))
    return peak, slope


def _lower_power(x: FloatArray) -> FloatArray:
    """`x ** (POWER - 1)` by squares and products: a general power takes ten times as long."""
    power, square, left = None, x, POWER - 1
    while True:
        if left % 2:
            power = square if power is None else power * square
        left //= 2
        if not left:
            assert power is not None
            return power
        square = square * square


class MotionBounds:
    """Position, velocity and acceleration of every joint inside its limits (the inequalities of Eq. 16).

    Parameters
    ----------
    series : FourierSeries
        The motions that are searched.
    limits : ExcitationLimits
        What every joint may do.
    start : ndarray (n_joints,)
        Where the motion starts; strictly inside the limits.
    """

    def __init__(self, series: FourierSeries, limits: ExcitationLimits, start: FloatArray) -> None:
        self.limits = (limits.position - start, limits.velocity, limits.acceleration)
        grid = np.linspace(0.0, series.duration, GRID * series.n_harmonics, endpoint=False)
        self._grid = np.stack(series.matrices(grid))
        self._across = np.ascontiguousarray(np.concatenate(self._grid).T)
        # Row by row: the motions of the first joint, of the next one, ...
        self._per_limit = [1 / np.ravel([limit[side] for limit in self.limits], order="F")[:, None] for side in (0, 1)]
        fine = series.grid(STEP)
        self._fine = [np.ascontiguousarray(matrix.T) for matrix in series.matrices(fine)]
        # Between two samples a trigonometric polynomial of top frequency w rises by at most (w h)^2 / 8 of its maximum.
        self._between = (series.top_frequency * (fine[1] - fine[0])) ** 2 / 8

    def values(self, x: FloatArray) -> FloatArray:
        """Room that is left, 1 - smooth share, (3 n_joints,); negative where a bound is violated."""
        peaks, _ = smooth_peak(self._shares(self._signals(x)).T)
        return np.asarray(1 - peaks.reshape(-1, 3).T.ravel())

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Slope of `values` in `x` (n_free, n_joints): (3 n_joints, n_free, n_joints)."""
        n_free, n_joints = x.shape
        signals = self._signals(x)
        _, slope = smooth_peak(self._shares(signals).T)
        lower, upper = self._per_limit
        slope = (slope.T * np.where(signals > 0, upper, lower)).reshape(n_joints, 3, -1)
        slopes = np.zeros((3, n_joints, n_free, n_joints))
        every = np.arange(n_joints)
        # The joints come first: those are the axes that the two lists of numbers pick together.
        slopes[:, every, :, every] = -(slope.swapaxes(0, 1) @ self._grid).swapaxes(0, 1)
        return slopes.reshape(3 * n_joints, n_free, n_joints)

    def _signals(self, x: FloatArray) -> FloatArray:
        """Motions on the grid of the search, side by side (3 n_joints, n_grid)."""
        return np.asarray((x.T @ self._across).reshape(3 * x.shape[1], -1))

    def _shares(self, signals: FloatArray) -> FloatArray:
        """`share` of `_signals`, by products: the limits are the same in every step."""
        lower, upper = self._per_limit
        return np.maximum(signals * upper, signals * lower)

    def usage(self, x: FloatArray) -> FloatArray:
        """Greatest share of each limit, (3, n_joints): exact on a 1 ms grid, and an upper bound between its samples."""
        peaks = []
        for across, limit in zip(self._fine, self.limits, strict=True):
            signal = x.T @ across
            extremes = np.stack([signal.min(axis=1), signal.max(axis=1)])
            between = self._between * np.abs(extremes).max(axis=0) / np.abs(limit).min(axis=0)
            peaks.append(share(extremes, limit).max(axis=0) + between)
        return np.array(peaks)

    def roughly_scaled(self, x: FloatArray) -> FloatArray:
        """As `scaled`, on the grid of the search: quick, and exact to a percent."""
        peaks = self._shares(self._signals(x)).max(axis=1).reshape(-1, 3)
        return np.asarray(x / np.maximum(peaks.max(axis=1), 1e-300))

    def scaled(self, x: FloatArray) -> FloatArray:
        """`x` with every joint's motion scaled about its start until it touches one of its limits."""
        # A hair less: the trajectory is evaluated by another order of operations.
        return np.asarray(x * (1 - 1e-9) / np.maximum(self.usage(x).max(axis=0), 1e-300))
