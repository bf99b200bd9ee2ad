"""Torque that no drive gives: lone samples far from the rest of their channel, and channels in another unit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.motion import label, moving_joints, torque_unit
from dynid_rs.runs.checks.spikes import FEW, few_rows, lone_rows
from dynid_rs.runs.recording import FloatArray, Recording

BEYOND = 10.0
"""No drive gives so many times the effort limit of its robot file: the strongest peak is some three times what is
rated. A unit that is a thousand times smaller is still seen at a hundredth of the limit."""
IN_LIMITS = 3.0
"""What a channel in the right unit reaches of its effort limit at most, a peak above a rated one."""
MILLI = 1e3
"""N mm (mN m) where N m was meant."""


def check_drive_torque(rec: Recording, robot: Any | None) -> Iterator[Finding]:
    """Samples and channels of torque that no drive gives; with a robot also against its effort limits."""
    limits = _limits(rec, robot)
    moves = moving_joints(rec)
    for joint in range(rec.n_joints):
        rows = lone_rows(rec, "tau", joint) if moves[joint] else np.zeros(0, dtype=np.intp)
        beyond = np.flatnonzero(np.abs(rec.tau[:, joint]) > BEYOND * limits[joint])
        too_much = np.flatnonzero(np.abs(rec.tau[:, joint]) > IN_LIMITS * limits[joint])
        # Where the rest is more than a drive gives too, it is the channel that is wrong, not a few rows of it.
        if len(beyond) and len(too_much) <= few_rows(rec.n_samples):
            rows = np.union1d(rows, too_much)
        if len(rows):
            yield _spike(rec, joint, rows, limits[joint])
    yield from _unit(rec, limits)


def _limits(rec: Recording, robot: Any | None) -> FloatArray:
    """Effort limits that say something, (n_joints,); infinite elsewhere.

    One number for all joints of an arm was filled in by somebody, and amperes are no effort.
    """
    nothing = np.full(rec.n_joints, np.inf)
    limits = getattr(robot, "effort_limits", None)
    if limits is None or rec.torque_unit != "N*m":
        return nothing
    limits = np.asarray(limits, dtype=np.float64)
    if len(limits) > 1 and np.all(limits == limits[0]):  # infinite ones too
        return nothing
    return np.where(limits > 0, limits, np.inf)  # NaN and zero are no limit


def _spike(rec: Recording, joint: int, rows: NDArray[np.intp], limit: float) -> Finding:
    tau = rec.tau[:, joint]
    worst = int(rows[np.argmax(np.abs(tau[rows]))])
    rest = float(np.abs(np.delete(tau, rows)).max())
    allowed = f", and the robot file allows {limit:g}" if np.isfinite(limit) else ""
    more = f" (and so are {len(rows) - 1} more)" if len(rows) > 1 else ""
    return Finding(
        "torque_spike",
        "error",
        f"{label(rec, 'tau', joint)} is {tau[worst]:.4g} {torque_unit(rec, joint)} in row {worst + 1}{more}, where the "
        f"rest of the run stays within {rest:.3g}{allowed}; a damaged number: cut the row out",
        rec.name,
        f"tau_{joint}",
        (worst, worst + 1),
        float(tau[worst]),
        torque_unit(rec, joint),
    )


def _unit(rec: Recording, limits: FloatArray) -> Iterator[Finding]:
    """Whole channels beyond the effort limits: another unit where it explains them all, else a question."""
    share = 100 * (1 - FEW)
    usual = np.percentile(np.abs(rec.tau), share, axis=0) / limits
    beyond = np.flatnonzero(usual > BEYOND)
    if not len(beyond):
        return
    known = np.isfinite(limits)
    worst = int(np.argmax(usual))
    reached = f"reaches {usual[worst]:.3g} times its effort limit of {limits[worst]:g} {torque_unit(rec, worst)}"
    if len(beyond) > known.sum() / 2 and np.all(usual / MILLI < IN_LIMITS):
        text = (
            f'{reached}, and as N mm all joints stay within theirs; if so write in dynid.toml: [units] torque = "mN*m" '
            "(it holds for all runs of a command)"
        )
        severity: Any = "error"
    else:
        text = f"{reached}; check unit, gear ratio and column of the torque, and the limit in the robot file"
        severity = "warning"
    yield Finding(
        "torque_beyond_effort",
        severity,
        f"{label(rec, 'tau', worst)} {text}",
        rec.name,
        f"tau_{worst}",
        (0, rec.n_samples),
        float(usual[worst]),
        "1",
    )
