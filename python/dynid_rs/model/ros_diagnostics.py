"""What a watch has said in the fields of a ROS 2 message, ``diagnostic_msgs/msg/DiagnosticArray``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from dynid_rs.base.changes import FROZEN, Change, advice
from dynid_rs.base.clock import is_wall_clock
from dynid_rs.model.standing import Standing, standing
from dynid_rs.model.watch import Watch, Watched

OK, WARN, ERROR, STALE = 0, 1, 2, 3
"""Levels of ``diagnostic_msgs/msg/DiagnosticStatus``."""
_NOT_WATCHED = "not watched: it never moved as the model was trained to"


def ros_diagnostics(watch: Watch, runs: Sequence[Watched]) -> dict[str, Any]:
    """State at the end of the last run, as a DiagnosticArray.

    Parameters
    ----------
    watch : Watch
        Has watched them.
    runs : sequence of Watched
        In the order in which they were recorded, at least one.

    Returns
    -------
    dict
        `header` (`stamp` with `sec` and `nanosec`, `frame_id`) and `status`, one per joint and one, the last, of a
        load; each with `level`, `name`, `message`, `hardware_id` and `values`, a list of `key` and `value`. The stamp
        is the end of the last run where its times are Unix time, else 0.

    Notes
    -----
    Levels of a joint: STALE (3) where it was not watched in the last run and its channel is not frozen, else ERROR (2)
    where a change of friction, gain, constant torque, delay, slip or error, or a frozen channel, has settled, WARN (1)
    where one was named and has not settled yet, else OK (0). Of the load: STALE where no joint was watched, WARN where
    there is one, else OK: a load is no fault. A change that was withdrawn is none.

    Raises
    ------
    ValueError
        There is no run.
    """
    if not runs:
        raise ValueError("ros_diagnostics: no run was watched; give one at least")
    last = runs[-1]
    state, robot = standing(watch, last), watch.model.robot
    end = float(last.t[-1]) if len(last.t) else 0.0
    # Exact, for a float of nanoseconds is not; a second that is rounded up belongs to `sec`.
    sec, nanosec = divmod(round(Fraction(end) * 1_000_000_000), 1_000_000_000) if is_wall_clock(end) else (0, 0)
    status = [_joint(state, j, joint, robot.name) for j, joint in enumerate(robot.joint_names)]
    return {
        "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""},
        "status": [*status, _load(state, robot.name)],
    }


def _joint(state: Standing, j: int, joint: str, robot: str) -> dict[str, Any]:
    own = [change for change in state.changes if change.joint == joint and change.kind != "load"]
    level = ERROR if any(change.said == "settled" for change in own) else WARN if own else OK
    message = "; ".join(_said(change) for change in own) or "nothing has changed"
    if state.watched[j] == 0.0 and state.find(FROZEN, joint) is None:
        level, message = STALE, _NOT_WATCHED
    values = {"watched_ratio": f"{state.watched[j]:.6g}"}
    if math.isfinite(state.residual[j]):
        values["residual_ratio"] = f"{state.residual[j]:.6g}"
    for change in own:
        values |= _values(change)
    return _status(level, f"dynid watch: {joint}", message, robot, values)


def _load(state: Standing, robot: str) -> dict[str, Any]:
    found = state.find("load")
    values = {} if found is None else _values(found)
    if found is not None and found.moments is not None:
        values |= {f"load_moment_{axis}": f"{m:.6g}" for axis, m in zip("xyz", found.moments, strict=True)}
    if not state.watched.any():
        level, message = STALE, "not watched: no joint moved as the model was trained to"
    else:
        level, message = (OK, "no load that is new") if found is None else (WARN, _said(found))
    return _status(level, "dynid watch: load", message, robot, values)


def _said(change: Change) -> str:
    return f"{change.what}{'' if change.said == 'named' else f' ({change.said})'}"


def _values(change: Change) -> dict[str, str]:
    """Size, interval and unit as numbers for programs, and in words."""
    low, high = change.interval
    kind = change.kind
    values = {
        kind: f"{change.size:.6g}",
        f"{kind}_low": f"{low:.6g}",
        f"{kind}_high": f"{high:.6g}",
        f"{kind}_unit": change.unit or "1",
        f"{kind}_state": change.said,
    }
    if change.either is not None:
        values[f"{kind}_or"] = change.either
    return values | {f"{kind}_advice": advice(kind, change.size).replace("`", "")}


def _status(level: int, name: str, message: str, robot: str, values: dict[str, str]) -> dict[str, Any]:
    pairs = [{"key": key, "value": value} for key, value in values.items()]
    return {"level": level, "name": name, "message": message, "hardware_id": robot, "values": pairs}
