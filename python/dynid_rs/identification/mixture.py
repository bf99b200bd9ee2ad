"""Gaussian mixture regression: scikit-learn fits the mixture, or Rust from scikit-learn's start; Rust evaluates it.

Eqs. 31-39.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.mixture import GaussianMixture
from sklearn.utils.validation import check_is_fitted, validate_data

from dynid_rs.identification.mixture_fit import Fit, bic, in_units, iterated, standardised, start_at

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
        x, centre, spread = standardised(np.column_stack([X, y]))
        large = len(x) >= FUSED_FROM and x.shape[1] <= FUSED_WIDTH
        fused = self.solver == "fused" or (self.solver == "auto" and large)
        mixture = GaussianMixture(
            min(self.n_components, len(x)),
            reg_covar=self.reg_covar,
            max_iter=self.max_iter,
            tol=self.tol,
            init_params="k-means++",
            means_init=None if self.means_init is None else (np.asarray(self.means_init) - centre) / spread,
            random_state=self.random_state,
        )
        fit = (_iterated if fused else _fitted)(mixture, x)
        self.converged_, self.n_iter_ = fit.converged, fit.n_iter
        self.bic_ = bic(fit, len(x))
        self.mixture_ = in_units(fit, centre, spread)
        return self

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Conditional mean (n_samples,), and its standard deviation if asked (law of total variance)."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        mean, variance = self.mixture_.predict(X)
        return (mean, np.sqrt(variance)) if return_std else mean


def _fitted(mixture: GaussianMixture, x: FloatArray) -> Fit:
    """Fit by scikit-learn."""
    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # reported as converged_
        mixture.fit(x)
    log_likelihood, n_iter, converged = mixture.score(x), mixture.n_iter_, mixture.converged_
    parts = mixture.weights_, mixture.means_, mixture.covariances_
    return Fit(*parts, float(log_likelihood), int(n_iter), bool(converged))


def _iterated(mixture: GaussianMixture, x: FloatArray) -> Fit:
    """Fit by Rust as scikit-learn would."""
    settings = {"reg_covar": mixture.reg_covar, "tol": mixture.tol, "max_iter": mixture.max_iter}
    return iterated(x, start_of(mixture, x), **settings)


def start_of(mixture: GaussianMixture, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where scikit-learn starts with k-means++: weights, means and covariances of one sample per component.

    Parameters
    ----------
    mixture : GaussianMixture
        With `init_params="k-means++"` and full covariances, not fitted.
    x : (n_samples, n_features)
        Data.
    """
    return start_at(x, mixture.n_components, mixture.reg_covar, mixture.means_init, mixture.random_state)
