"""Functions of one or two signals, without a name."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import USUAL, Hypothesis, standardised

FloatArray = NDArray[np.float64]
Signal = tuple[str, int]

N_WAVES = 5
"""Waves of a signal within its range that a function of it is made of."""
SIGNALS = ("q", "dq_motor", "ddq_motor", "tau_link")
"""Signals that a torque may depend on, of any joint."""


def signal_sets(found: Belief, j: int) -> Iterator[tuple[Signal, ...]]:
    """Single signals of any joint, and pairs: of joint j's own, of it and another's position or load, of positions."""
    n = found.setup.robot.n_joints
    single = [(name, k) for name in SIGNALS for k in range(n)]
    yield from ((signal,) for signal in single)
    for pair in combinations(single, 2):
        kinds, joints = {name for name, _ in pair}, [k for _, k in pair]
        crossed = ("dq_motor", j) in pair and bool(kinds & {"q", "tau_link"})
        if joints == [j, j] or crossed or (kinds == {"q"} and j in joints):
            yield pair


def wave_hypothesis(found: Belief, j: int, signals: tuple[Signal, ...]) -> Hypothesis:
    """Cosine series of a signal within its range, or of two and of their products, on joint j."""
    parts = []
    for states in found.catalogue.runs:
        scaled = []
        for name, k in signals:
            values = [np.asarray(getattr(s, name))[:, k] for s in found.catalogue.runs]
            low, high = min(x.min() for x in values), max(x.max() for x in values)
            scaled.append(np.pi * (np.asarray(getattr(states, name))[:, k] - low) / max(high - low, 1e-300))
        waves = [np.cos(m * u) for u in scaled for m in range(1, N_WAVES + 1)]
        if len(scaled) == 2:
            orders = [(m, k) for m in range(1, N_WAVES + 1) for k in range(1, N_WAVES + 2 - m)]
            waves += [np.cos(m * scaled[0]) * np.cos(k * scaled[1]) for m, k in orders]
        parts.append(states.in_band(np.stack(waves, axis=1)))
    moves = np.concatenate([states.counted[:, j] for states in found.catalogue.runs])
    columns = np.concatenate(parts) * moves[:, None]
    torque = np.sqrt(np.mean(np.concatenate([block.rows[j][:, -1] for block in found.fit.observations_.blocks]) ** 2))
    size = np.sqrt(np.mean(columns**2, axis=0))
    unit = USUAL * torque / np.where(size > 0, size, 1.0)
    width = columns.shape[1]
    free = np.tile([-np.inf, np.inf], (width, 1))
    names = tuple(f"wave_{k}" for k in range(width))
    return Hypothesis(
        "unknown", (j,), names, ("1",) * width, standardised({j: columns}, unit), unit, free, lambda setup, _: setup
    )
