"""Finding pairs of instants with the same q and opposite dq in a measured run (Eq. 5), without knowing its plan.

A motion and its reversal are mirror images about some instant of rest, whatever the motion is: constant speed out and
back, or anything played forwards and backwards. So one search finds both: instants of rest are tried as mirrors, each
is put where the positions on both sides agree best, and is followed outwards for as long as they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.runs.preprocessing import STILL_TIME, States, stretches

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

STILL_NOISE = 6.0
"""A joint moves where its speed is above this many standard deviations of the velocity's noise."""
STILL_SHARE = 2e-4
"""... and above this part of its greatest speed: the ripple of filters is no motion."""
CREEP = 5e-3
"""A joint that stays within this [rad, m] over a run rests: what its controller lets it creep mirrors nothing."""
LEAST_REST = 0.1
"""Shortest rest that may be a mirror [s]."""
LATEST_MIRROR = 0.25
"""The mirror stands within this time of the middle of the rest [s]: following errors shift it."""
ALIKE = 0.75
"""The mirror is placed by this much motion on each side of the rest [s]."""
SAME_SPEED = 0.05
"""Speeds on both sides of a mirror differ by at most this part of the greatest one nearby."""
SAME_PLACE = 5e-3
"""Positions on both sides differ by at most this part of the joint's range."""
LEAST_WINDOW = 0.4
"""Shortest motion on one side of a mirror [s]."""
CHUNK = 5.0
"""A mirror is followed outwards in steps of this length [s]."""
NEARBY = 0.25
"""Speeds are compared with the greatest one within this time [s]."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """A motion and its reversal: samples ``middle - k`` and ``middle + k``, k up to `reach`.

    `middle` counts samples from the run's start and may lie between two of them; `moves` (n_joints,) tells which
    joints moved.
    """

    states: States
    middle: float
    first: int
    reach: int
    moves: Mask

    def samples(self) -> tuple[NDArray[np.intp], FloatArray]:
        """Samples (n,) after the mirror and the places (n,) of their images before it, not whole numbers."""
        after = np.arange(self.first, self.first + self.reach)
        before: FloatArray = np.asarray(2 * self.middle - after, dtype=np.float64)
        return after, before


def still_speed(states: States) -> FloatArray:
    """Speed below which a joint counts as at rest, (n_joints,) [rad/s]."""
    n = states.dq_motor.shape[1]
    noise = np.array([states.velocity_noise(j) for j in range(n)])
    limit: FloatArray = np.maximum(STILL_NOISE * noise, STILL_SHARE * np.abs(states.dq_motor).max(axis=0))
    return limit


def find_mirrors(states: States) -> list[Mirror]:
    """Every motion of the run that was also made the other way round; no sample belongs to two of them."""
    limit, span = still_speed(states), np.ptp(states.q_motor, axis=0)
    place = SAME_PLACE * span + 1e-9
    limit[span <= CREEP] = place[span <= CREEP] = np.inf
    still = np.all(np.abs(states.dq_motor) <= limit, axis=1)
    rests = [(a, b) for a, b in stretches(still) if b - a >= LEAST_REST * states.rate]
    found = [mirror for a, b in rests if (mirror := _mirror_at(states, a, b, limit, place)) is not None]
    used = np.zeros(len(states.t), dtype=bool)
    kept = []
    for mirror in sorted(found, key=lambda mirror: -mirror.reach):
        cut = _unused(mirror, used)
        if cut is not None:
            after, before = cut.samples()
            used[after], used[np.round(before).astype(int)] = True, True
            kept.append(cut)
    return sorted(kept, key=lambda mirror: mirror.middle)


def _mirror_at(states: States, start: int, end: int, limit: FloatArray, place: FloatArray) -> Mirror | None:
    """Mirror in the rest from sample `start` to `end`, if the motion around it is one and its reversal."""
    q, dq, rate = states.q_motor, states.dq_motor, states.rate
    middle = _best_middle(q, start, end, rate)
    first = int(np.ceil(middle))
    longest = int(min(2 * middle - first + 1, len(q) - first))
    reach, chunk = 0, int(CHUNK * rate)
    while reach < longest:  # most mirrors end soon
        after = first + np.arange(reach, min(reach + chunk, longest))
        agrees = _agree(states, middle, after, limit, place)
        # A single odd sample (a resampling step) does not end a motion; a few in a row do.
        wrong = [a for a, b in stretches(~agrees) if b - a > 0.05 * rate]
        reach += wrong[0] if wrong else len(after)
        if wrong:
            break
    if reach < LEAST_WINDOW * rate:
        return None
    after = np.arange(first, first + reach)
    moves: Mask = np.any(np.abs(dq[after]) > 2 * limit, axis=0)
    if not moves.any():
        return None
    # Rest at the far end says nothing.
    last = np.flatnonzero(np.any(np.abs(dq[after]) > limit, axis=1))[-1]
    reach = int(min(reach, last + LEAST_REST * rate))
    return Mirror(states, middle, first, reach, moves) if reach >= LEAST_WINDOW * rate else None


def _agree(states: States, middle: float, after: NDArray[np.intp], limit: FloatArray, place: FloatArray) -> Mask:
    """Whether the samples `after` the mirror and their images have the same q and opposite dq."""
    from scipy.ndimage import maximum_filter1d

    q, dq, before = states.q_motor, states.dq_motor, np.asarray(2 * middle - after, dtype=np.float64)
    dq_before = at_places(dq, before)
    near = 2 * max(1, int(NEARBY * states.rate)) + 1
    speed = maximum_filter1d(np.maximum(np.abs(dq[after]), np.abs(dq_before)), near, axis=0, mode="nearest")
    same_speed = np.abs(dq[after] + dq_before) <= SAME_SPEED * speed + 2 * limit
    agrees: Mask = np.all(same_speed & (np.abs(q[after] - at_places(q, before)) <= place), axis=1)
    return agrees


def _best_middle(q: FloatArray, start: int, end: int, rate: float) -> float:
    """Where positions on both sides of a rest agree best, to a part of a sample."""
    farthest = min(int(LATEST_MIRROR * rate), (end - start) // 2 + 1)
    reach = (end - start) // 2 + farthest + int(ALIKE * rate)
    sums = np.arange(start + end - 1 - 2 * farthest, start + end + 2 * farthest)
    errors = np.full(len(sums), np.inf)
    near = q[max(0, start - 2 * reach) : end + 2 * reach]
    turned = np.ptp(near, axis=0) > 0
    for k, total in enumerate(sums):
        first = total // 2 + 1
        if total - first - reach + 1 >= 0 and first + reach <= len(q):
            after = q[first : first + reach, turned]
            before = q[total - first - reach + 1 : total - first + 1, turned][::-1]
            errors[k] = np.mean((after - before) ** 2)
    best = int(np.argmin(errors))
    shift = 0.0
    if 0 < best < len(sums) - 1 and np.isfinite(errors[best - 1 : best + 2]).all():
        left, here, right = errors[best - 1 : best + 2]
        bend = left - 2 * here + right
        shift = float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend > 0 else 0.0
    return float(sums[best] + shift) / 2


def _unused(mirror: Mirror, used: Mask) -> Mirror | None:
    """The part of a mirror next to its middle that no longer one has taken."""
    after, before = mirror.samples()
    taken = np.flatnonzero(used[after] | used[np.round(before).astype(int)])
    reach = int(taken[0]) if len(taken) else mirror.reach
    return replace(mirror, reach=reach) if reach >= LEAST_WINDOW * mirror.states.rate else None


def at_places(x: FloatArray, places: FloatArray) -> FloatArray:
    """Linear interpolation of x (n, ...) at fractional indices (m,)."""
    places = np.clip(places, 0, len(x) - 1)
    low = np.minimum(places.astype(int), len(x) - 2)
    part = (places - low).reshape(-1, *[1] * (x.ndim - 1))
    value: FloatArray = (1 - part) * x[low] + part * x[low + 1]
    return value


def in_motion(states: States, j: int, limit: float) -> Mask:
    """Samples (n,) at which joint j is not in a pause: friction at rest is not a function of the speed.

    A guard of the filter's memory keeps what it smears out of the pause away.
    """
    moving = np.ones(len(states.t), dtype=bool)
    guard = int(0.5 * states.rate / states.band.cutoff)
    for first, last in stretches(np.abs(states.dq_motor[:, j]) <= limit):
        if last - first > STILL_TIME * states.rate:
            moving[max(0, first - guard) : last + guard] = False
    return moving


def check_reversals(runs: Sequence[States], mirrors: Sequence[Sequence[Mirror]], names: Sequence[str]) -> None:
    """Refuse friction runs in which a joint moves but never back over the same positions.

    Raises
    ------
    DataError
        Names joint and file, and tells whether the joint never turned round or never repeated its way.
    """
    paired = np.any([m.moves for run in mirrors for m in run] + [np.zeros(len(names), dtype=bool)], axis=0)
    for j, name in enumerate(names):
        moving = [states for states in runs if np.ptp(states.q[:, j]) > CREEP]
        if paired[j] or not moving:
            continue
        speeds = np.concatenate([states.dq_motor[:, j] for states in moving])
        limit = max(still_speed(states)[j] for states in moving)
        one_way = not (np.any(speeds > 4 * limit) and np.any(speeds < -4 * limit))
        why = (
            "moves in one direction only, without reversal"
            if one_way
            else "turns round, but its speed is never constant over the same positions both ways and no motion is "
            "played backwards"
        )
        files = ", ".join(states.name for states in moving)
        raise DataError(
            f"{files}: joint {name} {why}; friction needs the same positions passed in both directions at the same "
            "speeds (`dynid excite --friction` plans such a run)",
            code="no_reversal",
            file=moving[0].name,
            column=f"q_{j}",
        )
