"""What healthy runs say of the observer: its variance from state to state, and how often it is passed by how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MOVING, STANDING, TURNING = range(3)
"""What a joint does, as the observer says it."""
STEPS = 100
"""Steps of the fit; after the first 30 the likelihood changes by less than 1e-4 of itself on the exam's arms."""
LEAST_SAMPLES = 100
"""Fewer independent samples of a joint that does something tell no variance."""
LEAST_VARIANCE = 1e-6
"""Of the mean square: no state is known better, so that a joint without noise has a threshold too."""
LEAST_SQUARE = 1e-100
"""Mean square of a joint that shows nothing at all: its floor's square is still a number [torque unit^2]."""
LEAST_STOPS = 20
"""A joint that has stopped, or turned, so often has shown what static friction it holds: after 20 the next one is the
largest with a chance of one in 21, and the tail's level goes beyond the largest."""
BLOCK = 1.0
"""Greatest deviations of so many seconds count as one [s]: many times what the observer and the noise remember."""
PASSED = 0.2
"""Share of the blocks that the tail is found from."""
LEAST_PEAKS = 20
"""Fewer peaks tell no tail: its growth would not be known within a quarter."""
SURE = 1.2815515655446004
"""The growth counts as one-sided 90 % larger than the mean says: a promise is to be kept."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What the observer saw on one healthy run, (n_samples, n_joints) each, and `step` [s] between samples."""

    external: FloatArray
    doing: FloatArray
    torque: FloatArray
    step: float


def fit_variances(runs: Sequence[Seen], every: float, names: str) -> dict[str, Any]:
    """Variance of the observer on each joint: of what it does, and per square of its torque, most likely on these runs.

    ``r_j ~ N(0, w_doing + w_torque tau_j^2)``. The weights are positive; each step multiplies one by the root of what
    the data say over what it says, and never makes the runs less likely (Fevotte, Bertin and Durrieu, Neural
    Computation 21, 2009, for the same divergence). What the parameters are off by on these runs is in it.

    Parameters
    ----------
    every : float
        Samples are taken so far apart [s]: the observer's time constant, over which it says the same.
    names : str
        How messages call the runs.

    Raises
    ------
    ValueError
        No joint moves long enough.
    """
    parts = [_thinned(run, every) for run in runs]
    square, doing, torque = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    n = square.shape[1]
    found = {name: np.zeros(n) for name in ("moving", "standing", "turning", "torque")}
    stops_known, turns_known = [], []
    for j in range(n):
        mean = max(float(np.mean(square[:, j])), LEAST_SQUARE)
        shape = np.stack([doing[:, j] == k for k in (MOVING, STANDING, TURNING)], axis=1).astype(float)
        counts = shape.sum(axis=0)
        columns = np.column_stack([shape, torque[:, j] ** 2])
        weights = np.append(np.full(3, 0.5 * mean), 0.5 * mean / max(float(np.mean(torque[:, j] ** 2)), 1e-300))
        floor = LEAST_VARIANCE * mean
        for _ in range(STEPS):
            variance = np.maximum(columns @ weights, floor)
            says = columns.T @ (1 / variance)
            data = columns.T @ (square[:, j] / variance**2)
            weights = weights * np.sqrt(data / np.maximum(says, 1e-300))
        usual = np.maximum(weights[:3], floor)
        told = counts >= LEAST_SAMPLES
        # What no run has shown is taken for the worst that they have.
        usual[~told] = usual[told].max() if told.any() else mean
        found["moving"][j], found["standing"][j], found["turning"][j] = usual
        found["torque"][j] = weights[3]
        stops_known.append(bool(told[STANDING] and _begun(runs, j, STANDING) >= LEAST_STOPS))
        turns_known.append(bool(told[TURNING] and _begun(runs, j, TURNING) >= LEAST_STOPS))
    if not np.any([np.count_nonzero(doing[:, j] == MOVING) >= LEAST_SAMPLES for j in range(n)]):
        raise ValueError(
            f"{names}: no joint moves long enough to tell what the model leaves; name runs in which the arm works"
        )
    said = {name: values.tolist() for name, values in found.items()}
    return said | {"stops_known": stops_known, "turns_known": turns_known}


def fit_tails(deviations: Sequence[FloatArray], step: float) -> dict[str, list[float]] | None:
    """How often a joint passes a multiple of its deviation: level and growth of its square, and how often per hour.

    Peaks over a threshold: of blocks of a second the greatest squares that lie beyond the level that a fifth of them
    passes do so by an exponential, as those of a normal process (Davison and Smith, 1990). None where the runs are too
    short.

    Parameters
    ----------
    deviations : per run (n_samples, n_joints)
        |r| / s of every joint.
    """
    size = max(1, round(BLOCK / step))
    n = deviations[0].shape[1]
    blocks = [run[: len(run) // size * size].reshape(-1, size, n).max(axis=1) ** 2 for run in deviations]
    peaks = np.concatenate(blocks)
    if len(peaks) * PASSED < LEAST_PEAKS:
        return None
    hours = len(peaks) * size * step / 3600
    found: dict[str, list[float]] = {"level": [], "per_hour": [], "growth": []}
    for own in peaks.T:
        level = float(np.quantile(own, 1 - PASSED))
        beyond = own[own > level] - level
        # A joint that has no noise passes nothing.
        mean = float(np.mean(beyond)) if len(beyond) else 1.0
        found["level"].append(level)
        found["per_hour"].append(max(len(beyond), 1) / hours)
        found["growth"].append(mean * (1 + SURE / np.sqrt(max(len(beyond), 1))))
    return found


def _thinned(run: Seen, every: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    kept = slice(None, None, max(1, round(every / run.step)))
    return run.external[kept] ** 2, run.doing[kept], run.torque[kept]


def _begun(runs: Sequence[Seen], j: int, what: int) -> int:
    """How often joint j began to do something."""
    count = 0
    for run in runs:
        does = run.doing[:, j] == what
        count += int(np.count_nonzero(does[1:] & ~does[:-1]))
    return count
