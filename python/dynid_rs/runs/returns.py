"""Motion that returns: a run goes round several times, or two runs show the same trajectory.

Whatever a model lacks is then there again, and what was left out has been seen elsewhere: rows of the same phase say
one thing of a misfit, however often the motion passes. Runs are compared as wholes, pauses aside: a motion that returns
for a part of a run only, or at another speed, is not seen to.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]

ALIKE = 0.01
"""Part of two motions' power by which they may differ where they are the same; that is all of it for two that have
nothing to do with each other."""
LEFT = 0.5
"""The same of a motion that has left where it was."""
LEAST = 1 / 8
"""Part of a run that has to return; of two runs, half of what moves in the shorter one."""
LEAST_SIZE = 0.2
"""Size of a joint's motion over that of all joints below which it counts as that large: one that rests shows noise."""
MOST = 32768
"""Samples of a run that are compared."""

_KEPT: OrderedDict[tuple[object, ...], IntArray] = OrderedDict()
"""Phases of the runs that were asked for last: every fit of the same runs asks again."""
MOST_KEPT = 8


def phases(runs: Sequence[States]) -> IntArray:
    """Phase of every row of all runs, (n_rows,): rows of the same number show the same motion.

    In the order of time where nothing returns, no two alike.
    """
    key = tuple(states.motion for states in runs)
    found = _KEPT.get(key)
    if found is None:
        found = _KEPT[key] = _phases(runs)
        while len(_KEPT) > MOST_KEPT:
            _KEPT.popitem(last=False)
    return found


def _phases(runs: Sequence[States]) -> IntArray:
    thin = -(-max((len(states.grid) for states in runs), default=1) // MOST)
    motions = _motions(runs, thin)
    longest = max(map(len, motions), default=0)
    pairs = zip(motions, runs, strict=True)
    shown = [_Stretch.of(x, states.moving[states.grid][::thin], 2 * longest) for x, states in pairs]
    tracks: list[_Track] = []
    found: dict[int, IntArray] = {}
    for k in sorted(range(len(runs)), key=lambda k: -len(motions[k])):  # a short one may not go round
        track, ahead = _shown_again(shown[k], tracks)
        if track is None:
            track = _Track(shown[k], 4 * thin * longest * k, _period(shown[k]))
            tracks.append(track)
        found[k] = track.phase(ahead + np.searchsorted(runs[k].grid, runs[k].rows) / thin, thin)
    return np.concatenate([np.zeros(0, dtype=np.int64), *(found[k] for k in range(len(runs)))])


def _motions(runs: Sequence[States], thin: int) -> list[FloatArray]:
    """Positions and speeds of every run over their usual size, (n, 2 n_joints) each, at every `thin`th of its rows."""
    parts = [np.concatenate([states.q, states.dq], axis=1)[states.grid][::thin] for states in runs]
    if not parts:
        return []
    whole = np.concatenate(parts)
    mean = whole.mean(axis=0)
    sides = np.split(whole.std(axis=0), 2)  # of positions, of speeds
    size = np.concatenate([np.maximum(side, LEAST_SIZE * np.sqrt(np.mean(side**2))) for side in sides])
    return [(part - mean) / np.where(size > 0, size, 1.0) for part in parts]


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A motion (n, k), zeros where it pauses, and where it does not; it is compared at `n_lags` lags."""

    x: FloatArray
    moves: FloatArray
    n_lags: int

    @staticmethod
    def of(x: FloatArray, moves: NDArray[np.bool_], n_lags: int) -> _Stretch:
        """A motion of which only some samples move."""
        return _Stretch(x * moves[:, None], moves.astype(np.float64), n_lags)

    @cached_property
    def spectra(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Of the motion, of its power, and of where it moves."""
        from scipy.fft import next_fast_len, rfft

        size = next_fast_len(self.n_lags)
        X, power, moves = (rfft(part, size, axis=0) for part in (self.x, np.sum(self.x**2, axis=1), self.moves))
        return X, power, moves

    def distances(self, other: _Stretch) -> tuple[FloatArray, IntArray, FloatArray]:
        """Power of ``self[t + lag] - other[t]`` over that of both, every lag, and in how many samples both move."""
        from scipy.fft import irfft, next_fast_len

        (X, power, moves), (Y, other_power, other_moves) = self.spectra, other.spectra
        change = power * other_moves.conj() + moves * other_power.conj() - 2 * np.sum(X * Y.conj(), axis=1)
        size, lags = next_fast_len(self.n_lags), np.arange(1 - len(other.x), len(self.x))
        both: FloatArray = np.rint(irfft(moves * other_moves.conj(), size)[lags % size])
        own = max(self.size + other.size, 1e-300)
        distance: FloatArray = irfft(change, size)[lags % size] / (own * np.maximum(both, 1.0))
        return distance, lags, both

    @cached_property
    def size(self) -> float:
        """Power of the motion about its mean."""
        inside = self.x[self.moves > 0]
        return float(inside.var(axis=0).sum()) if len(inside) else 0.0


@dataclass(frozen=True, eq=False)
class _Track:
    """A motion, the phase that it begins with, and after how many of its samples it returns, if it does."""

    stretch: _Stretch
    first: int
    period: float | None

    def phase(self, at: FloatArray, thin: int) -> IntArray:
        """Phase of its samples `at`, `thin` rows each."""
        at = at if self.period is None else np.mod(at, self.period)
        return self.first + np.floor(thin * at + 0.5 + 1e-6).astype(np.int64)


def _shown_again(stretch: _Stretch, tracks: Sequence[_Track]) -> tuple[_Track | None, float]:
    """The track that a run shows again, and from which of its samples on."""
    for track in tracks:
        distance, lags, both = track.stretch.distances(stretch)
        enough = both >= max(min(stretch.moves.sum(), track.stretch.moves.sum()) / 2, 1.0)
        best = int(np.argmin(np.where(enough, distance, np.inf)))
        if enough[best] and distance[best] < ALIKE:
            return track, float(lags[best])
    return None, 0.0


def _period(stretch: _Stretch) -> float | None:
    """After how many samples a motion returns, as its farthest return tells."""
    distance, lags, both = stretch.distances(stretch)
    distance, enough = distance[lags >= 0], both[lags >= 0] >= max(LEAST * stretch.moves.sum(), 1.0)
    left = np.flatnonzero(enough & (distance > LEFT))
    close = np.flatnonzero(enough & (distance < ALIKE) & (np.arange(len(distance)) > min(left, default=np.inf)))
    if not len(close):
        return None
    first = _nearest(distance, int(close[0]))
    period = float(first)
    for times in range(2, len(distance) // first + 1):
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
