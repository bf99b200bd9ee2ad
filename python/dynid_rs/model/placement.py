"""Where gravity and joint frames are, against what the robot file says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]

STEP = 1e-4
"""Of the derivative of gravity [rad]."""
SAME = 1e-12
"""Displacements [m, rad] below this are rounding."""


def tilted_gravity(gravity: FloatArray, roll: float, pitch: float) -> FloatArray:
    """Gravity (3,) in the frame of a base that stands turned by ``Ry(pitch) Rx(roll)`` [rad] against the declared one.

    The axes are the base's own where gravity is declared along z; else those of the frame that the shortest turn
    brings there (a base on a wall rolls and pitches about horizontal axes too).
    """
    from scipy.spatial.transform import Rotation

    level = _level(gravity)
    result: FloatArray = level.inv().apply(
        Rotation.from_euler("xyz", [roll, pitch, 0.0]).inv().apply(level.apply(gravity))
    )
    return result


def tilt_of(declared: _core.RobotModel, robot: _core.RobotModel) -> tuple[float, float]:
    """Roll and pitch [rad] by which the base of `robot` is turned against `declared`."""
    x, y, z = _level(declared.gravity).apply(robot.gravity) / max(float(np.linalg.norm(robot.gravity)), 1e-300)
    return float(np.arctan2(-y, -z)), float(np.arcsin(np.clip(x, -1.0, 1.0)))


def gravity_steps(declared: _core.RobotModel, robot: _core.RobotModel) -> list[FloatArray]:
    """Change of gravity (3,) [m/s^2] per rad of roll and of pitch, where `robot` stands."""
    now = np.array(tilt_of(declared, robot))
    steps = []
    for k in range(2):
        change = STEP * np.eye(2)[k]
        high, low = (tilted_gravity(declared.gravity, *(now + sign * change)) for sign in (1, -1))
        steps.append((high - low) / (2 * STEP))
    return steps


def displacement(declared: _core.RobotModel, robot: _core.RobotModel, joint: int) -> FloatArray:
    """How far a joint's frame sits from its declared place: offset [m] and rotation vector [rad], (6,).

    What `declared.with_joint_moved(joint, offset, rotation_vector)` takes.
    """
    from scipy.spatial.transform import Rotation

    (place, turn), (place_now, turn_now) = (_frame(model, joint) for model in (declared, robot))
    return np.concatenate([place_now - place, Rotation.from_matrix(turn.T @ turn_now).as_rotvec()])


def is_placed_alike(one: _core.RobotModel, other: _core.RobotModel) -> bool:
    """Whether gravity and every joint's frame are those of another model of the same arm, but for rounding."""
    moved = [displacement(one, other, j) for j in range(one.n_joints)]
    return one is other or (
        bool(np.allclose(one.gravity, other.gravity, rtol=0.0, atol=SAME))
        and bool(np.allclose(moved, 0.0, rtol=0.0, atol=SAME))
    )


def with_displacement(robot: _core.RobotModel, joint: int, change: FloatArray) -> _core.RobotModel:
    """Return the robot with a joint's frame moved by `change` (6,) [m, rad]."""
    return robot.with_joint_moved(joint, change[:3].tolist(), change[3:].tolist())


def _level(gravity: FloatArray):  # type: ignore[no-untyped-def]  # scipy's Rotation, imported late
    """Rotation that takes the declared gravity to minus z, by the shortest way."""
    from scipy.spatial.transform import Rotation

    down = np.asarray(gravity) / max(float(np.linalg.norm(gravity)), 1e-300)
    axis = np.cross(down, [0.0, 0.0, -1.0])
    sine, cosine = float(np.linalg.norm(axis)), -float(down[2])
    if sine < SAME:
        return Rotation.identity() if cosine >= 0 else Rotation.from_rotvec([np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine))


def _frame(robot: _core.RobotModel, joint: int) -> tuple[FloatArray, FloatArray]:
    """Place (3,) and orientation (3, 3) of a joint's frame in its parent link's."""
    points = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    place, turn = np.zeros(3), np.eye(3)
    frames = []
    for link in range(max(joint - 1, 0), joint + 1):
        at = _core.point_places(robot, np.zeros((1, robot.n_joints)), [link] * 4, points)[0]
        frames.append((at[0], (at[1:] - at[0]).T))
    if joint > 0:
        place, turn = frames[0]
    own_place, own_turn = frames[-1]
    return turn.T @ (own_place - place), turn.T @ own_turn
