"""What every effect of the laboratory is: hooks into the simulated arm, and what `truth.json` says of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Signals:
    """What really happens in the arm: arrays (n, n_joints), noiseless, on one clock.

    Parameters
    ----------
    t : ndarray (n,)
        [s], uniform where the effect has a memory.
    q, dq, ddq : ndarray
        Link side.
    q_motor, dq_motor, ddq_motor : ndarray
        Motor side, reduced.
    tau_link : ndarray
        Rigid-body torque [N m].
    tau_motor : ndarray
        Torque of the motors before what effects add on their side [N m].
    friction : ndarray
        Torque of the declared friction [N m].
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    q_motor: FloatArray
    dq_motor: FloatArray
    ddq_motor: FloatArray
    tau_link: FloatArray
    tau_motor: FloatArray
    friction: FloatArray


@dataclass(frozen=True, eq=False)
class Readings:
    """What the sensors of one run show before noise and steps; arrays (n, n_joints).

    Parameters
    ----------
    q, dq, ddq : ndarray
        Link channel.
    tau : ndarray
        Torque channel.
    temperature : ndarray, optional
        [degC].
    """

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    temperature: FloatArray | None = None


@dataclass(frozen=True)
class Value:
    """One number, or one per joint that the effect acts on, for people and programs."""

    name: str
    value: object
    unit: str


@dataclass(frozen=True, eq=False)
class LabEffect:
    """An effect that does nothing: each kind overrides the hooks that it needs.

    Parameters
    ----------
    kind : str
        Name in the catalogue.
    joints : tuple of int
        Where it acts; all joints for an effect of the whole robot.
    size : float
        Multiple of the default size.
    values : tuple of Value
        What `truth.json` says about it.
    """

    kind: str
    joints: tuple[int, ...]
    size: float = 1.0
    values: tuple[Value, ...] = field(default=())

    @property
    def yields(self) -> bool:
        """Whether it adds to the wind-up of gears."""
        return False

    @property
    def remembers(self) -> bool:
        """Whether its torque depends on the past: it is then evaluated on a fine grid from time 0 on."""
        return False

    def mount(self, arm: SimulatedArm) -> SimulatedArm:
        """Change the arm itself: masses, geometry, gears, the clock of a channel."""
        return arm

    def of_run(self, run: int, duration: float, rng: np.random.Generator) -> LabEffect:
        """Return what acts in one run [duration in s], where that differs from run to run."""
        return self

    def deflection(self, tau_gear: FloatArray) -> FloatArray | None:
        """Further wind-up (n, n_joints) [rad] of gears that transmit `tau_gear` (n, n_joints) [N m]."""
        return None

    def link_torque(self, arm: SimulatedArm, t: FloatArray, q: FloatArray) -> FloatArray | None:
        """Torque (n, n_joints) [N m] that the gears must give to the links beside the rigid body's."""
        return None

    def motor_torque(self, arm: SimulatedArm, signals: Signals) -> FloatArray | None:
        """Torque (n, n_joints) [N m] that the motors must give beside what the gears transmit."""
        return None

    @property
    def lag(self) -> FloatArray | None:
        """How late the torque channel is (n_joints,) [s]."""
        return None

    def read(self, readings: Readings, t: FloatArray) -> Readings:
        """What the sensors make of it."""
        return readings

    def to_json(self, joint_names: Sequence[str]) -> dict[str, object]:
        """Return kind, place and every number with its unit."""
        return {
            "kind": self.kind,
            "joints": [joint_names[joint] for joint in self.joints],
            "size": self.size,
            "parameters": [{"name": v.name, "value": v.value, "unit": v.unit} for v in self.values],
        }


def at_joints(joints: Sequence[int], n_joints: int, value: ArrayLike) -> FloatArray:
    """Return zeros (n_joints,) with `value` at `joints`; one number, or one per joint of the arm."""
    out = np.zeros(n_joints)
    spread = np.broadcast_to(np.asarray(value, dtype=np.float64), (n_joints,))
    out[list(joints)] = spread[list(joints)]
    return out


def equip(arm: SimulatedArm, effects: Sequence[LabEffect]) -> SimulatedArm:
    """Return the arm with further effects, in their order."""
    for effect in effects:
        mounted = effect.mount(arm)
        arm = replace(mounted, effects=(*mounted.effects, effect))
    return arm
