"""`kinematic_error`: a joint's frame is not where the robot file says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.hypotheses import Hypothesis, standardised
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.model.placement import with_displacement

FloatArray = NDArray[np.float64]

STEP = 1e-5
"""Of the derivative [m, rad]."""
USUAL = np.array([5e-3, 5e-3, 5e-3, 1e-2, 1e-2, 1e-2])
"""Usual error of a robot file: offset [m], rotation [rad]."""
LARGEST = 10.0
"""Most usual errors at once."""


def kinematic_hypotheses(about: About, setup: Setup) -> list[Hypothesis]:
    """One per joint from the second on: offset and rotation of its frame.

    The first joint's frame carries the whole arm: to turn it is `gravity_tilt`, to shift it changes nothing.
    """
    return [
        Hypothesis(
            "kinematic_error",
            (joint,),
            ("x", "y", "z", "rx", "ry", "rz"),
            ("m", "m", "m", "rad", "rad", "rad"),
            standardised(about.in_band(_slopes(about, setup, joint)), USUAL),
            USUAL,
            np.tile([-np.inf, np.inf], (6, 1)),
            _acceptance(joint),
            sizes=(1.0,),
        )
        for joint in range(1, setup.robot.n_joints)
    ]


def _slopes(about: About, setup: Setup, joint: int) -> list[FloatArray]:
    """Torque per offset [m] and rotation [rad] of a joint's frame, (n, n_joints, 6) per run."""
    moved = [[with_displacement(setup.robot, joint, h * e) for h in (STEP, -STEP)] for e in np.eye(6)]
    slopes = []
    for states in about.fit.runs_:
        motion = states.q, states.dq, states.ddq
        ends = [[there.inverse_dynamics(*motion, about.phi) for there in pair] for pair in moved]
        slopes.append(np.stack([(there - back) / (2 * STEP) for there, back in ends], axis=2))
    return slopes


def _acceptance(joint: int) -> Callable[[Setup, FloatArray], Setup]:
    def accept(setup: Setup, change: FloatArray) -> Setup:
        change = change * min(1.0, LARGEST / max(float(np.max(np.abs(change) / USUAL)), 1e-300))
        return replace(setup, robot=with_displacement(setup.robot, joint, change))

    return accept
