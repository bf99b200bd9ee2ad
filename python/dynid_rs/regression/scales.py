"""Torque scales, one per joint: estimated beside all other unknowns where drive gains are not known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid_rs.regression.columns import Plan
from dynid_rs.regression.systems import stack

FloatArray = NDArray[np.float64]

SCALE_SPREAD = 0.5
"""How far the logarithms of drive gains lie from the first joint's: a weak prior for joints whose own load says
little."""


class Gains(NamedTuple):
    """Which gains a fit found beside all else: torque channels' of `joints` (n_joints,), and the torque's `unit`.

    Of currents the unit's multiple of N m is unknown, in which the robot file's inertials are.
    """

    joints: NDArray[np.bool_]
    unit: bool


def free_scales(n_joints: int, fit_scale: bool, free_gains: Sequence[int]) -> NDArray[np.bool_]:
    """Which joints' torque scales are estimated, (n_joints,): all but the first in ampere, `free_gains` in N m.

    Raises
    ------
    ValueError
        `free_gains` names a joint that is not there, or all of them: one has to hold the unit.
    """
    if any(not 0 <= j < n_joints for j in free_gains) or (free_gains and len(set(free_gains)) >= n_joints):
        raise ValueError(
            f"free_gains must name joints from 0 to {n_joints - 1} and leave one that holds the unit, "
            f"found {tuple(free_gains)}"
        )
    joints = np.arange(n_joints)
    return joints > 0 if fit_scale else np.isin(joints, list(free_gains))


def improve_scale(
    plan: Plan,
    factors: Sequence[FloatArray],
    weights: FloatArray,
    scale: FloatArray,
    x: FloatArray,
    free: NDArray[np.bool_],
) -> FloatArray:
    """One Gauss-Newton step on the torque scales of the joints in `free` beside all other unknowns, without a prior."""
    n = plan.robot.n_joints
    system = stack(plan, factors, weights, scale)
    changes = np.zeros((len(system), n))
    first = 0
    for j, R in enumerate(factors):
        base = plan.unknowns(j)[plan.n_own :]
        changes[first : first + len(R), j] = weights[j] * (R[:, plan.n_own : -1] @ x[base])
        first += len(R)
    prior = np.zeros((n, plan.n_columns + n + 1))
    prior[:, plan.n_columns : -1] = np.diag(1 / (SCALE_SPREAD * scale))
    prior[:, -1] = -np.log(scale) / SCALE_SPREAD
    system = np.concatenate([np.concatenate([system[:, :-1], changes, system[:, -1:]], axis=1), prior])
    norms = np.linalg.norm(system[:, :-1], axis=0)
    used = np.concatenate([plan.estimable(), free]) & (norms > 0)
    step = np.zeros(plan.n_columns + n)
    step[used] = np.linalg.lstsq(system[:, :-1][:, used] / norms[used], system[:, -1], rcond=1e-6)[0] / norms[used]
    return in_reach(scale, step[plan.n_columns :])


def in_reach(scale: FloatArray, change: FloatArray) -> FloatArray:
    """Torque scales (n_joints,) after a step, which is linear near where it began only."""
    changed: FloatArray = scale + np.clip(change, -0.3 * scale, 0.5 * scale)
    return changed
