"""Channels that do not follow the robot: still joints, frozen, clipped, wrapped or jumping values."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.runs.cells import MIN_SPAN
from dynid_rs.runs.checks.derivatives import agrees_outside
from dynid_rs.runs.checks.motion import (
    angle_unit,
    equal_runs,
    extent,
    is_same,
    label,
    moving_joints,
    spans,
    torque_unit,
)
from dynid_rs.runs.checks.spikes import LONGEST, lone_rows
from dynid_rs.runs.recording import FloatArray, Recording

FROZEN_SECONDS = 0.1
FROZEN_SAMPLES, FROZEN_POSITIONS = 20, 5
"""Rows at least, at any rate. A position that hung is told by its jump, or by another channel: few will do."""
FROZEN_TRAVEL = 0.02
"""Travel of the joint [rad, m] in a frozen stretch: the channel stood still, not the joint."""
COARSE_STEPS = 2.5
"""A channel that hung jumps when it goes on; a coarse one that stood goes to its next step, or the one after that."""

PLATEAU_SAMPLES = 5
PLATEAU_TRAVEL = 1e-3
PLATEAU_LEVELS = 3
PLATEAU_FACTOR = 1.5
PLATEAU_CHANCE = 2
"""A smooth peak is on its last level for no longer than on the three below it together, up and down: ``sqrt(1)`` to
``sqrt(4) - sqrt(1)``. A range has ended if the rows of its plateaus are half as many again, and more than the rows by
which the times may be off at both ends."""
MIN_LEVELS = 30
"""Channels with fewer different values are coarsely quantised: plateaus are their nature."""

TURN = 2 * np.pi
MIN_JUMP = 0.05
JUMP_FACTOR = 5.0


def check_channels(rec: Recording) -> Iterator[Finding]:
    """Joints that never move; frozen, clipped, wrapped and jumping channels."""
    moves = moving_joints(rec)
    yield from _still_joints(rec)
    for joint in range(rec.n_joints):
        q = rec.q[:, joint]
        broken = False
        positions = _positions(rec, joint)
        turns = {signal: _turns(rec, signal, values, joint) for signal, values in positions.items()}
        unwrapped = {signal: _unwrapped(values, turns[signal]) for signal, values in positions.items()}
        for signal, values in positions.items():
            for finding in (
                *_frozen_position(rec, signal, unwrapped, joint),
                *_wrapped(rec, signal, values, turns[signal], joint),
            ):
                broken = True
                yield finding
            if not broken:
                yield from _jump(rec, signal, values, joint)
        tau = rec.tau[:, joint]
        if _is_constant(rec, "tau", joint):
            yield Finding(
                "stuck",
                "error" if moves[joint] else "warning",
                f"{label(rec, 'tau', joint)} is {tau[0] + 0.0:g} {torque_unit(rec, joint)} in every row; its "
                "channel is dead",
                rec.name,
                f"tau_{joint}",
                (0, rec.n_samples),
            )
            continue
        # A frozen position makes its joint look still: nothing can be said about the other channels then.
        if moves[joint] and not broken:
            yield from _clipped(rec, joint, tau, q)
            yield from _frozen(rec, "tau", tau, q, joint)
            if rec.dq is not None and not _is_constant(rec, "dq", joint):
                yield from _frozen(rec, "dq", rec.dq[:, joint], q, joint)


def _is_constant(rec: Recording, signal: str, joint: int) -> bool:
    found = extent(rec, signal)
    return bool(found.lowest[joint] == found.highest[joint])


def _equal_runs(rec: Recording, signal: str, joint: int, min_length: int) -> list[tuple[int, int]]:
    """`equal_runs` of a joint's signal; most have none, and that is known already."""
    if extent(rec, signal).longest_equal[joint] < min_length:
        return []
    return equal_runs(getattr(rec, signal)[:, joint], min_length)


def _positions(rec: Recording, joint: int) -> dict[str, FloatArray]:
    found = {"q": rec.q[:, joint]}
    if rec.q_motor is not None and not is_same(rec.q_motor[:, joint], rec.q[:, joint]):
        found["q_motor"] = rec.q_motor[:, joint]
    return found


