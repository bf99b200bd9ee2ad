"""95 % intervals of root-mean-square errors and of their change, for errors that depend on their neighbours in time.

The mean of n squares that remember each other varies by their long-run variance over n. The first few cosines of the
squares see that variance (equal-weighted cosine estimator: Mueller 2007, J. Econometrics 141; Lazarus, Lewis, Stock
and Watson 2018, J. Business & Economic Statistics 36), and as there are few of them, Student's t says how well.

    c_k = sqrt(2) / n  sum_i (e_i^2 / m) cos(pi k (i + 1/2) / n),   k = 1 ... 4,   m = mean(e^2)
    s   = (1 + STRETCH * memory / n) * sqrt(mean(c_k^2))            relative standard error of m

`python tests/error_interval_coverage.py` measures how often such intervals hold, on simulated errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.memory import residual_memory, square_memory
from dynid_rs.regression.evaluation import Comparison

FloatArray = NDArray[np.float64]
Interval = tuple[float, float]

LEVEL = 0.95
N_COSINES = 4
"""More see the variance better, but only of errors that forget sooner. Four cost a third of width against a variance
that is known (0.94 * 2.78 / 1.96, from chi and Student's t), and see a memory of up to a thirtieth of the run."""
N_BLOCKS = 32
"""Parts of a run whose mean squares show a size of the error that changes slowly."""
LEAST_ROWS = 2 * N_BLOCKS
"""Rows below which the parts are single samples."""
LONGEST_MEMORY = 1 / 8
"""Memory of the squares, as a part of the run, above which no interval is said: the cosines see too little of it."""
INFINITE = 3.0
"""Half width of the interval of a relative mean square at which its upper end is no number any more: (1 - 3/3)^-3."""
STRETCH, STRETCH_OF_CHANGE = 10.0, 5.5
"""Stretch of an interval per memory over run: what the cosines miss of a slow error, and what a short run hides of its
memory; of a change less, for what both errors share is not in it. Measured with the script above: 15 s with AR(1)
errors of 2 s hold in 86 % without it and in 94 % with it."""


@dataclass(frozen=True, eq=False)
class MeanSquare:
    """Mean square of one joint's error over its rows, and how it varied; everything but `value` is relative to it.

    `cosines` (N_COSINES,), `blocks` (N_BLOCKS,) mean squares of the parts of the run, `memory` of the squares as a
    part of the run, from the error's autocorrelation.
    """

    value: float
    cosines: FloatArray
    blocks: FloatArray
    memory: float

    @staticmethod
    def of(error: FloatArray) -> MeanSquare | None:
        """Of `error` (n_rows,); None where there is no error, or where the rows are too few to say more."""
        from scipy.fft import dct

        n = len(error)
        value = float(np.mean(error**2)) if n else 0.0
        if n < LEAST_ROWS or value <= 0.0:
            return None
        squares = error**2 / value
        blocks = _means_of_parts(squares)
        cosines = dct(squares, norm="ortho")[1 : N_COSINES + 1] / np.sqrt(n)
        return MeanSquare(value, cosines, blocks, square_memory(error) / n)


def _means_of_parts(values: FloatArray) -> FloatArray:
    """Means of `N_BLOCKS` parts that follow each other, the first ones longer by a row where they cannot be equal."""
    size, n_longer = divmod(len(values), N_BLOCKS)
    edge = n_longer * (size + 1)
    parts = values[:edge].reshape(n_longer, size + 1), values[edge:].reshape(N_BLOCKS - n_longer, size)
    return np.concatenate([part.mean(axis=1) for part in parts])


def rmse_interval(comparisons: Sequence[Comparison]) -> list[Interval | None]:
    """95 % interval of each joint's RMSE on the runs together; None where the runs are too short for its memory."""
    return [None if square is None else _around(square) for square in mean_squares(comparisons)]


def _around(square: MeanSquare) -> Interval | None:
    """Symmetric in the mean square to the power of -1/3, in which a mean of few squares is close to normal."""
    reach = _reach(square.cosines, square.blocks, square.memory, STRETCH)
    if reach is None or reach >= INFINITE:
        return None
    rms = np.sqrt(square.value)
    return float(rms * (1 + reach / 3) ** -1.5), float(rms * (1 - reach / 3) ** -1.5)


def change_interval(after: Sequence[Comparison], before: Sequence[Comparison]) -> list[Interval | None]:
    """95 % interval of ``RMSE after / RMSE before - 1`` per joint, both on the same runs; None as in `rmse_interval`.

    What makes a stretch of a run hard makes it so for both models: their squares are compared place by place, and
    what they share does not count. Symmetric in the logarithm, so that it does not matter which one comes first.
    """
    return _changes(mean_squares(after), mean_squares(before))


def interval_of_change(after: Sequence[FloatArray], before: Sequence[FloatArray]) -> list[Interval | None]:
    """`change_interval` from the errors themselves, (n_rows,) per joint, the same rows in both."""
    return _changes([MeanSquare.of(error) for error in after], [MeanSquare.of(error) for error in before])


def _changes(after: Sequence[MeanSquare | None], before: Sequence[MeanSquare | None]) -> list[Interval | None]:
    intervals: list[Interval | None] = []
    for new, old in zip(after, before, strict=True):
        if new is None or old is None:
            intervals.append(None)
            continue
        if new.value == old.value and np.array_equal(new.blocks, old.blocks):
            intervals.append((0.0, 0.0))  # the same errors, whatever their memory
            continue
        memory = max(new.memory, old.memory)
        reach = _reach(new.cosines - old.cosines, new.blocks - old.blocks, memory, STRETCH_OF_CHANGE)
        ratio, half = np.sqrt(new.value / old.value), None if reach is None else np.exp(reach / 2)
        intervals.append(None if half is None else (float(ratio / half - 1), float(ratio * half - 1)))
    return intervals


def mean_squares(comparisons: Sequence[Comparison]) -> list[MeanSquare | None]:
    """Every joint's mean square over the rows that count, the runs one behind the other."""
    errors = np.concatenate([comparison.error for comparison in comparisons])
    counted = np.concatenate([comparison.states.counted for comparison in comparisons])
    return [MeanSquare.of(error[rows]) for error, rows in zip(errors.T, counted.T, strict=True)]


def _reach(cosines: FloatArray, blocks: FloatArray, memory: float, stretch: float) -> float | None:
    """Half width of the 95 % interval of a relative mean square; None where the memory is too long for the run."""
    from scipy.special import stdtrit

    slow = (residual_memory([blocks - blocks.mean()]) - 1) / N_BLOCKS
    memory = max(memory, slow)
    if memory > LONGEST_MEMORY:
        return None
    spread = np.sqrt(np.mean(cosines**2))
    return float(stdtrit(N_COSINES, (1 + LEVEL) / 2) * (1 + stretch * memory) * spread)
