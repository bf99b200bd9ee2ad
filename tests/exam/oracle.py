"""Whether an effect can be seen at all: an F test that is told its kind, its place and its shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from exam.hidden import Exam, Hidden, fast, in_band
from exam.sensors import deflection_noise, torque_noise

FloatArray = NDArray[np.float64]

LEVEL = 1e-5
"""Chance at which the oracle believes: one in a hundred over about a thousand kinds and places."""
MEMORY = 1.0
"""Neighbours this far apart [s] may be alike: products of residual and column are summed up to there."""


def p_value(exam: Exam, index: int) -> float:
    """Chance of as much of hidden effect `index` in a world without it, everything else being told."""
    hidden = exam.hidden[index]
    if hidden.effect.side == "gear":
        return _gear(exam, hidden)
    if fast(hidden.effect):
        return _full_rate(exam, hidden)
    declared = exam.declared
    others = [declared.own(h.rows).ravel() for k, h in enumerate(exam.hidden) if k != index and in_band(h.effect)]
    told = np.stack(others, axis=1) if others else np.zeros((hidden.rows.size, 0))
    column = _beside(declared.own(hidden.rows).ravel(), told)
    noise = _beside(declared.own(exam.noise).ravel(), told)
    lags = int(MEMORY * 20)
    freedom = np.count_nonzero(declared.weights) - declared.rank - told.shape[1] - 1
    shape = hidden.rows.shape
    runs = [declared.groups == run for run in np.unique(declared.groups)]
    pieces = [(column.reshape(shape)[run, j], noise.reshape(shape)[run, j]) for run in runs for j in range(shape[1])]
    return _chance(pieces, freedom, np.count_nonzero(declared.weights), lags)


def seen(exam: Exam, index: int) -> bool:
    """Whether the oracle believes in an effect."""
    return p_value(exam, index) < LEVEL


def _beside(x: FloatArray, told: FloatArray) -> FloatArray:
    """What other effects, which are told, cannot imitate."""
    return x - told @ np.linalg.lstsq(told, x, rcond=None)[0] if told.shape[1] else x


def _chance(pieces: list[tuple[FloatArray, FloatArray]], freedom: int, n: int, lags: int) -> float:
    """p of the coefficient that a column gets from itself and the noise; pieces are (column, noise) of one channel.

    The coefficient's variance sums products of neighbours (Bartlett's weights), and is no less than without them.
    """
    power = sum(float(c @ c) for c, _ in pieces)
    if freedom < 2 or not power > 0:
        return 1.0
    coefficient = 1 + sum(float(c @ e) for c, e in pieces) / power
    alone, together = 0.0, 0.0
    for c, e in pieces:
        product = c * (e - (coefficient - 1) * c)
        alone += float(product @ product)
        together += float(product @ product)
        for lag in range(1, min(lags, len(product) - 1) + 1):
            together += 2 * (1 - lag / (lags + 1)) * float(product[lag:] @ product[:-lag])
    variance = max(alone, together) * n / freedom
    independent = max(2.0, freedom * alone / max(alone, together))
    return float(f_distribution.sf((coefficient * power) ** 2 / variance, 1, independent))


def _full_rate(exam: Exam, hidden: Hidden) -> float:
    """Ripple above the band, against the torque channels' noise as it is recorded."""
    world, j = exam.world, hidden.effect.joints[0]
    pieces = []
    for dense in world.train:
        s = dense.recorded
        column = hidden.effect.part(world, s, hidden.size)[:, j]
        pieces.append((column - column.mean(), torque_noise(world, exam.sensors, s)[:, j]))
    n = sum(len(c) for c, _ in pieces)
    return _chance(pieces, n - 10, n, int(min(MEMORY, 0.1) * world.case.rate))


def _gear(exam: Exam, hidden: Hidden) -> float:
    """A gear's own part of the deflection against the encoders' steps: as many independent rows as there are."""
    j = hidden.effect.joints[0]
    n = len(hidden.rows)
    noise = float(deflection_noise(exam.world, exam.sensors)[j])
    if not noise > 0 or n < 10:
        return 0.0 if n >= 10 else 1.0
    return float(f_distribution.sf(n / 4 * float(hidden.ratio[j]) ** 2, 1, n / 4))