def _still_joints(rec: Recording) -> Iterator[Finding]:
    moves, ranges = moving_joints(rec), spans(rec)
    for joint in np.flatnonzero(~moves).tolist():
        yield Finding(
            "joint_never_moves",
            "warning" if moves.any() else "error",
            f"{joint_words(rec.joints[joint])} never moves (range {ranges[joint]:.2g}, at "
            f"least {MIN_SPAN:g} {angle_unit(rec, joint)} is motion); "
            "its friction and inertia cannot be identified from this run",
            rec.name,
            f"q_{joint}",
            (0, rec.n_samples),
            float(ranges[joint]),
            angle_unit(rec, joint),
        )


def _min_frozen(rec: Recording, least: int = FROZEN_SAMPLES) -> int:
    return max(least, round(FROZEN_SECONDS * rec.rate))


def _frozen(rec: Recording, signal: str, values: FloatArray, q: FloatArray, joint: int) -> Iterator[Finding]:
    """Frozen torque or velocity: equal values over a long stretch while the joint travels, and a jump after it."""
    found, stretches = extent(rec, signal), _equal_runs(rec, signal, joint, _min_frozen(rec))
    if not stretches:
        return
    step = float(np.min(np.diff(np.unique(values))))
    for start, stop in stretches:
        clipped = signal == "tau" and values[start] in (found.lowest[joint], found.highest[joint])
        jumps = stop == len(values) or abs(values[stop] - values[start]) > COARSE_STEPS * step
        if not clipped and jumps and np.ptp(q[start:stop]) > FROZEN_TRAVEL:
            # Constant speed is a legitimate constant velocity, unless the joint disagrees.
            dt = rec.t[stop - 1] - rec.t[start]
            travel = abs(q[stop - 1] - q[start] - values[start] * dt)
            if signal == "dq" and travel < FROZEN_TRAVEL:
                continue
            yield _stuck(rec, f"{signal}_{joint}", start, stop, values[start])


def _frozen_position(rec: Recording, signal: str, positions: dict[str, FloatArray], joint: int) -> Iterator[Finding]:
    """Frozen position: equal values that end in a jump, or while the other channels of the joint travel.

    `positions` of the joint by signal, without whole turns.
    """
    values, stretches = positions[signal], _equal_runs(rec, signal, joint, _min_frozen(rec, FROZEN_POSITIONS))
    if not stretches:
        return
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0]
    usual = float(np.percentile(moving, 99)) if moving.size else np.inf
    speed, quantum = None, 0.0
    if rec.dq is not None and agrees_outside(rec, values, rec.dq[:, joint], stretches):
        speed = rec.dq[:, joint].copy()
        speed[lone_rows(rec, "dq", joint)] = 0.0  # damaged numbers are no way
        # A coarse channel that has no zero shows half a step of a joint that stands.
        levels = np.unique(speed)
        quantum = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    others = [other for name, other in positions.items() if name != signal]
    for start, stop in stretches:
        # A channel that goes on is elsewhere; where it is back at once a sample was damaged.
        after = np.abs(values[stop : stop + LONGEST + 1] - values[start])
        jump, travel = float(after.min(initial=np.inf)) if len(after) else 0.0, 0.0
        if rec.dq is not None and stop < rec.n_samples and steps[stop - 1] <= 2 * _way(rec, joint, stop):
            jump = 0.0  # the joint broke away: its velocity is that of the step
        if speed is not None:
            dt, dq = np.diff(rec.t[start:stop]), speed[start:stop]
            travel = abs(float(np.sum(0.5 * (dq[1:] + dq[:-1]) * dt)))
            travel -= quantum * float(rec.t[stop - 1] - rec.t[start])
        travel = max([travel, *(abs(float(other[stop - 1] - other[start])) for other in others)])
        # With a dead encoder (all equal) only a long way tells it from a joint that was held.
        if (jump > 5 * usual and jump > MIN_SPAN) or travel > FROZEN_TRAVEL:
            yield _stuck(rec, f"{signal}_{joint}", start, stop, float(getattr(rec, signal)[start, joint]))


def _way(rec: Recording, joint: int, row: int) -> float:
    """Way [rad] from the row before to `row` by the larger of the two recorded velocities."""
    assert rec.dq is not None
    return float(np.abs(rec.dq[row - 1 : row + 1, joint]).max() * (rec.t[row] - rec.t[row - 1]))


def _stuck(rec: Recording, column: str, start: int, stop: int, value: float) -> Finding:
    seconds = float(rec.t[stop - 1] - rec.t[start])
    return Finding(
        "stuck",
        "error",
        f"{column} stays at {value:.6g} for {seconds:.3g} s (rows {start + 1} to "
        f"{stop}) while the joint moves; "
        "cut these rows out",
        rec.name,
        column,
        (start, stop),
        seconds,
        "s",
    )


