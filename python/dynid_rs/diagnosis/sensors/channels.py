"""Channels that are not what they are called: swapped joints, flipped signs, other units.

A model would be wrong with any of them, and none of them is mended here: each is an error with its mend in the
sentence. What one run shows by itself (degrees, derivatives, motor against link encoder) is found by `runs/checks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.diagnosis.sensors.layout import Rows
from dynid_rs.regression.priors import declares_inertia
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

EXPLAINED = 0.3
"""Left-out residual power over torque power below which columns are taken to hold a channel."""
CONTRADICTED = 0.1
"""Share of the torque's power that no common links' parameters explain, from which on runs contradict each other."""
CLEARLY = 4.0
"""Power by which a change of channels has to be better on every joint it concerns."""
SPOILT = 10.0
"""Links shared by all joints leave this many times what each joint's own would: some sign or order is wrong..."""
LEAST_SPOILT = 0.05
"""...if that is this share of the torque at least."""
CONTRARY = 1.1
"""Factor by which the power that no common links explain may grow with a change of signs: more speaks against it."""
RESISTS = 0.5
"""Friction's correlation with the direction of motion; below minus this it would drive."""
UNIT_RANGE = 3.0
"""A unit is recognised within this factor: inertials of robot files are that wrong."""
ODD = 50.0
"""One joint's torque that is so many times off what that of the others is has a unit of its own."""
ABSURD = 10.0
"""Inertials of a robot file are never wrong by this factor."""
MOST_PERCENT = 400.0
"""No drive gives more of its rated torque [%]."""
SIGNALS = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")


def channel_findings(robot: _core.RobotModel, runs: Sequence[States], torque_unit: str = "N*m") -> list[Finding]:
    """Look for channels that are swapped, flipped or in other units.

    Parameters
    ----------
    robot : RobotModel
        As declared.
    runs : sequence of States
        Training runs.
    torque_unit : {"N*m", "A"}
        Currents have gains of their own: units are not judged then.
    """
    rows = Rows.of(robot, runs)
    shares, whole = rows.shares(), rows.whole_shares()
    findings = _swapped_torque(robot, shares) or _flipped_torque(robot, runs, rows, shares)
    judged = torque_unit == "N*m" and declares_inertia(robot)
    if not findings and judged:
        findings = _known_units(robot, rows)
    alone = np.diag(shares)
    spoilt = (whole > LEAST_SPOILT) & (whole > SPOILT * alone)
    several = len({block.run for block in rows.observations.blocks}) > 1
    # Runs of little motion say nothing of each other; where one set of links explains them all, nothing is wrong.
    several = several and bool(np.any(rows.pooled_shares() > CONTRADICTED))
    if not findings and (np.any(spoilt) or (several and np.any(whole > EXPLAINED))):
        findings = _other_layout(robot, runs, rows, whole)
    if not findings and judged:
        findings = _unknown_unit(robot, rows)
    return findings


def _swapped_torque(robot: _core.RobotModel, shares: FloatArray) -> list[Finding]:
    """Torque channels that follow another joint's columns, by the best assignment of channels to joints."""
    from scipy.optimize import linear_sum_assignment

    joints, channels = linear_sum_assignment(np.log(np.maximum(shares, 1e-12)))
    moved = np.flatnonzero(joints != channels)
    better = [shares[j, channels[j]] < EXPLAINED and CLEARLY * shares[j, channels[j]] < shares[j, j] for j in moved]
    if not len(moved) or not all(better):
        return []
    names = robot.joint_names
    pairs = ", ".join(f"tau_{channels[j]} moves {joint_words(names[j])}" for j in moved)
    column = f"tau_{channels[moved[0]]}"
    message = (
        f"torque columns are swapped: {pairs}; map them in dynid.toml under [columns] (a run left out is unexplained "
        f"there by {100 * max(shares[j, channels[j]] for j in moved):.2g} % at most, on the joints they are named "
        f"after by {100 * min(shares[j, j] for j in moved):.3g} % at least)"
    )
    return [Finding("torque_swapped", "error", message, column=column)]


