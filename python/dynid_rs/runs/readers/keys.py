"""Every key of `dynid.toml`, once: parser, docs/reference/dynid_toml.md and the schema for editors are made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from dynid_rs.runs.readers.config import GEARED, MOTOR_SIDE, SIGNALS, SIGNED, UNITS

Kind = Literal["column", "time_column", "unit", "numbers", "positive", "signs", "signals", "name", "names", "vector"]
"""What a value may be: see `KINDS`."""

KINDS: Mapping[Kind, str] = {
    "column": "a name with `{i}` (joint from 0), `{n}` (from 1) or `{joint}` (its name); or a list of names, one per "
    "joint in chain order; or `false`: do not read",
    "time_column": "a column's name",
    "unit": "one of the units listed",
    "numbers": "a number of at least 0, or a list of them, one per joint",
    "positive": "a positive number, or a list of them, one per joint",
    "signs": "1 or -1, or a list of them, one per joint",
    "signals": "a list of signals",
    "name": "a name",
    "names": "a list of names",
    "vector": "three numbers",
}


@dataclass(frozen=True)
class Key:
    """One key: its `table` and `name`, the `kind` of its value, what it `means`, and an `example` in TOML."""

    table: str
    name: str
    kind: Kind
    means: str
    example: str


TABLES: Mapping[str, str] = {
    "columns": "Which column is which signal. Signals that are left out keep their usual names (`q_0` or `q_elbow`).",
    "units": "Units of the file, where they are not SI.",
    "signs": "Directions that differ from those of the robot's file.",
    "gear": "Signals that the file gives on the motor side.",
    "drive": "Currents instead of torques.",
    "motor": "What turns inside the drives.",
    "robot": "The arm these files are of; options of the command line win over it.",
    "file": "Where in a file the run is, if it holds more than one.",
}

_MEANINGS: Mapping[str, tuple[str, str]] = {
    "t": ("time", '"timestamp"'),
    "q": ("position on the link side; with one encoder per joint, the only one", '"actual_q_{i}"'),
    "dq": ("velocity; compared with the derivative of q, and not used where they disagree", "false"),
    "ddq": ("acceleration; as dq", "false"),
    "q_motor": ("motor encoder, divided by the gear ratio or as [gear] says", '"motor_pos_{n}"'),
    "dq_motor": ("its velocity", '"motor_vel_{n}"'),
    "ddq_motor": ("its acceleration", "false"),
    "tau": ("torque at the joint, measured; a controller's own model is none", '["m_base", "m_elbow"]'),
    "current": ("motor current, read where there is no tau", '"actual_current_{i}"'),
    "q_reference": ("position that the controller was asked for", '"target_q_{i}"'),
    "temperature": ("temperature of the joint [degC]", '"joint_temperatures_{i}"'),
}
_QUANTITIES: Mapping[str, str] = {
    "time": "of t; whole numbers are kept exact, and dates (ISO 8601) need no unit; `100ns`: .NET ticks, FILETIME",
    "angle": "of q, q_motor, q_reference of turning joints, and of their derivatives where `velocity` is left out",
    "velocity": "of dq, dq_motor of turning joints",
    "length": "of sliding joints, and of their derivatives",
    "torque": "of tau",
    "current": "of current",
}
_SIGNS = {"q": "also of dq, ddq and q_reference", "q_motor": "also of dq_motor and ddq_motor", "tau": "also of current"}

KEYS: tuple[Key, ...] = (
    *(Key("columns", signal, "time_column" if signal == "t" else "column", *_MEANINGS[signal]) for signal in SIGNALS),
    *(Key("units", quantity, "unit", _QUANTITIES[quantity], f'"{list(UNITS[quantity])[1]}"') for quantity in UNITS),
    *(Key("signs", signal, "signs", _SIGNS[signal], "[1, -1, 1]") for signal in SIGNED),
    Key(
        "gear",
        "ratio",
        "positive",
        "motor turns per joint turn; left out beside `apply_to`: those of the robot's file",
        "[101, 101]",
    ),
    Key(
        "gear",
        "apply_to",
        "signals",
        f"which of {', '.join(GEARED)} are on the motor side (q: where the motor's encoder is the only one); "
        f"left out beside `ratio`: {', '.join(MOTOR_SIDE)}",
        '["q_motor"]',
    ),
    Key("drive", "gain", "positive", "N m/A at the joint: currents become torques", "[14.9, 13.3]"),
    Key(
        "motor",
        "rotor_inertia",
        "numbers",
        "kg m^2 on the link side: the rotor's own times the gear ratio squared",
        "[1.2, 0.9]",
    ),
    Key("robot", "joints", "names", "joints of the chain these rules are for; another robot is refused", '["a", "b"]'),
    Key("robot", "base", "name", "first link of the chain, where the URDF leaves a choice", '"base_link"'),
    Key("robot", "tip", "name", "last link of the chain, where the URDF branches", '"tool0"'),
    Key("robot", "gravity", "vector", "free fall in the base frame [m/s^2]", "[0.0, 0.0, -9.81]"),
    Key("file", "topic", "name", "topic of sensor_msgs/JointState in a bag that holds several", '"/joint_states"'),
    Key("file", "sheet", "name", "sheet of a workbook; left out: the first", '"Run 1"'),
)


def known_keys() -> dict[str, tuple[str, ...]]:
    """Tables, and the keys of each."""
    return {table: tuple(key.name for key in KEYS if key.table == table) for table in TABLES}
