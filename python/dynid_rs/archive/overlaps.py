"""Samples that two runs have in common, where memory holds neither: a few rows of each tell which two to look at."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from dynid_rs.runs.checks.repeats import Keys, row_keys
from dynid_rs.runs.recording import Recording

ONE_OF = 128
"""Of so many rows one is kept, by what stands there: the same ones of a run and of a piece of it."""
IN_A_ROW = 8
"""Rows that are looked at together: of one coarse joint many rows are alike in any two runs, so many on end are not."""
MIXING = np.uint64(0x9E3779B97F4A7C15)
"""Odd: no bit of a row's key is lost."""
LEAST = 2
"""Rows that two runs have to have in common. Of a thousand, eight are kept."""


def marks_of(recording: Recording) -> Keys:
    """Keys of `IN_A_ROW` rows that are kept, each once, where the arm moves: at rest rows repeat."""
    keys, q = row_keys(recording), recording.q
    n = max(len(keys) - IN_A_ROW + 1, 0)
    several = np.zeros(n, dtype=np.uint64)
    for k in range(IN_A_ROW):
        several = several * MIXING + keys[k : k + n]
    moves = np.any(q[:n] != q[len(q) - n :], axis=1)
    return np.unique(several[moves & (several >> np.uint64(32) & np.uint64(ONE_OF - 1) == 0)])


def suspects(marks: Sequence[Keys]) -> list[tuple[int, int]]:
    """Places of every two runs that seem to have samples in common; of several that all have, those that follow."""
    owners, rows = np.repeat(np.arange(len(marks)), [len(own) for own in marks]), np.concatenate(marks)
    order = np.lexsort((owners, rows))
    same = rows[order[1:]] == rows[order[:-1]]
    pairs = zip(owners[order[:-1]][same].tolist(), owners[order[1:]][same].tolist(), strict=True)
    return sorted(pair for pair, count in Counter(pairs).items() if count >= LEAST)
