"""Contact: an outside force for a limited time, as bursts of residual on one or several joints.

What counts is the residual that is local in time, against the scale that the same joint's has elsewhere: near its
reversals against other reversals, and beyond what the model itself is unsure of.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.sensors.watch import Usual, Watch, watch_run
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.runs.preprocessing import States, stretches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LENGTHS = (0.3, 0.6, 1.0)
"""Bursts [s] that are looked for; longer ones are found by their parts."""
SURE, LIKELY = 6.0, 4.8
"""Standard deviations of a burst, on one joint or taken together over all: of the first, and of more beside it.

Sixty clean arms with four runs of 20 s each have none above 5.9, and two above 5.
"""
EDGE = 2.0
"""A window reaches as far as its burst stands out by this many standard deviations of the narrowest kernel."""
NEAREST = 0.25
"""Windows closer than this [s] are one."""
REVERSAL_EDGES = (0.15, 0.3, 0.5, 0.8)
"""Times from a reversal [s] between which residuals are compared with each other."""
QUANTILES, REST_QUANTILES = (0.5, 0.75, 0.9), (0.5, 0.75)
"""The scale is the greatest that these quantiles give: contact is rare, wrong models are not."""
LEAST_VALUES = 20


@dataclass(frozen=True)
class Contact:
    """One burst: `start`, `end` [s] of its run's clock, the joints that feel it, each one's peak [torque unit]."""

    run: str
    start: float
    end: float
    joints: tuple[int, ...]
    peak: tuple[float, ...]
    strength: float


def find_contacts(fit: ThreeLoopIdentifier, runs: Sequence[States]) -> list[Contact]:
    """Find bursts in runs that were prepared without any exclusion, training and test runs alike.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted without a third loop; windows that are known already may have been excluded.
    runs : sequence of States
        Channels as recorded.
    """
    usual = Usual(fit)
    watches = [watch_run(fit, states, usual) for states in runs]
    scores = [[_smooth(watch, length) for watch in watches] for length in LENGTHS]
    scales = [_scales(watches, level) for level in scores]
    z = [
        [
            np.maximum(np.abs(x.m) - x.slack, 0) / np.hypot(scale, x.unsure)
            for x, scale in zip(level, scaled, strict=True)
        ]
        for level, scaled in zip(scores, scales, strict=True)
    ]
    strengths = [np.max([_together(level[k]) for level in z], axis=0) for k in range(len(watches))]
    if max(float(strength.max()) for strength in strengths) < SURE:
        return []
    return [
        _contact(watch, [level[k] for level in z], strengths[k], rows)
        for k, watch in enumerate(watches)
        # The narrowest kernel says where a burst ends, all of them together where there is one.
        for rows in _windows(strengths[k], _together(z[0][k]), watch)
    ]


def _contact(watch: Watch, z: Sequence[FloatArray], strength: FloatArray, window: tuple[int, int]) -> Contact:
    """Put a window (half-open range of samples) in words: when, which joints, how much."""
    rows = slice(*window)
    peaks = np.max([level[rows].max(axis=0) for level in z], axis=0)
    joints = np.flatnonzero(peaks >= min(peaks.max(), max(EDGE + 1, 0.3 * peaks.max())))
    residual = watch.residual[rows]
    peak = residual[np.abs(residual).argmax(axis=0), np.arange(len(peaks))]
    return Contact(
        watch.name,
        float(watch.t[window[0]]),
        float(watch.t[window[1] - 1]),
        tuple(joints.tolist()),
        tuple(peak[joints].tolist()),
        float(strength[rows].max()),
    )


def windows_of(
    contacts: Sequence[Contact], known: Mapping[str, Sequence[tuple[float, float]]] | None = None
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Windows (start, end) [s] by run name, those of `known` joined with them."""
    result: dict[str, list[tuple[float, float]]] = {name: list(windows) for name, windows in (known or {}).items()}
    for contact in contacts:
        result.setdefault(contact.run, []).append((contact.start, contact.end))
    return {name: _joined(windows) for name, windows in result.items()}


