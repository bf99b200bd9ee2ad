"""What no model of the signals can remove from a joint's residual, and whether anything above it is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.leftovers import NOTABLE, Leftovers, search_leftovers
from dynid_rs.diagnosis.repeats import Repeat, find_repeats, overlap
from dynid_rs.diagnosis.rows_beside import spread_of_sum
from dynid_rs.evaluation import N_RESAMPLES
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

STRETCH = 1.0
"""Residuals are resampled in stretches of this length [s]."""
SIGNIFICANT = 0.01
"""Chance at which a residual at its floor is taken for one above it, over all joints."""


@dataclass(frozen=True, eq=False)
class Floor:
    """Smallest residual that a model can leave in the band.

    Parameters
    ----------
    value : ndarray (n_joints,)
        [torque unit], root mean square.
    interval : ndarray (n_joints, 2)
        95 %.
    method : tuple of str
        How it was measured, per joint: ``"repetition"``; ``"left_out"``, by what any one or two signals predict of
        rows left out; ``"noise"``, where the residual is no more than the torque channel's wide-band noise.
    p_value : ndarray (n_joints,)
        Chance of so large a residual, or of one that others of its own kind predict so well, if it were at its floor.
    """

    value: FloatArray
    interval: FloatArray
    method: tuple[str, ...]
    p_value: FloatArray


def floor(
    fit: ThreeLoopIdentifier,
    runs: Sequence[States],
    residuals: Sequence[FloatArray],
    leftovers: Leftovers | None = None,
) -> Floor:
    """Measure the floor of every joint.

    Where motion repeats, it is the deviation between repetitions: whatever depends on the motion cancels, and what the
    motion did not repeat exactly is taken off by the model, since residuals are compared and not torques. Otherwise
    it lies between the torque channel's wide-band noise and what a flexible function of the signals, fitted to other
    runs, leaves: the value is the latter, so it is rather too high, and the interval reaches down to the former.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        The fitted model.
    runs : sequence of States
        Runs that it was fitted to.
    residuals : sequence of ndarray (n_rows, n_joints)
        Measured less predicted in the band, at the rows of each run [torque unit].
    leftovers : Leftovers, optional
        Of the fit, where it was searched already.
    """
    repeats = find_repeats(runs)
    if repeats:
        return _from_repeats(runs, residuals, repeats)
    return _from_search(residuals, leftovers or search_leftovers(fit))


def nothing_left(found: Floor) -> NDArray[np.bool_]:
    """Whether each joint's residual is at its floor, (n_joints,); wrongly denied in `SIGNIFICANT` of all robots."""
    return np.asarray(found.p_value * len(found.p_value) > SIGNIFICANT)


def _from_repeats(runs: Sequence[States], residuals: Sequence[FloatArray], repeats: Sequence[Repeat]) -> Floor:
    from scipy.stats import norm

    everywhere = [_at_all_samples(states, e) for states, e in zip(runs, residuals, strict=True)]
    sums, counts = [], []
    for repeat in repeats:
        one, other = runs[repeat.first], runs[repeat.second]
        e, again = overlap(one, other, repeat.shift, everywhere[repeat.first], everywhere[repeat.second])
        # Both parts carry noise of their own.
        squares = (again - e) ** 2 / 2
        for part in np.array_split(squares, max(1, int(len(squares) / (STRETCH * one.rate)))):
            sums.append(part.sum(axis=0))
            counts.append(len(part))
    value, interval = _resampled(np.array(sums), np.array(counts, dtype=float))
    whole = [_stretches(states, e**2) for states, e in zip(runs, residuals, strict=True)]
    left = _spread(*(np.concatenate(part) for part in zip(*whole, strict=True)))
    beneath = _spread(np.array(sums), np.array(counts, dtype=float))
    # A ratio of powers, in their logarithm, against the least that is worth a word.
    excess = np.log(left[0] / np.maximum(NOTABLE**2 * beneath[0], 1e-300))
    p_value = norm.sf(excess / np.hypot(left[1] / left[0], beneath[1] / np.maximum(beneath[0], 1e-300)))
    return Floor(value, interval, ("repetition",) * len(value), np.asarray(p_value))


def _from_search(residuals: Sequence[FloatArray], leftovers: Leftovers) -> Floor:
    rms = np.sqrt(np.mean(np.concatenate(residuals) ** 2, axis=0))
    noise = np.minimum(np.where(np.isfinite(leftovers.noise), leftovers.noise, 0.0), rms)
    value, interval = noise.copy(), np.column_stack([noise, rms])
    method, p_value = ["noise"] * len(rms), np.ones(len(rms))
    for j, leftover in leftovers.joints.items():
        method[j] = "left_out"
        best = leftover.found.scores[0]
        if leftover.p_value * len(rms) > SIGNIFICANT:
            value[j] = rms[j]  # nothing was seen to predict any of it
            continue
        # The rows left out count for less where the declared model is unsure, so parts are compared, not squares.
        part = float(best.power[0] / leftover.found.without)
        error = spread_of_sum(best.squares, leftover.rows.block) / max(float(best.squares.sum()), 1e-300)
        value[j] = np.clip(np.sqrt(part) * rms[j], noise[j], rms[j])
        interval[j] = noise[j], np.clip(value[j] * np.sqrt(1 + 1.96 * error), value[j], rms[j])
        p_value[j] = leftover.p_value
    return Floor(value, interval, tuple(method), p_value)


def _at_all_samples(states: States, residual: FloatArray) -> FloatArray:
    """Residual (n, n_joints) between its rows: the band lies well below what they can hold."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(states.t[states.rows], residual)(states.t))


def _stretches(states: States, squares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sums (n_stretches, n_joints) and counts (n_stretches,) of `squares` (n_rows, n_joints)."""
    n = max(1, int(len(squares) * states.step / states.rate / STRETCH))
    parts = np.array_split(squares, n)
    return np.array([part.sum(axis=0) for part in parts]), np.array([float(len(part)) for part in parts])


def _spread(sums: FloatArray, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean over stretches and its standard error, (n_joints,) each."""
    mean = sums.sum(axis=0) / counts.sum()
    return mean, np.sqrt(np.sum((sums - counts[:, None] * mean) ** 2, axis=0)) / counts.sum()


def _resampled(sums: FloatArray, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Root mean square (n_joints,) and its 95 % interval (n_joints, 2) from stretches."""
    rng = np.random.default_rng(0)
    draws = rng.integers(0, len(counts), (N_RESAMPLES, len(counts)))
    values = np.sqrt(sums[draws].sum(axis=1) / counts[draws].sum(axis=1)[:, None])
    interval: FloatArray = np.percentile(values, [2.5, 97.5], axis=0).T
    return np.sqrt(sums.sum(axis=0) / counts.sum()), interval
