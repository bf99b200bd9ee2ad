"""What is said of channels that are not what they are called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.base.numbers import percent

if TYPE_CHECKING:
    from dynid_rs.sensors.changes import Bench, Trial
    from dynid_rs.sensors.fit import ArmFit
    from dynid_rs.sensors.lag import Lag

FloatArray = NDArray[np.float64]

UNIT_RANGE = 2.0
"""A unit is recognised within this factor: inertials of robot files are that wrong."""
LEAST_TURN = 3.0
"""Smaller turns [deg] of gravity are not said where its size is wrong: they are steps of the search."""
ROUNDING = 1e-3
"""Relative difference up to which two sizes of gravity are one."""
MOST_PERCENT = 400.0
"""No drive gives more of its rated torque [%]."""


OF_ONE_RUN = " of this run alone (the others are right)"
"""Stands in the message of a finding that one `dynid.toml` for all runs cannot mend."""


def _place(trial: Trial, names: Sequence[str]) -> tuple[str, str]:
    """File of a finding, and the words that say where a mend belongs."""
    if len(trial.runs) == len(names):
        return names[0], ""
    return names[trial.runs[0]], OF_ONE_RUN


def _odds(as_it_is: ArmFit, trial: Trial) -> str:
    before, after = as_it_is.run_shares[list(trial.runs)], trial.fit.run_shares[list(trial.runs)]
    worst = np.unravel_index(int(np.argmax(before / np.maximum(after, 1e-300))), before.shape)
    return f"unexplained there: {percent(before[worst])} of the torque's power as it is, {percent(after[worst])} so"


def wiring(bench: Bench, trial: Trial, names: Sequence[str]) -> list[Finding]:
    """Signs, orders and zeros; one finding per joint of a sign."""
    joints = [bench.robot.joint_names[j] for j in trial.joints]
    file, where = _place(trial, names)
    if trial.code == "units_degrees":
        text = 'q looks like degrees; write in dynid.toml: [units] angle = "deg"'
        return [Finding(trial.code, "error", f"{text} ({_odds(bench.fit, trial)})", file, "q_0")]
    if trial.code == "zero_shifted":
        degrees = round(float(np.degrees(trial.shift)))
        message = (
            f"the position of {joint_words(*joints)} looks as if it were counted from another zero than the robot "
            f"file's: add {degrees} degrees to that column{where}, or turn the joint's <origin> in the robot file by "
            f"as much about its axis ({_odds(bench.fit, trial)})"
        )
        column = f"q_{trial.joints[0]}"
        return [Finding(trial.code, "error", message, file, column, value=float(degrees), unit="deg")]
    if trial.code.endswith("_swapped"):
        what, signal = {
            "torque_swapped": ("torque columns", "tau"),
            "position_swapped": ("positions", "q"),
            "joints_swapped": ("positions and torques", "q"),
        }[trial.code]
        message = (
            f"the {what} of {joint_words(*joints)} are swapped: exchange them{where} in dynid.toml under [columns] "
            f"({_odds(bench.fit, trial)})"
        )
        return [Finding(trial.code, "error", message, file, f"{signal}_{trial.joints[0]}")]
    signals = {"torque_flipped": "tau", "position_flipped": "q", "joint_flipped": "q"}[trial.code]
    what = {
        "torque_flipped": "the sign of the torque of {} is flipped",
        "position_flipped": "the sign of the position of {} is flipped",
        "joint_flipped": "{} turns the other way than the robot file says, position and torque together",
    }[trial.code]
    minus = [-1 if k in trial.joints else 1 for k in range(bench.robot.n_joints)]
    keys = f"q = {minus} and tau = {minus}" if trial.code == "joint_flipped" else f"{signals} = {minus}"
    return [
        Finding(
            trial.code,
            "error",
            f"{what.format(joint_words(name))}: write in dynid.toml under [signs]{where}: {keys} "
            f"({_odds(bench.fit, trial)})",
            file,
            f"{signals}_{j}",
            value=-1.0,
            unit="1",
        )
        for j, name in zip(trial.joints, joints, strict=True)
    ]


def unit(bench: Bench, trial: Trial, names: Sequence[str], gains: FloatArray) -> Finding:
    """Torque in another unit; what no unit explains may be currents."""
    file, where = _place(trial, names)
    gears, effort = np.abs(bench.robot.gear_ratio), np.asarray(bench.robot.effort_limits)
    geared = np.where(np.isfinite(gears) & (gears > 1), gears, np.nan)
    peak = np.max([np.abs(rows.tau).max(axis=0) for rows in bench.rows], axis=0)
    rated = np.where(np.isfinite(effort) & (effort > 0) & (peak < MOST_PERCENT), effort, np.nan)
    if len(effort) > 1 and np.all(effort == effort[0]):
        rated = np.full(len(effort), np.nan)  # one number for all was filled in
    units = (
        (1e-3, "in mN m", 'write torque = "mN*m" in dynid.toml under [units]'),
        (1e3, "in kN m", "multiply it by 1000"),
        (geared, "on the motor's side of the gears", "write tau in dynid.toml under [gear] apply_to"),
        (rated / 100, "in percent of the rated torque", "multiply it by the rated torque over 100"),
    )
    low, high = np.min(gains), np.max(gains)
    needs = f"the links need {low:.3g} to {high:.3g} N m for each unit of it"
    for factor, what, mend in units:
        off = np.abs(np.log(gains / factor))
        if np.all(np.isfinite(off)) and np.median(off) < np.log(UNIT_RANGE) and np.max(off) < np.log(10.0):
            message = f"the torque looks as if it were {what}: {needs}; {mend}{where}"
            return Finding("torque_unit", "error", message, file, "tau_0", value=float(np.median(gains)), unit="1")
    if np.median(gains) > 1:
        message = (
            f"the torque looks as if it were a motor current: {needs}; call the columns current_0, current_1, ... in "
            f"dynid.toml under [columns]{where}, or correct the masses of the robot file"
        )
        code = "current_as_torque"
    else:
        message = (
            f"the torque does not fit the robot file: {needs}; check its unit, its gear ratios{where}, and the masses "
            "of the robot file"
        )
        code = "torque_unit"
    return Finding(code, "error", message, file, "tau_0", value=float(np.median(gains)), unit="1")


def late(bench: Bench, lag: Lag, names: Sequence[str], *, steep: bool, filtered: bool) -> Finding:
    """Torque that is late, or that went through a filter; `steep` if its noise falls off as behind one."""
    trial = lag.trial
    joints = joint_words(*(bench.robot.joint_names[j] for j in trial.joints))
    whose = "all joints" if len(trial.joints) == bench.robot.n_joints else joints
    column = f"tau_{trial.joints[0]}"
    size = f"{1e3 * abs(lag.delay):.0f} ms"
    if not filtered or lag.delay < 0:
        first, second = ("torque", "positions") if lag.delay > 0 else ("positions", "torque")
        comes = "comes" if lag.delay > 0 else "come"
        odds = _odds(lag.in_time, trial)
        if steep and lag.delay > 0:
            odds += "; its noise falls off as behind a filter, but a delay explains the motion as well"
        message = (
            f"the {first} of {whose} {comes} about {size} after the {second} ({odds}); shift it, "
            "or let `dynid diagnose` fit the delay"
        )
        return Finding("torque_late", "warning", message, names[0], column, value=lag.delay, unit="s")
    message = (
        f"the torque of {whose} looks as if it had gone through a slow filter (late by {size}, its noise falls off; "
        f"{_odds(lag.in_time, trial)}); record it unfiltered, or raise the filter's corner"
    )
    return Finding("torque_filtered", "warning", message, names[0], column, value=lag.delay, unit="s")


def mounting(bench: Bench, trial: Trial, names: Sequence[str], gravity: FloatArray, *, signed: bool) -> Finding:
    """Gravity that is not as the robot has it: the base is mounted otherwise, or the size is wrong.

    Where no mass is known (not `signed`) gravity and its opposite are alike: the one nearer to the robot's is said.
    """
    declared = np.asarray(bench.robot.gravity)
    if not signed and declared @ gravity < 0:
        gravity = -gravity
    size, was = float(np.linalg.norm(gravity)), float(np.linalg.norm(declared))
    mend = f"give --gravity {_vector(gravity)}{'' if signed else ' (or its opposite: the file gives no masses)'}"
    whose, odds = "the robot file or --gravity has it", _odds(bench.fit, trial)
    if was == 0:
        message = f"gravity pulls, and is zero as {whose} ({odds}); {mend}"
        return Finding("mounting", "warning", message, names[0], None, value=size, unit="m/s^2")
    angle = float(np.degrees(np.arccos(np.clip(float(declared @ gravity) / (size * was), -1, 1))))
    if angle < LEAST_TURN and abs(size / was - 1) > ROUNDING:
        message = f"gravity is {size:.3g} m/s^2 and not {was:.3g}, as {whose} ({odds}); {mend}"
        return Finding("mounting", "warning", message, names[0], None, value=size, unit="m/s^2")
    resized = "" if abs(size / was - 1) < ROUNDING else f"is {size:.3g} m/s^2 and "
    message = (
        f"gravity {resized}pulls {angle:.0f} degrees away from {_vector(declared)} m/s^2, as {whose} ({odds}): the "
        f"base is mounted otherwise; {mend}"
    )
    return Finding("mounting", "warning", message, names[0], None, value=angle, unit="deg")


def gravity_of(finding: Finding) -> tuple[float, ...] | None:
    """The gravity [m/s^2] that a finding of `mounting` says; None where the opposite would be as good."""
    said = re.search(r"give --gravity (\S+?,\S+?,\S+?)$", finding.message)
    return None if said is None else tuple(map(float, said[1].split(",")))


def _vector(gravity: FloatArray) -> str:
    """As ``--gravity`` takes it."""
    return ",".join(f"{x + 0.0:.2f}" for x in np.round(gravity, 2))


def payload(trial: Trial, names: Sequence[str], mass: float | None) -> Finding:
    """A run that carries something else than the others; None where neither gains nor inertials say how much."""
    name = names[trial.runs[0]]
    more = "something else"
    if mass is not None:
        more = f"about {mass:.2g} kg more" if mass > 0 else f"about {-mass:.2g} kg less"
    message = (
        f"the arm carries {more} on this run than on the others; learn from runs of one load, and diagnose this "
        "one with --reference"
    )
    return Finding("payload_change", "warning", message, name, None, value=mass, unit=None if mass is None else "kg")
