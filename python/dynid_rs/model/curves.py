"""A torque as a curve over the signal that makes it: points, their means in bins and what the model says there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.units import angle_units
from dynid_rs.regression.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

N_POINTS, N_BINS = 400, 60
"""Most points of a plot, and points of a fitted curve."""
LEAST_PER_BIN = 5
"""Rows without which a bin's mean says nothing; fewer rows make fewer bins."""
N_ANGLES = 16
"""Points of a curve over an angle: in finer ones other joints' angles, which count too, do not average out."""


def binned(
    x: FloatArray,
    partial: FloatArray,
    columns: FloatArray,
    coefficients: FloatArray,
    covariance: FloatArray,
    most: int = N_BINS,
) -> dict[str, list[float]]:
    """Some of the points, and in bins of equally many, `most` at most, their mean, the curve's and its 95 % interval.

    `x`, `partial` (n,), `columns` (n, k), `coefficients` (k,) with `covariance` (k, k).
    """
    order = np.argsort(x, kind="stable")
    n_bins = min(most, max(1, len(order) // LEAST_PER_BIN))
    bins = [b for b in np.array_split(order, n_bins) if len(b)]
    thin = order[:: max(1, len(order) // N_POINTS)]
    mean = np.array([columns[b].mean(axis=0) for b in bins]).reshape(len(bins), len(coefficients))
    curve = mean @ coefficients
    half = NORMAL_95 * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", mean, covariance, mean), 0.0))
    return {
        "x": x[thin].tolist(),
        "partial": partial[thin].tolist(),
        "curve_x": [float(x[b].mean()) for b in bins],
        "mean": [float(partial[b].mean()) for b in bins],
        "curve": curve.tolist(),
        "curve_low": (curve - half).tolist(),
        "curve_high": (curve + half).tolist(),
    }


def over_angle(
    robot: _core.RobotModel, j: int, angle: FloatArray, brought: FloatArray, left: FloatArray, relative: float
) -> dict[str, Any]:
    """Plot of what a change brings to joint `j`.

    `angle` [rad, m], torque `brought` by it and `left` beside it, (n,) each; `relative`: standard deviation of its size
    over its size.
    """
    name = robot.joint_names[j]
    return {
        "signal": f"q_{name}",
        "unit": angle_units(robot.joint_kinds)[j],
        "quantity": "torque",
        "joint": name,
        **binned(angle, brought + left, brought[:, None], np.ones(1), np.array([[relative**2]]), N_ANGLES),
    }
