"""What several checks need to know about the motion of a run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding
from dynid_rs.base.units import angle_units, torque_of
from dynid_rs.runs.cells import MIN_SPAN
from dynid_rs.runs.recording import FloatArray, Recording

BLOCK_SECONDS = 0.1
"""Positions and integrated velocities are compared over blocks this long: jitter and noise average out."""

MIN_BLOCK = 5


class Extent(NamedTuple):
    """What the columns of a signal span, (n_joints,) each.

    `longest_equal`: rows of the longest stretch of equal neighbours, 1 where there are none.
    """

    lowest: FloatArray
    highest: FloatArray
    largest_step: FloatArray
    longest_equal: FloatArray


_SEEN: WeakKeyDictionary[Recording, dict[str, Extent]] = WeakKeyDictionary()
"""Every signal is looked at once, as long as its run is there."""


def extent(rec: Recording, signal: str) -> Extent:
    """What a signal that is there spans."""
    seen = _SEEN.setdefault(rec, {})
    if signal not in seen:
        seen[signal] = Extent(*_core.extent(getattr(rec, signal)))
    return seen[signal]


def spans(rec: Recording) -> FloatArray:
    """Range of every joint (n_joints,) [rad, m]."""
    found = extent(rec, "q")
    return found.highest - found.lowest


def moving_joints(rec: Recording) -> NDArray[np.bool_]:
    """Which joints move at all in this run (n_joints,)."""
    return spans(rec) > MIN_SPAN


def block_edges(rec: Recording) -> NDArray[np.intp]:
    """Rows that bound blocks of about 0.1 s."""
    step = max(MIN_BLOCK, round(BLOCK_SECONDS * rec.rate))
    step = max(1, min(step, (rec.n_samples - 1) // 4))
    return np.arange(0, rec.n_samples, step)


def block_changes(rec: Recording, values: FloatArray) -> FloatArray:
    """Change of a signal (n, k) over each block (n_blocks, k)."""
    return np.asarray(np.diff(values[block_edges(rec)], axis=0), dtype=np.float64)


def block_integrals(rec: Recording, values: FloatArray) -> FloatArray:
    """Integral of a signal (n, k) over each block (n_blocks, k), by trapezoids on the real stamps."""
    pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(rec.t)[:, None]
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)])
    return block_changes(rec, total)


def block_velocity(rec: Recording) -> FloatArray:
    """Mean velocity of each block (n_blocks, n_joints) [rad/s]."""
    return block_changes(rec, rec.q) / np.diff(rec.t[block_edges(rec)])[:, None]


def equal_runs(values: FloatArray, min_length: int) -> list[tuple[int, int]]:
    """Stretches (start, stop), half-open, of at least `min_length` equal neighbours in a column (n,)."""
    same = np.concatenate([[False], values[1:] == values[:-1], [False]])
    edges = np.flatnonzero(same[1:] != same[:-1])
    starts, stops = edges[::2], edges[1::2] + 1
    long = stops - starts >= min_length
    return list(zip(starts[long].tolist(), stops[long].tolist(), strict=True))


def is_same(a: FloatArray, b: FloatArray) -> bool:
    """Whether two columns (n,) hold the same numbers."""
    return bool(a[0] == b[0]) and np.array_equal(a, b)


def rms(values: FloatArray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(values @ values / len(values)))


def correlation(a: FloatArray, b: FloatArray) -> float:
    """Pearson correlation of two columns (n,); 0 when one of them is constant."""
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0 else 0.0


def label(rec: Recording, signal: str, joint: int) -> str:
    """Name a channel for people: ``tau_2 (elbow_joint)``, or ``tau_2`` where joints have no names."""
    name = rec.joints[joint]
    return f"{signal}_{joint}" if name == str(joint) else f"{signal}_{joint} ({name})"


def angle_unit(rec: Recording, joint: int) -> str:
    """Unit of a joint's position."""
    return angle_units(rec.kinds)[joint]


def torque_unit(rec: Recording, joint: int) -> str:
    """Unit of a joint's torque channel."""
    return torque_of(rec.torque_unit, rec.kinds[joint])


def with_lines(rec: Recording, findings: Iterable[Finding]) -> list[Finding]:
    """Findings on a run with the line of their first row, where its file is a text."""
    if rec.first_line is None:
        return list(findings)
    return [
        finding if finding.rows is None else replace(finding, line=rec.line_of(finding.rows[0])) for finding in findings
    ]
