"""What a watch has said, as Prometheus reads it: the text exposition format, version 0.0.4.

For node_exporter's textfile collector, which reads ``*.prom`` and takes no time stamps; names end in their base unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from dynid_rs.base.changes import FROZEN, RELATIVE
from dynid_rs.base.clock import is_wall_clock
from dynid_rs.model.standing import KINDS, LAST_ROWS, Standing, standing
from dynid_rs.model.watch import Watch, Watched

_PREFIX = "dynid_watch_"
_RELATIVE = tuple(kind for kind in KINDS if kind in RELATIVE)


@dataclass
class _Metric:
    """Samples of one name, which stand together."""

    name: str
    kind: str
    help: str
    samples: list[tuple[dict[str, str], float]] = field(default_factory=list)

    def add(self, value: float, **labels: str) -> None:
        self.samples.append((labels, value))

    def lines(self) -> list[str]:
        name = _PREFIX + self.name
        head = [f"# HELP {name} {_escaped(self.help)}", f"# TYPE {name} {self.kind}"]
        return [*head, *(f"{name}{_labels(labels)} {_number(value)}" for labels, value in self.samples)]


def prometheus_text(watch: Watch, runs: Sequence[Watched]) -> str:
    r"""State at the end of the last run in Prometheus' text format.

    Of a joint that was not watched in that run nothing is said but that, and that its channel is frozen, if it is; a
    change that was withdrawn is none.

    Parameters
    ----------
    watch : Watch
        Has watched them.
    runs : sequence of Watched
        In the order in which they were recorded, at least one.

    Returns
    -------
    str
        Metrics ``dynid_watch_changed`` (0 or 1), ``dynid_watch_change_ratio`` (friction, gain, unknown),
        ``dynid_watch_offset_newton_meters`` (``_newtons`` where a joint slides, ``_amperes`` of currents),
        ``dynid_watch_delay_seconds``, ``dynid_watch_slip_radians`` (``_meters`` where a joint slides),
        ``dynid_watch_load_kilograms`` and ``dynid_watch_load_moment_kilogram_meters`` (torque in N m alone),
        ``dynid_watch_residual_ratio``, ``dynid_watch_watched_ratio``, ``dynid_watch_rows_total``,
        ``dynid_watch_runs_total``, ``dynid_watch_last_row_timestamp_seconds`` (times of a wall clock alone), with
        labels `robot`, `joint`, `kind`, `axis`; ends in a line feed.

    Raises
    ------
    ValueError
        There is no run.
    """
    if not runs:
        raise ValueError("prometheus_text: no run was watched; give one at least")
    robot, last = watch.model.robot.name, runs[-1]
    state = standing(watch, last)
    metrics = [*_changes(watch, state, robot), *_rows(watch, state, robot)]
    rows = _Metric("rows_total", "counter", "Rows that were looked at, of all runs of this call.")
    rows.add(sum(len(run.t) for run in runs), robot=robot)
    number = _Metric("runs_total", "counter", "Runs that were looked at in this call.")
    number.add(len(runs), robot=robot)
    metrics += [rows, number]
    if len(last.t) and is_wall_clock(float(last.t[-1])):
        clock = _Metric("last_row_timestamp_seconds", "gauge", "Unix time at the end of the last row.")
        clock.add(float(last.t[-1]), robot=robot)
        metrics.append(clock)
    return "".join(f"{line}\n" for metric in metrics if metric.samples for line in metric.lines())


def _changes(watch: Watch, state: Standing, robot: str) -> list[_Metric]:
    """Whether something stands, and its size; of joints that were not watched a frozen channel alone."""
    at_end = "at the end of the last run, 0 where none stands."
    changed = _Metric("changed", "gauge", "Whether a change stands at the end of the last run (1) or not (0).")
    ratio = _Metric("change_ratio", "gauge", f"Relative change of friction, gain or error {at_end}")
    offsets = {
        name: _Metric(f"offset_{name}", "gauge", f"Constant torque that is new {at_end}")
        for name in ("newton_meters", "newtons", "amperes")
    }
    delay = _Metric("delay_seconds", "gauge", f"Delay of the torque channel that is new {at_end}")
    slips = {
        name: _Metric(f"slip_{name}", "gauge", f"Jump of the position that the encoder shows {at_end}")
        for name in ("radians", "meters")
    }
    names, kinds = watch.model.robot.joint_names, watch.model.robot.joint_kinds
    for joint, joint_kind, part in zip(names, kinds, state.watched, strict=True):
        unwatched = [FROZEN] if state.find(FROZEN, joint) else []
        for kind in KINDS[:-1] if part > 0.0 else unwatched:
            found = state.find(kind, joint)
            size = 0.0 if found is None else found.size
            changed.add(found is not None, robot=robot, joint=joint, kind=kind)
            if kind in _RELATIVE:
                ratio.add(size, robot=robot, joint=joint, kind=kind)
            elif kind == "offset":
                unit = "newtons" if joint_kind == "prismatic" else "newton_meters"
                unit = unit if watch.model.torque_unit == "N*m" else "amperes"
                offsets[unit].add(size, robot=robot, joint=joint)
            elif kind == "delay":
                delay.add(size, robot=robot, joint=joint)
            elif kind == "slip":
                slips["meters" if joint_kind == "prismatic" else "radians"].add(size, robot=robot, joint=joint)
    load = _Metric("load_kilograms", "gauge", f"Mass at the last link that is new {at_end}")
    moment = _Metric("load_moment_kilogram_meters", "gauge", f"Its first moments in the last link's frame {at_end}")
    if state.watched.any():
        found = state.find("load")
        changed.add(found is not None, robot=robot, kind="load")
        if watch.model.torque_unit == "N*m":
            load.add(0.0 if found is None else found.size, robot=robot)
            moments = (found.moments if found else None) or (0.0, 0.0, 0.0)
            for axis, value in zip("xyz", moments, strict=True):
                moment.add(value, robot=robot, axis=axis)
    return [changed, ratio, *offsets.values(), delay, *slips.values(), load, moment]


def _rows(watch: Watch, state: Standing, robot: str) -> list[_Metric]:
    residual = _Metric(
        "residual_ratio",
        "gauge",
        f"Root mean square of what is left over what is expected, of the last {LAST_ROWS} rows that were watched.",
    )
    watched = _Metric("watched_ratio", "gauge", "Part of the last run in which the joint was watched.")
    for joint, left, part in zip(watch.model.robot.joint_names, state.residual, state.watched, strict=True):
        watched.add(float(part), robot=robot, joint=joint)
        if math.isfinite(left):
            residual.add(float(left), robot=robot, joint=joint)
    return [residual, watched]


def _labels(labels: dict[str, str]) -> str:
    """Label names are ours; values may hold anything."""
    quoted = (f'{name}="{_escaped(value, quotes=True)}"' for name, value in labels.items())
    return "{" + ",".join(quoted) + "}"


def _escaped(text: str, *, quotes: bool = False) -> str:
    text = text.replace("\\", "\\\\").replace("\n", "\\n")
    return text.replace('"', '\\"') if quotes else text


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else repr(float(value))
