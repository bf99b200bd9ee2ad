"""Stretches of the training runs that repeat each other: a period that comes again, or a run recorded twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

ALIKE = 0.02
"""Positions of a repetition differ by less than this part of their spread, every joint's, root mean square."""
LEAST_OVERLAP = 4.0
"""Shortest stretch [s] that counts as a repetition."""
LEAST_SHIFT = 2.0
"""Shortest period [s]."""
RATE = 20.0
"""Samples per second [Hz] at which shifts are searched; what is found is refined."""


@dataclass(frozen=True)
class Repeat:
    """Run `second` at time ``t + shift`` [s] moves as run `first` at `t`; both may be the same run."""

    first: int
    second: int
    shift: float


def find_repeats(runs: Sequence[States]) -> list[Repeat]:
    """Find, for every run and pair of runs, the shift at which most of one repeats the other, where there is one."""
    spread = np.std(np.concatenate([states.q for states in runs]), axis=0)
    return [
        Repeat(i, k, shift)
        for i, k in combinations_with_replacement(range(len(runs)), 2)
        for shift in _shift(runs[i], runs[k], np.where(spread > 0, spread, np.inf), same=i == k)
    ]


def _shift(one: States, other: States, spread: FloatArray, *, same: bool) -> Iterator[float]:
    """The best shift, if any."""
    step = max(1, round(one.rate / RATE))
    a, b = one.q[::step] / spread, other.q[::step] / spread
    here, there = one.moving[::step].astype(float), other.moving[::step].astype(float)
    rate = one.rate / step
    # Mean squared distance at every lag, over samples that move in both: three correlations.
    pairs = _lagged(here[:, None], there[:, None])
    distance = (
        _lagged(here[:, None] * a**2, there[:, None] * np.ones_like(b))
        + _lagged(here[:, None] * np.ones_like(a), there[:, None] * b**2)
        - 2 * _lagged(here[:, None] * a, there[:, None] * b)
    )
    lag = np.arange(-(len(a) - 1), len(b))
    allowed = pairs[:, 0] > LEAST_OVERLAP * rate
    if same:
        allowed &= lag >= LEAST_SHIFT * rate
    if not allowed.any():
        return
    mean = np.where(allowed[:, None], distance / np.maximum(pairs, 1.0), np.inf)
    # A coarse grid misses the shift by up to half a sample; refined below before it is judged.
    best = int(np.argmin(mean.sum(axis=1)))
    coarse = float(lag[best] / rate)
    shift = _refined(one, other, coarse)
    if abs(shift - coarse) > 1.5 / rate:
        return  # nothing alike there: the steps went to where the motion is compared with itself
    q, q_again = overlap(one, other, shift, one.q, other.q)
    if len(q) > LEAST_OVERLAP * one.rate and np.all(np.sqrt(np.mean((q_again - q) ** 2, axis=0)) < ALIKE * spread):
        yield shift


def _refined(one: States, other: States, shift: float) -> float:
    """Newton's steps on the squared distance: what the velocity says about the shift."""
    for _ in range(3):
        q, q_again = overlap(one, other, shift, one.q, other.q)
        dq, _ = overlap(one, other, shift, one.dq, other.dq)
        if len(q) == 0 or not np.any(dq):
            break
        shift -= float(np.sum(dq * (q_again - q)) / np.sum(dq**2))
    return shift


def overlap(one: States, other: States, shift: float, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`x` (n, k) of one run and `y` of the other, `shift` later, at the samples at which both move, (m, k) each."""
    at = (one.t - one.t[0] + shift) * other.rate
    inside = np.flatnonzero((at >= 0) & (at <= len(other.t) - 1) & one.moving)
    low = np.minimum(at[inside].astype(np.intp), len(other.t) - 2)
    both = other.moving[low] & other.moving[low + 1]
    inside, low = inside[both], low[both]
    part = (at[inside] - low)[:, None]
    return x[inside], (1 - part) * y[low] + part * y[low + 1]


def _lagged(a: FloatArray, b: FloatArray) -> FloatArray:
    """``sum_t a(t) b(t + lag)`` per column, lags from -(len(a) - 1) to len(b) - 1."""
    from scipy.signal import fftconvolve

    return np.asarray(fftconvolve(b, a[::-1], axes=0))
