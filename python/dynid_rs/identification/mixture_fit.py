"""A Gaussian mixture over inputs and output, fitted by Rust from the start that scikit-learn would take (Eqs. 31-39).

Without scikit-learn, whose import takes a second of the processor and fifty megabytes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]

SEVERAL = 2
"""Samples that k-means++ draws for a component, and one more for every e-fold of components; the best is taken."""


class Fit(NamedTuple):
    """What iterations find."""

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    log_likelihood: float
    """Mean per sample, of the mixture found."""
    n_iter: int
    converged: bool


class MixtureFit:
    """`GaussianMixtureRegressor` with `solver="fused"`, for what has been checked; the same numbers.

    Parameters are that one's, and `mixture_` and `bic_` what it learns.
    """

    def __init__(
        self,
        n_components: int,
        *,
        reg_covar: float = 1e-4,
        max_iter: int = 100,
        tol: float = 1e-3,
        means_init: FloatArray | None = None,
        random_state: Any = None,
    ) -> None:
        self.n_components = n_components
        self.settings: dict[str, Any] = {"reg_covar": reg_covar, "max_iter": max_iter, "tol": tol}
        self.means_init = means_init
        self.random_state = random_state

    def fit(self, X: FloatArray, y: FloatArray) -> MixtureFit:
        """Fit to X (n_samples, n_features), y (n_samples,)."""
        x, centre, spread = standardised(np.column_stack([X, y]))
        means = None if self.means_init is None else (self.means_init - centre) / spread
        start = start_at(x, min(self.n_components, len(x)), self.settings["reg_covar"], means, self.random_state)
        fit = iterated(x, start, **self.settings)
        self.bic_ = bic(fit, len(x))
        self.mixture_ = in_units(fit, centre, spread)
        return self

    def predict(self, X: FloatArray) -> FloatArray:
        """Conditional mean (n_samples,)."""
        return self.mixture_.predict(X)[0]


def standardised(data: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Data of mean zero and variance one, what was taken off and what it was divided by."""
    centre, spread = data.mean(axis=0), data.std(axis=0)
    spread[spread == 0] = 1.0  # a constant input carries nothing, and must not divide by zero
    return (data - centre) / spread, centre, spread


def in_units(fit: Fit, centre: FloatArray, spread: FloatArray) -> _core.GaussianMixtureRegression:
    """Return the mixture that was fitted to standardised data, in the data's units."""
    alive = fit.weights > 0
    return _core.GaussianMixtureRegression(
        fit.weights[alive],
        fit.means[alive] * spread + centre,
        fit.covariances[alive] * np.outer(spread, spread),
    )


def iterated(
    x: FloatArray, start: tuple[FloatArray, FloatArray, FloatArray], *, reg_covar: float, max_iter: int, tol: float
) -> Fit:
    """Fit by Rust as scikit-learn would."""
    weights, means, covariances, bounds, converged, log_likelihood = _core.fit_mixture(
        x, *start, reg_covar=reg_covar, tol=tol, max_iter=max_iter
    )
    return Fit(weights, means, covariances, log_likelihood, len(bounds), converged)


def start_at(
    x: FloatArray, n_components: int, reg_covar: float, means_init: FloatArray | None, random_state: Any
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where scikit-learn starts with k-means++: weights, means and covariances of one sample per component."""
    chosen = k_means_plus_plus(x, n_components, random_state)
    count = 1 + 10 * np.finfo(np.float64).eps  # so that an empty component divides by something
    weights = np.full(len(chosen), count / len(x))
    means = x[chosen] / count if means_init is None else np.asarray(means_init)
    return weights, means, np.tile(reg_covar * np.eye(x.shape[1]), (len(chosen), 1, 1))


def k_means_plus_plus(x: FloatArray, n_chosen: int, random_state: Any) -> NDArray[np.intp]:
    """Samples far apart, the same that `sklearn.cluster.kmeans_plusplus` draws.

    Each is the best of a few that are drawn as often as their squared distance to those before them says (Arthur and
    Vassilvitskii, SODA 2007).
    """
    rng = _generator(random_state)
    norms, equally = np.einsum("ij,ij->i", x, x), np.ones(len(x))
    n_drawn = SEVERAL + int(np.log(n_chosen))
    chosen = np.empty(n_chosen, dtype=np.intp)
    chosen[0] = rng.choice(len(x), p=equally / equally.sum())
    nearest = _squared_distances(x, norms, chosen[:1])
    total = nearest @ equally
    for k in range(1, n_chosen):
        drawn = np.searchsorted(np.cumsum(nearest), rng.uniform(size=n_drawn) * total)
        drawn = np.minimum(drawn, len(x) - 1)  # rounding
        distances = np.minimum(nearest, _squared_distances(x, norms, drawn))
        totals = distances @ equally[:, None]
        best = int(np.argmin(totals))
        chosen[k], nearest, total = drawn[best], distances[best], totals[best]
    return chosen


def _squared_distances(x: FloatArray, norms: FloatArray, at: NDArray[np.intp]) -> FloatArray:
    """Of all samples from some of them, (n_some, n_samples); `norms`: squared lengths."""
    distances = -2 * (x[at] @ x.T)
    distances += norms[at, None]
    distances += norms
    return np.maximum(distances, 0.0)


def _generator(random_state: Any) -> Any:
    """scikit-learn's generator for a seed, for None that which all share."""
    if random_state is None:
        return np.random.mtrand._rand
    # numpy's newer generators draw other numbers.
    return random_state if isinstance(random_state, np.random.RandomState) else np.random.RandomState(random_state)


def bic(fit: Fit, n_samples: int) -> float:
    """Bayesian information criterion: what is free are the weights but one, the means and half the covariances."""
    k, d = fit.means.shape
    n_free = (k - 1) + k * d + k * d * (d + 1) // 2
    return float(-2 * fit.log_likelihood * n_samples + n_free * np.log(n_samples))
