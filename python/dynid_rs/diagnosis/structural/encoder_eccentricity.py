"""`encoder_eccentricity` with one encoder: a position that is wrong once per turn, seen through the torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynid_rs.diagnosis.hypotheses import Hypothesis, standardised
from dynid_rs.diagnosis.setup import FloatArray, Setup
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.regression.linear_model import Columns

STEP = 1e-4
"""Of the derivative [rad]."""
USUAL = np.array([1e-3, 1e-3])
"""Usual amplitude of a badly centred encoder's error [rad]."""


def eccentricity_hypotheses(about: About, setup: Setup) -> list[Hypothesis]:
    """One per turning joint: cosine and sine part [rad] of what its encoder shows too much.

    With two encoders their difference shows it by itself, and far more clearly: no hypotheses here.
    """
    if any(states.two_encoders for states in about.fit.runs_):
        return []
    turning = [j for j, kind in enumerate(setup.robot.joint_kinds) if kind == "revolute"]
    return [
        Hypothesis(
            "encoder_eccentricity",
            (j,),
            ("cosine", "sine"),
            ("rad", "rad"),
            standardised(_slopes(about, j), USUAL),
            USUAL,
            np.tile([-np.inf, np.inf], (2, 1)),
            _acceptance(j),
        )
        for j in turning
    ]


def _slopes(about: About, joint: int) -> Columns:
    """Change of all joints' torque per rad of an error ``e = c cos q + s sin q`` of one joint's encoder.

    The true position is ``q - e``, so speed and acceleration lose ``e' dq`` and ``e' ddq + e'' dq^2``. What friction
    and rotor make of that is small beside gravity's part.
    """
    parts = []
    for states in about.fit.runs_:
        q, dq, ddq = (x[:, joint] for x in (states.q, states.dq, states.ddq))
        slopes = []
        for error, slope in ((np.cos(q), -np.sin(q)), (np.sin(q), np.cos(q))):
            torque = []
            for step in (STEP, -STEP):
                true = [x.copy() for x in (states.q, states.dq, states.ddq)]
                true[0][:, joint] -= step * error
                true[1][:, joint] -= step * slope * dq
                true[2][:, joint] -= step * (slope * ddq - error * dq**2)
                torque.append(about.fit.robot.inverse_dynamics(true[0], true[1], true[2], about.phi))
            slopes.append((torque[0] - torque[1]) / (2 * STEP))
        parts.append(np.stack(slopes, axis=2))
    return about.in_band(parts)


def added(setup: Setup, joint: int, change: FloatArray) -> Setup:
    """Return the setup with an encoder's error changed by `change` (2,) [rad]."""
    error = setup.encoder_error.copy()
    error[joint] += change
    return replace(setup, encoder_error=error)


def _acceptance(joint: int) -> Callable[[Setup, FloatArray], Setup]:
    return lambda setup, x: added(setup, joint, x)
