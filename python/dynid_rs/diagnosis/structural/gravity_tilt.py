"""`gravity_tilt`: the base is not level. One rotation of gravity explains all joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.candidate import Candidate
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.beside import Beside, in_band
from dynid_rs.diagnosis.structural.frames import tilt_of, tilted_gravity
from dynid_rs.diagnosis.structural.plausible import Plausible
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

KIND = "gravity_tilt"
STEP = 1e-4
"""Of the derivative of gravity [rad]."""
USUAL = 0.03
"""Tilt [rad] for which unseen parameters are looked at."""
LEAST_SIGNAL = 0.1
"""What unseen parameters may do counts above this, in standard deviations of the noise over all independent rows: low,
since what the noise is taken for holds the tilt itself."""
N_SAMPLES = 150
"""States of the runs on which unseen parameters are looked for."""
WORTH = 0.2
"""Independent samples that a row is taken for in that."""
LARGEST_STEP = 0.6
"""Longest turn at once [rad]: a base on a wall is reached in steps."""


def tilt_candidates(beside: Beside, setup: Setup, plausible: Plausible) -> list[Candidate]:
    """Return the candidate: roll and pitch, then what parameters that level gravity hides can add.

    On a vertical first axis level gravity pulls without torque, and nothing tells where the links' masses are about
    that axis. Tilted gravity does pull, so that those unseen parameters act with any tilt; their columns are part of
    the hypothesis. With the effect accepted they are base parameters like the others.
    """
    if not np.any(setup.robot.gravity):
        return []
    fit = beside.fit
    robot = setup.robot
    pulls = gravity_steps(setup.declared, setup.robot)
    directions = [(pulls[0], plausible.phi), (pulls[1], plausible.phi)]
    weights = beside.weights * fit.links_.torque_scale_
    unseen = unseen_directions(robot, fit.runs_, weights, fit.observations_.n_rows, pulls, plausible)
    columns = []
    for states in fit.runs_:
        still = np.zeros_like(states.q)
        torque = [robot.with_gravity(g.tolist()).inverse_dynamics(states.q, still, still, phi) for g, phi in directions]
        extra = [
            sum(robot.with_gravity(g.tolist()).inverse_dynamics(states.q, still, still, phi) for g, phi in pair)
            for pair in unseen
        ]
        columns.append(in_band(fit, states, np.stack([*torque, *extra], axis=2)))
    names = ("roll", "pitch", *(f"unseen_{k}" for k in range(len(unseen))))
    return [
        Candidate(
            KIND,
            tuple(range(robot.n_joints)),
            names,
            ("rad", "rad", *("1" for _ in unseen)),
            np.tile([-np.inf, np.inf], (len(names), 1)),
            columns,
            lambda setup, x: turned(setup, x[:2]),
        )
    ]


def turned(setup: Setup, change: FloatArray) -> Setup:
    """Return the setup with roll and pitch [rad] changed by `change` (2,), at most by `LARGEST_STEP` at once."""
    change = change * min(1.0, LARGEST_STEP / max(float(np.linalg.norm(change)), 1e-300))
    roll, pitch = tilt_of(setup.declared, setup.robot)
    gravity = tilted_gravity(setup.declared.gravity, roll + change[0], pitch + change[1])
    return replace(setup, robot=setup.robot.with_gravity(gravity.tolist()))


def gravity_steps(declared: _core.RobotModel, robot: _core.RobotModel) -> list[FloatArray]:
    """Change of gravity (3,) [m/s^2] per rad of roll and of pitch, where `robot` stands."""
    now = np.array(tilt_of(declared, robot))
    steps = []
    for k in range(2):
        change = STEP * np.eye(2)[k]
        high, low = (tilted_gravity(declared.gravity, *(now + sign * change)) for sign in (1, -1))
        steps.append((high - low) / (2 * STEP))
    return steps


def unseen_directions(
    robot: _core.RobotModel,
    runs: Sequence[States],
    weights: FloatArray,
    n_rows: int,
    pulls: Sequence[FloatArray],
    plausible: Plausible,
) -> list[list[tuple[FloatArray, FloatArray]]]:
    """Pairs of gravity and phi whose torque a usual tilt may add beyond base parameters and the tilt itself.

    Parameters
    ----------
    robot, runs : RobotModel, sequence of States
        As they are believed to be, and where they were.
    weights : ndarray (n_joints,)
        Torque channel per N m, over its noise.
    n_rows : int
        Of the fit, per joint.
    pulls : (2,) of ndarray (3,)
        Change of gravity per rad of roll and pitch.
    plausible : Plausible
        Inertial parameters and what is not known of them.
    """
    moving = [np.flatnonzero(states.moving) for states in runs]
    at = [kept[:: max(1, len(runs) * len(kept) // N_SAMPLES)] for kept in moving]
    q, dq, ddq = (
        np.concatenate([getattr(states, name)[kept] for states, kept in zip(runs, at, strict=True)])
        for name in ("q", "dq", "ddq")
    )
    weight = weights[:, None]
    seen = (weight * robot.joint_torque_regressor(q, dq, ddq)).reshape(-1, len(plausible.phi))
    still = np.zeros_like(q)
    regressors = [
        (weight * robot.with_gravity(g.tolist()).joint_torque_regressor(q, still, still)).reshape(len(seen), -1)
        for g in pulls
    ]
    known = np.column_stack([seen, *(Y @ plausible.phi for Y in regressors)])
    norms = np.linalg.norm(known, axis=0)
    u, s, _ = np.linalg.svd(known[:, norms > 0] / norms[norms > 0], full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    added = USUAL * np.concatenate([Y @ plausible.root for Y in regressors], axis=1)
    added -= u @ (u.T @ added)
    _, s, vt = np.linalg.svd(added, full_matrices=False)
    signal = s * np.sqrt(WORTH * n_rows / len(q))
    width = plausible.root.shape[1]
    return [
        [(g, USUAL * plausible.root @ v[k * width : (k + 1) * width]) for k, g in enumerate(pulls)]
        for v in vt[signal > LEAST_SIGNAL]
    ]
