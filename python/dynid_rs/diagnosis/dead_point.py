"""What is believed of a cylinder where the robot file is believed: it was built to carry the weight.

A motion of thirty degrees shows little more of a cylinder than a spring, and shapes that fit it alike differ by
kilonewton metres a few degrees further on. Who builds one puts its dead point where the arm stands upright, so that it
pulls whichever way the arm leans. Upright is where the weight of all that hangs on the joint is highest, averaged over
whatever the joints beyond it do. Lengths are believed to be about what the catalogue's grid has.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.placed import CATALOGUE

FloatArray = NDArray[np.float64]

KIND = "counterbalance"
BESIDE_UPRIGHT = 0.2
"""How far [rad] a dead point lies beside the upright."""
PUSHES = 2.0
"""What stands against a strut that pushes: a rod that is pulled cannot buckle, and balancers of arms are built so."""
LEAST_WEIGHT = 0.01
"""Part of the most heavily loaded joint's weight from which on there is anything to carry."""
N_PLACES = 8
"""Places of the runs at which the joints before a cylinder's own are looked at."""


@dataclass(frozen=True)
class BuiltForWeight:
    """Where every joint stands upright (n_joints,) [rad]; NaN where it carries no weight."""

    upright: tuple[float, ...]

    def allows(self, joint: int) -> bool:
        """Whether there is weight for a cylinder to carry."""
        return bool(np.isfinite(self.upright[joint]))

    def doubt(self, hypothesis: Hypothesis) -> float:
        """How far the shape is from what such cylinders are: minus the logarithm of its probability, zero at best."""
        if hypothesis.kind != KIND:
            return 0.0
        shape = dict(hypothesis.shape)
        # One that pulls is shortest at its dead point, a strut is longest there: L^2 = a^2 + b^2 + 2ab cos(q + phase).
        dead_point = (np.pi if shape["gas_length"] > 0 else 0.0) - shape["phase"]
        beside = _angle(dead_point - self.upright[hypothesis.joints[0]]) / BESIDE_UPRIGHT
        lever = _unlike_others("b", shape["b"] / shape["a"])
        column = _unlike_others("gas_length", shape["gas_length"] / shape["a"])
        return 0.5 * float(beside**2 + lever**2 + column**2) + (PUSHES if shape["gas_length"] < 0 else 0.0)

    def certainty(self, hypothesis: Hypothesis, name: str) -> float:
        """One over the variance that is believed of a shape parameter, near its value; zero where nothing is."""
        if hypothesis.kind != KIND:
            return 0.0
        if name == "phase":
            return 1 / BESIDE_UPRIGHT**2
        length = dict(hypothesis.shape)[name]
        return 1 / (length * _of_others(name, length)[1]) ** 2


def _angle(turned: float) -> float:
    """The same angle within half a turn of zero [rad]."""
    return float(np.arctan2(np.sin(turned), np.cos(turned)))


def _unlike_others(name: str, length: float) -> float:
    """How far a length (of the longer lever) is from the catalogue's, over their scatter, both as logarithms."""
    mean, scatter = _of_others(name, length)
    return (float(np.log(abs(length))) - mean) / scatter


def _of_others(name: str, length: float) -> tuple[float, float]:
    """Mean and scatter of the logarithms of the catalogue's lengths that have the same sign."""
    (grid,) = (parameter["grid"] for parameter in CATALOGUE[KIND]["shape"] if parameter["name"] == name)
    others = np.log([abs(other) for other in grid if other * length > 0])
    return float(others.mean()), float(others.std())


def built_for_weight(robot: _core.RobotModel, q: FloatArray) -> BuiltForWeight:
    """What the robot file says of cylinders; `q` (n, n_joints) are places where the joints have been."""
    places = q[:: max(1, len(q) // N_PLACES)]
    sines = [_weight(robot, places, j) for j in range(robot.n_joints)]
    least = LEAST_WEIGHT * max(float(np.hypot(A, B)) for A, B in sines)
    return BuiltForWeight(tuple(float(np.arctan2(A, -B)) if np.hypot(A, B) > least else np.nan for A, B in sines))


def _weight(robot: _core.RobotModel, places: FloatArray, j: int) -> tuple[float, float]:
    """A and B [N m] of the weight ``A cos q + B sin q = -R sin(q - upright)`` on revolute joint j.

    Averaged over turns of the joints beyond; zero on a slide.
    """
    if robot.joint_kinds[j] != "revolute":
        return 0.0, 0.0
    beyond = [k for k in range(j + 1, robot.n_joints) if robot.joint_kinds[k] == "revolute"]
    # The weight is a sine of every angle, so that half a turn averages it away.
    turns = np.array(list(product((0.0, np.pi), repeat=len(beyond)))).reshape(2 ** len(beyond), len(beyond))
    q = np.repeat(places, len(turns), axis=0)
    q[:, beyond] += np.tile(turns, (len(places), 1))

    def weight(angle: float) -> float:
        q[:, j] = angle
        return float(robot.inverse_dynamics(q, 0 * q, 0 * q, np.asarray(robot.phi))[:, j].mean())

    return (weight(0.0) - weight(np.pi)) / 2, (weight(np.pi / 2) - weight(-np.pi / 2)) / 2
