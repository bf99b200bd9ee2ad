"""`gravity_tilt`: the base is not level. One rotation of gravity explains all joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.hypotheses import Hypothesis, standardised
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.model.placement import gravity_steps, tilted_gravity

FloatArray = NDArray[np.float64]

USUAL = 0.03
"""Usual tilt of a base [rad]."""
LARGEST_STEP = 0.6
"""Longest turn at once [rad]: what is far is reached in steps."""
UNSEEN = 4
"""Directions of inertials that level gravity hides and a tilt brings out, the strongest first, that stand beside it."""
N_SHOWN = 50
"""Positions, of all runs, that tell which directions those are."""


def tilt_hypotheses(about: About, setup: Setup) -> list[Hypothesis]:
    """Roll and pitch against where the base stands now, then what inertials that level gravity hides can add.

    On a vertical first axis level gravity pulls without torque, and nothing tells where the links' masses are about
    that axis. Tilted gravity does pull, so those unseen parameters act with any tilt.
    """
    if not np.any(setup.robot.gravity):
        return []
    pulls = [setup.robot.with_gravity(g.tolist()) for g in gravity_steps(setup.robot, setup.robot)]
    columns = []
    for states in about.fit.runs_:
        still = np.zeros_like(states.q)
        seen = [pull.inverse_dynamics(states.q, still, still, about.phi) for pull in pulls]
        unseen = [pull.inverse_dynamics(states.q, still, still, phi) for phi, pull in _unseen(about, pulls)]
        columns.append(np.stack([*seen, *(USUAL * torque for torque in unseen)], axis=2))
    n_unseen = columns[0].shape[2] - 2
    unit = np.array([USUAL, USUAL, *[1.0] * n_unseen])
    return [
        Hypothesis(
            "gravity_tilt",
            tuple(range(setup.robot.n_joints)),
            ("roll", "pitch", *(f"unseen_{k}" for k in range(n_unseen))),
            ("rad", "rad", *["1"] * n_unseen),
            standardised(about.in_band(columns), unit),
            unit,
            np.tile([-np.inf, np.inf], (len(unit), 1)),
            lambda setup, x: turned(setup, x[:2]),
        )
    ]


def turned(setup: Setup, change: FloatArray) -> Setup:
    """Return the setup with the base turned by roll and pitch [rad], by at most `LARGEST_STEP` at once.

    Against where it stands now: against a level base a roll would do nothing to one on a wall.
    """
    change = change * min(1.0, LARGEST_STEP / max(float(np.linalg.norm(change)), 1e-300))
    gravity = tilted_gravity(setup.robot.gravity, *change)
    return replace(setup, robot=setup.robot.with_gravity(gravity.tolist()))


def _unseen(about: About, pulls: Sequence[_core.RobotModel]) -> list[tuple[FloatArray, _core.RobotModel]]:
    """Inertials (10 n_links,) that the runs have not shown, each with the pull that would, the strongest first."""
    every = np.concatenate([states.q[states.rows] for states in about.fit.runs_])
    q = np.ascontiguousarray(every[:: max(1, len(every) // N_SHOWN)])
    still = np.zeros_like(q)
    found = []
    for pull in pulls:
        shown = pull.joint_torque_regressor(q, still, still).reshape(-1, len(about.phi)) @ about.root
        _, s, vt = np.linalg.svd(shown, full_matrices=False)
        found += [(strength, about.root @ v, pull) for strength, v in zip(s, vt, strict=True) if strength > 1e-6 * s[0]]
    found.sort(key=lambda each: -each[0])
    return [(phi, pull) for _, phi, pull in found[:UNSEEN]]