def _flipped_torque(robot: _core.RobotModel, runs: Sequence[States], rows: Rows, shares: FloatArray) -> list[Finding]:
    """Joints whose friction would drive them; the torque's sign or the position's, whichever all joints agree with."""
    drives = np.flatnonzero((rows.dissipation() < -RESISTS) & (np.diag(shares) < EXPLAINED))
    if not len(drives):
        return []
    flipped = np.ones(rows.n_joints)
    flipped[drives] = -1
    as_it_is = rows.pooled_shares()
    # Torque first: all of them flipped is a model with negative masses, as good for the residual, and as wrong.
    if _grown(rows.with_signs(flipped).pooled_shares(), as_it_is) < CONTRARY:
        return [_flip(robot, int(j), "tau") for j in drives]
    if _grown(Rows.of(robot, [_signed(states, flipped) for states in runs]).pooled_shares(), as_it_is) < CONTRARY:
        return [_flip(robot, int(j), "q") for j in drives]
    return []  # friction that is not well known: the links say that the signs are right


def _grown(shares: FloatArray, before: FloatArray) -> float:
    """Factor by which shares of unexplained power have grown, over all joints."""
    from scipy.stats import gmean

    return float(gmean(np.maximum(shares, 1e-300) / np.maximum(before, 1e-300)))


def _flip(robot: _core.RobotModel, j: int, signal: str) -> Finding:
    name = robot.joint_names[j]
    if signal == "both":
        return Finding(
            "joint_flipped",
            "error",
            f"{joint_words(name)} turns the other way than the robot file says, position and torque together: the "
            f"links' parameters fit with both signs turned only; write in dynid.toml under [signs]: "
            f"q = {_signs(robot, j)} and tau = {_signs(robot, j)}",
            column=f"q_{j}",
            value=-1.0,
            unit="1",
        )
    what = "torque" if signal == "tau" else "position"
    code = "torque_flipped" if signal == "tau" else "position_flipped"
    return Finding(
        code,
        "error",
        f"the sign of the {what} of {joint_words(name)} is flipped: friction would drive the joint, or its links would "
        f"contradict those of the others; write in dynid.toml under [signs]: {signal} = {_signs(robot, j)}",
        column=f"{signal}_{j}",
        value=-1.0,
        unit="1",
    )


def _signs(robot: _core.RobotModel, j: int) -> list[int]:
    return [-1 if k == j else 1 for k in range(robot.n_joints)]


def _other_layout(robot: _core.RobotModel, runs: Sequence[States], rows: Rows, whole: FloatArray) -> list[Finding]:
    """Try every sign and every exchange of two positions where the links' parameters contradict each other."""
    n = rows.n_joints
    trials: list[tuple[float, Finding]] = []

    def judge(changed: Rows, finding: Finding) -> None:
        shares = changed.whole_shares()
        if np.all(shares < EXPLAINED) or np.mean(np.log(shares / whole)) < -2 * np.log(CLEARLY):
            trials.append((float(np.mean(np.log(shares / whole))), finding))

    names = robot.joint_names
    for j in range(n):
        sign = np.where(np.arange(n) == j, -1.0, 1.0)
        judge(rows.with_signs(sign), _flip(robot, j, "tau"))
        turned = Rows.of(robot, [_signed(states, sign) for states in runs])
        judge(turned, _flip(robot, j, "q"))
        judge(turned.with_signs(sign), _flip(robot, j, "both"))
    degrees = Rows.of(robot, [_signed(states, np.full(n, np.pi / 180)) for states in runs])
    judge(
        degrees,
        Finding(
            "units_degrees", "error", 'q looks like degrees; write in dynid.toml: [units] angle = "deg"', column="q_0"
        ),
    )
    # Exchanges are many; where one sign is enough they need not be tried.
    for a, b in combinations(range(n), 2) if not trials else ():
        order = np.arange(n)
        order[[a, b]] = b, a
        for code, with_torque in (("position_swapped", False), ("joints_swapped", True)):
            exchanged = Rows.of(robot, [_ordered(states, order, with_torque) for states in runs])
            what = "positions and torques" if with_torque else "positions"
            message = (
                f"the {what} of {joint_words(names[a], names[b])} are swapped: the links' parameters of all joints "
                "agree with them exchanged only; map them in dynid.toml under [columns]"
            )
            judge(exchanged, Finding(code, "error", message, column=f"q_{a}"))
    trials.sort(key=lambda trial: trial[0])
    if not trials or trials[0][0] > -np.log(CLEARLY):
        return []
    return [trials[0][1]]


