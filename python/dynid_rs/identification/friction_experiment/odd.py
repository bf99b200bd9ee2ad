"""Friction torque without any model: half the difference of the torques at one place and opposite speeds (Eq. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid_rs.identification.friction_experiment.pairs import (
    Mirror,
    at_places,
    check_reversals,
    find_mirrors,
    in_motion,
    still_speed,
)
from dynid_rs.runs.preprocessing import Band, States, common_rate, prepare
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

CUTOFF = 5.0
"""Band [Hz] of speeds where recordings are given and no other band is."""
CONSTANT = 0.02
"""A leg's speed stays within this part of its median."""
LEAST_LEG = 0.25
"""Shortest stretch of constant speed [s]."""
BLOCK = 0.25
"""Samples closer than this [s] count as one when errors are estimated; noise of drives is shorter."""
LEAST_BLOCKS = 6
"""Fewer blocks say nothing about their spread; a short leg is cut finer."""
N_BINS = 24
"""Speed classes of the time-reversed pairs, geometric."""


@dataclass(frozen=True, eq=False)
class OddFriction:
    """Odd part of one joint's friction, one value per speed.

    Parameters
    ----------
    joint : str
        Name.
    kind : tuple of {"leg", "reversed"}
        Whether a value comes from a pair of constant-speed legs or from time-reversed motion of that speed, (m,).
    speed : ndarray (m,)
        Mean of both sides' speeds, positive [rad/s, m/s].
    tau_odd : ndarray (m,)
        ``(tau_1 - tau_2) / 2`` [torque unit].
    std_error : ndarray (m,)
        Its standard error, from blocks longer than the noise's memory [torque unit].
    n_blocks : ndarray (m,)
        Blocks behind it.
    """

    joint: str
    kind: tuple[str, ...]
    speed: FloatArray
    tau_odd: FloatArray
    std_error: FloatArray
    n_blocks: NDArray[np.int64]


def odd_friction(
    runs: Recording | States | Sequence[Recording | States], *, names: Sequence[str] | None = None
) -> list[OddFriction]:
    """Friction by Eq. 8 from runs of the friction experiment, for every joint that moves in them.

    Friction need not be odd, as Eq. 4 has it: what is found is its odd part.

    Pairs are found in the measured data. On constant-speed legs inertia plays no part; where a motion is played
    backwards it cancels, because the acceleration is the same on both sides.

    Parameters
    ----------
    runs : Recording, States or a sequence of either
        Measured runs.
    names : sequence of str, optional
        Names of the joints; those of the first recording, else their indices.

    Raises
    ------
    ValueError
        There is no run.
    DataError
        A joint moves but is never moved back over the same positions at the same speed; names joint and file.
    """
    given = [runs] if isinstance(runs, Recording | States) else list(runs)
    if not given:
        raise ValueError("there is no run to read friction from; give one of the friction experiment at least")
    recordings = [run for run in given if isinstance(run, Recording)]
    rate = common_rate(recordings) if recordings else 0.0
    states = [prepare(run, Band(CUTOFF), rate) if isinstance(run, Recording) else run for run in given]
    if names is None:
        names = recordings[0].joints if recordings else [str(j) for j in range(states[0].q.shape[1])]
    mirrors = [find_mirrors(run) for run in states]
    check_reversals(states, mirrors, names)
    found = []
    for j, name in enumerate(names):
        samples = [_odd_samples(mirror, j) for run in mirrors for mirror in run if mirror.moves[j]]
        if samples:
            found.append(_summary(name, samples))
    return found


@dataclass(frozen=True, eq=False)
class _Samples:
    """Odd torque of one joint along a mirror: speed of the side after it (signed), torque, time since the mirror."""

    rate: float
    index: NDArray[np.intp]
    speed: FloatArray
    tau_odd: FloatArray
    top: float


def _odd_samples(mirror: Mirror, j: int) -> _Samples:
    states = mirror.states
    after, before = mirror.samples()
    moving = in_motion(states, j, float(still_speed(states)[j]))
    kept = moving[after] & moving[np.round(before).astype(int)]
    after, before = after[kept], before[kept]
    speed = (states.dq_motor[after, j] - at_places(states.dq_motor[:, j], before)) / 2
    tau_odd = (states.tau[after, j] - at_places(states.tau[:, j], before)) / 2
    top = float(np.abs(states.dq_motor[:, j]).max())
    return _Samples(states.rate, after, speed, tau_odd, top)


