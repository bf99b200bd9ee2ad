"""Contact: an outside force for a limited time, as bursts of residual on one or several joints.

What counts is the residual that is local in time, against the scale that the same joint's has elsewhere: near its
reversals against other reversals, and beyond what the model itself is unsure of.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.spread import spread
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.runs.preprocessing import States, stretches
from dynid_rs.sensors.watch import Usual, Watch, watch_run

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LENGTHS = (0.3, 0.6, 1.0)
"""Bursts [s] that are looked for; longer ones are found by their parts."""
SURE, LIKELY = 6.0, 4.8
"""Standard deviations of a burst, on one joint or taken together over all: of the first, and of more beside it.

Sixty clean arms with four runs of 20 s each have none above 5.9, and two above 5.
"""
EDGE = 2.0
"""A window reaches as far as its burst stands out by this many standard deviations of the narrowest kernel."""
NEAREST = 0.25
"""Windows closer than this [s] are one."""
REVERSAL_EDGES = (0.15, 0.3, 0.5, 0.8)
"""Times from a reversal [s] between which residuals are compared with each other."""
QUANTILES, REST_QUANTILES = (0.5, 0.75, 0.9), (0.5, 0.75)
"""The scale is the greatest that these quantiles give: contact is rare, wrong models are not."""
LEAST_VALUES = 20
LEAST_CHANCE = 1e-304
"""Smaller chances are rounding."""
_TIMES = tuple(pairwise((0.0, *REVERSAL_EDGES, np.inf)))


@dataclass(frozen=True)
class Contact:
    """One burst: `start`, `end` [s] of its run's clock, the joints that feel it, each one's peak [torque unit].

    `most` is the joint whose torque it stands out of most: a heavy joint is off by more without any contact.
    """

    run: str
    start: float
    end: float
    joints: tuple[int, ...]
    peak: tuple[float, ...]
    strength: float
    most: int


def find_contacts(
    fit: ThreeLoopIdentifier, learned: Sequence[States], judged: Sequence[States] | None = None
) -> list[Contact]:
    """Find bursts in runs that were prepared without any exclusion.

    Nothing of the runs that are only judged touches the others: each is held against the scales of those that were
    learned from, and its own.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted without a third loop; windows that are known already may have been excluded.
    learned : sequence of States
        Training runs, channels as recorded.
    judged : sequence of States, optional
        Runs to look at, channels as recorded; the training runs by default.
    """
    lookout = Lookout(fit, learned)
    return lookout.learned if judged is None else lookout.judged(judged)


class Lookout:
    """What is usual in training runs, and what stands out of it: in them, and in runs that are only judged.

    Parameters are those of `find_contacts`.
    """

    def __init__(self, fit: ThreeLoopIdentifier, learned: Sequence[States]) -> None:
        self._fit, self._usual = fit, Usual(fit)
        watches = [watch_run(fit, states, self._usual) for states in learned]
        levels = [[_smooth(watch, length) for watch in watches] for length in LENGTHS]
        self._pools = [_Pool.of(watches, level) for level in levels]
        self._own = [_Burst.of(watch, [level[k] for level in levels], self._pools) for k, watch in enumerate(watches)]
        self._sure = max(burst.strongest for burst in self._own) >= SURE

    @property
    def learned(self) -> list[Contact]:
        """Bursts in the training runs."""
        return [contact for burst in self._own for contact in burst.contacts()] if self._sure else []

    def judged(self, runs: Sequence[States]) -> list[Contact]:
        """Bursts in other runs, channels as recorded."""
        others = []
        for states in runs:
            watch = watch_run(self._fit, states, self._usual)
            levels = [_smooth(watch, length) for length in LENGTHS]
            others.append(_Burst.of(watch, levels, self._pools, pooled=False))
        return [contact for burst in others if self._sure or burst.strongest >= SURE for contact in burst.contacts()]


@dataclass(frozen=True, eq=False)
class _Burst:
    """How much a run stands out: `z` (n_grid, n_joints) by kernel, `strength` (n_grid,) of all joints together.

    `near` (n_grid,): the same through the narrowest kernel, friction's part not taken off.
    """

    watch: Watch
    z: list[FloatArray]
    strength: FloatArray
    near: FloatArray

    @staticmethod
    def of(watch: Watch, levels: Sequence[_Level], pools: Sequence[_Pool], *, pooled: bool = True) -> _Burst:
        """Of a run through every kernel; `pooled` if the pools hold it."""
        spreads = [np.hypot(_scale_of(watch, x, pool, pooled), x.unsure) for x, pool in zip(levels, pools, strict=True)]
        z = [np.maximum(np.abs(x.m) - x.slack, 0) / spread for x, spread in zip(levels, spreads, strict=True)]
        near = _together(np.abs(levels[0].m) / spreads[0])
        return _Burst(watch, z, np.max([_together(level) for level in z], axis=0), near)

    @property
    def strongest(self) -> float:
        return float(self.strength.max())

    def contacts(self) -> list[Contact]:
        # The narrowest kernel says where a burst ends, all of them together where there is one. Where friction might
        # explain what is there, a push that was found goes on.
        windows = _windows(self.strength, self.near, self.watch)
        return [_contact(self.watch, self.z, self.strength, rows) for rows in windows]


def _contact(watch: Watch, z: Sequence[FloatArray], strength: FloatArray, window: tuple[int, int]) -> Contact:
    """Put a window (half-open range of samples) in words: when, which joints, how much."""
    rows = slice(*window)
    peaks = np.max([level[rows].max(axis=0) for level in z], axis=0)
    joints = np.flatnonzero(peaks >= min(peaks.max(), max(EDGE + 1, 0.3 * peaks.max())))
    residual = watch.residual[rows]
    peak = residual[np.abs(residual).argmax(axis=0), np.arange(len(peaks))]
    return Contact(
        watch.name,
        float(watch.t[window[0]]),
        float(watch.t[window[1] - 1]),
        tuple(joints.tolist()),
        tuple(peak[joints].tolist()),
        float(strength[rows].max()),
        int(peaks.argmax()),
    )


def windows_of(
    contacts: Sequence[Contact], known: Mapping[str, Sequence[tuple[float, float]]] | None = None
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Windows (start, end) [s] by run name, those of `known` joined with them."""
    result: dict[str, list[tuple[float, float]]] = {name: list(windows) for name, windows in (known or {}).items()}
    for contact in contacts:
        result.setdefault(contact.run, []).append((contact.start, contact.end))
    return {name: _joined(windows) for name, windows in result.items()}