def _joined(windows: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    joined: list[tuple[float, float]] = []
    for start, end in sorted(windows):
        if joined and start <= joined[-1][1] + NEAREST:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((start, end))
    return tuple(joined)


@dataclass(frozen=True, eq=False)
class _Level:
    """One run through a kernel of unit power; (n_grid, n_joints) each.

    Residual, what friction and the model's own doubt may be of it, and where most of the kernel saw something.
    """

    m: FloatArray
    slack: FloatArray
    unsure: FloatArray
    enough: BoolArray


def _smooth(watch: Watch, length: float) -> _Level:
    """Look at a run through a kernel of `length` [s]."""
    from scipy.ndimage import convolve1d

    kernel = np.hanning(max(1, round(length / watch.step)) + 2)[1:-1]
    if len(kernel) % 2 == 0:
        kernel = np.hanning(len(kernel) + 3)[1:-1]
    kernel /= np.linalg.norm(kernel)
    share = np.sqrt(np.maximum(convolve1d(watch.seen.astype(float), kernel**2, axis=0, mode="constant"), 1e-12))
    enough = watch.seen & (share > np.sqrt(0.5))
    # What the model does not know is wrong in the same direction all over the kernel.
    m, slack, unsure = (
        np.where(enough, convolve1d(x * watch.seen, kernel, axis=0, mode="constant") / share, 0.0)
        for x in (watch.residual, watch.slack, watch.unsure)
    )
    return _Level(m, slack, unsure, enough)


def _scales(watches: Sequence[Watch], level: Sequence[_Level]) -> list[FloatArray]:
    """Standard deviation that a joint's smoothed residual has by itself at every sample."""
    scales = [np.full(x.m.shape, np.inf) for x in level]
    n = level[0].m.shape[1]
    edges = (0.0, *REVERSAL_EDGES, np.inf)
    for j in range(n):
        for at_rest, quantiles in ((False, QUANTILES), (True, REST_QUANTILES)):
            masks = [x.enough[:, j] & (watch.resting == at_rest) for watch, x in zip(watches, level, strict=True)]
            values = [np.abs(x.m[mask, j]) for mask, x in zip(masks, level, strict=True)]
            # A run that rests is a pose of its own; runs that move are alike.
            common = 0.0 if at_rest else _scale(np.concatenate(values), quantiles)
            for scale, mask, own in zip(scales, masks, values, strict=True):
                size = max(common, _scale(own, quantiles))
                scale[mask, j] = size if size > 0 else np.inf
            if at_rest:
                continue
            for low, high in pairwise(edges):
                near = [
                    mask & (watch.since[:, j] >= low) & (watch.since[:, j] < high)
                    for mask, watch in zip(masks, watches, strict=True)
                ]
                alike = _scale(
                    np.concatenate([np.abs(x.m[mask, j]) for mask, x in zip(near, level, strict=True)]), quantiles
                )
                for scale, mask in zip(scales, near, strict=True):
                    scale[mask, j] = np.maximum(scale[mask, j], alike)
    return scales


def _scale(values: FloatArray, quantiles: Sequence[float]) -> float:
    from scipy.stats import norm

    if len(values) < LEAST_VALUES:
        return 0.0
    at = np.quantile(values, quantiles)
    return float(np.max(at / norm.ppf(0.5 + np.array(quantiles) / 2)))


def _together(z: FloatArray) -> FloatArray:
    """Standard deviations of all joints taken together, or of the one that stands out most, (n_grid,)."""
    from scipy.stats import chi2

    tail = np.clip(chi2.logsf(np.sum(z**2, axis=1), z.shape[1]), -700, None)
    # One degree of freedom with the same chance.
    result: FloatArray = np.maximum(np.sqrt(chi2.isf(np.exp(tail), 1)), z.max(axis=1))
    return result


def _windows(strength: FloatArray, near: FloatArray, watch: Watch) -> list[tuple[int, int]]:
    """Half-open ranges of samples around every burst, as far as it stands out."""
    marked = np.zeros(len(strength), dtype=bool)
    reach = max(1, round(LENGTHS[0] / 2 / watch.step))
    for peak in np.flatnonzero(strength > LIKELY):
        first = last = int(peak)
        # A dip no longer than the narrowest kernel is inside the burst.
        while first > 0 and near[max(0, first - reach) : first].max() > EDGE:
            first -= 1
        while last < len(near) - 1 and near[last + 1 : last + 1 + reach].max() > EDGE:
            last += 1
        marked[first : last + 1] = True
    gap = max(1, round(NEAREST / watch.step))
    for first, last in stretches(~marked):
        if first > 0 and last < len(marked) and last - first <= gap:
            marked[first:last] = True
    return stretches(marked)