def _summary(name: str, mirrors: Sequence[_Samples]) -> OddFriction:
    """Legs one by one, everything else in classes of speed."""
    rows: list[tuple[str, float, float, float, int]] = []
    rest, legs = [], []
    for samples in mirrors:
        leg = _constant_part(samples)
        if leg is None:
            rest.append(samples)
            continue
        speed, tau_odd = np.abs(samples.speed[leg]), samples.tau_odd[leg] * np.sign(samples.speed[leg])
        n_blocks = max(LEAST_BLOCKS, int(len(tau_odd) / (BLOCK * samples.rate)))
        legs.append((samples.rate, tau_odd))
        rows.append(("leg", float(speed.mean()), *_mean(np.array_split(tau_odd, n_blocks))))
    # One leg has few blocks: their spread says little, and no less than what all legs together say is believed.
    variance = _long_variance(legs)
    rows = [
        (kind, speed, tau, max(error, float(np.sqrt(variance / len(leg)))), n_blocks)
        for (kind, speed, tau, error, n_blocks), (_, leg) in zip(rows, legs, strict=True)
    ]
    if rest:
        rows += _classes(rest)
    rows.sort(key=lambda row: row[1])
    columns = list(zip(*rows, strict=True))
    return OddFriction(name, tuple(columns[0]), *(np.array(column) for column in columns[1:]))


def _long_variance(legs: Sequence[tuple[float, FloatArray]]) -> float:
    """Variance of a leg's mean times its samples, from long blocks of all legs (their rates and odd torques)."""
    power, n_free = 0.0, 0
    for rate, tau_odd in legs:
        blocks = np.array_split(tau_odd, max(2, int(len(tau_odd) / (2 * BLOCK * rate))))
        power += sum(len(block) * (block.mean() - tau_odd.mean()) ** 2 for block in blocks)
        n_free += len(blocks) - 1
    return power / max(n_free, 1)


def _constant_part(samples: _Samples) -> slice | None:
    """Where the speed is constant; None if that is less than half of the motion: no leg."""
    if len(samples.speed) < LEAST_LEG * samples.rate:
        return None
    median = np.median(samples.speed)
    constant = np.abs(samples.speed - median) <= CONSTANT * abs(median)
    at = np.flatnonzero(constant)
    if len(at) < max(LEAST_LEG * samples.rate, 0.25 * len(constant)):
        return None
    part = slice(int(at[0]), int(at[-1]) + 1)
    return part if constant[part].mean() > 0.9 else None


def _classes(mirrors: Sequence[_Samples]) -> list[tuple[str, float, float, float, int]]:
    top = max(samples.top for samples in mirrors)
    edges = np.concatenate([[0.0], np.geomspace(1e-3 * top, 1.001 * top, N_BINS)])
    rows = []
    for low, high in pairwise(edges):
        blocks, speeds = [], []
        for samples in mirrors:
            size = np.abs(samples.speed)
            at = np.flatnonzero((size >= low) & (size < high))
            if not len(at):
                continue
            folded = samples.tau_odd * np.sign(samples.speed)
            # Visits that follow each other closely share their noise: one block.
            block = np.floor(samples.index[at] / (BLOCK * samples.rate))
            cuts = np.flatnonzero(np.diff(block)) + 1
            blocks += np.split(folded[at], cuts)
            speeds.append(size[at])
        if len(blocks) >= LEAST_BLOCKS:
            rows.append(("reversed", float(np.concatenate(speeds).mean()), *_mean(blocks)))
    return rows


def _mean(blocks: Sequence[FloatArray]) -> tuple[float, float, int]:
    """Mean of all samples, its standard error from the blocks' own sums, and their number."""
    sizes = np.array([len(block) for block in blocks], dtype=float)
    sums = np.array([block.sum() for block in blocks])
    mean = sums.sum() / sizes.sum()
    spread = np.sum((sums - sizes * mean) ** 2) * len(blocks) / max(len(blocks) - 1, 1)
    return float(mean), float(np.sqrt(spread) / sizes.sum()), len(blocks)
