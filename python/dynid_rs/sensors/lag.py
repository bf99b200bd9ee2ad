"""Torque channels that come late: they are put earlier, or what the model says later, and the runs explained again.

A channel that is put earlier keeps the model's columns, so that many delays are one pass over the rows. Only where one
is found the columns are moved: the links' without friction's, and through filters, which nothing undoes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import ArmFit, fit_arms
from dynid_rs.sensors.loss import LossyRows, lossy_arm
from dynid_rs.sensors.rows import N_OWN, ArmRows, Moments

FloatArray = NDArray[np.float64]

NEAR = (-0.01, 0.01)
"""Delays [s] of which one has to pay: towards a delay that is there runs become likelier from the first step on."""
FAR = (-0.03, 0.025, 0.05, 0.09, 0.15)
"""Those that are tried beside them; the best is refined."""
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

    `in_time` is the same model without the delay. `links_log` tells L where the links' torque alone is late: friction
    that remembers where it came from looks late too. `filter_gain` tells by how much L is greater behind the likeliest
    filter in the delay's place.
    """

    trial: Trial
    delay: float
    in_time: ArmFit
    links_log: Callable[[], float]
    filter_gain: Callable[[], float]


@dataclass(frozen=True, eq=False)
class Shifter:
    """Goes on with a run at both ends, `size` rows in all, and moves it in time as a `Response` says."""

    n_rows: int
    step: float
    size: int

    @staticmethod
    def of(rows: ArmRows) -> Shifter:
        """For the rows of a run."""
        from scipy.fft import next_fast_len

        # A length of small factors: another one may cost ten times as much.
        size = next_fast_len(len(rows.t) + 2 * PAD, real=True)
        return Shifter(len(rows.t), float(rows.t[1] - rows.t[0]), size)

    def spectrum(self, x: FloatArray) -> NDArray[np.complex128]:
        """Of signals (n_rows, k), turned about their ends: values and slopes go on."""
        more = self.size - self.n_rows - PAD
        head, tail = 2 * x[0] - x[PAD:0:-1], 2 * x[-1] - x[-2 : -more - 2 : -1]
        return np.asarray(np.fft.rfft(np.concatenate([head, x, tail]), axis=0))

    def shifted(self, spectrum: NDArray[np.complex128], delay: float, response: Response) -> FloatArray:
        """The signals (n_rows, k) later by `delay` [s]."""
        turn = response(2j * np.pi * delay * np.fft.rfftfreq(self.size, self.step))[:, None]
        return np.asarray(np.fft.irfft(spectrum * turn, self.size, axis=0)[PAD : PAD + self.n_rows])


def early(bench: Bench, lossy: LossyRows, moments: Moments, delays: Sequence[float]) -> Moments:
    """Moments of a run whose channel number k is a joint's own torque put earlier by the delay number k [s]."""
    shifter, tau = Shifter.of(lossy.rows), lossy.rows.tau
    spectrum = shifter.spectrum(tau)
    channels = [shifter.shifted(spectrum, -delay, _late) if delay else tau for delay in delays]
    return lossy.channels(bench.arm, moments, np.stack(channels, axis=2))


def behind(bench: Bench, lossy: LossyRows, delay: float, response: Response, *, whole: bool) -> Moments:
    """Moments of a run with every joint's torque late by `delay` [s] in the model, or the links' torque alone."""
    shifter, rows = Shifter.of(lossy.rows), lossy.rows

    def shifted(j: int) -> FloatArray:
        late = shifter.shifted(shifter.spectrum(lossy.columns(bench.arm, j)), delay, response)
        if not whole:
            # What a gear loses belongs to its links.
            late[:, -N_OWN - 1 : -1] = rows.columns(bench.arm, j)[:, -N_OWN:]
        return late

    return lossy.moments(bench.arm, shifted)


def lags(bench: Bench, enough: float) -> list[Lag]:
    """Delays that make the runs more probable by `enough` nats: of all channels, and of each; the best of each."""
    n = bench.robot.n_joints
    groups = [tuple(range(n)), *((j,) for j in range(n))] if n > 1 else [(0,)]
    arm = lossy_arm(bench)

    @cache
    def channels(delays: tuple[float, ...]) -> list[Moments]:
        return [early(bench, *run, (0.0, *delays)) for run in zip(arm.rows, arm.moments, strict=True)]

    def modelled(joints: tuple[int, ...], delay: float, response: Response = _late, *, whole: bool = True) -> float:
        mask = np.isin(np.arange(n), joints)
        late = [behind(bench, rows, delay, response, whole=whole) for rows in arm.rows]
        return bench.fitted([plain.where(mask, other) for plain, other in zip(arm.moments, late, strict=True)]).log

    def filtered(joints: tuple[int, ...], delay: float) -> float:
        def after(response: Response) -> Callable[[Sequence[float]], list[float]]:
            return lambda delays: [modelled(joints, other, response) for other in delays]

        # Both in the model's columns: of the same torque, at the ends of runs too.
        return max(_refined(delay, after(response))[1] for response in FILTERS) - modelled(joints, delay)

    def fits(delays: Sequence[float], joints: tuple[int, ...]) -> list[ArmFit]:
        at = [[1 + k if j in joints else 0 for j in range(n)] for k in range(len(delays))]
        return fit_arms(bench.prior, [[run.picked(own) for run in channels(tuple(delays))] for own in at], bench.size)

    def logs(delays: Sequence[float], joints: tuple[int, ...]) -> list[float]:
        return [fit.log for fit in fits(delays, joints)]

    found = []
    for joints in groups:
        first = logs((*NEAR, *FAR), joints)
        if max(first[: len(NEAR)]) <= arm.fit.log or max(first) - arm.fit.log < enough:
            continue
        delay, _ = _refined((*NEAR, *FAR)[int(np.argmax(first))], partial(logs, joints=joints))
        trial = Trial("torque_late", joints, tuple(range(len(bench.rows))), fits([delay], joints)[0])
        links = partial(modelled, joints, delay, whole=False)
        found.append(Lag(trial, delay, arm.fit, links, partial(filtered, joints, delay)))
    return found


def _refined(delay: float, logs: Callable[[Sequence[float]], list[float]]) -> tuple[float, float]:
    """The likeliest delay near one and its logarithm, by halving steps."""
    best = delay, logs([delay])[0]
    step = 0.4 * abs(delay)
    for _ in range(5):
        aside = [best[0] + step, best[0] - step]
        best = max(best, *zip(aside, logs(aside), strict=True), key=lambda one: one[1])
        step /= 2
    return best
