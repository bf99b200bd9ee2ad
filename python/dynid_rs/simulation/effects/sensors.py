"""Channels that do not show what is there: gains, delays, an encoder disc that is not centred."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.effects.base import LabEffect, Readings

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TorqueGain(LabEffect):
    """The torque channel shows (1 + gain) times the torque; `gain` (n_joints,)."""

    gain: FloatArray = None  # type: ignore[assignment]

    def read(self, readings: Readings, t: FloatArray) -> Readings:
        """Scale the torque."""
        return replace(readings, tau=readings.tau * (1 + self.gain))


@dataclass(frozen=True, eq=False)
class TorqueDelay(LabEffect):
    """The torque channel is late; `delays` (n_joints,) [s]."""

    delays: FloatArray = None  # type: ignore[assignment]

    @property
    def lag(self) -> FloatArray:
        """How late it is (n_joints,) [s]."""
        return self.delays


@dataclass(frozen=True, eq=False)
class EncoderDelay(LabEffect):
    """The link channel is `delay` [s] later than the motor channel."""

    delay: float = 0.0

    def mount(self, arm: SimulatedArm) -> SimulatedArm:
        """Set the arm's delay."""
        return replace(arm, delay=self.delay)


@dataclass(frozen=True, eq=False)
class EncoderEccentricity(LabEffect):
    """The link encoder shows `q + amplitude sin(q + phase)`; both (n_joints,) [rad]."""

    amplitude: FloatArray = None  # type: ignore[assignment]
    phase: FloatArray = None  # type: ignore[assignment]

    def read(self, readings: Readings, t: FloatArray) -> Readings:
        """Turn position, velocity and acceleration into what the disc shows."""
        q, dq, ddq = readings.q, readings.dq, readings.ddq
        sine, cosine = np.sin(q + self.phase), np.cos(q + self.phase)
        slope = 1 + self.amplitude * cosine
        return replace(
            readings,
            q=q + self.amplitude * sine,
            dq=slope * dq,
            ddq=slope * ddq - self.amplitude * sine * dq**2,
        )
