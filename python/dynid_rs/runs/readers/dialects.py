"""Logs that are known by the names of their columns: what other programs write without being told.

What is read by such rules is said in the run's notes, above all what a column does not hold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.columns import ALIASES
from dynid_rs.runs.readers.config import ColumnRule, Config
from dynid_rs.runs.readers.units import unit_in_name, unit_of
from dynid_rs.runs.readers.words import meanings


@dataclass(frozen=True)
class Dialect:
    """Columns of one kind of log.

    Parameters
    ----------
    name : str
        For people.
    marks : tuple of str
        Columns that only such a log has; all of them.
    times : tuple of str
        Names of its time, the first that is there.
    columns : mapping of str to str
        Signal -> template, as in `dynid.toml`.
    units : mapping of str to str
        Units of the log.
    notes : tuple of str
        What its columns are.
    also : mapping of str to str
        A column, and what is to be said of it where it is there.
    no_torque : mapping of str to str
        A column that might be taken for a torque, and why it is none.
    """

    name: str
    marks: tuple[str, ...]
    times: tuple[str, ...]
    columns: Mapping[str, str]
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    also: Mapping[str, str] = field(default_factory=dict)
    no_torque: Mapping[str, str] = field(default_factory=dict)


_UR_CURRENT = "actual_current is the motors' current in A"
_UR_MODEL = "target_moment is the controller's own model, not a measurement, and is not read"
_KUKA_CURRENT = (
    "MACur is the motor current in percent of each drive's largest (or in A), no torque: where it is read, give N m "
    "per percent (or per A) as [drive] gain"
)

DIALECTS = (
    # Universal Robots, RTDE guide: fields of the output recipe; record.py of the client library and ur_rtde write them.
    # The recipe is the user's: positions are there, and any of the others.
    *(
        Dialect(
            "Universal Robots RTDE",
            ("actual_q_0", other),
            ("timestamp", "time"),
            {
                "q": "actual_q_{i}",
                "dq": "actual_qd_{i}",
                "current": "actual_current_{i}",
                "q_reference": "target_q_{i}",
                "temperature": "joint_temperatures_{i}",
            },
            notes=(_UR_CURRENT,),
            also={"target_moment_0": _UR_MODEL},
            no_torque={
                "target_moment_0": f"{_UR_MODEL}: fitted to it, a model would be a copy of the controller's; record "
                "actual_current beside actual_q"
            },
        )
        for other in ("actual_current_0", "actual_qd_0", "target_moment_0", "target_q_0")
    ),
    # libfranka, log.h: the names of franka::RobotState; time counts milliseconds.
    Dialect(
        "libfranka",
        ("state.q[0]",),
        ("time", "state.time", "duration"),
        {"q": "state.q[{i}]", "dq": "state.dq[{i}]", "tau": "state.tau_J[{i}]", "q_reference": "state.q_d[{i}]"},
        {"time": "ms"},
        ("libfranka counts time in ms", "state.tau_J is the link-side torque sensor"),
    ),
    # KUKA.RobotSensorInterface: what the controller sends each cycle; IPOC counts milliseconds, angles are in degrees.
    *(
        Dialect(
            "KUKA RSI",
            (f"AIPos{dot}A1",),
            ("IPOC", "Timestamp", "time", "t"),
            {
                "q": f"AIPos{dot}A{{n}}",
                "tau": f"GearTorque{dot}A{{n}}",
                "current": f"MACur{dot}A{{n}}",
                "q_reference": f"ASPos{dot}A{{n}}",
            },
            {"time": "ms", "angle": "deg"},
            ("RSI sends angles in degrees, and IPOC counts ms",),
            {f"MACur{dot}A1": _KUKA_CURRENT},
        )
        for dot in (".", "_", "")
    ),
    # PlotJuggler's export of sensor_msgs/JointState
    *(
        Dialect(
            "PlotJuggler",
            ("__time",),
            ("__time",),
            {
                "q": f"{topic}/{{joint}}/position",
                "dq": f"{topic}/{{joint}}/velocity",
                "tau": f"{topic}/{{joint}}/effort",
            },
        )
        for topic in ("/joint_states", "joint_states", "/robot/joint_states")
    ),
)

_JOINT_STATE = {"position": "q", "velocity": "dq", "effort": "tau"}

_TIMES = frozenset(
    ("t", "time", "timestamp", "timestamps", "zeit", "stamp", "datetime", "date_time", "elapsed", "elapsed_time")
) | {"ticks", "filetime", "__time", "header.stamp", "header_stamp", "t_s", "time_s", "timestamp_s"}


def speak(
    names: Sequence[str], config: Config, file: str, stamps: frozenset[str] = frozenset()
) -> tuple[Config, tuple[str, ...]]:
    """Rules for the columns of a file that is known by its names; what `config` says itself stays as it says.

    `stamps`: columns that are moments, of which the only one that is called a time is it.

    Returns
    -------
    config : Config
        With the rules of the dialect, and with the file's columns of time and torque where only their spelling is
        unusual.
    notes : tuple of str
        What was recognised.

    Raises
    ------
    DataError
        The file holds only what looks like a torque and is none.
    """
    dialect = next((known for known in DIALECTS if _speaks(known, names)), None) or _joint_states(names)
    if dialect is None:
        return _with_time(names, _with_torque(names, config), stamps), ()
    columns: dict[str, ColumnRule] = {}
    for signal, template in dialect.columns.items():
        if signal not in config.columns and _is_there(template, names):
            columns[signal] = template
    time = next((name for name in dialect.times if name in names), None)
    if time is not None and "t" not in config.columns:
        columns["t"] = time
    torques = {"tau", "current"} & {*columns, *(key for key, rule in config.columns.items() if rule is not None)}
    units = {key: unit for key, unit in dialect.units.items() if key != "time" or columns.get("t") != "t"}
    for column, reason in dialect.no_torque.items():
        if column in names and not torques:
            raise DataError(
                f"{file}: {shown(column)} is no measured torque: {reason}",
                code="no_measured_torque",
                file=file,
                column=column,
            )
    said = [f"read as {dialect.name} writes it", *dialect.notes]
    said += [text for column, text in dialect.also.items() if column in names]
    config = replace(config, columns={**columns, **config.columns}, units={**units, **config.units})
    return _with_time(names, config, stamps), ("; ".join(said),)


def _speaks(dialect: Dialect, names: Sequence[str]) -> bool:
    position = dialect.columns["q"]
    return all(mark in names for mark in dialect.marks) and _is_there(position, names)


def _joint_states(names: Sequence[str]) -> Dialect | None:
    """sensor_msgs/JointState as rows, by its words and names: `position` and `effort` of the same joints."""
    for head, (before, after) in product(("", "field."), (("_", ""), ("[", "]"))):
        joints = {
            word: {
                name[len(head + word + before) : len(name) - len(after)]
                for name in names
                if name.startswith(f"{head}{word}{before}") and name.endswith(after)
            }
            for word in _JOINT_STATE
        }
        named = joints["position"]
        if named and named == joints["effort"] and not any(joint.isdigit() for joint in named):
            columns = {
                signal: f"{head}{word}{before}{{joint}}{after}"
                for word, signal in _JOINT_STATE.items()
                if joints[word] == named
            }
            # rostopic echo -p counts nanoseconds, whatever its columns are called.
            times = ("time", "field.header.stamp") if head else ()
            return Dialect("sensor_msgs/JointState", (), times, columns, {"time": "ns"} if head else {})
    return None


def _is_there(template: str, names: Sequence[str]) -> bool:
    """Whether the first joint's column is there; for a name in the middle, any column of that form."""
    if "{joint}" in template:
        head, _, tail = template.partition("{joint}")
        return any(name.startswith(head) and name.endswith(tail) for name in names)
    return template.format(i=0, n=1) in names


