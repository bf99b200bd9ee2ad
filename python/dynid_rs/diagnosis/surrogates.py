"""Residuals that depend on nothing but remember as long: the null against which dependence is judged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.rows_beside import JointRows

FloatArray = NDArray[np.float64]


SMOOTH = 9
"""Lines of a spectrum that are averaged before two are compared."""
MOST = 10.0
"""Most by which a line's power is raised."""


def surrogates(rows: JointRows, n: int, random_state: int) -> FloatArray:
    """Copies (n_rows, n) of a joint's residual that have its spectrum once the declared model was fitted to them.

    The residual has lost to the declared columns what looks like them, mostly slow motion. A copy of its spectrum would
    lose that twice, and gain less by chance than the residual does; so it is raised by what a first copy loses.
    """
    first = phase_randomised(rows.residual, rows.block, n, random_state)
    left = first - rows.whole.taken @ (rows.whole.taken.T @ first)
    raised = rows.residual.copy()
    for k in np.unique(rows.block):
        here = rows.block == k
        kept = _smooth_power(left[here]) / np.maximum(_smooth_power(first[here]), 1e-300)
        spectrum = np.fft.rfft(raised[here]) / np.sqrt(np.clip(kept, 1 / MOST, 1.0))
        raised[here] = np.fft.irfft(spectrum, int(here.sum()))
    return phase_randomised(raised, rows.block, n, random_state + 1)


def _smooth_power(x: FloatArray) -> FloatArray:
    """Mean spectrum of the columns of `x` (n, k), smoothed, (n // 2 + 1,)."""
    from scipy.ndimage import uniform_filter1d

    power = np.mean(np.abs(np.fft.rfft(x, axis=0)) ** 2, axis=1)
    return np.asarray(uniform_filter1d(power, SMOOTH, mode="nearest"))


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
