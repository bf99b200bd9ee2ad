"""Samples that two runs have in common, where memory holds neither: a few rows of each tell which two to look at."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from dynid_rs.runs.checks.repeats import Keys, row_keys
from dynid_rs.runs.recording import Recording

ONE_OF = 128
"""Of so many rows one is kept, by its content: the same ones of a run and of a piece of it."""
LEAST = 2
"""Rows that two runs have to have in common. Of a thousand, eight are kept."""


def marks_of(recording: Recording) -> Keys:
    """`row_keys` of the rows that are kept, each once, where the arm moves: at rest rows repeat."""
    keys = row_keys(recording)
    moves = np.any(np.diff(recording.q, axis=0, prepend=recording.q[:1]) != 0.0, axis=1)
    return np.unique(keys[moves & (keys >> np.uint64(32) & np.uint64(ONE_OF - 1) == 0)])


def suspects(marks: Sequence[Keys]) -> list[tuple[int, int]]:
    """Places of every two runs that seem to have samples in common; of several that all have, those that follow."""
    owners, rows = np.repeat(np.arange(len(marks)), [len(own) for own in marks]), np.concatenate(marks)
    order = np.lexsort((owners, rows))
    same = rows[order[1:]] == rows[order[:-1]]
    pairs = zip(owners[order[:-1]][same].tolist(), owners[order[1:]][same].tolist(), strict=True)
    return sorted(pair for pair, count in Counter(pairs).items() if count >= LEAST)
