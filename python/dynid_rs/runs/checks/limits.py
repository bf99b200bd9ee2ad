"""Positions against what a joint can do: units that look like degrees or millimetres, limits of the robot."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.runs.cells import ABSURD, MIN_SPAN
from dynid_rs.runs.checks.motion import angle_unit, extent, label, moving_joints
from dynid_rs.runs.checks.spikes import FEW
from dynid_rs.runs.recording import Recording

DEGREE = np.pi / 180.0
MILLIMETRE = 1e-3
TURN, TWO_TURNS = 2 * np.pi, 4 * np.pi
TOLERANCE = 0.01
"""Excess over a limit [rad, m] that calibration explains."""


class Limited(Protocol):
    """The part of a robot model that these checks need; NaN or infinity where a joint has no limit."""

    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower position limits (n_joints,) [rad, m]."""

    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper position limits (n_joints,) [rad, m]."""


def check_magnitudes(rec: Recording) -> Iterator[Finding]:
    """Numbers that no joint reaches in any unit: damaged cells."""
    for signal in ("q", "tau", "dq", "ddq", "q_motor", "dq_motor"):
        values = getattr(rec, signal)
        if values is None:
            continue
        found = extent(rec, signal)
        if max(found.highest.max(), -found.lowest.min()) <= ABSURD:
            continue
        row, joint = np.unravel_index(int(np.argmax(np.abs(values))), values.shape)
        yield Finding(
            "absurd_value",
            "error",
            f"{label(rec, signal, int(joint))} is {values[row, joint]:.3g} in row {row + 1}; "
            "the file is damaged or its unit is wrong",
            rec.name,
            f"{signal}_{joint}",
            (int(row), int(row) + 1),
            float(values[row, joint]),
        )


def check_limits(rec: Recording, robot: Limited | None) -> Iterator[Finding]:
    """Angles that look like degrees, lengths that look like millimetres; positions beyond the limits of the robot."""
    low, high, *_ = extent(rec, "q")
    largest = np.maximum(np.abs(low), np.abs(high))
    turns = np.array([kind != "prismatic" for kind in rec.kinds])
    if robot is None:
        moves = moving_joints(rec) & turns
        wide = moves & (largest > TWO_TURNS) & _often(np.abs(rec.q) > TWO_TURNS)
        # One joint may turn round and round; half of the robot does not.
        if wide.sum() > 1 and 2 * wide.sum() >= moves.sum():
            yield _degrees(rec, "warning", largest, f"{int(wide.sum())} of {rec.n_joints} joints go beyond two turns")
        return
    lower, upper = _limits(robot.lower, -np.inf), _limits(robot.upper, np.inf)
    excess = np.maximum(lower - low, high - upper)
    beyond = excess > TOLERANCE
    limit = np.maximum(np.abs(lower), np.abs(upper))
    # A joint without a range, which its file locks, is beyond nothing.
    far = (limit > 0) & (largest > 3 * limit) & _often(np.abs(rec.q) > 3 * limit)

    def fits(joints: NDArray[np.bool_], factor: float) -> bool:
        inside = (low * factor >= lower - TOLERANCE) & (high * factor <= upper + TOLERANCE)
        return bool(np.any(far & joints) and np.all(inside[joints]))

    # What would hardly move as millimetres has another zero.
    if fits(~turns, MILLIMETRE) and np.all(MILLIMETRE * (high - low)[far & ~turns] > MIN_SPAN):
        yield _millimetres(rec, int(np.argmax(np.where(~turns & far, largest, 0.0))), largest)
        beyond &= turns
    if fits(turns, DEGREE):
        far &= turns
        worst = int(np.argmax(np.where(far, largest / np.where(far, limit, 1.0), 0.0)))
        others = moving_joints(rec) & turns & ~far
        if np.sum(others) >= np.sum(far) and np.all(largest[others] <= TURN):
            # As degrees most joints would hardly move; as radians they go where joints go.
            yield _mixed(rec, worst, float(largest[worst]))
            return
        text = f"q_{worst} is far beyond the limits of the robot, and all fit as degrees"
        yield _degrees(rec, "error", largest, text)
        return
    for joint in np.flatnonzero(beyond).tolist():
        outside = np.flatnonzero((rec.q[:, joint] < lower[joint]) | (rec.q[:, joint] > upper[joint]))
        unit = angle_unit(rec, joint)
        yield Finding(
            "position_limits",
            "warning",
            f"{label(rec, 'q', joint)} goes from {low[joint]:.4g} to {high[joint]:.4g} {unit}, its limits are "
            f"{lower[joint]:.4g} to {upper[joint]:.4g}; check the robot, the zero position and the sign",
            rec.name,
            f"q_{joint}",
            (int(outside[0]), int(outside[-1]) + 1),
            float(excess[joint]),
            unit,
        )


def _millimetres(rec: Recording, joint: int, largest: NDArray[np.float64]) -> Finding:
    return Finding(
        "units_length",
        "error",
        f"{label(rec, 'q', joint)} looks like millimetres: as metres it goes up to {largest[joint]:.4g}, far beyond "
        "the limits of the robot, and all that slide fit as millimetres; if so write in dynid.toml: [units] length = "
        '"mm"',
        rec.name,
        f"q_{joint}",
        (0, rec.n_samples),
        float(largest[joint]),
        "m",
    )


def _mixed(rec: Recording, joint: int, largest: float) -> Finding:
    return Finding(
        "units_mixed",
        "error",
        f"{label(rec, 'q', joint)} looks like degrees, up to {largest:.4g}, and the others like radians, none beyond "
        f'{TURN:.3g}; write that column in radians, or, if all are degrees, in dynid.toml: [units] angle = "deg"',
        rec.name,
        f"q_{joint}",
        (0, rec.n_samples),
        largest,
        "rad",
    )


def _often(beyond: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Columns of (n, n_joints) that are true in more than a few rows, (n_joints,): a unit is in every row."""
    often: NDArray[np.bool_] = beyond.mean(axis=0) > FEW
    return often


def _limits(values: Any, missing: float) -> NDArray[np.float64]:
    limits = np.array(values, dtype=np.float64)
    return np.where(np.isnan(limits), missing, limits)


def _degrees(rec: Recording, severity: Any, largest: NDArray[np.float64], text: str) -> Finding:
    angles = np.where([kind != "prismatic" for kind in rec.kinds], largest, 0.0)
    return Finding(
        "units_degrees",
        severity,
        f'q looks like degrees: {text}; if so write in dynid.toml: [units] angle = "deg"',
        rec.name,
        f"q_{int(np.argmax(angles))}",
        (0, rec.n_samples),
        float(angles.max()),
        "rad",
    )
