"""`dynid.toml`: how the columns of somebody's files become signals in SI on the link side.

```toml
[columns]                          # any signal; names not given here keep their defaults
t = "timestamp"
q = "actual_q_{i}"                 # {i}: joint from 0, {n}: from 1, {joint}: its URDF name
tau = ["m_base", "m_elbow"]        # or one column per joint, in chain order
dq = false                         # do not read

[units]                            # of the file
time = "ms"
angle = "deg"

[drive]
gain = [14.9, 13.3]                # N m/A at the joint: currents become torques

[gear]
ratio = [101.0, 101.0]             # motor turns per joint turn; left out: those of the robot's file
apply_to = ["q_motor", "dq_motor"] # signals that the file gives on the motor side; also ddq_motor, tau

[motor]
rotor_inertia = [1.2, 0.9]         # kg m^2 on the link side: the rotor's own times the gear ratio squared

[signs]                            # +1 or -1 per joint
q = [1, -1]                        # also dq, ddq
q_motor = [1, -1]                  # also dq_motor, ddq_motor
tau = [1, -1]                      # also current
```
"""

from __future__ import annotations

import difflib
import math
import string
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import shown, shown_ends, shown_value
from dynid_rs.runs.recording import TIME_UNITS

ColumnRule = str | tuple[str, ...] | None
"""A template, one name per joint, or None: do not read."""

