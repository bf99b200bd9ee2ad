"""Spectrum of what a fit leaves of every joint, and the sums of products that noise of this spectrum makes of columns.

The noise's autocovariance is estimated with a flat-top lag window (Politis 2003, Econometric Reviews 22) and applied in
the frequency domain, where a Toeplitz matrix is a product.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.memory import flat_top
from dynid_rs.regression.columns import Observations
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]


class NoiseSpectrum:
    """Spectrum of one joint's noise, from its residual and from what the fit took away with it.

    The fit takes noise away where the columns have their power (at low frequencies): of a line's power, the leverage
    ``h(f) = w a(f)* B a(f)``, a(f) the transform of the columns. Residual and leverage are smoothed alike, then
    ``S = S_residual / (1 - h / n)^2``: once is unbiased, twice is what leaving samples out would give (the
    jackknife, HC3 of MacKinnon and White 1985), and makes up for shapes and weights that were fitted too.
    """

    def __init__(
        self,
        residuals: Sequence[FloatArray],
        masks: Sequence[FloatArray],
        columns: Sequence[FloatArray],
        weighted_bread: FloatArray,
        power: int = 2,
    ) -> None:
        from scipy.fft import irfft, next_fast_len, rfft

        longest = max(map(len, residuals))
        sums, pairs, taken = np.zeros(longest), np.zeros(longest), np.zeros(longest)
        for residual, mask, column in zip(residuals, masks, columns, strict=True):
            n = len(residual)
            size = next_fast_len(2 * n)
            sums[:n] += irfft(np.abs(rfft(residual, size)) ** 2, size)[:n]
            pairs[:n] += irfft(np.abs(rfft(mask, size)) ** 2, size)[:n]
            lines = rfft(column, size, axis=0)
            leverage = np.sum((lines.real @ weighted_bread) * lines.real, axis=1)
            leverage += np.sum((lines.imag @ weighted_bread) * lines.imag, axis=1)
            taken[:n] += irfft(leverage, size)[:n]
        covariances = sums / np.maximum(np.round(pairs), 1.0)
        n_counted = max(float(pairs[0]), 1.0)  # a joint that rests has none
        taper = flat_top(covariances, n_counted)
        self._power = power
        self._covariances = covariances[: len(taper)] * taper
        self._taken = taken[: len(taper)] * taper / n_counted

    @property
    def memory(self) -> float:
        """Rows that an independent one is worth: power at frequency zero over the mean; at least one."""
        left = self._covariances
        return max(1.0, float(2 * left.sum() / left[0] - 1)) if left[0] > 0 else 1.0

    def spectrum(self, size: int) -> FloatArray:
        """Power per line of a real transform of length `size`."""
        from scipy.fft import rfft

        residual = 2 * rfft(self._covariances, size).real - self._covariances[0]
        taken = 2 * rfft(self._taken, size).real - self._taken[0]
        spectrum: FloatArray = np.maximum(residual, 0.0) / np.maximum(1 - taken, 0.1) ** self._power
        return spectrum


def toeplitz_product(columns: FloatArray, spectrum: Callable[[int], FloatArray]) -> FloatArray:
    """``C' Gamma C`` for C (n, p) and the Toeplitz matrix with this spectrum."""
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(2 * len(columns))
    # rfft holds each inner line once for its pair.
    twice = np.full(size // 2 + 1, 2.0)
    twice[0] = 1.0
    if size % 2 == 0:
        twice[-1] = 1.0
    transformed = rfft(columns, size, axis=0)
    scaled = transformed * (spectrum(size) * twice / size)[:, None]
    product: FloatArray = scaled.real.T @ transformed.real + scaled.imag.T @ transformed.imag
    return product


def on_grid(observations: Observations, runs: Sequence[States], parts: Sequence[FloatArray]) -> list[FloatArray]:
    """Rows of every block back on the run's full grid, zeros where standstill was left out."""
    grids = []
    for k, states in enumerate(runs):
        rows = np.concatenate([part for block, part in zip(observations.blocks, parts, strict=True) if block.run == k])
        grid = np.zeros((len(states.grid), rows.shape[1]))
        grid[states.moving[states.grid]] = rows
        grids.append(grid)
    return grids


def counted_rows(observations: Observations) -> list[FloatArray]:
    """Ones where a joint moves, zeros where it rests, per block (n_rows, n_joints)."""
    return [block.counted.astype(np.float64) for block in observations.blocks]


def noise_products(
    observations: Observations,
    runs: Sequence[States],
    residuals: Sequence[FloatArray],
    columns: Sequence[Sequence[FloatArray]],
    weighted_breads: Sequence[FloatArray],
) -> list[FloatArray]:
    """``C_j' Gamma_j C_j`` (k, k) of every joint, Gamma_j its noise's own autocovariance, estimated without bias.

    Parameters
    ----------
    residuals : per block (n_rows, n_joints)
        What a fit leaves.
    columns : per joint and block (n_rows, k)
        C_j. The first of them are those of the fit.
    weighted_breads : per joint
        ``w_j (sum w C' C)^-1`` of the fit, in the places of its columns.
    """
    left = on_grid(observations, runs, residuals)
    masks = on_grid(observations, runs, counted_rows(observations))
    grids = [on_grid(observations, runs, parts) for parts in columns]
    return grid_noise_products(left, masks, grids, weighted_breads)


def grid_noise_products(
    residuals: Sequence[FloatArray],
    masks: Sequence[FloatArray],
    columns: Sequence[Sequence[FloatArray]],
    weighted_breads: Sequence[FloatArray],
    *,
    power: int = 1,
) -> list[FloatArray]:
    """As `noise_products`, on every run's full grid: zeros where `masks` (n_grid, n_joints) is zero.

    `power` 2 makes up for shapes and weights that were fitted too (`NoiseSpectrum`).

    Parameters
    ----------
    residuals : per run (n_grid, n_joints)
        What a fit leaves.
    columns : per joint and run (n_grid, k)
        C_j.
    """
    products = []
    for j, bread in enumerate(weighted_breads):
        fitted = [grid[:, : len(bread)] for grid in columns[j]]
        noise = NoiseSpectrum([run[:, j] for run in residuals], [m[:, j] for m in masks], fitted, bread, power=power)
        products.append(np.sum([toeplitz_product(run, noise.spectrum) for run in columns[j]], axis=0))
    return products
