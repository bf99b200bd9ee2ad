"""What runs without a change say of a model's error and of the torque channels: what a watch measures changes by.

Healthy runs are few, so that what they say is taken at the unfavourable end of its 95 % interval: a watch that takes an
error for smaller, or shorter, than it is makes more false alarms than it promises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dynid_rs.base.memory import memory_bound
from dynid_rs.runs.recording import FloatArray

UNKNOWN_MEMORY = 10.0
"""Rows that are worth one independent one where no run has told: two seconds."""
LEAST_ROWS = 30
"""Fewer rows of a joint in motion tell no deviation: its interval would be wider than a fourth."""
SLOW_ROWS, SLOW_PART = 10, 0.03
"""So many rows, which are worth an independent one, have to have been slower for a row to say something; of few rows
this part."""
SPARE = 7 / 8
"""Part of the variance of sums that a watch has to know.

Where half of what is tolerated has changed (c = 1/2), a row of r times the variance that it is taken for adds to the
test of a change by d = 8 times what is tolerated, the widest, a ratio whose mean is
``exp((d - 1) (2 c + (d - 1) r - (d + 1)) g / 2)``: at most one for ``r <= (d + 1 - 2 c) / (d - 1) = 8 / 7``."""
LEAST_VALUES = 30
"""Fewer values of a torque channel tell not how far the torque goes while one is shown."""
LEAST_FROZEN = 0.05
"""A value that lasts less than this [s] is no fault yet, whatever healthy runs say: messages are lost, and a fault is
to be told within twice that time."""
RARE = 0.05
"""Chance that an error is larger than it is taken for."""


@dataclass(frozen=True, eq=False)
class Healthy:
    """One value per joint, each an ndarray (n_joints,).

    Attributes
    ----------
    inflation
        Variance of rows over what the model expects.
    memory
        Rows that are worth an independent one.
    least_speed
        Mean speed of a row [rad/s, m/s] below which too few rows say what the model leaves; infinite where it was not
        told at all.
    frozen_after, frozen_way
        Time [s] after which a value that a torque channel repeats is no torque, infinite: never, where the model's
        torque has gone as far meanwhile [torque unit].
    """

    inflation: FloatArray
    memory: FloatArray
    least_speed: FloatArray
    frozen_after: FloatArray
    frozen_way: FloatArray

    @staticmethod
    def untold(n: int, memory: float = UNKNOWN_MEMORY) -> Healthy:
        """Before any run has told."""
        return Healthy(np.ones(n), np.full(n, memory), np.zeros(n), np.full(n, np.inf), np.zeros(n))

    def lists(self) -> dict[str, Any]:
        """By name."""
        return {one.name: getattr(self, one.name).tolist() for one in fields(self)}

    def to_json(self) -> dict[str, list[float | None]]:
        """By name; infinity is null."""
        return {name: [x if np.isfinite(x) else None for x in values] for name, values in self.lists().items()}


def learn(
    relative: Sequence[FloatArray], speed: Sequence[FloatArray], repeats: Sequence[FloatArray], false_per_day: float
) -> Healthy | None:
    """Return what healthy runs say; None where no joint moved for `LEAST_ROWS` rows.

    Parameters
    ----------
    relative, speed : sequences of ndarray (n_rows, n_joints)
        Of every run what rows leave over what the model expects, NaN where a joint says nothing, and mean speeds.
    repeats : sequence of ndarray (n_joints, 4)
        Of every run how values of the torque channels repeat, as the compiled `watch_run` counts them.
    false_per_day : float
        False alarms of one test that are put up with.
    """
    n = relative[0].shape[1]
    found = Healthy.untold(n)
    found.least_speed[:] = np.inf
    for j in range(n):
        of_rows = [(run[:, j], v[:, j]) for run, v in zip(relative, speed, strict=True)]
        speeds = np.sort(np.concatenate([v[np.isfinite(run)] for run, v in of_rows]))
        if len(speeds) < LEAST_ROWS:
            continue
        slow = speeds[min(SLOW_ROWS, int(SLOW_PART * len(speeds)))]
        own = [np.where(v >= slow, run, np.nan) for run, v in of_rows]
        found.least_speed[j] = slow
        memory, bound, worth = memory_bound(own)
        square = float(np.nanmean(np.concatenate(own) ** 2))
        most = _most(worth)
        found.inflation[j] = max(square * most, np.finfo(float).tiny)
        # A sum of rows varies by the product of the two.
        found.memory[j] = max(1.0, max(memory, SPARE * bound) / most)
    told = np.isfinite(found.least_speed)
    if not told.any():
        return None
    found.memory[~told] = found.memory[told].max()
    counts = np.stack(repeats)
    number, time = counts[..., 0].sum(axis=0), counts[..., 1].sum(axis=0)
    longest, way = counts[..., 2].max(axis=0), counts[..., 3].max(axis=0)
    for j in np.flatnonzero(number >= LEAST_VALUES).tolist():
        k = beyond_records(int(number[j]), 86_400.0 / time[j], false_per_day)
        found.frozen_after[j] = max(k * longest[j], LEAST_FROZEN)
        found.frozen_way[j] = k * way[j]
    return found


def beyond_records(n_values: int, per_day: float, false_per_day: float) -> int:
    """Multiple of the way that the model's torque went, at most, while one of `n_values` was shown, that none goes.

    The chance p that the next value goes further than all of them is that of a record, distributed as
    Beta(1, n_values). A value through which the torque has gone so far is no likelier to go as far again than a new one
    (neither noise nor steps remember where a value began), so that it goes k times as far with a chance of at most p^k,
    whose mean is ``k! n_values! / (n_values + k)!``. The least k is taken that leaves no more than `false_per_day` of
    all values of a day, which is `per_day` times as many.
    """
    expected, k = per_day * n_values, 0
    while expected > false_per_day:
        k += 1
        expected *= k / (n_values + k)
    return k


def _most(worth: float) -> float:
    """Factor on a mean square of so many independent normal values; the true one is above with a chance of `RARE`."""
    from scipy.special import gammaincinv

    return worth / (2.0 * float(gammaincinv(worth / 2.0, RARE)))