SIGNALS = ("t", "q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "tau", "current", "q_reference", "temperature")
PLACEHOLDERS = ("i", "n", "joint")

UNITS: Mapping[str, Mapping[str, float]] = {
    "time": TIME_UNITS,
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
    "velocity": {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0},
    "length": {"m": 1.0, "mm": 1e-3},
    "torque": {"N*m": 1.0, "mN*m": 1e-3, "kN*m": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
}
"""Factor to SI of every unit that a file may use. Velocity follows the angle when it is not given."""

GEARED = ("q_motor", "dq_motor", "ddq_motor", "tau")
SIGNED = ("q", "q_motor", "tau")

MAX_CONFIG_BYTES = 1 << 20

PerJoint = tuple[float, ...]


@dataclass(frozen=True)
class Config:
    """What `dynid.toml` says; every field may be left out.

    Parameters
    ----------
    columns : mapping of str to str, tuple of str or None
        Rules that replace the default names of a signal.
    units : mapping of str to str
        Units of the file.
    drive_gain : tuple of float, optional
        Torque at the joint per ampere [N m/A]; one number for all joints or one per joint.
    gear_ratio : tuple of float, optional
        Motor turns per joint turn; one number for all joints or one per joint. None: the columns are on the link
        side already, unless `gear_of_robot` says otherwise.
    gear_apply_to : tuple of str
        Signals that the file gives on the motor side.
    rotor_inertia : tuple of float, optional
        Rotor inertia on the link side [kg m^2]; one number for all joints or one per joint.
    gear_of_robot : bool
        `gear_apply_to` stands in the file without a ratio: the robot's own gear ratios count.
    signs : mapping of str to tuple of float
        +1 or -1 per joint for ``"q"``, ``"q_motor"``, ``"tau"``.
    source : str
        File name for messages.
    """

    columns: Mapping[str, ColumnRule] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    drive_gain: PerJoint | None = None
    gear_ratio: PerJoint | None = None
    gear_apply_to: tuple[str, ...] = ("q_motor", "dq_motor", "ddq_motor")
    rotor_inertia: PerJoint | None = None
    gear_of_robot: bool = False
    signs: Mapping[str, PerJoint] = field(default_factory=dict)
    source: str = "dynid.toml"

    def factor(self, quantity: str) -> float:
        """Factor from the unit of the file to SI."""
        if quantity == "velocity" and "velocity" not in self.units:
            quantity = "angle"
        return UNITS[quantity][self.unit(quantity)]

    def unit(self, quantity: str) -> str:
        """Unit of the file."""
        return self.units.get(quantity, next(iter(UNITS[quantity])))

    def with_gears(self, ratios: Iterable[float] | None) -> Config:
        """Return these rules with the robot's gear ratios (NaN: unknown), if the file left them to the robot.

        Raises
        ------
        DataError
            The file left them to a robot that does not know them all.
        """
        if not self.gear_of_robot:
            return self
        known = () if ratios is None else tuple(float(ratio) for ratio in ratios)
        if not known or any(math.isnan(ratio) for ratio in known):
            raise DataError(
                f"{self.source}, [gear] apply_to: needs ratio beside it, because no robot is given whose file declares "
                "gear_ratio for every joint",
                code="bad_config",
                file=self.source,
                column="[gear] apply_to",
            )
        return replace(self, gear_ratio=known, gear_of_robot=False)


def read_config(path: str | Path) -> Config:
    """Read a `dynid.toml`.

    Raises
    ------
    DataError
        Not TOML, a key that is not known, a value of the wrong kind; names file and key.
    OSError
        The file cannot be opened.
    """
    place, file = check_readable(path), Path(path).name
    if place.stat().st_size > MAX_CONFIG_BYTES:
        raise DataError(f"{file}: is larger than {MAX_CONFIG_BYTES} bytes, expected a short TOML file", file=file)
    try:
        content = tomllib.loads(place.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise DataError(f"{file}: is not UTF-8 text; save it as UTF-8", code="bad_config", file=file) from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"{file}: is not valid TOML: {shown_ends(str(error))}", code="bad_config", file=file) from None
    return _Parser(file).config(content)


@dataclass(frozen=True)
class _Parser:
    file: str

    def fault(self, key: str, text: str) -> DataError:
        return DataError(
            f"{self.file}, {shown(key, 60)}: {text}", code="bad_config", file=self.file, column=shown(key, 60)
        )

    def known(self, key: str, name: str, names: Iterable[str]) -> None:
        names = list(names)
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]}?" if close else f"expected one of {', '.join(names)}"
            raise self.fault(key, f"this key is not known; {hint}")

    def config(self, content: dict[str, Any]) -> Config:
        keys = {
            "columns": SIGNALS,
            "units": tuple(UNITS),
            "drive": ("gain",),
            "gear": ("ratio", "apply_to"),
            "motor": ("rotor_inertia",),
            "signs": SIGNED,
        }
        for table, entries in content.items():
            self.known(f"[{table}]" if isinstance(entries, dict) else table, table, keys)
            if not isinstance(entries, dict):
                raise self.fault(table, f"must be a table, written as [{table}]")
            for name in entries:
                self.known(f"[{table}] {name}", name, keys[table])
        drive, gear, motor = (content.get(table, {}) for table in ("drive", "gear", "motor"))
        return Config(
            columns={name: self.column(name, rule) for name, rule in content.get("columns", {}).items()},
            units={name: self.unit(name, unit) for name, unit in content.get("units", {}).items()},
            drive_gain=self.positive("[drive] gain", drive["gain"]) if "gain" in drive else None,
            gear_ratio=self.positive("[gear] ratio", gear["ratio"]) if "ratio" in gear else None,
            gear_apply_to=self.apply_to(gear["apply_to"]) if "apply_to" in gear else Config.gear_apply_to,
            rotor_inertia=self.at_least_zero("[motor] rotor_inertia", motor["rotor_inertia"]) if motor else None,
            gear_of_robot="apply_to" in gear and "ratio" not in gear,
            signs={name: self.sign(name, value) for name, value in content.get("signs", {}).items()},
            source=self.file,
        )

    def column(self, signal: str, rule: object) -> ColumnRule:
        key = f"[columns] {signal}"
        if rule is False:
            if signal in ("t", "q"):
                raise self.fault(key, "cannot be left out; name its column")
            return None
        if isinstance(rule, str) and rule:
            fields = self.placeholders(key, rule)
            if signal == "t" and fields:
                raise self.fault(key, "time is one column; write its name without braces")
            if signal != "t" and not fields:
                raise self.fault(key, 'one column per joint is needed; write "{i}" for the joint (from 0), or a list')
            return rule
        if isinstance(rule, list) and rule and signal != "t" and all(isinstance(n, str) and n for n in rule):
            return tuple(rule)
        expected = "a column name" if signal == "t" else 'a name with "{i}", a list of names, or false'
        raise self.fault(key, f"must be {expected}")

    def placeholders(self, key: str, template: str) -> list[str]:
        try:
            parts = list(string.Formatter().parse(template))
        except ValueError as error:
            raise self.fault(key, f"{shown_value(template)}: {shown_ends(str(error))}") from None
        fields = [name for _, name, _, _ in parts if name is not None]
        if any(
            name not in PLACEHOLDERS or spec or conversion for _, name, spec, conversion in parts if name is not None
        ):
            raise self.fault(key, f"{shown_value(template)}: only {{i}}, {{n}} and {{joint}} may stand in braces")
        return fields

    def unit(self, quantity: str, unit: object) -> str:
        if not isinstance(unit, str) or unit not in UNITS[quantity]:
            raise self.fault(
                f"[units] {quantity}", f"must be one of {', '.join(UNITS[quantity])}, got {shown_value(unit)}"
            )
        return unit

    def numbers(self, key: str, value: object) -> PerJoint:
        listed = value if isinstance(value, list) else [value]
        try:
            numbers = tuple(float(v) for v in listed if isinstance(v, int | float) and not isinstance(v, bool))
        except OverflowError:  # TOML integers have no end
            numbers = ()
        if not numbers or len(numbers) != len(listed) or not all(math.isfinite(v) for v in numbers):
            raise self.fault(key, f"must be a number or a list of numbers, one per joint, got {shown_value(value)}")
        return numbers

    def positive(self, key: str, value: object) -> PerJoint:
        numbers = self.numbers(key, value)
        if min(numbers) <= 0:
            raise self.fault(key, f"must be positive, got {min(numbers):g}; a direction belongs in [signs]")
        return numbers

    def at_least_zero(self, key: str, value: object) -> PerJoint:
        numbers = self.numbers(key, value)
        if min(numbers) < 0:
            raise self.fault(key, f"must be at least 0, got {min(numbers):g}")
        return numbers

    def sign(self, signal: str, value: object) -> PerJoint:
        numbers = self.numbers(f"[signs] {signal}", value)
        if any(abs(v) != 1.0 for v in numbers):
            raise self.fault(f"[signs] {signal}", "must be 1 or -1 for each joint")
        return numbers

    def apply_to(self, value: object) -> tuple[str, ...]:
        if not isinstance(value, list) or not value or any(name not in GEARED for name in value):
            raise self.fault("[gear] apply_to", f"must be a list of {', '.join(GEARED)}")
        return tuple(value)
