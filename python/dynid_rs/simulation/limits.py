"""What a robot may do in a simulated experiment, where its file says so and where it does not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

_N_POSES = 256
_SPEED_UP = 2.5
"""Acceleration limit over velocity limit [1/s]: full speed after 0.4 s, as industrial arms do."""

_MAX_ACCELERATION = 10.0
_MANY = 3
_HALF_RANGE = {"revolute": np.pi, "prismatic": 0.5}
_VELOCITY = {"revolute": 2.0, "prismatic": 0.5}


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of the motion of each joint, all finite.

    Parameters
    ----------
    lower, upper : ndarray (n_joints,)
        Position [rad, m].
    velocity : ndarray (n_joints,)
        Greatest speed [rad/s, m/s].
    acceleration : ndarray (n_joints,)
        Greatest acceleration [rad/s^2, m/s^2].
    """

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def motion_limits(robot: RobotModel) -> MotionLimits:
    """Return the declared limits, with plausible ones where a robot declares none.

    A turning joint uses at most one turn, a sliding one without limits 1 m. URDF has no limit of
    acceleration (a robot.toml may have one): 2.5 times the speed per second, at most 10 rad/s^2.
    """
    half = np.array([_HALF_RANGE[kind] for kind in robot.joint_kinds])
    turning = np.array([kind == "revolute" for kind in robot.joint_kinds])
    declared_lower, declared_upper = np.asarray(robot.lower), np.asarray(robot.upper)
    lower = np.where(
        np.isfinite(declared_lower),
        declared_lower,
        np.where(np.isfinite(declared_upper), declared_upper - 2 * half, -half),
    )
    upper = np.where(np.isfinite(declared_upper), declared_upper, lower + 2 * half)
    middle, span = (lower + upper) / 2, upper - lower
    span = np.where(turning, np.minimum(span, 2 * half), span)
    fallback = np.array([_VELOCITY[kind] for kind in robot.joint_kinds])
    declared = np.asarray(robot.velocity_limits)
    velocity = np.where(np.isfinite(declared) & (declared > 0), declared, fallback)
    plausible, declared = np.minimum(_SPEED_UP * velocity, _MAX_ACCELERATION), np.asarray(robot.acceleration_limits)
    return MotionLimits(
        lower=middle - span / 2,
        upper=middle + span / 2,
        velocity=velocity,
        acceleration=np.where(np.isfinite(declared) & (declared > 0), declared, plausible),
    )


def typical_inertia(robot: RobotModel) -> FloatArray:
    """Median over random poses of the diagonal of the mass matrix (n_joints,) [kg m^2, kg]."""
    q = random_poses(motion_limits(robot))
    still = np.zeros_like(q)
    at_rest = robot.inverse_dynamics(q, still, still)
    diagonal = np.empty(q.shape[1])
    for joint in range(q.shape[1]):
        unit = still.copy()
        unit[:, joint] = 1.0
        diagonal[joint] = np.median((robot.inverse_dynamics(q, still, unit) - at_rest)[:, joint])
    return np.maximum(diagonal, 0.0)


def plausible_effort(robot: RobotModel) -> FloatArray:
    """Return the declared effort limits (n_joints,) [N m, N], or such that hold and move the arm.

    A declared limit that does not even carry the arm is a placeholder (many files say 0, 1 or 10), and so is
    one number for three joints or more if it is far above what they need (1000 or 10000).
    """
    limits = motion_limits(robot)
    q = random_poses(limits)
    rng = np.random.default_rng(1)
    dq, ddq = (0.5 * rng.uniform(-1, 1, q.shape) * limit for limit in (limits.velocity, limits.acceleration))
    still = np.zeros_like(q)
    holding = np.abs(robot.inverse_dynamics(q, still, still)).max(axis=0)
    moving = np.abs(robot.inverse_dynamics(q, dq, ddq)).max(axis=0) + limits.acceleration * np.asarray(
        robot.rotor_inertia
    )
    declared = np.asarray(robot.effort_limits)
    derived = np.maximum(2 * moving, 1.0)
    if declared.size >= _MANY and len(set(declared.tolist())) == 1:
        declared = np.where(declared > holding, np.minimum(declared, derived), declared)
    return np.where(np.isfinite(declared) & (declared > holding), declared, derived)


def random_poses(limits: MotionLimits) -> FloatArray:
    """Return poses within the limits (n, n_joints), always the same."""
    rng = np.random.default_rng(0)
    return np.asarray(rng.uniform(limits.lower, limits.upper, (_N_POSES, limits.lower.size)))
