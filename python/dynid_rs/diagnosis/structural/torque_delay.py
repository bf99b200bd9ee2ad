"""`torque_delay`: the torque channel comes late against the encoders."""

from __future__ import annotations

from dataclasses import replace

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
    """One for all joints together: drives share a clock, and physics that lags on one joint looks like a late drive."""
    return [
        Hypothesis(
            "torque_delay",
            tuple(range(setup.robot.n_joints)),
            ("delay",),
            ("s",),
            standardised(lateness(about.fit), USUAL),
            USUAL,
            np.array([[-np.inf, np.inf]]),
            later,
        )
    ]


def lateness(fit: ThreeLoopIdentifier) -> dict[int, FloatArray]:
    """Change of the channel per second of delay, minus the predicted torque's rate, (n_rows, 1) per joint."""
    rows = []
    for states in fit.raw_runs_:
        torque = evaluate(fit.model_, states)[0]
        rows.append(states.in_band(-slope(torque, states.rate)))
    stacked = np.concatenate(rows)
    return {j: np.ascontiguousarray(stacked[:, j : j + 1]) for j in range(stacked.shape[1])}


def later(setup: Setup, x: FloatArray) -> Setup:
    """Return the setup with the torque channel later by x (1,) [s], at most by `LARGEST` at once."""
    delay = setup.torque_delay + float(np.clip(x[0], -LARGEST, LARGEST))
    return replace(setup, torque_delay=float(np.clip(delay, -MOST, MOST)))
