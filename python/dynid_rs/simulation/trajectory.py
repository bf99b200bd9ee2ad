"""Motion that is known exactly: Fourier series between two rests."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.limits import MotionLimits

FloatArray = NDArray[np.float64]

REST = 0.5
"""Time at rest before and after the motion [s]: filters start there, and a late channel has a past."""

MIN_DURATION = 4.0
LONGEST_PERIOD = 20.0
"""Longer runs repeat their period, as measured ones do."""

TOP_FREQUENCY = 0.5
"""Highest frequency of the motion [Hz]; well inside the band that identification keeps."""

MIN_HARMONICS = 5
USAGE = (0.75, 0.95)
"""Share of the tightest limit that a joint uses, drawn per run and joint."""


class Trajectory(Protocol):
    """Motion of the links, known at any time."""

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""

    def evaluate(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at times `t` (n,) [s], each (n, n_joints)."""


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Rest, a Fourier series over whole periods, rest.

    With w = `fundamental` and s the time since the motion started::

        q(s) = offset + sum_l  sin_coef_l / (w l) sin(w l s) - cos_coef_l / (w l) cos(w l s)

    the series of Eq. 15 of the double-encoder paper (Liu et al.).

    Parameters
    ----------
    offset : ndarray (n_joints,)
        Centre of the series [rad, m].
    sin_coef, cos_coef : ndarray (n_harmonics, n_joints)
        Amplitudes of velocity [rad/s, m/s].
    fundamental : float
        [rad/s].
    n_periods : int
        Periods between the two rests.
    rest : float
        Length of each rest [s].
    """

    offset: FloatArray
    sin_coef: FloatArray
    cos_coef: FloatArray
    fundamental: float
    n_periods: int = 1
    rest: float = REST

    @property
    def duration(self) -> float:
        """Both rests and the motion [s]."""
        return 2 * self.rest + self.n_periods * 2 * np.pi / self.fundamental

    def evaluate(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at times `t` (n,) [s], each (n, n_joints)."""
        since = np.asarray(t, dtype=np.float64) - self.rest
        moving = (since > 0) & (since < self.duration - 2 * self.rest)
        # The series returns to its start after whole periods, so time zero stands for both rests.
        since = np.where(moving, since, 0.0)
        omega = self.fundamental * np.arange(1, len(self.sin_coef) + 1)
        sines, cosines = np.sin(np.outer(since, omega)), np.cos(np.outer(since, omega))
        column = omega[:, None]
        q = self.offset + sines @ (self.sin_coef / column) - cosines @ (self.cos_coef / column)
        dq = cosines @ self.sin_coef + sines @ self.cos_coef
        ddq = cosines @ (self.cos_coef * column) - sines @ (self.sin_coef * column)
        # The constraints hold to rounding; at rest they hold exactly.
        return q, np.where(moving[:, None], dq, 0.0), np.where(moving[:, None], ddq, 0.0)

    def scaled(self, factor: float) -> FourierTrajectory:
        """Return the same motion, smaller about its centre."""
        return replace(self, sin_coef=factor * self.sin_coef, cos_coef=factor * self.cos_coef)

    def to_json(self) -> dict[str, object]:
        """Return every number of the trajectory."""
        return {
            "offset": self.offset.tolist(),
            "sin_coef": self.sin_coef.tolist(),
            "cos_coef": self.cos_coef.tolist(),
            "fundamental_rad_s": self.fundamental,
            "n_periods": self.n_periods,
            "rest_s": self.rest,
        }


def random_trajectory(limits: MotionLimits, duration: float, rng: np.random.Generator) -> FourierTrajectory:
    """Draw a trajectory that uses a good part of the limits and keeps them.

    Velocity, acceleration and jerk are zero where motion and rest meet.

    Parameters
    ----------
    limits : MotionLimits
        What every joint may do.
    duration : float
        With both rests [s].
    rng : Generator
        Source of all chance.

    Raises
    ------
    ValueError
        `duration` is too short for rest, motion and rest.
    """
    if not duration >= MIN_DURATION:
        raise ValueError(
            f"a duration of {duration:g} s is too short, a run needs at least {MIN_DURATION:g} s: "
            f"{REST:g} s of rest at both ends and some motion between"
        )
    motion = duration - 2 * REST
    n_periods = max(1, round(motion / LONGEST_PERIOD))
    period = motion / n_periods
    n_harmonics = max(MIN_HARMONICS, round(TOP_FREQUENCY * period))
    order = np.arange(1.0, n_harmonics + 1)
    shape = (n_harmonics, limits.lower.size)
    # dq(0) = sum a, jerk(0) ~ sum a l^2, ddq(0) ~ sum b l: what breaks them is taken out of the coefficients.
    unit = FourierTrajectory(
        offset=np.zeros(limits.lower.size),
        sin_coef=_without(np.stack([np.ones_like(order), order**2]), rng.standard_normal(shape)),
        cos_coef=_without(order[None], rng.standard_normal(shape)),
        fundamental=2 * np.pi / period,
        n_periods=n_periods,
    )
    q, dq, ddq = unit.evaluate(REST + np.linspace(0.0, period, 200 * n_harmonics))
    room = limits.upper - limits.lower
    factor = rng.uniform(*USAGE, room.size) * np.min(
        [
            room / np.ptp(q, axis=0),
            limits.velocity / np.abs(dq).max(axis=0),
            limits.acceleration / np.abs(ddq).max(axis=0),
        ],
        axis=0,
    )
    low, high = factor * q.min(axis=0), factor * q.max(axis=0)
    offset = limits.lower - low + rng.uniform(0.0, 1.0, room.size) * (room - (high - low))
    # Between two samples a step h apart the series passes its samples by at most h^2/8 of its acceleration.
    beyond = factor * np.abs(ddq).max(axis=0) * (period / (len(q) - 1)) ** 2 / 8
    offset = np.clip(offset, limits.lower - low + beyond, limits.upper - high - beyond)
    return replace(unit, offset=offset, sin_coef=unit.sin_coef * factor, cos_coef=unit.cos_coef * factor)


def _without(constraints: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Remove from `coefficients` (n, m) what the rows of `constraints` (k, n) see."""
    basis, _ = np.linalg.qr(constraints.T)
    return np.asarray(coefficients - basis @ (basis.T @ coefficients))
