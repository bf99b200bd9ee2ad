"""A planned trajectory from a file: samples that a controller can play, made smooth in between."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.simulation.trajectory import REST

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel

FloatArray = NDArray[np.float64]

MAX_STEP = 0.1
"""Longest step [s] of a plan: what lies between two samples is made up."""

MIN_SAMPLES = 20
MAX_PLAN = 3600.0
_SIGNALS = ("q", "dq", "ddq")
_RESTING = 1e-6
_LIMIT_TOLERANCE = 1e-6
_DISAGREEMENT = 0.05
"""Of the greatest speed or acceleration of a joint: more than this between a column and the derivative of the
one before it is another unit or another order of the joints, not rounding."""


@dataclass(frozen=True, eq=False)
class PlayedTrajectory:
    """Rest, the samples of a plan, rest. Between samples a polynomial of fifth order meets q, dq and ddq.

    Parameters
    ----------
    t : ndarray (n,)
        [s], increasing, from 0.
    q, dq, ddq : ndarray (n, n_joints)
        Plan at `t`; speed is zero at both ends.
    source : str
        Name of the file.
    rest : float
        Length of each rest [s].
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    source: str = "plan"
    rest: float = REST

    @property
    def duration(self) -> float:
        """Both rests and the plan [s]."""
        return float(2 * self.rest + self.t[-1])

    def evaluate(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at times `t` (n,) [s], each (n, n_joints)."""
        since = np.asarray(t, dtype=np.float64) - self.rest
        moving = (since > 0) & (since < self.t[-1])
        clipped = np.clip(since, 0.0, self.t[-1])
        k = np.clip(np.searchsorted(self.t, clipped, side="right") - 1, 0, self.t.size - 2)
        step = (self.t[k + 1] - self.t[k])[:, None]
        s = (clipped - self.t[k])[:, None] / step
        q, dq, ddq = _quintic(
            s,
            step,
            (self.q[k], self.dq[k], self.ddq[k]),
            (self.q[k + 1], self.dq[k + 1], self.ddq[k + 1]),
        )
        return q, np.where(moving[:, None], dq, 0.0), np.where(moving[:, None], ddq, 0.0)

    def to_json(self) -> dict[str, object]:
        """Return where the plan came from; its samples are in that file."""
        return {"plan": self.source, "n_samples": int(self.t.size), "rest_s": self.rest}


def read_plan(path: Path, robot: RobotModel) -> PlayedTrajectory:
    """Read a planned trajectory: columns `t`, `q_i`, `dq_i`, `ddq_i` for every joint, by index or by name.

    Raises
    ------
    DataError
        Columns that lack or do not belong to each other, a plan that does not start and end at rest, that is
        too short, too long or too coarse, or that leaves the robot's limits.
    OSError
        The file cannot be read.
    """
    from dynid_rs.runs.readers.csv import open_csv

    table = open_csv(path)
    names = robot.joint_names
    columns = {
        (signal, j): _column(table.names, signal, j, names, table.file)
        for signal in _SIGNALS
        for j in range(len(names))
    }
    if "t" not in table.names:
        raise DataError(
            f"{table.file}: column t is missing [s]; a plan has t, q_i, dq_i and ddq_i",
            code="missing_column",
            file=table.file,
            column="t",
        )
    extra = f"q_{len(names)}"
    if extra in table.names:
        raise DataError(
            f"{table.file}: column {extra} is there, but the robot has {len(names)} joints; "
            "this plan is for another robot",
            code="too_many_joints",
            file=table.file,
            column=extra,
        )
    loaded = table.load(["t", *columns.values()])
    t = np.asarray(loaded["t"], dtype=np.float64)
    q, dq, ddq = (
        np.stack([np.asarray(loaded[columns[signal, j]], dtype=np.float64) for j in range(len(names))], axis=1)
        for signal in _SIGNALS
    )
    _check_time(t, table.file)
    _check_numbers(q, dq, ddq, table.file)
    _check_rest(dq, table.file)
    plan = PlayedTrajectory(t - t[0], q, dq, ddq, source=table.file)
    _check_derivatives(plan, table.file)
    _check_limits(plan, robot, table.file)
    return plan


def _quintic(
    s: FloatArray,
    step: FloatArray,
    start: tuple[FloatArray, FloatArray, FloatArray],
    end: tuple[FloatArray, FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hermite's polynomial through value, slope and curvature at both ends, and its derivatives, at s in [0, 1]."""
    c0, c1, c2 = start[0], step * start[1], step**2 * start[2] / 2
    # What is left at the end once the first three coefficients have had their say.
    value = end[0] - (c0 + c1 + c2)
    slope = step * end[1] - (c1 + 2 * c2)
    curve = step**2 * end[2] - 2 * c2
    c3, c4, c5 = 10 * value - 4 * slope + curve / 2, -15 * value + 7 * slope - curve, 6 * value - 3 * slope + curve / 2
    q = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
    dq = (c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / step
    ddq = (2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / step**2
    return q, dq, ddq


def _column(names: tuple[str, ...], signal: str, joint: int, joints: list[str], file: str) -> str:
    for name in (f"{signal}_{joint}", f"{signal}_{joints[joint]}"):
        if name in names:
            return name
    raise DataError(
        f"{file}: column {signal}_{joint} is missing; a plan for this robot has t and q_i, dq_i, ddq_i "
        f"with i from 0 to {len(joints) - 1}",
        code="missing_column",
        file=file,
        column=f"{signal}_{joint}",
    )


def _check_time(t: FloatArray, file: str) -> None:
    from dynid_rs.runs.cells import check_time

    check_time(t, file=file)
    longest = float(np.diff(t).max())
    if longest > MAX_STEP:
        raise DataError(
            f"{file}: a step of {longest:.4g} s is too long for a plan, at most {MAX_STEP:g} s; sample it finer",
            code="coarse_plan",
            file=file,
            column="t",
        )
    if t[-1] - t[0] > MAX_PLAN:
        raise DataError(
            f"{file}: a plan of {t[-1] - t[0]:.4g} s is too long, at most {MAX_PLAN:g} s; split it",
            code="long_plan",
            file=file,
            column="t",
        )


def _check_numbers(q: FloatArray, dq: FloatArray, ddq: FloatArray, file: str) -> None:
    from dynid_rs.runs.cells import check_finite

    for signal, values in zip(_SIGNALS, (q, dq, ddq), strict=True):
        for joint in range(values.shape[1]):
            check_finite(values[:, joint], file=file, column=f"{signal}_{joint}")


def _check_rest(dq: FloatArray, file: str) -> None:
    fastest = np.maximum(np.abs(dq).max(axis=0), 1.0)
    for row, where in ((0, "starts"), (len(dq) - 1, "ends")):
        joint = int(np.argmax(np.abs(dq[row]) / fastest))
        if abs(dq[row, joint]) > _RESTING * fastest[joint]:
            raise DataError(
                f"{file}: the plan {where} with joint {joint} at {dq[row, joint]:.3g} rad/s; a plan starts and ends at "
                "rest, let it speed up and slow down",
                code="plan_not_at_rest",
                file=file,
                column=f"dq_{joint}",
                row=row,
            )


def _check_derivatives(plan: PlayedTrajectory, file: str) -> None:
    """Compare each column with the integral of the next: units, order of joints, another robot's file."""
    from scipy.integrate import cumulative_simpson

    for signal, value, rate in (("q", plan.q, plan.dq), ("dq", plan.dq, plan.ddq)):
        integral = cumulative_simpson(rate, x=plan.t, axis=0, initial=0.0)
        error = np.ptp(value - integral, axis=0)
        size = np.maximum(np.ptp(value, axis=0), np.ptp(integral, axis=0))
        wrong = np.flatnonzero(error > _DISAGREEMENT * size + 1e-6)
        if wrong.size:
            joint = int(wrong[0])
            raise DataError(
                f"{file}: d{signal}_{joint} is not the derivative of {signal}_{joint}: integrated it is off by "
                f"{error[joint]:.3g} where {signal} covers {size[joint]:.3g}; check units and order of the columns",
                code="plan_derivatives",
                file=file,
                column=f"d{signal}_{joint}",
            )


def _check_limits(plan: PlayedTrajectory, robot: RobotModel, file: str) -> None:
    lower, upper, speed = (np.asarray(x) for x in (robot.lower, robot.upper, robot.velocity_limits))
    speed = np.where(np.isfinite(speed) & (speed > 0), speed, np.inf)
    excess = {
        "q": np.maximum(plan.q - upper, lower - plan.q),
        "dq": np.abs(plan.dq) - speed,
    }
    for signal, beyond in excess.items():
        row, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        if beyond[row, joint] > _LIMIT_TOLERANCE:
            limit = f"{lower[joint]:.4g} to {upper[joint]:.4g}" if signal == "q" else f"at most {speed[joint]:.4g}"
            value = float((plan.q if signal == "q" else plan.dq)[row, joint])
            raise DataError(
                f"{file}, row {int(row) + 1}, column {signal}_{joint}: {value:.4g} leaves the limits of joint "
                f"{robot.joint_names[int(joint)]!r} ({limit}); plan within them",
                code="plan_limits",
                file=file,
                column=f"{signal}_{joint}",
                row=int(row),
            )