def _signed(states: States, sign: FloatArray) -> States:
    changed: dict[str, Any] = {name: getattr(states, name) * sign for name in SIGNALS}
    return replace(states, **changed)


def _ordered(states: States, order: NDArray[np.intp], with_torque: bool) -> States:
    names = (*SIGNALS, "tau") if with_torque else SIGNALS
    changed: dict[str, Any] = {name: np.ascontiguousarray(getattr(states, name)[:, order]) for name in names}
    return replace(states, **changed)


def _known_units(robot: _core.RobotModel, rows: Rows) -> list[Finding]:
    """Torque against what the robot file's inertials predict: a unit, or a side of the gears, that explains it."""
    slope, sure = rows.prior_slopes()
    sure &= slope > 0
    gears, effort = np.abs(robot.gear_ratio), robot.effort_limits
    geared = np.where(np.isfinite(gears) & (gears > 1), gears, np.nan)
    peak = np.max([np.abs(tau).max(axis=0) for tau in rows.torque], axis=0)
    rated = np.where(np.isfinite(effort) & (effort > 0) & (peak < MOST_PERCENT), effort, np.nan)
    units = (
        ("in N m", slope, ""),
        ("in mN m", slope / 1e3, 'write torque = "mN*m" in dynid.toml under [units]'),
        ("in kN m", slope * 1e3, "multiply it by 1000"),
        ("on the motor's side of the gears", slope * geared, "write tau in dynid.toml under [gear] apply_to"),
        ("in percent of the rated torque", slope * rated / 100, "multiply it by the rated torque over 100"),
    )
    if not sure.any():
        return []
    # Of what fits, what fits best: a percent of a rated torque may look like a N m on some joints.
    off = [float(np.max(np.abs(np.log(values[sure])))) for _, values, _ in units]
    best = int(np.nanargmin(off))
    if best == 0 or off[best] > np.log(UNIT_RANGE) or off[0] < np.log(UNIT_RANGE):
        return []
    return [_unit(rows, f"the torque looks as if it were {units[best][0]}", units[best][2])]


def _odd_unit(robot: _core.RobotModel, j: int, slope: float, others: float) -> Finding:
    message = (
        f"the torque of {joint_words(robot.joint_names[j])} is {slope:.3g} times what the robot file's inertials need, "
        f"and that of the other joints {others:.3g} times: check its unit and its gear ratio"
    )
    return Finding("torque_unit", "error", message, column=f"tau_{j}", value=float(slope), unit="1")


def _unknown_unit(robot: _core.RobotModel, rows: Rows) -> list[Finding]:
    """Torque that is far from what the robot file's inertials need, for no reason that is known."""
    slope, sure = rows.prior_slopes()
    sure &= slope > 0
    middle = float(np.median(slope[sure])) if sure.any() else 1.0
    odd = np.flatnonzero(sure & (np.abs(np.log(np.maximum(slope, 1e-300) / middle)) > np.log(ODD)))
    if len(odd) and sure.sum() > 2:
        return [_odd_unit(robot, int(j), slope[j], middle) for j in odd]
    if 1 / ABSURD < middle < ABSURD:
        return []
    return [
        _unit(rows, "the torque does not fit the robot file", "check its unit, its gear ratios, and the robot file")
    ]


def _unit(rows: Rows, what: str, mend: str) -> Finding:
    slope, sure = rows.prior_slopes()
    values = np.sort(slope[sure & (slope > 0)])
    message = f"{what}: it is {values[0]:.3g} to {values[-1]:.3g} times what the robot file's inertials need; {mend}"
    column = f"tau_{int(np.flatnonzero(sure)[0])}"
    return Finding("torque_unit", "error", message, column=column, value=float(np.median(values)), unit="1")
