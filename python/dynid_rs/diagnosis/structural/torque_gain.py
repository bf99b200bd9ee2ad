"""`torque_gain`: one joint's torque channel shows a multiple of the torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.hypotheses import Hypothesis, standardised
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.identification.loads import load_rows
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.scales import SCALE_SPREAD

FloatArray = NDArray[np.float64]

USUAL = np.array([0.1])
"""Usual error of a gain."""
MOST_GAIN = 3.0
"""A channel that shows more than so many times the torque, or less than its inverse, is in another unit: no gain."""


def gain_hypotheses(about: About, setup: Setup) -> list[Hypothesis]:
    """One per joint whose gain is not fitted yet: its predicted rigid-body torque.

    Gains show through the parameters that joints share, so at least one joint keeps the unit; in ampere the gains of
    all joints but the first are fitted in every model.
    """
    fit, n = about.fit, setup.robot.n_joints
    if fit.torque_unit_ != "N*m" or len(setup.gain_joints) >= n - 1:
        return []
    found = []
    for j, load in enumerate(load_rows(fit.observations_, fit.links_)):
        if j not in setup.gain_joints and np.any(load):
            found.append(
                Hypothesis(
                    "torque_gain",
                    (j,),
                    ("gain",),
                    ("1",),
                    standardised({j: load[:, None]}, USUAL),
                    USUAL,
                    np.array([[1 / MOST_GAIN - 1, MOST_GAIN - 1]]),
                    _acceptance(j),
                    sizes=(1.0,),
                )
            )
    return found


def gain_spread(fit: ThreeLoopIdentifier, j: int, std: FloatArray) -> float | None:
    """Standard deviation of the logarithm of joint j's gain; None where it is not fitted.

    `std` is that of all unknowns of the model that diagnosis makes of the fit: gains stand behind the fit's own.
    """
    free = np.flatnonzero(fit.links_.torque_scale_ != 1.0).tolist()
    if j not in free:
        return None
    return SCALE_SPREAD * float(std[fit.observations_.plan.n_columns + free.index(j)])


def _acceptance(joint: int) -> Callable[[Setup, FloatArray], Setup]:
    def accepted(setup: Setup, x: FloatArray) -> Setup:
        gains = tuple(sorted({*setup.gain_joints, joint}))
        return replace(setup, gain_joints=gains) if len(gains) < setup.robot.n_joints else setup

    return accepted
