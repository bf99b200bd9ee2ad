"""Effects that no catalogue knows, each with the signals that it truly depends on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation import LabEffect, SimulatedArm
from dynid_rs.simulation.effects.base import Signals

FloatArray = NDArray[np.float64]
Law = Callable[[Signals, int, int], FloatArray]
"""(signals, own joint, other joint) to torque over effort limit, (n,)."""

WIDTH = 0.02
"""Speed [rad/s] over which friction changes its sign."""


PLAY = 0.5
"""Half of a spring's dead zone [rad]; the same in every run, as all laws here are."""


def _sign(speed: FloatArray) -> FloatArray:
    return np.tanh(speed / WIDTH)


def _dead_zone(s: Signals, j: int, k: int) -> FloatArray:
    return np.sign(s.q[:, j]) * np.maximum(np.abs(s.q[:, j]) - PLAY, 0.0)


@dataclass(frozen=True)
class Formula:
    """A formula and the signals in it.

    `signals`: one group per signal that has to be named; within a group any one will do. "j" is the own joint, "k"
    the other one, as in `dq_j`.
    """

    law: Law
    signals: tuple[tuple[str, ...], ...]
    both: bool = False


STRANGERS: dict[str, Formula] = {
    # Friction of a joint that a neighbour's cable squeezes.
    "squeezed_friction": Formula(
        lambda s, j, k: 0.04 * _sign(s.dq_motor[:, j]) * np.sin(s.q[:, k]), (("q_k",), ("dq_j",))
    ),
    # A spring between two joints.
    "twisted_hose": Formula(lambda s, j, k: 0.03 * np.sin(3 * s.q[:, j]) * np.sin(s.q[:, k]), (("q_j",), ("q_k",))),
    "shared_cable": Formula(lambda s, j, k: 0.01 * (s.q[:, j] + s.q[:, k]) ** 3, (("q_j",), ("q_k",)), both=True),
    "dead_zone_spring": Formula(lambda s, j, k: 0.1 * _dead_zone(s, j, k), (("q_j",),)),
    # Bearings pressed by the load of another joint: the load is a function of positions, either may be named.
    "borrowed_load_friction": Formula(
        lambda s, j, k: 1e-3 * np.abs(s.tau_link[:, k]) * _sign(s.dq_motor[:, j]),
        (("tau_link_k", "q_k"), ("dq_j",)),
    ),
    "uneven_grease": Formula(lambda s, j, k: 0.02 * s.dq_motor[:, j] * np.cos(2 * s.q[:, j]), (("q_j",), ("dq_j",))),
    "neighbours_drag": Formula(lambda s, j, k: 0.02 * np.abs(s.dq[:, k]) * s.dq[:, k], (("dq_k",),)),
    "differential_teeth": Formula(lambda s, j, k: 0.02 * np.sin(7 * (s.q[:, j] + s.q[:, k])), (("q_j",), ("q_k",))),
    "leaking_damper": Formula(lambda s, j, k: 0.02 * s.dq[:, j] * np.abs(s.dq[:, k]), (("dq_j",), ("dq_k",))),
}


@dataclass(frozen=True, eq=False)
class Stranger(LabEffect):
    """Torque of a law on its first joint, on both where the law is shared; `effort` (n_joints,) [N m]."""

    effort: FloatArray = None  # type: ignore[assignment]

    @property
    def joints_pushed(self) -> tuple[int, ...]:
        """Joints that feel it."""
        return self.joints if STRANGERS[self.kind].both else self.joints[:1]

    def motor_torque(self, arm: SimulatedArm, signals: Signals) -> FloatArray:
        """Return the law's torque at its joints."""
        law, (j, k) = STRANGERS[self.kind].law, self.joints
        torque = np.zeros_like(signals.q)
        course = law(signals, j, k) * self.effort[list(self.joints_pushed)].min()
        torque[:, list(self.joints_pushed)] = self.size * course[:, None]
        return torque

    def depends_on(self, joint_names: list[str]) -> list[list[str]]:
        """Groups of signals that have to be named, in the words of `result.json`."""
        j, k = (joint_names[joint] for joint in self.joints)
        return [
            [
                name.removesuffix("_j") + f"_{j}" if name.endswith("_j") else name.removesuffix("_k") + f"_{k}"
                for name in group
            ]
            for group in STRANGERS[self.kind].signals
        ]


def build_stranger(kind: str, joint: int, other: int, effort: FloatArray, size: float) -> Stranger:
    """Place a law between two joints."""
    return Stranger(kind, (joint, other), size, effort=effort)
