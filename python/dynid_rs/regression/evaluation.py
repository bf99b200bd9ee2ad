"""Errors on runs, their intervals, and the floor under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

N_RESAMPLES = 400
"""Bootstrap resamples of an error's interval."""
LEAST_BLOCK = 1.0
"""Block [s] that is resampled as a whole; errors stay alike for about as long."""
LEAST_BLOCKS = 8
"""Fewer blocks have nothing to resample; a short run is cut finer."""
WELCH = 1024
"""Samples of a segment of the noise's spectrum."""
FLOOR_METHOD = (
    "wide-band noise of the torque channel inside the band, from the quietest part of its spectrum above the band; "
    "no model of the states can go below it"
)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Measured and predicted torque of one run at its rows, in the band and as recorded; (n_rows, n_joints) each."""

    states: States
    measured: FloatArray
    predicted: FloatArray
    raw_error: FloatArray

    @property
    def error(self) -> FloatArray:
        """Measured minus predicted, in the band."""
        return self.measured - self.predicted


def compare(states: States, predicted: FloatArray) -> Comparison:
    """Compare `predicted` (n, n_joints), torque at every sample, with the run's own, both through the band's filter."""
    return Comparison(
        states, states.in_band(states.tau), states.in_band(predicted), (states.tau - predicted)[states.moving]
    )


def rmse(errors: Sequence[FloatArray]) -> FloatArray:
    """Root mean square over all rows, (n_joints,)."""
    stacked = np.concatenate(list(errors))
    result: FloatArray = np.sqrt(np.mean(stacked**2, axis=0))
    return result


def torque_std(comparisons: Sequence[Comparison]) -> FloatArray:
    """Standard deviation of the measured torque, (n_joints,)."""
    result: FloatArray = np.concatenate([comparison.measured for comparison in comparisons]).std(axis=0)
    return result


def rmse_interval(comparisons: Sequence[Comparison], random_state: int = 0) -> FloatArray:
    """95 % interval of the RMSE, (n_joints, 2), by resampling blocks as long as the error's memory."""
    rng = np.random.default_rng(random_state)
    squares = []
    for comparison in comparisons:
        states = comparison.states
        length = max(1, int(LEAST_BLOCK * states.rate / states.step))
        n_blocks = min(max(LEAST_BLOCKS, len(comparison.error) // length), len(comparison.error))
        squares += [(np.sum(block**2, axis=0), len(block)) for block in np.array_split(comparison.error, n_blocks)]
    sums = np.array([total for total, _ in squares])
    counts = np.array([count for _, count in squares], dtype=float)
    draws = rng.integers(0, len(counts), (N_RESAMPLES, len(counts)))
    values = np.sqrt(sums[draws].sum(axis=1) / counts[draws].sum(axis=1)[:, None])
    interval: FloatArray = np.percentile(values, [2.5, 97.5], axis=0).T
    return interval


def noise_floor(runs: Sequence[States]) -> FloatArray:
    """Standard deviation of the torque channel's own noise inside the band, (n_joints,); NaN where it cannot be seen.

    The level is that of the quietest stretch of the spectrum above the band (vibrations stand above it); white noise of
    that level is then passed through the band. Noise that lives inside the band alone is not seen, so this is a bound
    from below.
    """
    from scipy.signal import freqz_sos, welch
    from scipy.stats import chi2

    floors = []
    for states in runs:
        frequency, density = welch(states.tau, states.rate, nperseg=min(len(states.tau), WELCH), axis=0)
        # Torques that were thinned out carry an anti-aliasing edge at 0.4 of the rate.
        high = density[(frequency > 2 * states.band.cutoff) & (frequency < 0.35 * states.rate)]
        if states.filter is None or len(high) < 4:
            continue  # no room above the band
        stretches = np.array_split(high, min(8, len(high) // 4))
        # A line's power is chi-squared distributed over the segments that were averaged: its median is below its mean.
        n_segments = max(1, (len(states.tau) - WELCH) // (WELCH // 2) + 1)
        middle = chi2.median(2 * n_segments) / (2 * n_segments)
        level = np.min([np.median(stretch, axis=0) / middle for stretch in stretches], axis=0)
        _, response = freqz_sos(states.filter[0], worN=frequency, fs=states.rate)
        passed = np.trapezoid(np.abs(response) ** 4, frequency)  # forwards and backwards
        floors.append(np.sqrt(level * passed))
    if not floors:
        return np.full(runs[0].tau.shape[1], np.nan)
    result: FloatArray = np.sqrt(np.mean(np.square(floors), axis=0))
    return result
