"""A ridge where the data leave directions open: as little as left-out parts of the training run ask for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.columns import Observations
from dynid_rs.systems import residual_power, solve, stack

FloatArray = NDArray[np.float64]

RIDGES = (0.0, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
"""Ridges that are tried, relative to the greatest singular value of the unit-norm columns."""
RIDGE_WORTH = 0.01
"""Of ridges whose greatest regret (logarithm of a joint's left-out power over its least) differs less, the smallest."""
RIDGE_NEED = 0.5
"""A ridge biases: it has to lower the greatest regret by this much to be used at all."""
RIDGE_COST = 1.6
"""Most that a ridge may add to a joint's residual power on the training rows."""


def choose_ridge(
    observations: Observations, left_out: list[list[FloatArray]], weights: FloatArray, scale: FloatArray
) -> float:
    """Smallest ridge with the least regret on left-out blocks: no joint pays for what another one gains."""
    plan = observations.plan
    power = np.zeros((len(RIDGES), plan.robot.n_joints))
    for block, factors in zip(observations.blocks, left_out, strict=True):
        for k, x in enumerate(solve(plan, stack(plan, factors, weights, scale), RIDGES)):
            power[k] += residual_power(plan, block.factors, x, scale)
    # What a ridge costs where the data does speak shows on the training rows themselves.
    factors = observations.factors()
    solutions = solve(plan, stack(plan, factors, weights, scale), RIDGES)
    trained = np.array([residual_power(plan, factors, x, scale) for x in solutions])
    power[np.any(trained > RIDGE_COST * trained[0] + 1e-300, axis=1)] = np.inf
    log_power = np.log(np.maximum(power, 1e-300))
    regret = (log_power - log_power.min(axis=0)).max(axis=1)
    if regret[0] <= regret.min() + RIDGE_NEED:
        return 0.0
    return RIDGES[int(np.flatnonzero(regret <= regret.min() + RIDGE_WORTH)[0])]
