"""What every joint may do while it is excited."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.quoting import shown
from dynid_rs.simulation.limits import motion_limits

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

LEAST_ROOM = 1e-3
"""Room from the start to a limit [rad, m] below which a joint counts as stuck."""
MOTIONS = ("position", "velocity", "acceleration")


@dataclass(frozen=True, eq=False)
class ExcitationLimits:
    """Limits of the motion and of the torque, rows lower and upper: (2, n_joints) each.

    Parameters
    ----------
    position, velocity, acceleration : ndarray (2, n_joints)
        Finite [rad, rad/s, rad/s^2; m for sliding joints]; velocity and acceleration below and above zero.
    torque : ndarray (2, n_joints), optional
        Of the links, friction not counted [N m, N]; infinite where there is no limit, NaN where it is the robot's own.
        None: all are the robot's own.

    Raises
    ------
    ValueError
        A limit is missing, not a number or turned round; names quantity and joint index.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray | None = None

    def __post_init__(self) -> None:
        n_joints = np.shape(self.position)[-1] if np.ndim(self.position) == 2 else 0
        for name in (*MOTIONS, "torque"):
            value = getattr(self, name)
            if value is None:
                continue
            array = np.array(value, dtype=np.float64)
            if array.shape != (2, n_joints) or n_joints == 0:
                raise ValueError(f"limits of {name} have shape {array.shape}, expected (2, n_joints): lower and upper")
            object.__setattr__(self, name, array)
            wrong = fault(name, array)
            if wrong is not None:
                raise ValueError(wrong)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.position.shape[1])

    @classmethod
    def symmetric(cls, position: Any, velocity: Any, acceleration: Any, torque: Any = None) -> ExcitationLimits:
        """Limits of equal size in both directions, (n_joints,) each."""

        def both(size: Any) -> FloatArray:
            array = np.asarray(size, dtype=np.float64)
            return np.stack([-array, array])

        return cls(both(position), both(velocity), both(acceleration), None if torque is None else both(torque))

    @classmethod
    def of_robot(cls, robot: RobotModel) -> ExcitationLimits:
        """Return the declared limits, with plausible ones where the robot declares none (URDF has no acceleration)."""
        declared = motion_limits(robot)
        position = np.stack([declared.lower, declared.upper])
        wrong = fault("position", position, robot.joint_names)
        if wrong is not None:
            raise ValueError(wrong)
        return cls(
            position,
            np.stack([-declared.velocity, declared.velocity]),
            np.stack([-declared.acceleration, declared.acceleration]),
        )

    def start(self, wanted: Any = None, joint_names: Sequence[str] | None = None) -> FloatArray:
        """Where the motion starts and ends (n_joints,): `wanted`, or zero, or the middle where zero is outside.

        Joints are called by their names where these are given, else by index.

        Raises
        ------
        ValueError
            `wanted` lies outside the limits or at one of them; or the limits leave no room to move.
        """
        lower, upper = self.position
        names = _names(joint_names, self.n_joints)
        tight = np.flatnonzero(upper - lower < 2 * LEAST_ROOM)
        if tight.size:
            joint = int(tight[0])
            raise ValueError(
                f"the position of joint {names[joint]} may only lie between {lower[joint]:g} and {upper[joint]:g}, "
                f"which leaves no room to move; widen these limits to {2 * LEAST_ROOM:g} at least, or fix the joint"
            )
        if wanted is None:
            inside = (lower + LEAST_ROOM <= 0) & (upper - LEAST_ROOM >= 0)
            return np.where(inside, 0.0, (lower + upper) / 2)
        start = np.array(wanted, dtype=np.float64)
        if start.shape != (self.n_joints,):
            raise ValueError(f"start has shape {start.shape}, expected ({self.n_joints},), one position per joint")
        # Written so that a NaN fails too.
        outside = np.flatnonzero(~((start >= lower + LEAST_ROOM) & (start <= upper - LEAST_ROOM)))
        if outside.size:
            joint = int(outside[0])
            raise ValueError(
                f"the start of joint {names[joint]} is {start[joint]:g}, outside its limits {lower[joint]:g} and "
                f"{upper[joint]:g} or within {LEAST_ROOM:g} of one; choose a start between them"
            )
        return start


def fault(quantity: str, limits: FloatArray, joint_names: Sequence[str] | None = None) -> str | None:
    """What is wrong with limits (2, n_joints) of a quantity, in one sentence, or None; joints by name or by index."""
    if quantity == "torque":
        limits = np.where(np.isnan(limits), [[-np.inf], [np.inf]], limits)
    for joint, (lower, upper) in zip(_names(joint_names, limits.shape[1]), limits.T.tolist(), strict=True):
        where = f"{quantity} of joint {joint}"
        if np.isnan([lower, upper]).any() or (quantity != "torque" and not np.isfinite([lower, upper]).all()):
            return f"the limits of {where} are {lower:g} and {upper:g}, expected finite numbers"
        if quantity == "position" and lower == upper:
            return (
                f"joint {joint} is locked at {lower:g} by its limits; widen them, or make the joint fixed in the robot "
                "file"
            )
        if not lower < upper:
            return f"the lower limit of {where} is {lower:g} and the upper one {upper:g}; exchange or widen them"
        if quantity != "position" and not lower < 0 < upper:
            return (
                f"the limits of {where} are {lower:g} and {upper:g}; zero must lie between them, "
                "because the joint starts and ends at rest"
            )
    return None


def _names(joint_names: Sequence[str] | None, n: int) -> list[str]:
    return [str(joint) for joint in range(n)] if joint_names is None else [shown(name) for name in joint_names]


def share(signal: FloatArray, limits: FloatArray) -> FloatArray:
    """How much of its limit (2, n) a signal (m, n) uses, sample by sample: 1 at the limit of its side."""
    # Lower limits are negative, so that the side a signal is not on counts below zero.
    return np.asarray(np.maximum(signal / limits[1], signal / limits[0]))