def _clipped(rec: Recording, joint: int, values: FloatArray, q: FloatArray) -> Iterator[Finding]:
    """Plateaus at the torque's largest or smallest value while the joint moves: the range of the channel ended."""
    stretches, levels = _equal_runs(rec, "tau", joint, PLATEAU_SAMPLES), np.unique(values)
    if not stretches or levels.size < MIN_LEVELS:
        return
    column = f"tau_{joint}"
    moved = [(start, stop) for start, stop in stretches if np.ptp(q[start:stop]) > PLATEAU_TRAVEL]
    highest, lowest = levels[-1 - PLATEAU_LEVELS :], levels[PLATEAU_LEVELS::-1]
    for (*beside, limit), word in ((highest, "largest"), (lowest, "smallest")):
        plateaus = [(start, stop) for start, stop in moved if values[start] == limit]
        count = sum(stop - start for start, stop in plateaus)
        if count > PLATEAU_FACTOR * (np.count_nonzero(np.isin(values, beside)) + PLATEAU_CHANCE):
            yield Finding(
                "saturated",
                "error",
                f"{column} sits on its {word} value {limit:.6g} {torque_unit(rec, joint)} for "
                f"{count} rows, first rows "
                f"{plateaus[0][0] + 1} to {plateaus[0][1]}; the channel or the drive is "
                "saturated: move less or slower",
                rec.name,
                column,
                (plateaus[0][0], plateaus[-1][1]),
                float(limit),
                torque_unit(rec, joint),
            )


def _turns(rec: Recording, signal: str, values: FloatArray, joint: int) -> NDArray[np.intp]:
    """Rows (k,) after which an angle goes on a whole turn beside where it was; lone rows that come back are spikes."""
    none = np.zeros(0, dtype=np.intp)
    if extent(rec, signal).largest_step[joint] < np.pi:
        return none
    steps = np.diff(values)
    sizes = np.abs(steps)
    if np.percentile(sizes, 95) >= 1.0:
        return none
    turns = np.flatnonzero(np.abs(sizes - TURN) < 0.2 * TURN)
    back = np.flatnonzero((np.diff(turns) <= LONGEST) & (np.diff(np.sign(steps[turns])) != 0))
    return np.delete(turns, np.concatenate([back, back + 1]))


def _unwrapped(values: FloatArray, turns: NDArray[np.intp]) -> FloatArray:
    """An angle (n,) without the turns after some of its rows."""
    if not len(turns):
        return values
    steps = np.zeros(len(values))
    steps[turns + 1] = TURN * np.sign(values[turns + 1] - values[turns])
    return np.asarray(values - np.cumsum(steps))


def _wrapped(rec: Recording, signal: str, values: FloatArray, turns: NDArray[np.intp], joint: int) -> Iterator[Finding]:
    if not len(turns):
        return
    row, column = int(turns[0]), f"{signal}_{joint}"
    yield Finding(
        "wrapped",
        "error",
        f"{column} jumps by a whole turn {len(turns)} times, first at row {row + 2}; unwrap the angle",
        rec.name,
        column,
        (row, row + 2),
        float(values[row + 1] - values[row]),
        "rad",
    )


def _jump(rec: Recording, signal: str, values: FloatArray, joint: int) -> Iterator[Finding]:
    if extent(rec, signal).largest_step[joint] <= MIN_JUMP:
        return
    dt, column = np.diff(rec.t), f"{signal}_{joint}"
    # A longer step of time explains a longer way, a shorter one does not: stamps jitter more than samples.
    steps = np.abs(np.diff(values)) / np.maximum(dt / rec.median_step, 1.0)
    usual = float(np.percentile(steps, 99))
    jumps = (np.abs(np.diff(values)) > MIN_JUMP) & (steps > max(JUMP_FACTOR * usual, 0.5 * steps.max()))
    if jumps.any():
        row = int(np.argmax(jumps))  # of a jump and the way back the jump
        size, unit = float(abs(values[row + 1] - values[row])), angle_unit(rec, joint)
        yield Finding(
            "position_jump",
            "error",
            f"{column} jumps by {size:.3g} {unit} at row {row + 2}, where {usual:.2g} {unit} is a large step; "
            "lost samples or a broken channel: cut these rows out",
            rec.name,
            column,
            (row + 1, row + 2),
            size,
            unit,
        )
