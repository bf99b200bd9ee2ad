"""Where the joints go: smooth in closed form, so that speed and acceleration are exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from exam.draw import Case, log_uniform, stream

FloatArray = NDArray[np.float64]

WIDEST = 1.5
"""No joint goes further than this from its middle [rad]."""


@dataclass(frozen=True)
class Motion:
    """Positions, speeds and accelerations (n, n_joints) at the instants `t` (n,)."""

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray


def make_motion(case: Case, run: int, t: FloatArray) -> Motion:
    """Return the motion of one run at the instants `t`."""
    rng = stream(case.seed, 2, run)
    middle = stream(case.seed, 2, 1000).uniform(-0.8, 0.8, case.n_joints)
    if case.motion == "moves":
        q, dq, ddq = _moves(rng, case, t)
    elif case.motion == "pauses":
        s, ds, dds = _stop_and_go(rng, t)
        p, dp, ddp = _fourier(rng, case, s)
        q, dq, ddq = p, dp * ds[:, None], ddp * ds[:, None] ** 2 + dp * dds[:, None]
    elif case.motion == "poor":
        q, dq, ddq = _poor(rng, case, t)
    else:
        q, dq, ddq = _fourier(rng, case, t)
    return Motion(t, q + middle, dq, ddq)


def _speeds(rng: np.random.Generator, case: Case) -> FloatArray:
    """Greatest speed of each joint [rad/s]; wrists go faster, heavy arms go slower."""
    n = case.n_joints
    return case.speed * (case.mass / 20.0) ** -0.1 * (1 + 0.1 * np.arange(n)) * rng.uniform(0.6, 1.0, n)


def _fourier(rng: np.random.Generator, case: Case, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A sum of harmonics of a slow period, scaled to the greatest speed or way, whichever is met first."""
    base = 2 * np.pi / rng.uniform(8.0, 20.0)
    n_harmonics = int(rng.integers(4, 8))
    amplitude = rng.normal(size=(n_harmonics, case.n_joints)) / np.arange(1, n_harmonics + 1)[:, None] ** 0.7
    phase = rng.uniform(0, 2 * np.pi, (n_harmonics, case.n_joints))
    speeds = _speeds(rng, case)
    return _harmonics(t, base * np.arange(1, n_harmonics + 1), amplitude, phase, speeds, WIDEST)


def _poor(rng: np.random.Generator, case: Case, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slow, and the joints nearly in phase."""
    base = 2 * np.pi / rng.uniform(10.0, 20.0)
    n_harmonics = 2
    common = rng.uniform(0, 2 * np.pi, (n_harmonics, 1))
    phase = common + rng.normal(0.0, 0.25, (n_harmonics, case.n_joints))
    amplitude = np.array([[1.0], [0.4]]) * rng.uniform(0.7, 1.3, (n_harmonics, case.n_joints))
    speeds = np.minimum(0.35 * _speeds(rng, case), 0.4)
    return _harmonics(t, base * np.arange(1, n_harmonics + 1), amplitude, phase, speeds, 0.7)


def _harmonics(t, omega, amplitude, phase, speeds, widest) -> tuple[FloatArray, FloatArray, FloatArray]:
    angle = t[:, None, None] * omega[:, None] + phase
    q = np.sum(amplitude * np.sin(angle), axis=1)
    dq = np.sum(amplitude * omega[:, None] * np.cos(angle), axis=1)
    ddq = np.sum(-amplitude * omega[:, None] ** 2 * np.sin(angle), axis=1)
    scale = np.minimum(speeds / np.abs(dq).max(axis=0), widest / np.abs(q).max(axis=0))
    return q * scale, dq * scale, ddq * scale


def _ramp(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A step from 0 to 1 over 0 <= x <= 1 that starts and ends smoothly; its integral, itself, its derivative."""
    x = np.clip(x, 0.0, 1.0)
    return x**6 - 3 * x**5 + 2.5 * x**4, 6 * x**5 - 15 * x**4 + 10 * x**3, 30 * x**2 * (1 - x) ** 2


def _trapezoid(t, start: float, rise: float, cruise: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Way, speed and acceleration of a move of unit speed: up, along, down."""
    first, up, push = _ramp((t - start) / rise)
    last, down, brake = _ramp((t - start - rise - cruise) / rise)
    # Beyond the ramp its integral goes on with unit speed.
    way_up = rise * first + np.maximum(t - start - rise, 0.0)
    way_down = rise * last + np.maximum(t - start - 2 * rise - cruise, 0.0)
    return way_up - way_down, up - down, (push - brake) / rise


def _moves(rng: np.random.Generator, case: Case, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """From point to point, all joints at once, with trapezoidal speed and a rest between."""
    n = case.n_joints
    q, dq, ddq = (np.zeros((len(t), n)) for _ in range(3))
    speeds, place = _speeds(rng, case), np.zeros(n)
    clock = float(rng.uniform(0.2, 0.8))
    while clock < t[-1]:
        target = rng.uniform(-1.2, 1.2, n) * np.where(rng.random(n) < 0.8, 1.0, 0.1)
        hurry = rng.uniform(0.4, 1.0)
        rise = float(rng.uniform(0.2, 0.5))
        cruise = float(np.max(np.abs(target - place) / (hurry * speeds)))
        way, speed, push = _trapezoid(t, clock, rise, cruise)
        step = (target - place) / (rise + cruise)
        q += way[:, None] * step
        dq += speed[:, None] * step
        ddq += push[:, None] * step
        place = target
        clock += 2 * rise + cruise + float(rng.exponential(0.3))
    return q, dq, ddq


def _stop_and_go(rng: np.random.Generator, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A clock that starts and ends at rest and stands still now and then; its own speed and acceleration."""
    s, ds, dds = (np.zeros(len(t)) for _ in range(3))
    clock = float(log_uniform(rng, 0.3, 2.0))
    last = t[-1] - float(log_uniform(rng, 0.3, 2.0))
    while clock < last - 2.5:
        rise = float(rng.uniform(0.3, 0.7))
        cruise = min(float(rng.uniform(2.0, 10.0)), last - clock - 2 * rise)
        for total, part in zip((s, ds, dds), _trapezoid(t, clock, rise, cruise), strict=True):
            total += part
        clock += 2 * rise + cruise + float(log_uniform(rng, 0.3, 3.0))
    return s, ds, dds
