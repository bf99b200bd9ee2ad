"""Gaussian mixture regression: scikit-learn fits the mixture, or Rust from scikit-learn's start; Rust evaluates it.

Eqs. 31-39.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.cluster import kmeans_plusplus
from sklearn.mixture import GaussianMixture
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from dynid_rs import _core

FloatArray = NDArray[np.float64]

SOLVERS = ("auto", "scikit-learn", "fused")
FUSED_FROM = 20_000
"""Samples from which `solver="auto"` iterates in Rust; below, scikit-learn takes less than a second."""
FUSED_WIDTH = 8
"""Most columns, inputs and output, that Rust iterates on."""


class GaussianMixtureRegressor(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Regression of y on X through the conditional of a Gaussian mixture over both (Eq. 31), fitted by EM.

    Parameters
    ----------
    n_components : int
        Gaussians K.
    reg_covar : float
        Added to the diagonal of every covariance, in units of the standardised data.
    max_iter : int
        Most steps of expectation and maximisation.
    tol : float
        Gain of the mean log-likelihood at which they stop.
    means_init : array_like (n_components, n_features + 1), optional
        Means to start from, in the units of (X, y): those of an earlier fit, say.
    random_state : int, RandomState or None
        Seed of the initialisation.
    solver : {"auto", "scikit-learn", "fused"}
        Who iterates. scikit-learn, which is the reference; or Rust, from scikit-learn's start with the same steps, some
        fifty times as fast, to the same log-likelihood within 1e-9 ("fused", at most 8 columns of X and y). By default
        Rust from 20,000 samples on.

    Attributes
    ----------
    mixture_ : GaussianMixtureRegression
        The fitted mixture, owned by Rust.
    bic_ : float
        Bayesian information criterion of the mixture over (X, y); smaller is better.
    """

    def __init__(
        self,
        n_components: int = 4,
        *,
        reg_covar: float = 1e-4,
        max_iter: int = 100,
        tol: float = 1e-3,
        means_init: Any = None,
        random_state: Any = None,
        solver: str = "auto",
    ) -> None:
        self.n_components = n_components
        self.reg_covar = reg_covar
        self.max_iter = max_iter
        self.tol = tol
        self.means_init = means_init
        self.random_state = random_state
        self.solver = solver

    def fit(self, X: ArrayLike, y: ArrayLike) -> GaussianMixtureRegressor:
        """Fit to X (n_samples, n_features), y (n_samples,).

        Raises
        ------
        ValueError
            Shapes do not fit, a value is not finite, or there are fewer samples than components.
        """
        if self.n_components < 1:
            raise ValueError(f"n_components must be at least 1, found {self.n_components}")
        if self.solver not in SOLVERS:
            raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, found {self.solver!r}")
        X, y = validate_data(self, X, y, y_numeric=True, dtype=np.float64, ensure_min_samples=2)
        data = np.column_stack([X, y])
        centre, spread = data.mean(axis=0), data.std(axis=0)
        spread[spread == 0] = 1.0  # a constant input carries nothing, and must not divide by zero
        large = len(data) >= FUSED_FROM and data.shape[1] <= FUSED_WIDTH
        fused = self.solver == "fused" or (self.solver == "auto" and large)
        mixture = GaussianMixture(
            min(self.n_components, len(data)),
            reg_covar=self.reg_covar,
            max_iter=self.max_iter,
            tol=self.tol,
            init_params="k-means++",
            means_init=None if self.means_init is None else (np.asarray(self.means_init) - centre) / spread,
            random_state=self.random_state,
        )
        fit = (_iterated if fused else _fitted)(mixture, (data - centre) / spread)
        self.converged_, self.n_iter_ = fit.converged, fit.n_iter
        self.bic_ = _bic(fit, len(data))
        alive = fit.weights > 0
        self.mixture_ = _core.GaussianMixtureRegression(
            fit.weights[alive],
            fit.means[alive] * spread + centre,
            fit.covariances[alive] * np.outer(spread, spread),
        )
        return self

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Conditional mean (n_samples,), and its standard deviation if asked (law of total variance)."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        mean, variance = self.mixture_.predict(X)
        return (mean, np.sqrt(variance)) if return_std else mean


class _Fit(NamedTuple):
    """What either solver finds."""

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    log_likelihood: float
    """Mean per sample, of the mixture found."""
    n_iter: int
    converged: bool


def _fitted(mixture: GaussianMixture, x: FloatArray) -> _Fit:
    """Fit by scikit-learn."""
    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # reported as converged_
        mixture.fit(x)
    log_likelihood, n_iter, converged = mixture.score(x), mixture.n_iter_, mixture.converged_
    parts = mixture.weights_, mixture.means_, mixture.covariances_
    return _Fit(*parts, float(log_likelihood), int(n_iter), bool(converged))


def _iterated(mixture: GaussianMixture, x: FloatArray) -> _Fit:
    """Fit by Rust as scikit-learn would."""
    weights, means, covariances, bounds, converged, log_likelihood = _core.fit_mixture(
        x, *start_of(mixture, x), reg_covar=mixture.reg_covar, tol=mixture.tol, max_iter=mixture.max_iter
    )
    return _Fit(weights, means, covariances, log_likelihood, len(bounds), converged)


def start_of(mixture: GaussianMixture, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where scikit-learn starts with k-means++: weights, means and covariances of one sample per component.

    Parameters
    ----------
    mixture : GaussianMixture
        With `init_params="k-means++"` and full covariances, not fitted.
    x : (n_samples, n_features)
        Data.
    """
    _, chosen = kmeans_plusplus(x, mixture.n_components, random_state=check_random_state(mixture.random_state))
    count = 1 + 10 * np.finfo(np.float64).eps  # so that an empty component divides by something
    weights = np.full(len(chosen), count / len(x))
    means = x[chosen] / count if mixture.means_init is None else np.asarray(mixture.means_init)
    return weights, means, np.tile(mixture.reg_covar * np.eye(x.shape[1]), (len(chosen), 1, 1))


def _bic(fit: _Fit, n_samples: int) -> float:
    """Bayesian information criterion: what is free are the weights but one, the means and half the covariances."""
    k, d = fit.means.shape
    n_free = (k - 1) + k * d + k * d * (d + 1) // 2
    return float(-2 * fit.log_likelihood * n_samples + n_free * np.log(n_samples))
