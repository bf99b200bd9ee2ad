"""Gaussian mixture regression: scikit-learn fits the mixture, Rust evaluates it (Eqs. 31-39)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.mixture import GaussianMixture
from sklearn.utils.validation import check_is_fitted, validate_data

from dynid_rs import _core

FloatArray = NDArray[np.float64]


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
    ) -> None:
        self.n_components = n_components
        self.reg_covar = reg_covar
        self.max_iter = max_iter
        self.tol = tol
        self.means_init = means_init
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> GaussianMixtureRegressor:
        """Fit to X (n_samples, n_features), y (n_samples,).

        Raises
        ------
        ValueError
            Shapes do not fit, a value is not finite, or there are fewer samples than components.
        """
        import warnings

        from sklearn.exceptions import ConvergenceWarning

        if self.n_components < 1:
            raise ValueError(f"n_components must be at least 1, found {self.n_components}")
        X, y = validate_data(self, X, y, y_numeric=True, dtype=np.float64, ensure_min_samples=2)
        data = np.column_stack([X, y])
        centre, spread = data.mean(axis=0), data.std(axis=0)
        spread[spread == 0] = 1.0  # a constant input carries nothing, and must not divide by zero
        mixture = GaussianMixture(
            min(self.n_components, len(data)),
            reg_covar=self.reg_covar,
            max_iter=self.max_iter,
            tol=self.tol,
            init_params="k-means++",
            means_init=None if self.means_init is None else (np.asarray(self.means_init) - centre) / spread,
            random_state=self.random_state,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # reported as converged_
            mixture.fit((data - centre) / spread)
        self.converged_ = bool(mixture.converged_)
        self.n_iter_ = int(mixture.n_iter_)
        self.bic_ = float(mixture.bic((data - centre) / spread))
        alive = mixture.weights_ > 0
        self.mixture_ = _core.GaussianMixtureRegression(
            mixture.weights_[alive],
            mixture.means_[alive] * spread + centre,
            mixture.covariances_[alive] * np.outer(spread, spread),
        )
        return self

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Conditional mean (n_samples,), and its standard deviation if asked (law of total variance)."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        mean, variance = self.mixture_.predict(X)
        return (mean, np.sqrt(variance)) if return_std else mean
