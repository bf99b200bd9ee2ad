"""Residuals that depend on nothing but remember as long: the null against which dependence is judged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def phase_randomised(residual: FloatArray, block: NDArray[np.intp], n: int, random_state: int) -> FloatArray:
    """Copies (n_rows, n) of `residual` (n_rows,) with the spectrum of every block kept and its phases drawn.

    Theiler et al. 1992, Physica D 58: whatever correlation in time the residual has, its copies have too, but not at
    the states where it had it.
    """
    rng = np.random.default_rng(random_state)
    out = np.zeros((len(residual), n))
    for k in np.unique(block):
        here = block == k
        part = residual[here] - residual[here].mean()
        spectrum = np.fft.rfft(part)
        turned = np.abs(spectrum)[:, None] * _phases(rng, (len(spectrum), n))
        out[here] = np.fft.irfft(turned, len(part), axis=0)
    return out


def upper_tail(value: float, null: FloatArray) -> float:
    """Probability that the null (n,) of a maximum reaches `value`: a Gumbel law through its mean and spread.

    Counting cannot say less than 1 / (n + 1), and a maximum over many sets is what a Gumbel law is made for.
    """
    from scipy.stats import gumbel_r

    if not np.ptp(null) > 0:
        return float(np.mean(null >= value))
    spread = float(null.std(ddof=1)) * np.sqrt(6) / np.pi
    return float(gumbel_r.sf(value, float(null.mean()) - np.euler_gamma * spread, spread))


def _phases(rng: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.complex128]:
    """Complex numbers of length one at random angles."""
    angle = 2 * np.pi * rng.random(shape)
    return np.asarray(np.cos(angle) + 1j * np.sin(angle))
