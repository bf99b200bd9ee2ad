"""What a motion must keep beside its own limits: torque here, workspace and self-collision in their own files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.quoting import shown
from dynid_rs.base.units import torque_of
from dynid_rs.excitation.bounds import STEP, smooth_peak
from dynid_rs.excitation.limits import share

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel
    from dynid_rs.excitation.limits import ExcitationLimits

FloatArray = NDArray[np.float64]
Motion = tuple[FloatArray, FloatArray, FloatArray]


class StartError(ValueError):
    """The start violates a constraint already."""


class Constraint(Protocol):
    """Something that can be kept or violated by a motion: room is left (positive) or missing (negative)."""

    @property
    def name(self) -> str:
        """What it is, for people."""

    @property
    def stride(self) -> int:
        """Every how many-th point of the grid of the search is asked."""

    @property
    def fine_step(self) -> float:
        """Step of the grid of the final check [s]."""

    def smooth_room(self, motion: Motion, *, slopes: bool) -> tuple[float, Motion]:
        """Room that is left, smoothly, and its slopes in q, dq and ddq (n_samples, n_joints) each, if asked for."""

    def exact_room(self, motion: Motion) -> float:
        """Least room over all samples."""

    def describe(self) -> Any:
        """JSON that tells this constraint from another."""

    def report(self, motion: Motion) -> Any:
        """JSON with the exact extremes beside their bounds."""


class PhysicalLimits(Protocol):
    """A constraint as the user states it: nothing is read or loaded before it is bound to a robot."""

    def bind(self, robot: RobotModel, start: FloatArray) -> Constraint:
        """Return the constraint of `robot`; refuses a start that violates it already."""


class TorqueBound:
    """Torque of the links with the declared inertials, friction not counted, inside its limits.

    Parameters
    ----------
    robot : RobotModel
        With inertials.
    limits : ndarray (2, n_joints)
        Lower and upper; infinite where there is none.
    start : ndarray (n_joints,)
        Pose of the start, which must be held.

    Raises
    ------
    ValueError
        The robot declares no inertials, or a limit does not hold the arm at its start (`StartError`).
    """

    name = "torque"
    stride = 1
    fine_step = STEP

    def __init__(self, robot: RobotModel, limits: FloatArray, start: FloatArray) -> None:
        if not np.any(robot.phi):
            raise ValueError(
                "torque limits need the inertials of the links, and the robot declares none; "
                "add them to the robot file or leave the torque limits out"
            )
        self.robot = robot
        self.limits = np.array(limits, dtype=np.float64)
        shares = self._shares(self._torque((start[None], 0 * start[None], 0 * start[None])))[0]
        if shares.max() >= 1:
            joint = int(shares.argmax())
            holding = self._torque((start[None], 0 * start[None], 0 * start[None]))[0, joint]
            unit = torque_of("N*m", robot.joint_kinds[joint])
            raise StartError(
                f"holding the start pose takes {holding:.4g} {unit} at joint {robot.joint_names[joint]}, beyond its "
                f"torque limits {self.limits[0, joint]:g} and {self.limits[1, joint]:g}; choose another start or wider "
                "limits"
            )

    def smooth_room(self, motion: Motion, *, slopes: bool) -> tuple[float, Motion]:
        """Room left by the smooth greatest share of all joints and samples."""
        tau = self._torque(motion)
        peak, slope = smooth_peak(self._shares(tau).reshape(-1, 1))
        if not slopes:
            return float(1 - peak[0]), motion
        scale = np.where(tau > 0, self.limits[1], self.limits[0])
        direction = -slope.reshape(tau.shape) / scale
        return float(1 - peak[0]), _core.inverse_dynamics_gradient(self.robot, *motion, direction)

    def exact_room(self, motion: Motion) -> float:
        """One minus the greatest share."""
        return float(1 - self._shares(self._torque(motion)).max())

    def describe(self) -> Any:
        """Return the limits."""
        return ["torque", *(repr(value) for value in self.limits.ravel().tolist())]

    def report(self, motion: Motion) -> Any:
        """Return least and greatest torque of every joint beside the limits."""
        tau = self._torque(motion)
        finite = np.where(np.isfinite(self.limits), self.limits, np.nan)
        return {
            "least": tau.min(axis=0).tolist(),
            "greatest": tau.max(axis=0).tolist(),
            "lower": [None if np.isnan(value) else value for value in finite[0].tolist()],
            "upper": [None if np.isnan(value) else value for value in finite[1].tolist()],
            "units": [torque_of("N*m", kind) for kind in self.robot.joint_kinds],
            "kept": self.exact_room(motion) >= 0,
        }

    def _torque(self, motion: Motion) -> FloatArray:
        return self.robot.inverse_dynamics(*motion)

    def _shares(self, tau: FloatArray) -> FloatArray:
        return share(tau, self.limits)


def torque_bound(robot: RobotModel, limits: ExcitationLimits, start: FloatArray) -> TorqueBound | str:
    """Return the bound from `limits`, else from the robot file; or why there is none.

    A declared limit that does not hold the arm at its start is a placeholder (many files say 0, 1 or 10).
    """
    own = limits.torque is None
    if own and not np.any(robot.phi):
        return "torque is not limited: the robot file declares no inertials"
    size = usable_effort(robot, start)
    torque = np.stack([-size, size])
    if limits.torque is not None:
        torque = np.where(np.isnan(limits.torque), torque, limits.torque)
    if np.isfinite(torque).any():
        return TorqueBound(robot, torque, start)
    return (
        "torque is not limited: the robot file declares no effort that holds the arm" if own else "no torque is limited"
    )


def usable_effort(robot: RobotModel, start: FloatArray) -> FloatArray:
    """Declared effort (n_joints,) [N m, N] where it holds the arm at its start, else infinite."""
    declared, still = np.asarray(robot.effort_limits), 0 * start[None]
    holding = np.abs(robot.inverse_dynamics(start[None], still, still))[0]
    return np.where(declared > holding, declared, np.inf)


def unlimited_joints(bound: TorqueBound, start: FloatArray) -> tuple[str, ...]:
    """Name the joints whose declared effort does not hold the arm at its start, and so limits nothing (n_notes,)."""
    robot, declared = bound.robot, np.asarray(bound.robot.effort_limits)
    too_small = (declared > 0) & np.isfinite(declared) & np.isinf(usable_effort(robot, start))
    named = ", ".join(
        f"{shown(robot.joint_names[j])} ({declared[j]:g} {torque_of('N*m', robot.joint_kinds[j])})"
        for j in np.flatnonzero(too_small & np.isinf(bound.limits).all(axis=0))
    )
    why = "the declared effort does not hold the arm at its start; if it is meant, choose another start"
    return (f"torque is not limited at {named}: {why}",) if named else ()
