"""Gaps and jumps in time: a run falls into parts there, each a run of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid_rs.runs.cells import MAX_GAP_STEPS, MIN_SAMPLES, MIN_SPAN, MIN_STEP, FloatArray, usual_step

SHORTEST_SHARE = 0.05
"""A part that is shorter than this share of the longest is left out: nothing is learned from a few samples."""
LEAST_KEPT = 0.5
"""Where less than this share of the rows would be left, time is damaged, and the run is refused."""
MOST_SAID = 3
"""More breaks than this are counted, not listed."""


PART = " (part "


@dataclass(frozen=True)
class Parts:
    """Rows of a run by part: `rows` are half-open; `breaks` are the rows before which time breaks.

    `lost`: rows of parts that are too short to be of use; `resting`: of parts in which nothing moves.
    """

    rows: tuple[tuple[int, int], ...]
    breaks: tuple[int, ...] = ()
    lost: int = 0
    resting: int = 0

    def in_motion(self, q: FloatArray) -> Parts:
        """Without the parts in which no joint of q (n, n_joints) moves, where one does in others: they say nothing."""
        moving = tuple((start, stop) for start, stop in self.rows if np.ptp(q[start:stop], axis=0).max() > MIN_SPAN)
        if not moving:
            return self
        left = sum(stop - start for start, stop in self.rows) - sum(stop - start for start, stop in moving)
        return replace(self, rows=moving, resting=left)


@dataclass(frozen=True)
class Split:
    """Where a run fell into parts: what is said of it, its code, and the rows and the line of the first break."""

    text: str
    code: str
    row: int
    line: int | None = None


def part_name(name: str, k: int, n_parts: int) -> str:
    """Name of part `k` (from 0) of a run."""
    return f"{name}{PART}{k + 1} of {n_parts})"


def is_part(name: str) -> bool:
    """Whether a run's name is that of a part."""
    return PART in name


def whole_name(name: str) -> str:
    """Name of the run that a part is of, or of the run itself."""
    return name.partition(PART)[0]


def find_parts(t: FloatArray) -> Parts:
    """Parts of a run between gaps that cannot be bridged and jumps of its clock.

    Time (n,) that stands still, is not finite or is mostly in pieces stays in one part, which `check_time` refuses.
    """
    whole = Parts(((0, len(t)),))
    if len(t) < MIN_SAMPLES or not np.isfinite(t).all():
        return whole
    with np.errstate(over="ignore"):
        dt = np.diff(t)
    forward = dt[dt > 0]
    if np.any(dt == 0) or not len(forward):
        return whole
    usual = usual_step(forward)
    if usual < MIN_STEP:
        return whole
    breaks = np.flatnonzero((dt < 0) | (dt > MAX_GAP_STEPS * usual)) + 1
    if not len(breaks):
        return whole
    edges = [0, *(int(row) for row in breaks), len(t)]
    pieces = list(pairwise(edges))
    longest = max(stop - start for start, stop in pieces)
    kept = tuple((start, stop) for start, stop in pieces if stop - start >= max(MIN_SAMPLES, SHORTEST_SHARE * longest))
    n_kept = sum(stop - start for start, stop in kept)
    if n_kept < LEAST_KEPT * len(t):
        return whole
    return Parts(kept, tuple(edges[1:-1]), len(t) - n_kept)


def split_of(t: FloatArray, parts: Parts, lines: Sequence[int] | None = None) -> Split | None:
    """Where a run falls into parts; None where it is one. `lines`: of the first breaks, in a text."""
    if not parts.breaks:
        return None
    row = parts.breaks[0]
    code = "long_gap" if all(t[k] > t[k - 1] for k in parts.breaks) else "time_backwards"
    return Split(_said(t, parts, lines), code, row, None if lines is None else lines[0])


def _said(t: FloatArray, parts: Parts, lines: Sequence[int] | None) -> str:
    said = []
    for k, row in enumerate(parts.breaks[:MOST_SAID]):
        step = t[row] - t[row - 1]
        line = "" if lines is None else f" (line {lines[k]})"
        what = f"a gap of {step:.4g} s" if step > 0 else f"time goes back by {-step:.4g} s"
        said.append(f"{what} before row {row + 1}{line}")
    more = len(parts.breaks) - len(said)
    listed = ", ".join(said) + (f" and {more} more" if more else "")
    n = len(parts.rows)
    into = "1 part" if n == 1 else f"{n} parts, each a run of its own"
    rows = ", ".join(f"{start + 1} to {stop}" for start, stop in parts.rows[:MOST_SAID])
    left_out = ((parts.lost, "in pieces that are too short"), (parts.resting, "at rest"))
    rest = "".join(f"; {count} rows {why} are left out" for count, why in left_out if count)
    return f"{listed}: read as {into} (rows {rows}{', ...' if n > MOST_SAID else ''}){rest}"
