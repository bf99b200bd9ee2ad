"""How much a residual's samples know of each other: the lag window, and how many independent samples they are worth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WEAK = 1e-6
"""Directions of the columns weaker than this (relative singular value) do not count."""


def flat_top(covariances: FloatArray, n_samples: float) -> FloatArray:
    """Window over the lags up to twice the last one whose correlation is not noise; the farther half is tapered.

    The flat-top lag window of Politis 2003, Econometric Reviews 22.
    """
    if covariances[0] <= 0:
        return np.ones(1)
    bound = 2 * np.sqrt(np.log10(n_samples) / n_samples)
    small = np.abs(covariances / covariances[0]) < bound
    quiet = 5
    last = next((k for k in range(1, len(small) - quiet) if small[k : k + quiet].all()), 1) - 1
    window = min(max(2 * last, 1), len(covariances) - 1, int(n_samples / 4))
    taper: FloatArray = np.clip(2 * (1 - np.arange(window + 1) / (window + 1)), 0, 1)
    return taper


def column_memory(columns: list[FloatArray]) -> FloatArray:
    """Mean autocorrelation of the directions that the columns span; one (n_rows, width) per run, (longest run,)."""
    from scipy.fft import irfft, next_fast_len, rfft

    stacked = np.concatenate(columns)
    norms = np.linalg.norm(stacked, axis=0)
    u, s, _ = np.linalg.svd(stacked[:, norms > 0] / norms[norms > 0], full_matrices=False)
    directions = u[:, s > WEAK * s[0]] if len(s) else u
    memory = np.zeros(max(map(len, columns)))
    first = 0
    for run in columns:
        part = directions[first : first + len(run)]
        first += len(run)
        size = next_fast_len(2 * len(run))
        power = np.sum(np.abs(rfft(part, size, axis=0)) ** 2, axis=1)
        memory[: len(run)] += irfft(power, size)[: len(run)]
    return memory / memory[0] if memory[0] > 0 else memory


def inflation(residuals: list[FloatArray], memory: FloatArray) -> float:
    """By how much correlation in time blows up the columns' variance: at least 1; rows over it count as independent.

    ``tr(U' Gamma U) / (p sigma^2)`` with U the p orthonormal directions of the columns and Gamma the residual's
    autocovariance: the factor by which a likelihood that takes samples as independent is too sure of itself
    (magnitude adjustment of Ribatet, Cooley and Davison 2012, Statistica Sinica 22).
    """
    from scipy.fft import irfft, next_fast_len, rfft

    sums, pairs = np.zeros(len(memory)), np.zeros(len(memory))
    for residual in residuals:
        n = len(residual)
        size = next_fast_len(2 * n)
        sums[:n] += irfft(np.abs(rfft(residual, size)) ** 2, size)[:n]
        pairs[:n] += n - np.arange(n)
    if sums[0] <= 0:
        return 1.0
    covariances = sums / np.maximum(pairs, 1.0)
    taper = flat_top(covariances, float(pairs[0]))
    lags = taper * covariances[: len(taper)] / covariances[0] * memory[: len(taper)]
    return max(1.0, float(2 * lags.sum() - lags[0]))


WEAKEST = 0.05
"""Correlation below which a residual's memory has ended."""


def residual_memory(residuals: list[FloatArray]) -> float:
    """``1 + 2 sum rho`` over the lags before the autocorrelation first falls below `WEAKEST`; one array per run."""
    residuals = [residual for residual in residuals if len(residual)]
    lags = np.zeros(max(map(len, residuals), default=1))
    for residual in residuals:
        lags[: len(residual)] += _autocovariance(residual)
    if lags[0] <= 0:
        return 1.0
    return 1.0 + 2.0 * float(_remembered(lags / lags[0]).sum())


UNLIKELY = 1.645
"""Standard deviations that a normal value is below with 95 %."""


def memory_bound(residuals: list[FloatArray]) -> tuple[float, float, float]:
    """`residual_memory` of arrays with gaps (NaN), what it is at most with 95 %, and the samples that they are worth.

    Mean square times memory is the spectrum at frequency zero, by a window of L lags, whose relative variance is
    ``2 (2 L + 1) / n`` for n samples (M. B. Priestley, Spectral Analysis and Time Series, 1981, 6.2.4). The bound is
    that of the product, over the mean square as it was found.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * max(map(len, residuals), default=1))
    sums, pairs = np.zeros(size), np.zeros(size)
    for residual in residuals:
        there = np.isfinite(residual)
        sums += irfft(np.abs(rfft(np.where(there, residual, 0.0), size)) ** 2, size)
        pairs += irfft(np.abs(rfft(there.astype(float), size)) ** 2, size)
    n = float(np.round(pairs[0]))
    # Lags of fewer than a tenth of all pairs are noise.
    usable = np.round(pairs[: size // 2]) >= max(1.0, 0.1 * n)
    last = int(np.argmin(usable)) if not usable.all() else len(usable)
    if n == 0 or sums[0] <= 0:
        return 1.0, 1.0, n
    rho = _remembered((sums[:last] / np.round(pairs[:last])) / (sums[0] / n))
    memory = max(1.0, 1.0 + 2.0 * float(rho.sum()))
    return memory, memory * (1.0 + UNLIKELY * float(np.sqrt(2.0 * (2 * len(rho) + 1) / n))), n / memory


def returning(residual: FloatArray, phase: NDArray[np.int64]) -> float:
    """How many rows of a motion that returns say the same of a residual, (n_rows,): one where nothing returns.

    ``1 + (R - 1) rho`` with R the times that a row's motion is shown and rho how alike what is left is each time. Noise
    is another one; what a model lacks is the same.
    """
    _, place = np.unique(phase, return_inverse=True)
    times, sums, squares = np.bincount(place), np.bincount(place, residual), np.bincount(place, residual**2)
    alike = float((times - 1) @ squares)
    if alike <= 0:
        return 1.0
    rho = float(sums @ sums - squares.sum()) / alike
    return 1.0 + max(rho, 0.0) * float((times * (times - 1.0)).sum() / times.sum())


def square_memory(residual: FloatArray) -> float:
    """Samples of `residual` (n,) that its squares count as one, were it Gaussian around its mean; at least 1.

    A square's autocorrelation is then ``(gamma^2 + 2 mu^2 gamma) / (gamma_0^2 + 2 mu^2 gamma_0)`` with ``gamma`` the
    residual's autocovariance and ``mu`` its mean. The residual tells its memory more surely than its squares do.
    """
    mean = residual.mean()
    lags = _autocovariance(residual - mean)
    if lags[0] <= 0:
        return float(len(residual))  # one value all along
    rho, offset = _remembered(lags / lags[0]), 2 * mean**2 * len(residual) / lags[0]
    return 1.0 + 2.0 * float(np.sum(rho**2 + offset * rho) / (1.0 + offset))


def _autocovariance(residual: FloatArray) -> FloatArray:
    """Sums of products at every lag, (n,)."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * len(residual))
    lags: FloatArray = irfft(np.abs(rfft(residual, size)) ** 2, size)[: len(residual)]
    return lags


def _remembered(rho: FloatArray) -> FloatArray:
    """Correlations from lag 1 to before the first that is below `WEAKEST`."""
    ended = np.flatnonzero(rho < WEAKEST)
    return rho[1 : ended[0] if len(ended) else len(rho)]
