"""Errors on runs, and the floor under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.low_pass import gain_at, power_density
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

WELCH = 1024
"""Samples of a segment of the noise's spectrum."""
INTERPOLATED = 1.5
"""A torque on a grid that is finer than this times its samples has straight lines between them."""
FLOOR_METHOD = (
    "wide-band noise of the torque channel inside the band, from the quietest part of its spectrum above the band; "
    "an estimate, which no model of the states can go below but by chance"
)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Measured and predicted torque of one run at its rows, in the band and as recorded; (n_rows, n_joints) each.

    Joints that rest while others move are in them too; `states.counted` says what is scored.
    """

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


def rmse(errors: Sequence[FloatArray], counted: Sequence[NDArray[np.bool_]] | None = None) -> FloatArray:
    """Root mean square over all rows, or over those that are `counted` (n_rows, n_joints) per run; (n_joints,)."""
    stacked = np.concatenate(list(errors))
    where = True if counted is None else np.concatenate(list(counted))
    # A joint that rests all the time has no error.
    mean = np.sum(stacked**2, axis=0, where=where) / np.maximum(np.sum(np.ones_like(stacked), axis=0, where=where), 1)
    result: FloatArray = np.sqrt(mean)
    return result


def band_rmse(comparisons: Sequence[Comparison]) -> FloatArray:
    """Root mean square of the error in the band where joints move, (n_joints,)."""
    return rmse([c.error for c in comparisons], [c.states.counted for c in comparisons])


def raw_rmse(comparisons: Sequence[Comparison]) -> FloatArray:
    """The same of the torque as recorded."""
    return rmse([c.raw_error for c in comparisons], [~c.states.resting[c.states.moving] for c in comparisons])


def torque_std(comparisons: Sequence[Comparison]) -> FloatArray:
    """Standard deviation of the measured torque where it is scored, (n_joints,)."""
    return _deviation([c.measured for c in comparisons], comparisons)


def share_left(comparisons: Sequence[Comparison]) -> FloatArray:
    """What the model leaves of the torque, (n_joints,): the larger of the shares with and without what is constant.

    The weight of a load that a sliding joint lifts is constant: large beside how much the torque varies, and small
    beside the torque. 0 for a joint without torque.
    """
    counted = [c.states.counted for c in comparisons]
    errors, measured = [c.error for c in comparisons], [c.measured for c in comparisons]
    left = np.array([rmse(errors, counted), _deviation(errors, comparisons)])
    size = np.array([rmse(measured, counted), _deviation(measured, comparisons)])
    result: FloatArray = np.max(np.divide(left, size, out=np.zeros_like(left), where=size > 0), axis=0)
    return result


def _deviation(parts: Sequence[FloatArray], comparisons: Sequence[Comparison]) -> FloatArray:
    """Standard deviation where it is scored, (n_joints,)."""
    values = np.concatenate(list(parts))
    counted = np.concatenate([c.states.counted for c in comparisons])
    n = np.maximum(counted.sum(axis=0), 1)
    mean = np.sum(values, axis=0, where=counted) / n
    result: FloatArray = np.sqrt(np.sum((values - mean) ** 2, axis=0, where=counted) / n)
    return result


def noise_floor(runs: Sequence[States]) -> FloatArray:
    """Standard deviation of the torque channel's own noise inside the band, (n_joints,); NaN where it cannot be seen.

    Of the same samples as the error that stands above it: every run counts by the rows on which it is scored, and one
    run whose noise cannot be seen leaves none.

    The level is that of the quietest stretch of the spectrum above the band (vibrations stand above it); white noise of
    that level is then passed through the band. Noise that lives inside the band alone is not seen, so this is a bound
    from below.
    """
    from scipy.special import chdtri

    power, weight = np.zeros(runs[0].tau.shape[1]), np.zeros(runs[0].tau.shape[1])
    for states in runs:
        frequency, density = power_density(states.tau, states.rate, min(len(states.tau), WELCH))
        # Torques that were thinned out carry an anti-aliasing edge at 0.4 of the rate.
        known = 0.35 * min(states.rate, states.recorded_rate)
        above = (frequency > 2 * states.band.cutoff) & (frequency < known)
        high = density[above]
        if states.rate > INTERPOLATED * states.recorded_rate:
            high = high / np.sinc(frequency[above] / states.recorded_rate)[:, None] ** 4  # what straight lines leave
        if states.filter is None or len(high) < 4:
            return np.full_like(power, np.nan)  # no room above the band
        stretches = np.array_split(high, min(8, len(high) // 4))
        # A line's power is chi-squared distributed over the segments that were averaged: its median is below its mean.
        n_segments = max(1, (len(states.tau) - WELCH) // (WELCH // 2) + 1)
        middle = chdtri(2 * n_segments, 0.5) / (2 * n_segments)
        level = np.min([np.median(stretch, axis=0) / middle for stretch in stretches], axis=0)
        gain = gain_at(states.filter[0], frequency / states.rate)
        passed = np.trapezoid(gain**4, frequency)  # forwards and backwards
        scored = states.counted.sum(axis=0)
        power, weight = power + scored * level * passed, weight + scored
    result: FloatArray = np.sqrt(np.divide(power, weight, out=np.full_like(power, np.nan), where=weight > 0))
    return result


def r2(comparisons: Sequence[Comparison]) -> FloatArray:
    """Coefficient of determination in the band where joints move, (n_joints,): ``1 - (rmse / torque_std)^2``.

    As scikit-learn's `r2_score`: of a torque that never changes 0, or 1 where nothing is left of it.
    """
    return _determination(band_rmse(comparisons) ** 2, torque_std(comparisons) ** 2)


def r2_as_recorded(measured: Sequence[FloatArray], predicted: Sequence[FloatArray]) -> FloatArray:
    """The same of every sample as it was recorded, noise, standstill and all, (n_joints,)."""
    tau, error = np.concatenate(list(measured)), np.concatenate(list(measured)) - np.concatenate(list(predicted))
    return _determination(np.mean(error**2, axis=0), np.var(tau, axis=0))


def _determination(left: FloatArray, variance: FloatArray) -> FloatArray:
    explained: FloatArray = 1 - np.divide(left, variance, out=np.ones_like(left), where=variance > 0)
    return np.where((variance <= 0) & (left <= 0), 1.0, explained)
