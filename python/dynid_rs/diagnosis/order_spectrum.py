"""Power of a whitened residual at every order: cycles per turn of the joint, whole or not.

A torque ``a cos(N q) + b sin(N q)`` is looked for with the angle that was sampled with the torque (a least-squares
spectrum, Lomb 1976, against angle in place of time). Nothing has to be uniform in angle, and an order whose frequency
``N |dq| / 2 pi`` exceeds half the rate still has one pattern of its own as long as the speed changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.angle_data import AngleRun
from dynid_rs.diagnosis.whitening import Whitener

FloatArray = NDArray[np.float64]

OVERSAMPLING = 4
"""Orders per resolution cell ``2 pi / range of q``."""
CELLS_PER_CYCLE = 16
"""Cells of the angle grid per cycle of the greatest order."""
BACKGROUND = 30
"""The noise's level at an order is the median over so many resolution cells on both sides."""
MOST_ORDER = 1000.0
LEAST_CYCLES = 1.5
"""Fewer cycles within the range of q look like gravity."""
LEAST_ORDER = 3.5
"""Lower orders are tested in the band, beside gravity."""
N_SPEEDS = 24
"""Classes of speed for which a filter's gain is computed,"""
N_GAINS = 200
"""at so many orders; between them it is interpolated."""
ALIKE = 0.5
"""Two orders whose samples correlate by more than this are aliases of each other."""
SLOW = 0.25
"""The sampling limit is reached where the joint, at this quantile of its speeds, has two samples per cycle."""


@dataclass(frozen=True)
class OrderGrid:
    """Orders ``step * (first, first + 1, ..., last)``."""

    step: float
    first: int
    last: int

    @property
    def orders(self) -> FloatArray:
        """(n_orders,) cycles per turn."""
        orders: FloatArray = self.step * np.arange(self.first, self.last + 1, dtype=np.float64)
        return orders


def order_grid(runs: Sequence[AngleRun]) -> OrderGrid:
    """Orders that the runs can hold, a quarter of a resolution cell apart."""
    span = max(run.span for run in runs)
    speeds = np.concatenate([np.abs(run.speed[run.used]) for run in runs])
    rate = float(np.median([run.rate for run in runs]))
    greatest = min(MOST_ORDER, np.pi * rate / float(np.quantile(speeds, SLOW)))
    least = max(LEAST_ORDER, 2 * np.pi * LEAST_CYCLES / span)
    step = 2 * np.pi / span / OVERSAMPLING
    first = int(np.ceil(least / step))
    return OrderGrid(step, first, max(first + 1, int(greatest / step)))


def amplitudes(angle: FloatArray, values: FloatArray, grid: OrderGrid) -> NDArray[np.complex128]:
    """``sum values * (cos + i sin)(N angle)`` at every order of the grid (n_orders,), by one transform.

    Values are spread over the two nearest cells of a grid of angles, so that an order costs no pass over the data.
    """
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(CELLS_PER_CYCLE * grid.last, real=True)
    cell = 2 * np.pi / (grid.step * size)
    place = angle / cell
    left = np.floor(place)
    share = place - left
    at = left.astype(np.int64)
    cells = np.bincount(at % size, values * (1 - share), size) + np.bincount((at + 1) % size, values * share, size)
    found = np.conj(rfft(cells))[grid.first : grid.last + 1]
    spread: FloatArray = np.sinc(grid.orders * cell / (2 * np.pi)) ** 2
    return np.asarray(found / spread, dtype=np.complex128)


def power(
    runs: Sequence[AngleRun],
    whitener: Whitener,
    white: Sequence[FloatArray],
    masks: Sequence[FloatArray],
    grid: OrderGrid,
) -> FloatArray:
    """Power that a sine of each order takes off, (n_orders,), over what noise gives in each of two coefficients.

    Parameters
    ----------
    white : sequence of ndarray (n,)
        Whitened residual of every run, the declared model's columns taken out.
    masks : sequence of ndarray (n,)
        One where samples share the phase that is fitted, zero elsewhere.
    """
    z = np.zeros(grid.last - grid.first + 1, dtype=np.complex128)
    gain = np.zeros(len(z))
    orders = grid.orders
    some = np.linspace(0, len(orders) - 1, min(len(orders), N_GAINS)).astype(int)
    for k, run in enumerate(runs):
        part = masks[k]
        if not part.any():
            continue
        z += amplitudes(run.angle, whitener.adjoint(part * white[k], k), grid)
        weight = (whitener.weights[k] * part) ** 2
        speed = np.abs(run.speed) / run.rate
        count, edges = np.histogram(speed, N_SPEEDS, weights=weight)
        middle = (edges[:-1] + edges[1:]) / 2
        at_some = whitener.power(orders[some][:, None] * middle) @ count / 2
        gain += np.interp(orders, orders[some], at_some)
    return np.abs(z) ** 2 / np.maximum(gain, 1e-300)


def over_background(spectrum: FloatArray) -> FloatArray:
    """Spectrum over the level around it: two degrees of freedom have the median 2 log 2."""
    from scipy.ndimage import median_filter

    size = min(2 * BACKGROUND * OVERSAMPLING + 1, len(spectrum))
    level = median_filter(spectrum, size, mode="nearest") / (2 * np.log(2))
    relative: FloatArray = spectrum / np.maximum(level, 1.0)
    return relative


def alias_distance(runs: Sequence[AngleRun], whitener: Whitener) -> float | None:
    """Distance of two orders that the samples can hardly tell apart; None if the speed changes enough.

    At a constant speed v the samples lie ``v / rate`` apart in angle, and orders ``2 pi rate / v`` apart are one.
    """
    span = max(run.span for run in runs)
    step = 2 * np.pi / span / OVERSAMPLING
    grid = OrderGrid(step, 2 * OVERSAMPLING, int(2 * MOST_ORDER / step))
    weights = [weight**2 for weight in whitener.weights]
    window = np.abs(sum(amplitudes(run.angle, weight, grid) for run, weight in zip(runs, weights, strict=True)))
    at = int(np.argmax(window))
    return float(grid.orders[at]) if window[at] > ALIKE * sum(weight.sum() for weight in weights) else None
