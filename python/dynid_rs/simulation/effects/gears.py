"""Gears that yield more than a spring: stiffening, softening, play."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.effects.base import LabEffect

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]

GEAR = (
    "stiffness",
    "damping",
    "hysteresis",
    "hysteresis_distance",
    "hysteresis_loss",
    "kinematic_error",
    "kinematic_cycles",
    "kinematic_phase",
)
"""What a gear is, in the words of `SimulatedArm`."""


@dataclass(frozen=True, eq=False)
class JointElasticity(LabEffect):
    """Elastic gears: `stiffness`, `damping`, `hysteresis` and `kinematic_error` of these joints (n_joints,)."""

    gears: SimulatedArm | None = None

    def mount(self, arm: SimulatedArm) -> SimulatedArm:
        """Take the gears of these joints from `gears`."""
        here = np.isin(np.arange(arm.robot.n_joints), self.joints)
        changed = {name: np.where(here, getattr(self.gears, name), getattr(arm, name)) for name in GEAR}
        # What a gear loses is tooth friction: an arm without friction has gears without that loss.
        coulomb = arm.friction[:, :2].min(axis=1)
        most = np.where(changed["hysteresis"] > 0, coulomb / np.maximum(changed["hysteresis"], 1e-300), np.inf)
        changed["hysteresis_loss"] = np.minimum(changed["hysteresis_loss"], most)
        return replace(arm, **changed)


@dataclass(frozen=True, eq=False)
class NonlinearElasticity(JointElasticity):
    """Elastic gears with `q_motor - q = tau / K + cubic tau^3`; `cubic` (n_joints,) [rad/(N m)^3]."""

    cubic: FloatArray = None  # type: ignore[assignment]

    @property
    def yields(self) -> bool:
        """Whether it adds to the wind-up of gears: yes."""
        return True

    def deflection(self, tau_gear: FloatArray) -> FloatArray:
        """Return the cubic part."""
        return np.asarray(self.cubic * tau_gear**3)


@dataclass(frozen=True, eq=False)
class Backlash(LabEffect):
    """Play: the deflection goes from -gap/2 to gap/2 while the torque goes from -width to width.

    `gap` (n_joints,) [rad], `width` (n_joints,) [N m]. The teeth do not lose contact at one instant: load
    is shared, so the step is one of finite slope with continuous curvature.
    """

    gap: FloatArray = None  # type: ignore[assignment]
    width: FloatArray = None  # type: ignore[assignment]

    @property
    def yields(self) -> bool:
        """Whether it adds to the wind-up of gears: yes."""
        return True

    def deflection(self, tau_gear: FloatArray) -> FloatArray:
        """Return the smooth step."""
        x = np.clip(tau_gear / self.width, -1.0, 1.0)
        return np.asarray(self.gap / 2 * (15 * x - 10 * x**3 + 3 * x**5) / 8)
