"""`encoder_eccentricity` with one encoder: a position that is wrong once per turn, seen through the torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynid_rs.assembly import evaluate
from dynid_rs.diagnosis.candidate import Candidate, RunColumns
from dynid_rs.diagnosis.setup import FloatArray, Setup
from dynid_rs.diagnosis.structural.beside import Beside

KIND = "encoder_eccentricity"
STEP = 1e-4
"""Of the derivative [rad]."""


def eccentricity_candidates(beside: Beside, setup: Setup) -> list[Candidate]:
    """Return one candidate per turning joint: cosine and sine part [rad] of what its encoder shows too much.

    With two encoders their difference shows it by itself, and far more clearly: no candidates here.
    """
    if any(states.two_encoders for states in beside.fit.runs_):
        return []
    turning = [j for j, kind in enumerate(setup.robot.joint_kinds) if kind == "revolute"]
    return [
        Candidate(
            KIND,
            (j,),
            ("cosine", "sine"),
            ("rad", "rad"),
            np.tile([-1.0, 1.0], (2, 1)),
            eccentricity_columns(beside, j),
            _acceptance(j),
        )
        for j in turning
        if not np.any(setup.encoder_error[j])
    ]


def eccentricity_columns(beside: Beside, joint: int) -> list[RunColumns]:
    """Change of all joints' torque per rad of ``e = c cos q + s sin q`` that the encoder of `joint` shows too much.

    The true position is ``q - e``, so speed and acceleration lose ``e' dq`` and ``e' ddq + e'' dq^2``. The whole model
    is evaluated there: rotor and friction follow the same encoder.
    """
    fit = beside.fit
    columns: list[RunColumns] = []
    for states in fit.raw_runs_:
        q, dq, ddq = (x[:, joint] for x in (states.q, states.dq, states.ddq))
        slopes = []
        for error, slope in ((np.cos(q), -np.sin(q)), (np.sin(q), np.cos(q))):
            torque = []
            for step in (STEP, -STEP):
                true = [x.copy() for x in (states.q, states.dq, states.ddq)]
                true[0][:, joint] -= step * error
                true[1][:, joint] -= step * slope * dq
                true[2][:, joint] -= step * (slope * ddq - error * dq**2)
                there = replace(
                    states, q=true[0], dq=true[1], ddq=true[2], q_motor=true[0], dq_motor=true[1], ddq_motor=true[2]
                )
                torque.append(evaluate(fit.model_, there)[0])
            slopes.append((torque[0] - torque[1]) / (2 * STEP))
        rows = states.in_band(np.stack(slopes, axis=2))
        columns.append({j: rows[:, j] for j in range(rows.shape[1])})
    return columns


def added(setup: Setup, joint: int, change: FloatArray) -> Setup:
    """Return the setup with an encoder's error changed by `change` (2,) [rad]."""
    error = setup.encoder_error.copy()
    error[joint] += change
    return replace(setup, encoder_error=error)


def _acceptance(joint: int) -> Callable[[Setup, FloatArray], Setup]:
    return lambda setup, x: added(setup, joint, x)
