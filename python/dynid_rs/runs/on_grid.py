"""Channels between their samples, on a uniform grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def uniform_grid(t: FloatArray, rate: float) -> FloatArray:
    """Times (m,) [s] at `rate` [Hz] within a run's times (n,): those themselves where they are uniform already."""
    uniform = t[0] + np.arange(len(t)) / rate
    if np.abs(t - uniform).max() < 1e-6 / rate:
        return t  # interpolation would only add rounding
    return np.arange(t[0], t[-1], 1 / rate)


def splined(t: FloatArray, x: FloatArray, grid: FloatArray) -> FloatArray:
    """Positions (n, n_joints) at the times of a grid, (m, n_joints), by cubic splines: they are differentiated."""
    if grid is t:
        return x
    from scipy.interpolate import CubicSpline  # late: with it comes scipy.optimize, and most runs are on the grid

    between: FloatArray = CubicSpline(t, x)(grid)
    return between


def linear(t: FloatArray, x: FloatArray, grid: FloatArray) -> FloatArray:
    """Other channels (n, n_joints) at the times of a grid, (m, n_joints), along straight lines: they may jump."""
    if grid is t:
        return x
    return np.stack([np.interp(grid, t, column) for column in x.T], axis=1)
