"""A model whose torque channels show more by a factor: what of it is a torque, and what is its cube or per torque."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]
Regression = _core.GaussianMixtureRegression | _core.NormalisedRbf


def gained_coefficients(effect: _core.Effect, coefficients: FloatArray, factor: FloatArray) -> FloatArray:
    """Coefficients (n_joints, n_columns) with which an effect shows `factor` (n_joints,) times its torque."""
    # What is the cube of the motor's torque sees one that is larger already.
    power = -2 if "tau_motor" in effect.signals else 1
    gained: FloatArray = coefficients * factor[:, None] ** power
    return gained


def gained_third_loop(model: _core.TorqueModel, factor: FloatArray) -> dict[str, Any]:
    """Residual and compliance on channels that show `factor` (n_joints,) times the torque, for `with_changes`."""
    if model.residual is None or model.compliance is None:
        return {}
    inputs, regressions = model.residual
    gained = [None if one is None else _gained(one, float(more)) for one, more in zip(regressions, factor, strict=True)]
    return {"residual": (inputs, gained), "compliance": (model.compliance / factor).tolist()}


def _gained(regression: Regression, factor: float) -> Regression:
    """`factor` times its mean, and the square of that times its variance."""
    if isinstance(regression, _core.NormalisedRbf):
        weights, variances = factor * regression.weights, factor**2 * regression.variances
        return _core.NormalisedRbf(regression.centers, regression.precision, weights, variances)
    means, scale = regression.means.copy(), np.ones(regression.means.shape[1])
    scale[-1] = factor
    means *= scale
    return _core.GaussianMixtureRegression(regression.weights, means, regression.covariances * np.outer(scale, scale))
