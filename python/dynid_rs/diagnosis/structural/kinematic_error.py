"""`kinematic_error`: a joint's frame is not where the robot file says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.candidate import Candidate, RunColumns
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.beside import Beside, in_band
from dynid_rs.diagnosis.structural.frames import with_displacement
from dynid_rs.diagnosis.structural.plausible import Plausible

FloatArray = NDArray[np.float64]

KIND = "kinematic_error"
STEP = 1e-5
"""Of the derivative [m, rad]."""
USUAL = np.array([5e-3, 5e-3, 5e-3, 1e-2, 1e-2, 1e-2])
"""Usual error of a robot file: offset [m], rotation [rad]. The prior that holds directions no torque shows."""
LEAST_SIGNAL = 3.0
"""A direction counts if a usual error in it stands above the noise of all rows by this, beside the whole model."""
LARGEST = 10.0
"""Most usual errors at once."""


def spread(value: FloatArray) -> FloatArray:
    """Standard deviations (6,) [m, rad] of a frame's error, of which `value` (6,) is what is seen.

    Where one part is out by ten usual errors, the parts that no torque shows may be as well.
    """
    largest: FloatArray = USUAL * max(1.0, float(np.max(np.abs(value) / USUAL)))
    return largest


def kinematic_candidates(beside: Beside, setup: Setup, plausible: Plausible) -> list[Candidate]:
    """Return one candidate per joint from the second on, in those directions that nothing else imitates.

    The first joint's frame carries the whole arm: to turn it is `gravity_tilt`, to shift it changes nothing.
    """
    candidates = []
    for joint in range(1, setup.robot.n_joints):
        columns = displacement_columns(beside, setup, plausible, joint)
        _, signal, directions = np.linalg.svd(beside.left(beside.stacked(columns)) * USUAL, full_matrices=False)
        kept = directions[signal > max(LEAST_SIGNAL, 1e-6 * signal[0])]
        if not len(kept):
            continue
        to_change = USUAL[:, None] * kept.T
        names = tuple(f"direction_{k}" for k in range(len(kept)))
        candidates.append(
            Candidate(
                KIND,
                (joint,),
                names,
                tuple("1" for _ in names),
                np.tile([-LARGEST, LARGEST], (len(names), 1)),
                [{j: rows @ to_change for j, rows in run.items()} for run in columns],
                _acceptance(joint, to_change),
            )
        )
    return candidates


def displacement_columns(beside: Beside, setup: Setup, plausible: Plausible, joint: int) -> list[RunColumns]:
    """Torque per offset [m] and rotation [rad] of a joint's frame, six columns per run."""
    moved = [[with_displacement(setup.robot, joint, h * e) for h in (STEP, -STEP)] for e in np.eye(6)]
    columns = []
    for states in beside.fit.runs_:
        motion = states.q, states.dq, states.ddq
        slopes = [
            (there.inverse_dynamics(*motion, plausible.phi) - back.inverse_dynamics(*motion, plausible.phi))
            / (2 * STEP)
            for there, back in moved
        ]
        columns.append(in_band(beside.fit, states, np.stack(slopes, axis=2)))
    return columns


def moved(setup: Setup, joint: int, change: FloatArray) -> Setup:
    """Return the setup with a joint's frame moved by `change` (6,) [m, rad], at most by `LARGEST` usual errors."""
    change = change * min(1.0, LARGEST / max(float(np.max(np.abs(change) / USUAL)), 1e-300))
    return replace(setup, robot=with_displacement(setup.robot, joint, change))


def _acceptance(joint: int, to_change: FloatArray) -> Callable[[Setup, FloatArray], Setup]:
    return lambda setup, x: moved(setup, joint, to_change @ x)
