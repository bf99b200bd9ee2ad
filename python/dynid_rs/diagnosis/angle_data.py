"""One joint's torque residual against its motor angle, at every recorded sample."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import States, stretches
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]

LEAST_SPAN = 0.2
"""A run that moves the joint by less [rad] says nothing about ripple."""
STILL = 0.03
"""Samples slower than this part of the joint's usual speed are left out: the angle stands still."""
USUAL = 0.5
"""The usual speed is this quantile of the speeds at which the joint moves."""
SWEEP_TRAVEL = 2 * np.pi
"""Longest stretch of travel [rad] that counts as one sweep."""
SWEEP_LEAST = 0.25
"""Shortest [rad]; what is left between reversals is in no sweep."""


@dataclass(frozen=True, eq=False)
class AngleRun:
    """Samples of one run of one joint, (n,) each; `beside` (n, n_columns) is what the declared model has.

    `angle` is that of the motor over the gear ratio, `residual` the measured torque less the predicted one, at the
    recorded rate and not filtered. `used` marks the samples with motion.
    """

    name: str
    angle: FloatArray
    speed: FloatArray
    residual: FloatArray
    beside: FloatArray
    used: NDArray[np.bool_]
    rate: float

    @property
    def span(self) -> float:
        """Range of the angle in motion [rad]."""
        return float(np.ptp(self.angle[self.used])) if self.used.any() else 0.0

    def sweeps(self) -> list[slice]:
        """Stretches of motion in one direction, of `SWEEP_LEAST` to `SWEEP_TRAVEL` rad."""
        found = []
        for way in (1.0, -1.0):
            for first, last in stretches(self.used & (way * self.speed > 0)):
                travel = float(np.ptp(self.angle[first:last]))
                if travel < SWEEP_LEAST:
                    continue
                n_parts = int(np.ceil(travel / SWEEP_TRAVEL))
                edges = np.linspace(first, last, n_parts + 1).astype(int)
                found += [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
        return sorted(found, key=lambda part: part.start)


@dataclass(frozen=True, eq=False)
class FullRateRun:
    """A run with its states, the prediction at its own stamps, and what every joint's declared model has there."""

    recording: Recording
    states: States
    residual: FloatArray
    rows: list[FloatArray]


def full_rate_runs(fit: ThreeLoopIdentifier, recordings: Sequence[Recording]) -> list[FullRateRun]:
    """Residual (n, n_joints) and the declared model's columns of every run, not filtered.

    `recordings` need not be training runs: a run in which one joint sweeps while the others rest serves that joint.
    """
    return [_full_rate(fit, recording) for recording in recordings]


def _full_rate(fit: ThreeLoopIdentifier, recording: Recording) -> FullRateRun:
    delay = np.zeros(fit.robot.n_joints) if fit.encoder_delay_ is None else fit.encoder_delay_.value
    states = fit.states(recording).aligned(delay, fit.encoder_error)
    plan = fit.observations_.plan
    phi = np.zeros(10 * plan.robot.n_joints)
    phi[plan.pivots] = fit.links_.phi_base_
    load = plan.robot.inverse_dynamics(states.q, states.dq, states.ddq, phi)
    rows = _core.observe(
        plan.robot,
        list(plan.effects),
        plan.pivots.tolist(),
        *states.signals(),
        states.tau,
        filter=None,
        kept=list(range(len(states.t))),
        tau_link=load,
        step=1 / states.rate,
        temperature=states.temperature,
    )
    return FullRateRun(recording, replace(states, tau_link=load), recording.tau - fit.predict(recording), rows)


def angle_runs(runs: Sequence[FullRateRun], j: int) -> list[AngleRun]:
    """Runs in which joint j moves."""
    found = []
    for run in runs:
        recording, states = run.recording, run.states
        angle = (recording.q if recording.q_motor is None else recording.q_motor)[:, j]
        speed = np.interp(recording.t, states.t, states.dq_motor[:, j])
        columns = run.rows[j][:, :-1]
        columns = columns[:, np.ptp(columns, axis=0) > 0]
        beside = np.stack([np.interp(recording.t, states.t, column) for column in columns.T], axis=1)
        beside = np.column_stack([np.ones(len(angle)), beside])
        fast = np.abs(speed)
        moving = fast > STILL * fast.max()
        usual = float(np.quantile(fast[moving], USUAL)) if moving.any() else 0.0
        used = moving & (fast > STILL * usual)
        rate = (recording.n_samples - 1) / recording.duration
        part = AngleRun(recording.name, angle, speed, run.residual[:, j], beside, used, rate)
        if part.span >= LEAST_SPAN:
            found.append(part)
    return found
