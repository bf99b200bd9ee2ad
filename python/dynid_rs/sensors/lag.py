"""Torque channels that come late: a delay is given to what the model says, and tried in turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import ArmFit
from dynid_rs.sensors.loss import LossyRows, lossy_arm
from dynid_rs.sensors.rows import N_OWN, Moments

FloatArray = NDArray[np.float64]

NEAR = (-0.01, 0.01)
"""Delays [s] that are tried first: towards a delay that is there runs become more probable from the first step on."""
FAR = (-0.03, 0.025, 0.05, 0.09, 0.15)
"""Those that are tried where one of the first is better than none; the best is refined."""
ComplexArray = NDArray[np.complexfloating[Any, Any]]
Response = Callable[[ComplexArray], ComplexArray]
"""What a channel makes of a sine: of i omega T (n_frequencies,), where T is how late slow ones are."""


def _late(s: ComplexArray) -> ComplexArray:
    return np.asarray(np.exp(-s), dtype=np.complex128)


def _first_order(s: ComplexArray) -> ComplexArray:
    return 1 / (1 + s)


def _second_order(s: ComplexArray) -> ComplexArray:
    return 1 / (1 + s + s * s / 2)  # Butterworth's


def _averaged(s: ComplexArray) -> ComplexArray:
    return np.asarray(np.exp(-s) * np.sinc(s.imag / np.pi), dtype=np.complex128)


FILTERS = (_first_order, _second_order, _averaged)
"""What drives and loggers smooth with."""
PAD = 20
"""Rows by which a run is continued at both ends at least before it is shifted."""


@dataclass(frozen=True, eq=False)
class Lag:
    """The channels of `trial.joints` come late by `delay` [s].

    `in_time` is the same model without the delay. `links_log` is L where the links' torque alone is late: friction that
    remembers where it came from looks late too. `filter_log`, of all channels together, is L behind the likeliest
    filter in the delay's place.
    """

    trial: Trial
    delay: float
    in_time: ArmFit
    links_log: float = -np.inf
    filter_log: float = -np.inf


@dataclass(frozen=True, eq=False)
class Spectra:
    """A run's columns by frequency, joint by joint: a delay only turns them.

    `parts` (n_frequencies, k_j) of every joint, of `size` rows each, `PAD` and what is before them included.
    """

    lossy: LossyRows
    size: int
    parts: list[NDArray[np.complex128]]

    @staticmethod
    def of(bench: Bench, lossy: LossyRows) -> Spectra:
        """Spectra of a run, which goes on at both ends."""
        from scipy.fft import next_fast_len

        rows = lossy.rows
        # A length of small factors: another one may cost ten times as much.
        size = next_fast_len(len(rows.t) + 2 * PAD, real=True)
        more = size - len(rows.t) - PAD
        parts = []
        for j in range(rows.n_joints):
            A = lossy.columns(bench.robot, j)
            # Turned about its ends: values and slopes go on.
            head, tail = 2 * A[0] - A[PAD:0:-1], 2 * A[-1] - A[-2 : -more - 2 : -1]
            parts.append(np.fft.rfft(np.concatenate([head, A, tail]), axis=0))
        return Spectra(lossy, size, parts)

    def moments(self, bench: Bench, delay: float, response: Response, *, whole: bool) -> Moments:
        """Moments of the run with every joint's torque late by `delay` [s], or with the links' alone."""
        rows = self.lossy.rows
        step = float(rows.t[1] - rows.t[0])
        turn = response(2j * np.pi * delay * np.fft.rfftfreq(self.size, step))[:, None]

        def shifted(j: int) -> FloatArray:
            late = np.fft.irfft(self.parts[j] * turn, self.size, axis=0)[PAD : PAD + len(rows.t)]
            if not whole:
                # What a gear loses belongs to its links.
                late[:, -N_OWN - 1 : -1] = rows.columns(bench.robot, j)[:, -N_OWN:]
            return np.asarray(late)

        return self.lossy.moments(bench.robot, shifted)


def lags(bench: Bench, enough: float) -> list[Lag]:
    """Delays that make the runs more probable by `enough` nats: of all channels, and of each; the best of each."""
    n = bench.robot.n_joints
    groups = [tuple(range(n)), *((j,) for j in range(n))] if n > 1 else [(0,)]
    seen: dict[tuple[float, Response, bool], list[Moments]] = {}
    arm = lossy_arm(bench)
    spectra = [Spectra.of(bench, rows) for rows in arm.rows]

    def changed(delay: float, joints: Sequence[int], response: Response, *, whole: bool = True) -> list[Moments]:
        key = delay, response, whole
        if key not in seen:
            seen[key] = [own.moments(bench, delay, response, whole=whole) for own in spectra]
        mask = np.isin(np.arange(n), joints)
        return [plain.where(mask, other) for plain, other in zip(arm.moments, seen[key], strict=True)]

    def tried(delay: float, joints: Sequence[int], response: Response = _late) -> Lag:
        runs = changed(delay, joints, response)
        trial = Trial("torque_late", tuple(joints), tuple(range(len(bench.rows))), bench.fitted(runs))
        return Lag(trial, delay, arm.fit)

    def filter_log(lag: Lag) -> float:
        behind = [partial(tried, joints=lag.trial.joints, response=response) for response in FILTERS]
        return max(_log(_refined(again(lag.delay), again)) for again in behind)

    found = []
    for group in groups:
        best = max((tried(delay, group) for delay in NEAR), key=_log)
        if _log(best) <= arm.fit.log:
            continue
        best = max((best, *(tried(delay, group) for delay in FAR)), key=_log)
        if _log(best) - arm.fit.log >= enough:
            best = _refined(best, partial(tried, joints=group))
            links = bench.fitted(changed(best.delay, group, _late, whole=False)).log
            behind = filter_log(best) if len(group) == n else -np.inf
            found.append(replace(best, links_log=links, filter_log=behind))
    return found


def _log(lag: Lag) -> float:
    return lag.trial.fit.log


def _refined(best: Lag, again: Callable[[float], Lag]) -> Lag:
    step = 0.4 * abs(best.delay)
    for _ in range(5):
        best = max((best, again(best.delay + step), again(best.delay - step)), key=_log)
        step /= 2
    return best
