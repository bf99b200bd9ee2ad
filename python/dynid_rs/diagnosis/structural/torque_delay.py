"""`torque_delay`: the torque channel comes late against the encoders."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.hypotheses import Hypothesis, standardised
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.runs.slope import slope

FloatArray = NDArray[np.float64]

USUAL = np.array([5e-3])
"""Usual delay [s]: one cycle of a bus or two."""
LARGEST = 0.02
"""Longest change [s] at once: what is far is reached in steps."""
MOST = 0.5
"""A channel that is later or earlier [s] is none of the same motion; a model holds no longer delay."""


def delay_hypotheses(about: About, setup: Setup) -> list[Hypothesis]:
    """One for all joints together, as drives share a clock, and one for each joint that is late by itself.

    All encoders together may be late instead, those of one joint are another matter: one torque is never early.
    """
    every = tuple(range(setup.robot.n_joints))
    columns = standardised(lateness(about.fit), USUAL)
    alone = [(j,) for j in every if len(every) > 1]
    return [
        Hypothesis(
            "torque_delay",
            joints,
            ("delay",),
            ("s",),
            {j: columns[j] for j in joints},
            USUAL,
            np.array([[0.0 if len(joints) < len(every) else -np.inf, np.inf]]),
            partial(later, joints),
        )
        for joints in [every, *alone]
    ]


def lateness(fit: ThreeLoopIdentifier) -> dict[int, FloatArray]:
    """Change of the channel per second of delay, minus the predicted torque's rate, (n_rows, 1) per joint."""
    rows = []
    for states in fit.raw_runs_:
        torque = evaluate(fit.model_, states)[0]
        rows.append(states.in_band(-slope(torque, states.rate)))
    stacked = np.concatenate(rows)
    return {j: np.ascontiguousarray(stacked[:, j : j + 1]) for j in range(stacked.shape[1])}


def later(joints: tuple[int, ...], setup: Setup, x: FloatArray) -> Setup:
    """Return the setup with the joints' torque channels later by x (1,) [s], at most by `LARGEST` at once."""
    (before,) = delay_of(setup, joints)
    longest = MOST - float(np.abs(setup.delays[list(joints)] - before).max())
    earliest = -longest if _together(setup, joints) else 0.0
    delay = before + float(np.clip(x[0], -LARGEST, LARGEST))
    return with_delay(setup, joints, float(np.clip(delay, earliest, longest)))


def delay_of(setup: Setup, joints: tuple[int, ...]) -> FloatArray:
    """Delay [s] (1,) that is all joints' together, or what one joint has beyond that."""
    return np.array([setup.torque_delay if _together(setup, joints) else setup.own_delay[joints[0]]])


def with_delay(setup: Setup, joints: tuple[int, ...], delay: float) -> Setup:
    """Return the setup with `delay_of` these joints at `delay` [s]."""
    if _together(setup, joints):
        return replace(setup, torque_delay=delay)
    own = setup.own_delay.copy()
    own[list(joints)] = delay
    return replace(setup, own_delay=own)


def _together(setup: Setup, joints: tuple[int, ...]) -> bool:
    return len(joints) == setup.robot.n_joints
