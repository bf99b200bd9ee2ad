"""A full set of inertial parameters behind the fitted base parameters, as near to the robot file as they allow.

Base parameters give the torque of the geometry and gravity that they belong to. How that torque changes with geometry
or gravity depends on the parameters that nothing has seen so far; the robot file's inertials, taken as uncertain by as
much as they are, are the best guess of those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.regression.priors import link_spread

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Plausible:
    """Inertial parameters `phi` (10 n_links,) and a root (10 n_links, k) of their covariance."""

    phi: FloatArray
    root: FloatArray


def plausible_phi(
    robot: _core.RobotModel,
    phi_base: FloatArray,
    covariance: FloatArray,
    *,
    declared: FloatArray | None = None,
    unknown_gain: bool = False,
) -> Plausible:
    """Condition the declared inertials, uncertain by as much as they are, on fitted base parameters.

    Parameters
    ----------
    robot : RobotModel
        Geometry and gravity that the base parameters belong to, and declared inertials.
    phi_base, covariance : ndarray (n_base,), (n_base, n_base)
        Fitted base parameters and how sure they are.
    declared : ndarray (10 n_links,), optional
        Declared inertials, where they are not those of `robot`.
    unknown_gain : bool
        The torque is an unknown multiple of N m: the declared inertials count up to a factor.
    """
    base = robot.base_parameters()
    declared = np.asarray(robot.phi if declared is None else declared)
    regroup = np.zeros((base.n_base, len(declared)))
    regroup[np.arange(base.n_base), np.asarray(base.pivots)] = 1.0
    if base.beta.size:
        regroup[:, np.asarray(base.dependent)] = base.beta
    spread = link_spread(declared)
    wide = regroup * spread
    gram = wide @ wide.T + covariance
    scale = 1 / np.sqrt(np.diag(gram))
    inverse = np.linalg.pinv(gram * np.outer(scale, scale), rcond=1e-12, hermitian=True) * np.outer(scale, scale)
    along = regroup @ declared
    gain = 1.0
    if unknown_gain and np.any(along):
        gain = float(along @ inverse @ phi_base / (along @ inverse @ along))
    phi = gain * declared + spread * (wide.T @ (inverse @ (phi_base - gain * along)))
    left = np.eye(len(spread)) - wide.T @ inverse @ wide
    values, vectors = np.linalg.eigh(0.5 * (left + left.T))
    kept = values > 1e-9
    return Plausible(phi, spread[:, None] * vectors[:, kept] * np.sqrt(values[kept]))
