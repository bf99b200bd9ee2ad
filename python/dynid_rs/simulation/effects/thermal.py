"""A session that warms the arm up: friction falls from run to run, and thermometers show it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.simulation.effects.base import LabEffect, Readings, Signals, Value

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]

PAUSE = 10.0
"""Between two runs of a session [s]."""

_COLD, _RISE, _STEP = 25.0, 20.0, 0.1
"""Temperature before the session and its rise [degC]; thermometers show tenths."""


@dataclass(frozen=True, eq=False)
class ThermalDrift(LabEffect):
    """Declared friction times (1 + change f), with T df/dt = 1 - f over the whole session.

    `change` (n_joints,), negative; `time_constant` T [s]; `start` is when this run starts, after the arm was
    cold [s]. The temperature channel shows 25 + 20 f degC.
    """

    change: FloatArray = None  # type: ignore[assignment]
    time_constant: float = 1.0
    start: float = 0.0

    def of_run(self, run: int, duration: float, rng: np.random.Generator) -> ThermalDrift:
        """Start where the runs before, of the same length, have ended."""
        start = run * (duration + PAUSE)
        return replace(self, start=start, values=(*self.values, Value("start", start, "s")))

    def motor_torque(self, arm: SimulatedArm, signals: Signals) -> FloatArray:
        """Return what warmth takes from friction."""
        return np.asarray(self.change * self.warmth(signals.t)[:, None] * signals.friction)

    def read(self, readings: Readings, t: FloatArray) -> Readings:
        """Add the thermometers."""
        shown = np.round((_COLD + _RISE * self.warmth(t)) / _STEP) * _STEP
        return replace(readings, temperature=np.repeat(shown[:, None], readings.q.shape[1], axis=1))

    def warmth(self, t: FloatArray) -> FloatArray:
        """Warmth f at times `t` (n,) [s] of the run, from 0 when cold to 1 (n,).

        One formula, one home: the core's `thermal_friction`, its viscous column at a speed of 1 after one step
        of 1 s, with a time constant per time instead of a time per time constant.
        """
        since = np.maximum(self.start + t, 1e-9)
        effect = _core.Effect.of(
            "thermal_friction",
            time_constant=self.time_constant / since,
            reference_speed=np.zeros(t.size),
            transition_width=np.ones(t.size),
        )
        speed, zero = np.ones((2, t.size)), np.zeros((2, t.size))
        viscous = np.tile([0.0, 1.0], (t.size, 1))
        return np.asarray(_core.effect_torque(effect, viscous, zero, speed, zero, step=1.0)[1])