def _joined(windows: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    joined: list[tuple[float, float]] = []
    for start, end in sorted(windows):
        if joined and start <= joined[-1][1] + NEAREST:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((start, end))
    return tuple(joined)


@dataclass(frozen=True, eq=False)
class _Level:
    """One run through a kernel of unit power; (n_grid, n_joints) each.

    Residual, what friction and the model's own doubt may be of it, and where most of the kernel saw something.
    """

    m: FloatArray
    slack: FloatArray
    unsure: FloatArray
    enough: BoolArray


def _smooth(watch: Watch, length: float) -> _Level:
    """Look at a run through a kernel of `length` [s]."""
    from scipy.ndimage import convolve1d

    kernel = np.hanning(max(1, round(length / watch.step)) + 2)[1:-1]
    if len(kernel) % 2 == 0:
        kernel = np.hanning(len(kernel) + 3)[1:-1]
    kernel /= np.linalg.norm(kernel)
    m, slack, unsure = (np.zeros(watch.seen.shape) for _ in range(3))
    enough, pausing = np.zeros(watch.seen.shape, dtype=bool), watch.pause[:, None] >= 0
    for there in (watch.seen & ~pausing, watch.seen & pausing):  # a brake that holds in pauses is not felt in motion
        if not there.any():
            continue
        share = np.sqrt(np.maximum(convolve1d(there.astype(float), kernel**2, axis=0, mode="constant"), 1e-12))
        told = there & (share > np.sqrt(0.5))
        # What the model does not know is wrong in the same direction all over the kernel.
        for smooth, x in ((m, watch.residual), (slack, watch.slack), (unsure, watch.unsure)):
            smooth[told] = (convolve1d(x * there, kernel, axis=0, mode="constant") / share)[told]
        enough |= told
    return _Level(m, slack, unsure, enough)


@dataclass(frozen=True, eq=False)
class _Pool:
    """What the runs that were learned from leave: its scale in motion, sizes near reversals and in pauses.

    `moving` (n_joints,); `near[k][j]` of the k-th time from a reversal and a joint, `pausing[j]` of a joint. A run that
    rests is a pose of its own; runs that move are alike.
    """

    moving: FloatArray
    near: list[list[_Alike]]
    pausing: list[_Alike]

    @staticmethod
    def of(watches: Sequence[Watch], level: Sequence[_Level]) -> _Pool:
        joints = range(level[0].m.shape[1])
        runs = list(zip(watches, level, strict=True))
        moving = [np.concatenate([np.abs(x.m[_moves(watch, x, j), j]) for watch, x in runs]) for j in joints]
        near = [[_Alike.joined([_Alike.of(watch, x, j, time) for watch, x in runs]) for j in joints] for time in _TIMES]
        pausing = [_Alike.joined([_Alike.in_pauses(watch, x, j) for watch, x in runs]) for j in joints]
        return _Pool(np.array([_scale(sizes, QUANTILES) for sizes in moving]), near, pausing)


@dataclass(frozen=True, eq=False)
class _Alike:
    """Sizes (n,) of what is left of a joint as long from a reversal, or in pauses; which one, run and number (n, 2)."""

    sizes: FloatArray
    turns: NDArray[Any]

    @staticmethod
    def of(watch: Watch, x: _Level, j: int, time: tuple[float, float]) -> _Alike:
        mask = _moves(watch, x, j) & _within(watch, j, time)
        turns = np.stack([np.full(mask.sum(), id(watch)), watch.turn[mask, j]], axis=1)
        return _Alike(np.abs(x.m[mask, j]), turns)

    @staticmethod
    def in_pauses(watch: Watch, x: _Level, j: int) -> _Alike:
        """Sizes in pauses, and which one."""
        mask = x.enough[:, j] & (watch.pause >= 0)
        turns = np.stack([np.full(mask.sum(), id(watch)), watch.pause[mask]], axis=1)
        return _Alike(np.abs(x.m[mask, j]), turns)

    @staticmethod
    def joined(parts: Sequence[_Alike]) -> _Alike:
        return _Alike(np.concatenate([part.sizes for part in parts]), np.concatenate([part.turns for part in parts]))

    @cached_property
    def whole(self) -> float:
        """Scale of all."""
        return _scale(self.sizes, QUANTILES)

    @cached_property
    def great(self) -> dict[tuple[int, int], float]:
        """Scale without one of them, of those that make up so much of all that the greatest quantile is their own.

        A push at one of three reversals is told by the others, not by itself.
        """
        turns, counts = np.unique(self.turns, axis=0, return_counts=True)
        found = {}
        for run, number in turns[counts > (1 - QUANTILES[-1]) * len(self.sizes)].tolist():
            others = (self.turns != (run, number)).any(axis=1)
            found[run, number] = _scale(self.sizes[others], QUANTILES)
        return found

    def scale(self, but: tuple[int, int]) -> float:
        """Scale of all, or without one reversal or pause where that is a great part of them."""
        return self.great.get(but, self.whole)


def _moves(watch: Watch, x: _Level, j: int) -> BoolArray:
    result: BoolArray = x.enough[:, j] & ~watch.resting & (watch.pause < 0)
    return result


def _within(watch: Watch, j: int, time: tuple[float, float]) -> BoolArray:
    result: BoolArray = (watch.since[:, j] >= time[0]) & (watch.since[:, j] < time[1])
    return result


def _scale_of(watch: Watch, x: _Level, pool: _Pool, pooled: bool) -> FloatArray:
    """Standard deviation that a run's smoothed residual has by itself at every sample, (n_grid, n_joints).

    The pool's or its own, whichever is greater; its own near reversals only where the pool does not hold it.
    """
    scale = np.full(x.m.shape, np.inf)
    in_motion = watch.pause < 0
    for j in range(x.m.shape[1]):
        for at_rest, common, quantiles in ((False, pool.moving[j], QUANTILES), (True, 0.0, REST_QUANTILES)):
            mask = x.enough[:, j] & (watch.resting == at_rest) & in_motion
            size = max(float(common), _scale(np.abs(x.m[mask, j]), quantiles))
            scale[mask, j] = size if size > 0 else np.inf
        for alike, time in zip(pool.near, _TIMES, strict=True):
            mask = _moves(watch, x, j) & _within(watch, j, time)
            _at_least(scale[:, j], mask, alike[j], _Alike.of(watch, x, j, time), pooled)
        mask = x.enough[:, j] & ~in_motion
        scale[mask, j] = pool.moving[j]
        _at_least(scale[:, j], mask, pool.pausing[j], _Alike.in_pauses(watch, x, j), pooled, alone=False)
    scale[scale == 0] = np.inf
    return scale


def _at_least(
    scale: FloatArray, mask: BoolArray, alike: _Alike, own: _Alike, pooled: bool, *, alone: bool = True
) -> None:
    """Raise a joint's scale (n_grid,) where `mask` is set to that of what is alike: reversals, or pauses.

    Of one that has no like nothing is known but itself, if it tells anything `alone`.
    """
    all_alike = [alike] if pooled else [alike, own]
    turns, place = np.unique(own.turns, axis=0, return_inverse=True)
    sizes = [max(group.scale((run, k)) for group in all_alike) or alone * own.whole for run, k in turns.tolist()]
    if sizes:
        scale[mask] = np.maximum(scale[mask], np.array(sizes)[place.ravel()])


def _scale(values: FloatArray, quantiles: Sequence[float]) -> float:
    return spread(values, quantiles) if len(values) >= LEAST_VALUES else 0.0


def _together(z: FloatArray) -> FloatArray:
    """Standard deviations of all joints taken together, or of the one that stands out most, (n_grid,)."""
    from scipy.special import chdtrc, chdtri

    tail = np.maximum(chdtrc(z.shape[1], np.sum(z**2, axis=1)), LEAST_CHANCE)
    # One degree of freedom with the same chance.
    result: FloatArray = np.maximum(np.sqrt(chdtri(1, tail)), z.max(axis=1))
    return result


def _windows(strength: FloatArray, near: FloatArray, watch: Watch) -> list[tuple[int, int]]:
    """Half-open ranges of samples around every burst, as far as it stands out."""
    marked = np.zeros(len(strength), dtype=bool)
    reach = max(1, round(LENGTHS[0] / 2 / watch.step))
    for peak in np.flatnonzero(strength > LIKELY):
        first = last = int(peak)
        # A dip no longer than the narrowest kernel is inside the burst.
        while first > 0 and near[max(0, first - reach) : first].max() > EDGE:
            first -= 1
        while last < len(near) - 1 and near[last + 1 : last + 1 + reach].max() > EDGE:
            last += 1
        marked[first : last + 1] = True
    gap = max(1, round(NEAREST / watch.step))
    for first, last in stretches(~marked):
        if first > 0 and last < len(marked) and last - first <= gap:
            marked[first:last] = True
    return stretches(marked)
