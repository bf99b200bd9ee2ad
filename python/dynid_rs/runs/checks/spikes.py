"""Samples that stand alone: damaged numbers and drop-outs, as no motion and no drive makes them.

A row is compared with the median of the rows around it. It is damaged if it is far larger than all the rest as well, or
exactly zero where the rows on both sides are far from it, both above or both below: a channel in coarse steps is zero
wherever it changes its sign. Else something may have been hit, or friction was overcome. In white noise `SIGMAS`
deviations are one in 10^32; friction's steps last for more than one sample.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.base.spread import spread
from dynid_rs.runs.checks.motion import angle_unit, extent, label, moving_joints
from dynid_rs.runs.recording import FloatArray, Recording

SIGMAS = 12.0
QUANTILES = (0.5, 0.9)
"""Each says how large noise is, and the larger counts: in a channel of coarse steps half the rows are where their
neighbours are, whatever the noise."""
SHARE = 0.2
"""Of the channel's size: what is nearer to the rows around it does no harm."""
OUTSIDE = 4.5
"""Times the largest of the rest: a drive peaks at some three times what it is rated for, impacts at more."""
LONGEST = 3
"""Rows of a spike; no logger repeats a damaged number more often."""
FEW = 0.005
"""More than this share of the rows is no lone sample, but a part of the motion: the same of positions in degrees and
torques beyond a limit."""
WINDOW = 2 * LONGEST + 1
MIN_LEVELS = 30
"""A channel of fewer different numbers is coarse: its one step may be many times its noise."""


def few_rows(n_samples: int) -> int:
    """Rows that may be damaged; where more are odd, it is the channel."""
    return max(LONGEST, int(FEW * n_samples))


def lone_rows(rec: Recording, signal: str, joint: int) -> NDArray[np.intp]:
    """Rows (k,) of a channel that stand alone as no arm makes them; most channels have none."""
    found, values = extent(rec, signal), getattr(rec, signal)[:, joint]
    none = np.zeros(0, dtype=np.intp)
    # A lone row is as far from its neighbour as from the rest: most channels are done with here.
    low, high = np.percentile(values, (5.0, 95.0))
    size = float(high - low) / 3
    if len(values) < 4 * WINDOW or not found.largest_step[joint] > SHARE * size:
        return none
    off = np.abs(values - _local_median(values))
    far = max(SIGMAS * spread(off, QUANTILES), SHARE * size)
    rows = np.flatnonzero(off > far)
    if not 0 < len(rows) <= few_rows(len(values)):
        return none
    rest = np.delete(values, rows)
    if np.unique(rest).size < MIN_LEVELS:
        return none
    reach = OUTSIDE * float(np.abs(rest).max())
    lone: NDArray[np.intp] = rows[(np.abs(values[rows]) > reach) | _dropped(values, rows, far)]
    return lone


def _dropped(values: FloatArray, rows: NDArray[np.intp], far: float) -> NDArray[np.bool_]:
    """Which of some rows (k,) are zero between two values that are both beyond `far`, with the same sign."""
    there = np.flatnonzero(values)
    after = np.searchsorted(there, rows)
    inside = (values[rows] == 0) & (after > 0) & (after < len(there))
    before, after = values[there[after[inside] - 1]], values[there[after[inside]]]
    dropped = np.zeros(len(rows), dtype=bool)
    dropped[inside] = np.maximum(np.minimum(before, after), -np.maximum(before, after)) > far
    return dropped


def _local_median(values: FloatArray) -> FloatArray:
    padded = np.concatenate([values[LONGEST:0:-1], values, values[-2 : -LONGEST - 2 : -1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)
    return np.asarray(np.median(windows, axis=1))


def check_spikes(rec: Recording) -> Iterator[Finding]:
    """Lone samples of recorded velocities; torques are `check_drive_torque`'s, positions jump."""
    if rec.dq is None:
        return
    for joint in np.flatnonzero(moving_joints(rec)).tolist():
        rows = lone_rows(rec, "dq", joint)
        if not len(rows):
            continue
        unit = f"{angle_unit(rec, joint)}/s"
        worst = int(rows[np.argmax(np.abs(rec.dq[rows, joint]))])
        more = f" (and {len(rows) - 1} more)" if len(rows) > 1 else ""
        yield Finding(
            "velocity_spike",
            "error",
            f"{label(rec, 'dq', joint)} is {rec.dq[worst, joint]:.4g} {unit} in row {worst + 1}{more}, far from the "
            "rows beside it; a damaged number: cut the row out",
            rec.name,
            f"dq_{joint}",
            (int(rows[0]), int(rows[-1]) + 1),
            float(rec.dq[worst, joint]),
            unit,
        )
