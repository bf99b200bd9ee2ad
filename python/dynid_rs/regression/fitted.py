"""What a fit of the link dynamics gives to those who build on it, whoever fitted it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs.regression.columns import Observations
from dynid_rs.regression.evidence import Posterior
from dynid_rs.regression.systems import stack, whitened

FloatArray = NDArray[np.float64]
Weighting = Literal["joint_variance", "full_covariance"] | None


@dataclass(frozen=True, eq=False)
class Beside:
    """Rows with a noise of their own that stood beside the training runs' in a fit, as they were weighted there.

    `rows` ``[own | base | torque]`` or factors of them per joint, torque scales not applied; `power` (n_joints,): mean
    square of what the fit leaves of a row.
    """

    rows: list[FloatArray]
    power: FloatArray


class FittedLinks(Protocol):
    """A fitted `LinkDynamicsIdentifier`, as far as intervals, models and bodies need it; its page says what each is."""

    weighting: Weighting
    x_: FloatArray
    phi_base_: FloatArray
    own_: FloatArray
    torque_scale_: FloatArray
    noise_std_: FloatArray
    covariance_: FloatArray
    weights_: FloatArray
    worth_: FloatArray
    ridge_: float
    posterior_: Posterior | None
    beside_: list[Beside]


def weighted_system(observations: Observations, links: FittedLinks, *, least_noise: float = 0.0) -> FloatArray:
    """System ``[columns | torque]`` that `links` was solved on, its noise of variance one (Eq. 13).

    With a prior its rows stand below, and a joint's rows count as many as the independent samples they are worth; rows
    that stood beside them in the fit come last.

    Parameters
    ----------
    least_noise : float
        No joint's noise counts as less than this part of its torque.
    """
    plan, factors = observations.plan, observations.factors()
    size = np.array([np.linalg.norm(R[:, -1]) for R in factors]) / np.sqrt(observations.n_rows)
    least = np.maximum(least_noise * size, 1e-300)
    root, unit = np.sqrt(links.worth_), np.ones(len(factors))
    if links.weighting == "full_covariance":
        short = np.maximum(least**2 - np.diag(links.covariance_), 0.0)
        covariance = (links.covariance_ + np.diag(short)) / np.outer(root, root)
        system = whitened(observations, covariance, links.torque_scale_)
    else:
        noise = links.noise_std_
        if links.weighting is None:
            noise = np.full(len(factors), np.sqrt(np.mean(noise**2)))
            unit = 1 / np.maximum(noise, least)  # nothing was weighted, nor what stood beside
        system = stack(plan, factors, root / np.maximum(noise, least), links.torque_scale_)
    beside = [stack(plan, group.rows, unit, links.torque_scale_) for group in links.beside_]
    return np.concatenate([system, *([] if links.posterior_ is None else [links.posterior_.pull]), *beside])
