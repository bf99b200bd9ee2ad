"""Torque channels that come late, or through a slow filter: what a channel makes of the arm's torque, tried in turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.sensors.changes import Bench, Trial
from dynid_rs.diagnosis.sensors.rows import ArmRows, Moments

FloatArray = NDArray[np.float64]
Response = Callable[[FloatArray, float], NDArray[np.complex128]]

DELAYS = (-0.02, 0.01, 0.025, 0.05, 0.09)
TIMES = (0.03, 0.06, 0.1)
"""Delays, and mean delays of filters, [s] that are tried first; the best is refined."""
PAD = 20
"""Rows by which a run is continued at both ends before it is filtered."""


def _late(f: FloatArray, d: float) -> NDArray[np.complex128]:
    return np.asarray(np.exp(-2j * np.pi * f * d))


def _first_order(f: FloatArray, d: float) -> NDArray[np.complex128]:
    return np.asarray(1 / (1 + 2j * np.pi * f * d))


def _second_order(f: FloatArray, d: float) -> NDArray[np.complex128]:
    s = 2j * np.pi * f * d / np.sqrt(2)  # Butterworth; its mean delay is sqrt(2) over its corner
    return np.asarray(1 / (1 + np.sqrt(2) * s + s**2))


def _average(f: FloatArray, d: float) -> NDArray[np.complex128]:
    return np.asarray(np.sinc(2 * f * d) * np.exp(-2j * np.pi * f * d))


WAYS: dict[str, Response] = {
    "late": _late,
    "first order": _first_order,
    "second order": _second_order,
    "moving average": _average,
}


@dataclass(frozen=True, eq=False)
class Lag:
    """What the channels of `trial.joints` do: the way, and its mean delay [s]."""

    trial: Trial
    way: str
    delay: float


def lags(bench: Bench, enough: float) -> list[Lag]:
    """Ways that make the runs more probable by `enough` nats, of all channels and of one; the best of each way."""
    n = bench.robot.n_joints
    groups = [tuple(range(n)), *((j,) for j in range(n))] if n > 1 else [(0,)]
    seen: dict[tuple[str, float], list[Moments]] = {}

    def tried(way: str, delay: float, joints: Sequence[int]) -> Lag:
        key = (way, round(delay, 6))
        if key not in seen:
            seen[key] = [_moments(bench, rows, WAYS[way], delay) for rows in bench.rows]
        mask = np.isin(np.arange(n), joints)
        runs = [plain.where(mask, other) for plain, other in zip(bench.plain, seen[key], strict=True)]
        whole = tuple(range(len(bench.rows)))
        return Lag(Trial("torque_late", tuple(joints), whole, bench.fitted(runs)), way, delay)

    first = {group: [tried("late", d, group) for d in DELAYS] for group in groups}
    found = []
    for group, lates in first.items():
        if max(lag.trial.fit.log for lag in lates) - bench.fit.log < enough:
            continue
        for way in WAYS:
            start = lates if way == "late" else [tried(way, d, group) for d in TIMES]
            found.append(_refined(start, lambda d, w=way, g=group: tried(w, d, g)))  # type: ignore[misc]
    return found


def _refined(tried: list[Lag], again: Callable[[float], Lag]) -> Lag:
    best = max(tried, key=lambda lag: lag.trial.fit.log)
    step = 0.4 * abs(best.delay)
    for _ in range(4):
        for delay in (best.delay + step, best.delay - step):
            other = again(delay)
            if other.trial.fit.log > best.trial.fit.log:
                best = other
                break
        step /= 2
    return best


def _moments(bench: Bench, rows: ArmRows, way: Response, delay: float) -> Moments:
    step = float(rows.t[1] - rows.t[0])
    n = len(rows.t) + 2 * PAD
    response = way(np.fft.rfftfreq(n, step), delay)

    def through(A: FloatArray) -> FloatArray:
        # Turned about its ends: values and slopes go on.
        head, tail = 2 * A[0] - A[PAD:0:-1], 2 * A[-1] - A[-2 : -PAD - 2 : -1]
        spectrum = np.fft.rfft(np.concatenate([head, A, tail]), axis=0)
        return np.asarray(np.fft.irfft(spectrum * response[:, None], n, axis=0)[PAD:-PAD])

    return Moments.of(bench.robot, rows, through).picked(range(rows.n_joints))
