"""Base parameters straight from samples: one pass, one triangular factor per joint, weighted by the joints' noise.

What the three loops do carefully (a band, priors, friction searched), this does once and fast: for samples that are
clean already, for a first look.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BaseFit:
    """Least squares for `tau = Y phi + effects`, weighted by the joints' noise."""

    base: _core.BaseParameters
    """Which columns of phi were fitted."""
    parameters: FloatArray
    """Base parameters (n_base,)."""
    std: FloatArray
    """Their standard deviations (n_base,)."""
    effects: FloatArray
    """Coefficients of the effects (n_joints, n_effect_columns)."""
    effects_std: FloatArray
    """Their standard deviations (n_joints, n_effect_columns)."""
    noise_std: FloatArray
    """Standard deviation of what is left, per joint (n_joints,) [torque unit]: the weights are its inverse square."""

    @property
    def phi(self) -> FloatArray:
        """Ten parameters per link with the same torque (10 n_links,): not a physical inertia."""
        return self.base.lift(self.parameters)


def fit_base_parameters(
    robot: _core.RobotModel,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    tau: ArrayLike,
    *,
    effects: Sequence[_core.Effect] = (),
    n_reweightings: int = 2,
) -> BaseFit:
    """Fit base parameters and `effects` to samples, none of which is kept.

    Parameters
    ----------
    q, dq, ddq, tau : array_like, (n_samples, n_joints)
        States [rad, rad/s, rad/s^2] and torques [N*m]; float64 arrays in C order are read where they stand.
    effects : sequence of Effect
        Further columns of every joint; their speeds are these states'.
    n_reweightings : int
        Rounds in which every joint is weighted by what it left in the round before; 0 for ordinary least squares.

    Raises
    ------
    ValueError
        Shapes disagree, a number is not finite, there are no more samples than parameters, an effect needs a signal
        that is not here, or the samples do not tell the columns apart.
    """
    base = robot.base_parameters()
    pivots = base.pivots.tolist()
    factors = _core.fold(robot, list(effects), pivots, q, dq, ddq, q, dq, ddq, tau)
    n_rows = len(np.asarray(tau))
    parameters, std, own, own_std, noise = _core.weighted_fit(factors, pivots, n_rows, n_reweightings=n_reweightings)
    shape = (robot.n_joints, -1) if own.size else (robot.n_joints, 0)
    return BaseFit(base, parameters, std, own.reshape(shape), own_std.reshape(shape), noise)
