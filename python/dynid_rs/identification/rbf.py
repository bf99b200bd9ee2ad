"""Normalised radial basis functions: centres and weights here, the basis and its evaluation in Rust (Eqs. 27-30)."""

from __future__ import annotations

from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from dynid_rs import _core

FloatArray = NDArray[np.float64]

MAX_PRINTED_CENTERS = 10_000
"""The printed basis keeps its whole grid, which grows with the power of the inputs."""


class RbfRegressor(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Regression of y on X as the weighted mean of Gaussian bumps on a grid (Eq. 29).

    Every input has `n_centers` equally spaced centres between the data's limits (Eq. 28), and the bumps stand on the
    grid of all combinations: the paper's single sum over (deflection, rate) has to cover "the entire flexible error
    space". A grid point that is nearest to no sample is left out, so no weight is without data.

    Parameters
    ----------
    n_centers : int
        Centres N per input.
    weighting : {"least_squares", "weighted_means"}
        Weights fitted together, or each alone as Eq. 30 has it: the psi-weighted mean of y, which smooths.
    ridge : float
        Pull of the least-squares weights towards those weighted means, in units of a cell's mean number of samples.
    as_printed : bool
        Eqs. 27-28 to the letter: width sigma = 1 / (spacing / 2)^2. That is an inverse square used as a width; at a
        spacing of 1e-4 rad the bumps are 4e8 rad wide and f is a constant. Otherwise it is the precision
        h = 1 / (spacing / 2)^2.

    Attributes
    ----------
    rbf_ : NormalisedRbf
        The fitted function, owned by Rust.
    centers_ : ndarray (n_cells, n_features)
        Grid points in use.
    weights_ : ndarray (n_cells,)
        w of Eq. 29.
    precision_ : ndarray (n_features,)
        h of every input.
    """

    def __init__(
        self,
        n_centers: int = 5,
        *,
        weighting: Literal["least_squares", "weighted_means"] = "least_squares",
        ridge: float = 0.02,
        as_printed: bool = False,
    ) -> None:
        self.n_centers = n_centers
        self.weighting = weighting
        self.ridge = ridge
        self.as_printed = as_printed

    def fit(self, X: ArrayLike, y: ArrayLike) -> RbfRegressor:
        """Fit to X (n_samples, n_features), y (n_samples,).

        Raises
        ------
        ValueError
            An argument out of its range, shapes that do not fit, a value that is not finite.
        """
        if self.n_centers < 2:
            raise ValueError(f"n_centers must be at least 2, found {self.n_centers}")
        if self.weighting not in ("least_squares", "weighted_means"):
            raise ValueError(f"weighting must be 'least_squares' or 'weighted_means', found {self.weighting!r}")
        if not (np.isfinite(self.ridge) and self.ridge >= 0):
            raise ValueError(f"ridge must not be negative, found {self.ridge}")
        checked = validate_data(self, X, y, y_numeric=True, dtype=np.float64, ensure_min_samples=2)
        return self._fit(*checked)

    def _fit(self, X: FloatArray, y: FloatArray) -> RbfRegressor:
        low, high = X.min(axis=0), X.max(axis=0)
        spacing = (high - low) / (self.n_centers - 1)
        spacing[spacing <= 1e-9 * np.maximum(np.abs(low), np.abs(high))] = 1.0  # a constant input carries nothing
        self.precision_ = _printed(spacing) if self.as_printed else (0.5 * spacing) ** -2.0
        self.centers_ = low + spacing * self._cells(X, low, spacing)
        # Without weights yet, for its basis.
        bare = _core.NormalisedRbf(self.centers_, self.precision_, *np.zeros((2, len(self.centers_))))
        self.weights_ = self._weights(bare, X, y)
        left = y - bare.shares(X) @ self.weights_
        variances = _weighted_means(bare.basis(X), left**2)
        self.rbf_ = _core.NormalisedRbf(self.centers_, self.precision_, self.weights_, variances)
        return self

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Value of f (n_samples,), and the standard deviation of y about it if asked."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        mean, variance = self.rbf_.predict(X)
        return (mean, np.sqrt(variance)) if return_std else mean

    def _cells(self, X: FloatArray, low: FloatArray, spacing: FloatArray) -> FloatArray:
        """Grid points in use as steps along every input, (n_cells, n_features)."""
        if not self.as_printed:
            cells: FloatArray = np.unique(np.round((X - low) / spacing), axis=0)
            return cells
        if self.n_centers ** X.shape[1] > MAX_PRINTED_CENTERS:
            raise ValueError(
                f"as_printed needs the whole grid: {self.n_centers} centres to the power of {X.shape[1]} inputs are "
                f"more than {MAX_PRINTED_CENTERS}; lower n_centers"
            )
        return np.array(list(product(range(self.n_centers), repeat=X.shape[1])), dtype=np.float64)

    def _weights(self, bare: _core.NormalisedRbf, X: FloatArray, y: FloatArray) -> FloatArray:
        alone = _weighted_means(bare.basis(X), y)
        if self.weighting == "weighted_means":
            return alone
        shares = bare.shares(X)
        pull = np.sqrt(self.ridge * len(y) / len(alone))
        # Cells with little data stay near their own mean instead of exploding.
        change, *_ = np.linalg.lstsq(
            np.concatenate([shares, pull * np.eye(len(alone))]),
            np.concatenate([y - shares @ alone, np.zeros(len(alone))]),
            rcond=None,
        )
        weights: FloatArray = alone + change
        return weights


def _printed(spacing: FloatArray) -> FloatArray:
    """Precision 1 / sigma^2 with Eq. 28's sigma = 1 / (spacing / 2)^2."""
    sigma = (0.5 * spacing) ** -2.0
    precision: FloatArray = np.maximum(sigma**-2.0, 1e-300)
    return precision


def _weighted_means(psi: FloatArray, y: FloatArray) -> FloatArray:
    """Eq. 30, every weight alone: ``w_j = sum_i psi_j(i) y(i) / sum_i psi_j(i)``; the mean where psi_j vanishes."""
    total = psi.sum(axis=0)
    means: FloatArray = np.where(total > 0, psi.T @ y / np.where(total > 0, total, 1.0), y.mean())
    return means
