"""Samples that two runs have in common: a test on them would be an exam with known answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.runs.cells import MIN_SPAN
from dynid_rs.runs.parts import whole_name
from dynid_rs.runs.recording import Recording

Keys = NDArray[np.uint64]

LEAST_ROWS = 50
"""Rows in a row that are the same in position and torque, to the last bit, while some joint moves. Of two runs that
were measured apart not even one is, but for noise that is coarser than the motion."""


def common_rows(a: Recording, b: Recording, keys: tuple[Keys, Keys] | None = None) -> tuple[int, int] | None:
    """Rows (start, stop) of `b` that `a` has too, in the same order, whatever the clock; None where there are few.

    `keys`: `row_keys` of both, where they are known.
    """
    if a.n_joints != b.n_joints or a.torque_unit != b.torque_unit:
        return None
    first, second = (row_keys(a), row_keys(b)) if keys is None else keys
    common, of_a, of_b = np.intersect1d(first, second, return_indices=True)
    if len(common) < LEAST_ROWS:
        return None
    (shift, count), *_ = Counter((of_b - of_a).tolist()).most_common(1)
    if count < LEAST_ROWS:
        return None
    rows = np.sort(of_b[of_b - of_a == shift])
    start, stop = int(rows[0]), int(rows[-1]) + 1
    if np.ptp(b.q[start:stop], axis=0).max() <= MIN_SPAN:
        return None
    return start, stop


def row_keys(recording: Recording) -> Keys:
    """One number for each row (n,), of its positions and torques: equal rows have equal ones."""
    bits = np.concatenate([recording.q, recording.tau], axis=1)
    bits = np.ascontiguousarray(bits + 0.0).view(np.uint64)  # minus zero is zero
    odd = np.random.default_rng(0).integers(0, 2**63, bits.shape[1], dtype=np.uint64) * np.uint64(2) + np.uint64(1)
    mixed = bits ^ (bits >> np.uint64(29))
    with np.errstate(over="ignore"):
        return np.asarray((mixed * odd).sum(axis=1, dtype=np.uint64))


def repeat_findings(runs: Sequence[Recording]) -> dict[int, Finding]:
    """Runs of which another one, before them, has samples too: an error ``run_twice`` for each place in `runs`."""
    found: dict[int, Finding] = {}
    for k, run in enumerate(runs):
        for earlier in runs[:k]:
            rows = common_rows(earlier, run)
            if rows is None:
                continue
            whole = rows[1] - rows[0] >= run.n_samples
            what = "all its samples" if whole else f"rows {rows[0] + 1} to {rows[1]}"
            mend = "name the run once, and test on another one"
            if whole_name(run.name) == whole_name(earlier.name):
                mend = "the log wrote them twice: cut them out"
            message = f"{what} are samples of {earlier.name} too; {mend}"
            found[k] = Finding("run_twice", "error", message, run.name, None, rows, float(rows[1] - rows[0]), "rows")
            found[k] = replace(found[k], line=run.line_of(rows[0]))
            break
    return found
