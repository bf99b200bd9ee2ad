"""`torque_gain`: one joint's torque channel shows a multiple of the torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynid_rs.diagnosis.candidate import Candidate
from dynid_rs.diagnosis.setup import FloatArray, Setup
from dynid_rs.diagnosis.structural.beside import Beside

KIND = "torque_gain"
MOST_GAIN = 3.0
"""A channel that shows more than so many times the torque, or less than its inverse, is in another unit: no gain."""


def gain_candidates(beside: Beside, setup: Setup) -> list[Candidate]:
    """Return one candidate per joint whose gain is not fitted yet: its predicted rigid-body torque.

    Gains show through the parameters that joints share, so at least one joint keeps the unit; in ampere the gains of
    all joints but the first are fitted in every model.
    """
    fit = beside.fit
    n = setup.robot.n_joints
    if fit.torque_unit_ != "N*m" or len(setup.gain_joints) >= n - 1:
        return []
    observations, links = fit.observations_, fit.links_
    plan = observations.plan
    candidates = []
    for j in (j for j in range(n) if j not in setup.gain_joints):
        base = links.x_[plan.unknowns(j)[plan.n_own :]] * links.torque_scale_[j]
        load = observations.by_run([block.rows[j][:, plan.n_own : -1] @ base for block in observations.blocks])
        if not any(np.any(part) for part in load):
            continue
        candidates.append(
            Candidate(
                KIND,
                (j,),
                ("gain",),
                ("1",),
                np.array([[1 / MOST_GAIN - 1, MOST_GAIN - 1]]),
                [{j: part[:, None]} for part in load],
                _acceptance(j),
            )
        )
    return candidates


def _acceptance(joint: int) -> Callable[[Setup, FloatArray], Setup]:
    return lambda setup, x: replace(setup, gain_joints=tuple(sorted({*setup.gain_joints, joint})))