def _with_torque(names: Sequence[str], config: Config) -> Config:
    """`config` with `torque_0`, ... or `torque_NAME` as torque, where no column has a name that goes before it.

    Drives' logs have a motor's torque of that name beside `tau_0` or `current_0`, which are read as ever then.
    """
    usual = tuple(f"{alias}_" for signal in ("tau", "current") for alias in ALIASES[signal])
    if {"tau", "current"} & set(config.columns) or any(name.startswith(usual) for name in names):
        return config
    if "torque_0" in names:
        return replace(config, columns={"tau": "torque_{i}", **config.columns})
    if any(f"q_{name.removeprefix('torque_')}" in names for name in names if name.startswith("torque_")):
        return replace(config, columns={"tau": "torque_{joint}", **config.columns})
    return config


def _with_time(names: Sequence[str], config: Config, stamps: frozenset[str]) -> Config:
    """`config` with the time column, where it is one that is only spelled in another way: `Time`, `time_ms`."""
    if "t" in config.columns or any(name in names for name in ALIASES["t"]):
        return config
    found = []
    for name in names:
        unit = unit_in_name(name)
        short = name.lower().strip()
        if unit is not None and (unit_of(unit) or ("",))[0] == "time":
            short = short[: -len(unit) - 1]
        if short.replace(" ", "_") in _TIMES:
            found.append(name)
    if not found:
        found = [name for name in names if name in stamps and "time" in meanings(name)]
    if len(found) != 1:
        return config
    return replace(config, columns={"t": found[0], **config.columns})
