"""Kinematic error of a gear: sharp lines of the deflection in the angle domain, at any number of cycles per turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.signals import GearSignals

FloatArray = NDArray[np.float64]

LOWEST, HIGHEST = 5.0, 1000.0
"""Cycles per turn: slower ones are not told from load and eccentricity, faster ones not sampled by any run."""
PER_RESOLUTION = 4
"""Orders tried within the resolution that the travelled angle gives."""
NEIGHBOURS = 12
"""Resolutions whose median is the level that a line stands above."""
MOST = 3
"""Lines of one gear at most."""
BESIDE, WEAK = 5.0, 0.1
"""A line within so many cycles of a stronger one, and below this part of it, is the other one's foot."""


def find_orders(runs: Sequence[GearSignals], left: Sequence[FloatArray]) -> tuple[float, ...]:
    """Return the orders of lines that stand out of what all other terms leave, (n,) per run; strongest first.

    These are proposals: one in two comes from noise alone, and the choice of terms counts how many orders were tried.
    """
    angle = [run.q_motor[run.used] for run in runs]
    values = np.concatenate([e[run.used] for e, run in zip(left, runs, strict=True)])
    angles = np.concatenate(angle)
    found: list[tuple[float, float]] = []
    for _ in range(MOST):
        cycles, power = angle_spectrum(angles, values)
        if len(cycles) < 2 * NEIGHBOURS * PER_RESOLUTION:
            break
        stands = power / _level(power)
        at = int(np.argmax(stands))
        # A line of noise is exponentially distributed about its mean: the greatest of many is about their logarithm.
        if stands[at] < np.log(len(cycles) / PER_RESOLUTION):
            break
        order = _refined(angles, values, float(cycles[at]), float(cycles[1] - cycles[0]))
        wave = _wave(angles, order)
        x = np.linalg.lstsq(wave, values, rcond=None)[0]
        values = values - wave @ x
        size = float(np.hypot(*x))
        if any(abs(order - other) < BESIDE and size < WEAK * strong for other, strong in found):
            continue  # what a strong line leaves beside it
        found.append((order, size))
    return tuple(order for order, _ in found)


def angle_spectrum(angles: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Power of `values` (n,) over cycles per turn of `angles` (n,): cycles, power, (n_orders,) each.

    Samples are put into bins of the angle, much finer than the highest order, so that one transform does for all.
    """
    low, reach = float(angles.min()), float(np.ptp(angles))
    if not reach > 0:
        return np.zeros(0), np.zeros(0)
    width = 2 * np.pi / (16 * HIGHEST)
    sums = np.bincount(((angles - low) / width).astype(int), weights=values)
    size = PER_RESOLUTION * len(sums)
    power = np.asarray(np.abs(np.fft.rfft(sums, size)) ** 2, dtype=np.float64)
    cycles = np.arange(len(power)) * (2 * np.pi / (size * width))
    inside = (cycles >= LOWEST) & (cycles <= HIGHEST)
    return np.asarray(cycles[inside], dtype=np.float64), power[inside]


def _wave(angles: FloatArray, order: float) -> FloatArray:
    return np.stack([np.cos(order * angles), np.sin(order * angles)], axis=1)


def _refined(angles: FloatArray, values: FloatArray, order: float, step: float) -> float:
    from scipy.optimize import minimize_scalar

    def gain(cycles: float) -> float:
        wave = _wave(angles, cycles)
        along = wave.T @ values
        return -float(along @ np.linalg.solve(wave.T @ wave, along))

    found = minimize_scalar(gain, bounds=(order - 2 * step, order + 2 * step), method="bounded")
    return float(found.x)


def _level(power: FloatArray) -> FloatArray:
    """Mean power of noise around every order, from the median of its neighbours."""
    from scipy.ndimage import median_filter

    median = median_filter(power, 2 * NEIGHBOURS * PER_RESOLUTION + 1, mode="nearest")
    return np.asarray(np.maximum(median / np.log(2), 1e-300))
