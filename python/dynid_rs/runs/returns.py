"""Motion that returns: a run goes round several times, or two runs are the same trajectory.

Whatever a model lacks is then there again, and what was left out has been seen elsewhere: rows of the same phase say
one thing of a misfit, however often the motion passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ALIKE = 0.01
"""Stretches that differ by less than this part of the motion's power, a tenth of its size, are the same motion."""
LEFT = 0.5
"""The same of a motion that has left where it was; of what has nothing to do with each other it is one."""
LEAST = 1 / 8
"""Part of a run that has to return; of two runs, half of the shorter one."""
MOST = 4096
"""Samples of a run that are compared."""


def phases(runs: Sequence[States]) -> IntArray:
    """Phase of every row of all runs, (n_rows,): rows of the same number show the same motion again.

    In the order of time where nothing returns, no two alike.
    """
    thin = -(-max(len(states.grid) for states in runs) // MOST)
    motions = [_motion(states)[::thin] for states in runs]
    usual = np.concatenate(motions).reshape(-1, 2, runs[0].q.shape[1]).std(axis=0)
    size = np.sqrt(np.mean(usual**2, axis=1)).repeat(usual.shape[1])  # joints that rest show noise, and little of it
    longest = max(map(len, motions))
    tracks: list[_Track] = []
    found = []
    for x, states in zip(motions, runs, strict=True):
        stretch = _Stretch.of(x / np.where(size > 0, size, 1.0), 2 * longest)
        track, ahead = _shown_again(stretch, tracks)
        if track is None:
            track = _Track(stretch, 4 * thin * longest * len(tracks), _period(stretch))
            tracks.append(track)
        found.append(track.phase(ahead + np.searchsorted(states.grid, states.rows) / thin, thin))
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A motion (n, k), its spectrum, and its power before every sample (n + 1,)."""

    x: FloatArray
    spectrum: NDArray[np.complex128]
    power: FloatArray
    size: int

    @staticmethod
    def of(x: FloatArray, n: int) -> _Stretch:
        """A motion that is compared with others at `n` lags."""
        from scipy.fft import next_fast_len, rfft

        size = next_fast_len(n)
        return _Stretch(x, rfft(x, size, axis=0), np.concatenate([[0.0], np.cumsum(np.sum(x**2, axis=1))]), size)

    def distances(self, other: _Stretch) -> tuple[FloatArray, IntArray, IntArray]:
        """Power of ``self[t + lag] - other[t]`` over that of two motions, every lag, and how many samples overlap."""
        from scipy.fft import irfft

        n, m = len(self.x), len(other.x)
        cross = irfft(np.sum(self.spectrum * np.conj(other.spectrum), axis=1), self.size)
        lags = np.arange(1 - m, n)
        start, end = np.maximum(lags, 0), np.minimum(lags + m, n)
        both = self.power[end] - self.power[start] + other.power[end - lags] - other.power[start - lags]
        own = max(float(self.x.var(axis=0).sum() + other.x.var(axis=0).sum()), 1e-300)
        distance: FloatArray = (both - 2 * cross[lags % self.size]) / (own * (end - start))
        return distance, lags, end - start


@dataclass(frozen=True, eq=False)
class _Track:
    """A motion, the phase that it begins with, and after how many of its samples it returns, if it does."""

    stretch: _Stretch
    first: int
    period: float | None

    def phase(self, at: FloatArray, thin: int) -> IntArray:
        """Phase of its samples `at`, `thin` rows each."""
        at = at if self.period is None else np.mod(at, self.period)
        return self.first + np.rint(thin * at).astype(np.int64)


def _shown_again(stretch: _Stretch, tracks: Sequence[_Track]) -> tuple[_Track | None, float]:
    """The track that a run shows again, and from which of its samples on."""
    for track in tracks:
        distance, lags, overlap = track.stretch.distances(stretch)
        enough = overlap >= min(len(stretch.x), len(track.stretch.x)) / 2
        best = int(np.argmin(np.where(enough, distance, np.inf)))
        if distance[best] < ALIKE:
            return track, float(lags[best])
    return None, 0.0


def _motion(states: States) -> FloatArray:
    """Positions and speeds on the grid, (n_grid, 2 n_joints)."""
    return np.column_stack([states.q[states.grid], states.dq[states.grid]])


def _period(stretch: _Stretch) -> float | None:
    """After how many samples a motion returns, as its farthest return tells."""
    distance, lags, overlap = stretch.distances(stretch)
    distance, overlap = distance[lags >= 0], overlap[lags >= 0]
    enough = overlap >= LEAST * len(stretch.x)
    left = np.flatnonzero(distance > LEFT)
    if not len(left):
        return None
    close = np.flatnonzero(enough & (distance < ALIKE) & (np.arange(len(distance)) > left[0]))
    if not len(close):
        return None
    first = _nearest(distance, int(close[0]))
    period = float(first)
    for times in range(2, len(stretch.x) // first + 1):
        around = round(times * period)
        if around >= len(distance) or not enough[around] or distance[around] > ALIKE:
            break
        period = _nearest(distance, around) / times
    return period


def _nearest(distance: FloatArray, at: int) -> int:
    """The lag of the least distance downhill from one."""
    while True:
        lower = min((k for k in (at - 1, at, at + 1) if 0 <= k < len(distance)), key=lambda k: distance[k])
        if lower == at:
            return at
        at = lower
