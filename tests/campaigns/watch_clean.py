"""Hours in which nothing changes: pieces that go on from one another, rests, and friction that is cold or warm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from exam.draw import log_uniform, stream

import dynid_rs as dyn
from campaigns.watch_arm import LEARNED, STEP, WARM, draw_watched, prepare

HEALTHY, HEALTHY_SECONDS = (0.0, 1.0, 0.3, 1.0, 0.7, 1.0), 100.0
"""How warm friction is in healthy runs, and how long each is [s]."""
PIECE = (60.0, 200.0)
"""Seconds of a piece."""
WARMING = (600.0, 1800.0)
"""Time in which friction warms up, and cools down [s]."""
BREAKS, BREAK = 0.15, (300.0, 3600.0)
"""Chance of a break after a piece, and how long it is [s]: the arm is off, and cools down."""


@dataclass
class Clean:
    """One arm.

    One value per joint: `error` of the model over the noise alone, `healthy` what rows are expected to leave over the
    noise, `grown` what they leave over what is expected (RMS; the promise is about one). `moved` is the part of the
    rows in which some joint says something; `alarms` each have a time [s of this arm] and what became of it.
    """

    seed: int
    joints: int
    encoders: int
    mass: float
    memory: list[float]
    warm: list[float]
    error: list[float]
    healthy: list[float]
    cycles: int = 0
    pieces: int = 0
    moved: float = 0.0
    grown: list[float] = field(default_factory=list)
    alarms: list[tuple[float, str, str]] = field(default_factory=list)

    def to_json(self) -> dict[str, object]:
        """As it is kept."""
        return asdict(self)


def watch_clean(seed: int, cycles: int, motions: Sequence[str] = LEARNED) -> Clean:
    """Watch the arm of a seed for so many cycles."""
    arm = draw_watched(seed, warm=WARM)
    ready = prepare(arm, warmths=HEALTHY, seconds=HEALTHY_SECONDS, motions=motions)
    case, rng = arm.world.case, stream(seed, 43)
    healthy = ready.deviation / arm.noise_of_rows
    lists = [values.tolist() for values in (arm.memory, arm.warm, ready.error, healthy)]
    found = Clean(seed, case.n_joints, case.n_encoders, case.mass, *lists)
    tau, warmth, begun = float(log_uniform(rng, *WARMING)), 0.0, 0.0
    squares, counts, moved, rows = np.zeros(case.n_joints), np.zeros(case.n_joints), 0, 0
    said: list[tuple[float, dyn.Change]] = []
    remembered = None
    while found.cycles < cycles:
        seconds = _length(rng, (cycles - found.cycles) * STEP)
        motion = str(rng.choice(("fourier", "pauses", "moves"), p=(0.3, 0.4, 0.3)))
        steps = np.arange(round(seconds / STEP)) * STEP
        course = 1 - (1 - warmth) * np.exp(-steps / tau)
        run = arm.record(ready.first + found.pieces, seconds, motion, warmth=course)
        watched = ready.watch.watch(run, remembered=remembered)
        remembered = watched.remembered
        said += [(begun + change.t, change) for change in watched.changes]
        left = np.divide(watched.left, watched.deviation, out=np.zeros_like(watched.left), where=watched.watched)
        squares, counts = squares + np.sum(left**2, axis=0), counts + watched.watched.sum(axis=0)
        moved, rows = moved + np.count_nonzero(watched.watched.any(axis=1)), rows + len(watched.t)
        found.cycles, found.pieces, begun = found.cycles + len(run.t), found.pieces + 1, begun + seconds
        warmth = float(course[-1])
        if rng.random() < BREAKS:
            warmth *= float(np.exp(-rng.uniform(*BREAK) / tau))
    found.grown = np.sqrt(squares / np.maximum(counts, 1)).tolist()
    found.moved = moved / rows
    found.alarms = alarms_of(said)
    return found


def alarms_of(said: list[tuple[float, dyn.Change]]) -> list[tuple[float, str, str]]:
    """Names that were given, each with its time and what became of it: one change at a time is open."""
    alarms = []
    for k, (t, change) in enumerate(said):
        if change.said == "named":
            became = next((later.said for _, later in said[k + 1 :] if later.said != "named"), "open")
            alarms.append((t, str(change).split(": ", 1)[1], became))
    return alarms


def _length(rng: np.random.Generator, left: float) -> float:
    """Seconds of the next piece: no last one is shorter than any other, where there is as much."""
    low, high = PIECE
    return left if left <= high else float(np.round(rng.uniform(low, min(high, left - low)), 1))
