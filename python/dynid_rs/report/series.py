"""Long signals made short enough to draw: envelopes, means in bins, autocorrelation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

_MAX_SEGMENTS = 100
_GAP_STEPS = 5.0


def envelope(t: Array, values: Array, max_points: int) -> tuple[Array, Array]:
    """Minimum and maximum per bucket, in their order, with gaps in time left open.

    Parameters
    ----------
    t : ndarray, (n,)
        Time [s], increasing.
    values : ndarray, (n, k)
        Signals.
    max_points : int
        About how many points to keep.

    Returns
    -------
    t, values : ndarray, (m,) and (m, k)
        NaN rows stand where the line must break.
    """
    step = np.diff(t)
    gaps = np.flatnonzero(step > _GAP_STEPS * np.median(step)) + 1 if t.size > 1 else np.empty(0, dtype=np.intp)
    if gaps.size >= _MAX_SEGMENTS:
        gaps = gaps[:0]
    times, parts = [], []
    for rows in np.split(np.arange(t.size), gaps):
        share = max(2, round(max_points * rows.size / t.size))
        short_t, short = _envelope_of_segment(t[rows], values[rows], share)
        times += [short_t, short_t[-1:]]
        parts += [short, np.full((1, values.shape[1]), np.nan)]
    return np.concatenate(times[:-1]), np.concatenate(parts[:-1])


def _envelope_of_segment(t: Array, values: Array, max_points: int) -> tuple[Array, Array]:
    n, k = values.shape
    if n <= max_points:
        return t, values
    size = -(-n // max(1, max_points // 2))
    n_buckets = -(-n // size)
    # The last bucket is filled up with its last sample, which changes neither extreme.
    rows = np.minimum(np.arange(n_buckets * size), n - 1).reshape(n_buckets, size)
    buckets = values[rows]
    low, high = buckets.argmin(axis=1), buckets.argmax(axis=1)
    pick = np.stack([np.minimum(low, high), np.maximum(low, high)], axis=1)
    short = np.take_along_axis(buckets, pick, axis=1).reshape(2 * n_buckets, k)
    return t[rows[:, [0, size // 2]]].reshape(-1), short


def binned_mean(x: Array, y: Array, n_bins: int) -> tuple[Array, Array]:
    """Mean of `y` in equal bins of `x`; zero is an edge, because friction jumps there."""
    largest = float(np.abs(x).max(initial=0.0))
    if largest == 0.0:
        return np.empty(0), np.empty(0)
    width = 2.0 * largest / n_bins
    code = np.clip(np.floor(x / width).astype(np.int64) + n_bins // 2, 0, n_bins - 1)
    number = np.bincount(code, minlength=n_bins)
    kept = number >= max(3, x.size // 2000)
    total = np.bincount(code, weights=y, minlength=n_bins)
    centre = (np.arange(n_bins) - n_bins // 2 + 0.5) * width
    return centre[kept], total[kept] / number[kept]


def thin(n: int, extremes: Array, max_points: int) -> NDArray[np.intp]:
    """Rows of a random, repeatable choice that keeps the largest and the smallest of `extremes` (n,)."""
    if n <= max_points:
        return np.arange(n)
    chosen = np.random.default_rng(0).choice(n, size=max_points, replace=False)
    return np.unique(np.append(chosen, [extremes.argmin(), extremes.argmax()]))


def autocorrelation(runs: list[Array], n_lags: int) -> Array:
    """Autocorrelation at lags 0 .. n_lags - 1, runs taken together but never across their ends."""
    total = np.zeros(n_lags)
    for run in runs:
        centred = run - run.mean()
        length = 1 << int(2 * run.size - 1).bit_length()
        spectrum = np.fft.rfft(centred, length)
        lags = min(n_lags, run.size)
        total[:lags] += np.fft.irfft(np.abs(spectrum) ** 2, length)[:lags]
    return total / total[0] if total[0] > 0.0 else total
