"""What is believed of a cylinder where the robot file is believed: it was built to carry the weight.

A motion of thirty degrees shows little more of a cylinder than a spring, and shapes that fit it alike differ by
kilonewton metres a few degrees further on. Who builds one puts its dead point where the arm stands upright, so that it
pulls whichever way the arm leans. Upright is where all that hangs on the joint stands highest, averaged over whatever
the joints beyond it do; where it turns with the joints before, nothing is believed of it. Lengths are believed to be
about what the catalogue's grid has.
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
ONE_PLACE = 0.9
"""Length of the mean of the uprights at all places, over that of each, from which on there is one."""
MOST_BEYOND = 8
"""Joints beyond that are turned; what hangs further out has little weight."""
N_PLACES = 40
"""Places of the runs at which the joints before a cylinder's own are looked at."""


@dataclass(frozen=True)
class BuiltForWeight:
    """Where every joint stands upright (n_joints,) [rad], NaN where that is no one place; which carry weight."""

    upright: tuple[float, ...]
    carries: tuple[bool, ...]

    def allows(self, joint: int) -> bool:
        """Whether there is weight for a cylinder to carry."""
        return self.carries[joint]

    def supports(self, joint: int, q: FloatArray, torque: FloatArray) -> bool:
        """Whether a torque on a joint (n,) carries its weight along positions q (n,), rather than pressing it down."""
        weight = -np.sin(q - self.upright[joint])
        return bool(np.sum((weight - weight.mean()) * torque) < 0)  # false where no upright is known

    def doubt(self, hypothesis: Hypothesis) -> float:
        """How far the shape is from what such cylinders are: minus the logarithm of its probability, zero at best."""
        if hypothesis.kind != KIND:
            return 0.0
        shape = dict(hypothesis.shape)
        # One that pulls is shortest at its dead point, a strut is longest there: L^2 = a^2 + b^2 + 2ab cos(q + phase).
        dead_point = (np.pi if shape["gas_length"] > 0 else 0.0) - shape["phase"]
        upright = self.upright[hypothesis.joints[0]]
        beside = _angle(dead_point - upright) / BESIDE_UPRIGHT if np.isfinite(upright) else 0.0
        lever = _unlike_others("b", shape["b"] / shape["a"])
        column = _unlike_others("gas_length", shape["gas_length"] / shape["a"])
        return 0.5 * float(beside**2 + lever**2 + column**2) + (PUSHES if shape["gas_length"] < 0 else 0.0)

    def certainty(self, hypothesis: Hypothesis, name: str) -> float:
        """One over the variance that is believed of a shape parameter, near its value; zero where nothing is."""
        if hypothesis.kind != KIND:
            return 0.0
        if name == "phase":
            return 1 / BESIDE_UPRIGHT**2 if np.isfinite(self.upright[hypothesis.joints[0]]) else 0.0
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
    sines = np.stack([_weight(robot, places, j) for j in range(robot.n_joints)])
    sizes = np.hypot(*sines.transpose(2, 0, 1)).mean(axis=1)
    A, B = sines.mean(axis=1).T
    # Behind another joint that leans, upright turns with that joint: then it is no one place.
    one_place = np.hypot(A, B) > ONE_PLACE * sizes
    carries = sizes > LEAST_WEIGHT * sizes.max()
    upright = np.where(one_place & carries, np.arctan2(A, -B), np.nan)
    return BuiltForWeight(tuple(upright.tolist()), tuple(carries.tolist()))


def _weight(robot: _core.RobotModel, places: FloatArray, j: int) -> FloatArray:
    """A and B [N m] of the weight ``A cos q + B sin q = -R sin(q - upright)`` on revolute joint j, (n_places, 2).

    Averaged over turns of the joints beyond; zero on a slide.
    """
    if robot.joint_kinds[j] != "revolute":
        return np.zeros((len(places), 2))
    beyond = [k for k in range(j + 1, robot.n_joints) if robot.joint_kinds[k] == "revolute"][:MOST_BEYOND]
    # The weight is a sine of every angle, so that half a turn averages it away.
    turns = np.array(list(product((0.0, np.pi), repeat=len(beyond)))).reshape(2 ** len(beyond), len(beyond))
    q = np.repeat(places, len(turns), axis=0)
    q[:, beyond] += np.tile(turns, (len(places), 1))

    def weight(angle: float) -> FloatArray:
        q[:, j] = angle
        torque = robot.inverse_dynamics(q, 0 * q, 0 * q, np.asarray(robot.phi))[:, j]
        averaged: FloatArray = torque.reshape(len(places), len(turns)).mean(axis=1)
        return averaged

    return np.stack([weight(0.0) - weight(np.pi), weight(np.pi / 2) - weight(-np.pi / 2)], axis=1) / 2
