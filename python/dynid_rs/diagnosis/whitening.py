"""Making a residual's samples independent of each other: an autoregressive filter, and weights against bursts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MEMORY = 0.15
"""Memory [s] of the filter."""
MOST_TAPS = 40
RESOLUTION = 0.5
"""Of the noise's spectrum [Hz],"""
LINE_WIDTH = 13
"""which is a running median over so many lines, so that none of them is taken for noise where the speed is constant;"""
SLOW = 3.0
"""below this [Hz] it stays as it is: the torque of a wrong model is steep there."""
BURST = 0.5
"""The noise's size is followed over this time [s]."""
QUIET = 0.3
"""No sample counts more than as if the noise were this part of the usual."""


@dataclass(frozen=True, eq=False)
class Whitener:
    """Filter ``A = 1 - sum a_k z^-k`` fitted to a residual, then a weight per sample; zero where nothing counts.

    `taps` (n_taps,), `weights` one (n,) per run.
    """

    taps: FloatArray
    weights: list[FloatArray]

    def apply(self, x: FloatArray, run: int) -> FloatArray:
        """Whitened columns of `x` (n,) or (n, k)."""
        from scipy.signal import lfilter

        y: FloatArray = lfilter(self.taps, [1.0], x, axis=0)
        return y * (self.weights[run] if x.ndim == 1 else self.weights[run][:, None])

    def adjoint(self, y: FloatArray, run: int) -> FloatArray:
        """Transpose of `apply` on (n,)."""
        from scipy.signal import lfilter

        back: FloatArray = lfilter(self.taps, [1.0], (self.weights[run] * y)[::-1])[::-1]
        return back

    def power(self, angle_per_sample: FloatArray) -> FloatArray:
        """Gain squared of the filter for a sine that turns by so much per sample [rad]."""
        n = 4096
        table = np.abs(np.fft.rfft(self.taps, n)) ** 2
        folded = np.abs((angle_per_sample + np.pi) % (2 * np.pi) - np.pi)
        gain: FloatArray = np.interp(folded, np.linspace(0, np.pi, len(table)), table)
        return gain


def fit_whitener(residuals: Sequence[FloatArray], used: Sequence[NDArray[np.bool_]], rate: float) -> Whitener:
    """Whitener of residuals (n,) of several runs, from the samples that are used.

    The autoregression is that of Yule and Walker; a whitened residual has unit variance everywhere.
    """
    from scipy.linalg import solve_toeplitz
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import lfilter

    n = sum(int(keep.sum()) for keep in used)
    n_taps = int(min(MOST_TAPS, max(2, MEMORY * rate), n / 40))
    covariance = smooth_covariance(residuals, used, rate, n_taps + 1)
    covariance[0] *= 1 + 1e-9
    taps = np.concatenate([[1.0], -solve_toeplitz(covariance[:-1], covariance[1:])])
    weights = []
    for r, keep in zip(residuals, used, strict=True):
        white = lfilter(taps, [1.0], r)
        length = max(5, int(BURST * rate))
        count = uniform_filter1d(keep.astype(np.float64), length)
        size = np.sqrt(np.maximum(uniform_filter1d(white**2 * keep, length), 0.0) / np.maximum(count, 1 / length))
        usual = np.median(size[keep])
        weight = np.where(keep, 1 / np.maximum(size, QUIET * usual), 0.0)
        weight[:n_taps] = 0.0
        weights.append(weight)
    return Whitener(taps, weights)


def smooth_covariance(
    residuals: Sequence[FloatArray], used: Sequence[NDArray[np.bool_]], rate: float, n_lags: int
) -> FloatArray:
    """Autocovariance (n_lags,) of the noise under whatever stands in single lines of the spectrum."""
    from scipy.ndimage import median_filter
    from scipy.signal import welch

    longest = max(len(r) for r in residuals)
    length = int(min(rate / RESOLUTION, longest / 2))
    total = np.zeros(length // 2 + 1)
    for r, keep in zip(residuals, used, strict=True):
        if len(r) >= length:
            frequency, density = welch(np.where(keep, r - r[keep].mean(), 0.0), rate, nperseg=length)
            total += len(r) * density
    smooth = median_filter(total, min(LINE_WIDTH, len(total)), mode="nearest")
    slow = frequency < SLOW
    smooth[slow] = np.maximum(smooth, total)[slow]
    covariance: FloatArray = np.fft.irfft(np.maximum(smooth, 1e-12 * smooth.max()))[:n_lags]
    return covariance
