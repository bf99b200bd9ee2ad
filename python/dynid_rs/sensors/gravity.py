"""Another gravity than the robot's: a base that hangs, stands on a wall or on a slope, or another size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import ArmFit
from dynid_rs.sensors.rows import Moments

FloatArray = NDArray[np.float64]

EARTH = 9.81
"""Free fall [m/s^2]: 9.78 at the equator, 9.83 at the poles."""
ELSEWHERE = 0.02
"""Relative difference from which on a size is not Earth's, and Earth's is tried too."""
STEPS = (0.4, 0.2, 0.1, 0.05)
"""Turns [rad] that are tried about the best direction so far, one after the other."""
GRAIN = 1.5 * STEPS[-1]
"""Turn [rad] up to which a direction is the robot's own: the last steps across it, and what they may be off by. A base
that is so little off level is a tilt, which a diagnosis names."""


def gravity_trial(bench: Bench, fitted: Callable[[_core.RobotModel], ArmFit] | None = None) -> tuple[Trial, FloatArray]:
    """The gravity (3,) [m/s^2] under which the runs are most probable: any direction, the robot's size or Earth's.

    `fitted` explains the runs with another robot; as they stand on the bench by default.
    """

    def tried(gravity: FloatArray) -> Trial:
        robot = bench.robot.with_gravity(gravity.tolist())
        fit = _as_they_stand(bench, robot) if fitted is None else fitted(robot)
        return Trial("mounting", tuple(range(robot.n_joints)), tuple(range(len(bench.rows))), fit)

    declared = float(np.linalg.norm(bench.robot.gravity))
    strengths = [declared] if declared > 0 else []
    if abs(declared - EARTH) > ELSEWHERE * EARTH:
        strengths.append(EARTH)
    corners = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    directions = [corner / np.linalg.norm(corner) for corner in corners if np.any(corner)]
    starts = [(strength, direction) for strength in strengths for direction in directions]
    trials = [tried(strength * direction) for strength, direction in starts]
    best = max(range(len(trials)), key=lambda k: trials[k].fit.log)
    trial, (strength, direction) = trials[best], starts[best]
    for step in STEPS:
        for across in _across(direction):
            for turn in (step, -step):
                turned = np.cos(turn) * direction + np.sin(turn) * across
                other = tried(strength * turned)
                if other.fit.log > trial.fit.log:
                    trial, direction = other, turned / np.linalg.norm(turned)
                    break
    return trial, strength * direction


def is_another(gravity: FloatArray, declared: FloatArray) -> bool:
    """Whether a gravity (3,) is of another size than the robot's, or from further away than the search's grain."""
    size, was = float(np.linalg.norm(gravity)), float(np.linalg.norm(declared))
    if abs(size - was) > ELSEWHERE * was:
        return True
    return float(gravity @ declared) < float(np.cos(GRAIN)) * size * was


def _as_they_stand(bench: Bench, robot: _core.RobotModel) -> ArmFit:
    n = robot.n_joints
    return bench.fitted([Moments.of(robot, rows).picked(range(n)) for rows in bench.rows])


def _across(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (3,) at right angles to a direction and to each other."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
