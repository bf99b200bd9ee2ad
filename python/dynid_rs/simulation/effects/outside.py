"""Forces from outside: a push for a limited time, which no model holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.effects.base import LabEffect, Value

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]

LENGTH = (0.4, 1.0)
"""Of one push [s]."""

EVERY = 10.0
"""One push per this time [s], and at least one per run."""

_EDGES = 1.0
"""No push this close to the ends of a run [s]."""


@dataclass(frozen=True)
class Push:
    """A force on the origin of the last link's frame: `force` (3,) [N] in the base frame at its peak."""

    start: float
    end: float
    force: tuple[float, float, float]

    def course(self, t: FloatArray) -> FloatArray:
        """Share of the peak at `t` (n,) [s]: a bump whose first three derivatives are continuous."""
        x = np.clip((2 * t - self.start - self.end) / (self.end - self.start), -1.0, 1.0)
        return np.asarray((1 - x**2) ** 4)


@dataclass(frozen=True, eq=False)
class Contact(LabEffect):
    """Something touches the last link now and then, with a force of up to `force` [N]."""

    force: float = 0.0
    pushes: tuple[Push, ...] = ()

    def of_run(self, run: int, duration: float, rng: np.random.Generator) -> Contact:
        """Draw time and direction of the pushes, one in every equal part of the run."""
        count = max(1, int(duration / EVERY))
        room = (duration - 2 * _EDGES) / count
        pushes = []
        for part in range(count):
            length = min(rng.uniform(*LENGTH), 0.9 * room)
            start = _EDGES + part * room + rng.uniform(0.0, room - length)
            direction = rng.standard_normal(3)
            force = self.force * direction / np.linalg.norm(direction)
            pushes.append(Push(float(start), float(start + length), tuple(force.tolist())))
        windows = [{"start_s": p.start, "end_s": p.end, "force": list(p.force)} for p in pushes]
        return replace(self, pushes=tuple(pushes), values=(*self.values, Value("windows", windows, "s, N")))

    def link_torque(self, arm: SimulatedArm, t: FloatArray, q: FloatArray) -> FloatArray:
        """Return minus the force's own torque: what the gears must hold against it."""
        total = np.zeros_like(q)
        for push in self.pushes:
            rows = np.flatnonzero((t > push.start) & (t < push.end))
            if rows.size:
                torque = -force_torque(arm, q[rows], push.force)
                total[rows] += push.course(t[rows])[:, None] * torque
        return total


def force_torque(arm: SimulatedArm, q: FloatArray, force: tuple[float, float, float]) -> FloatArray:
    """Joint torque `J(q).T force` (n, n_joints) of a force (3,) [N] on the origin of the last link's frame.

    A point of 1 kg there, at rest under a gravity of `force`, is held by exactly minus this torque.
    """
    point = np.zeros(10 * arm.robot.n_joints)
    point[-10] = 1.0
    still = np.zeros_like(q)
    return np.asarray(-arm.robot.with_gravity(force).inverse_dynamics(q, still, still, point))
