"""Reads `dynid.toml`; every fault names file and key."""

from __future__ import annotations

import difflib
import math
import string
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import file_name, shown, shown_ends, shown_value
from dynid_rs.base.toml import read_toml
from dynid_rs.runs.readers.config import GEARED, SIGNALS, UNITS, ColumnRule, Config, PerJoint
from dynid_rs.runs.readers.keys import known_keys

Rules = Config | Mapping[str, Any] | str | Path | None
"""Rules as people give them: read, as a mapping, or the path of a `dynid.toml`."""
MAPPING = "config"
"""What a mapping is called in messages, where a file has its name."""
PLACEHOLDERS = ("i", "n", "joint")
STRONGEST_GRAVITY = 100.0
"""More than this [m/s^2] is a slip of the unit or of a key; Jupiter has 25."""


def read_config(path: str | Path) -> Config:
    """Read a `dynid.toml`.

    Raises
    ------
    DataError
        Not TOML, a key that is not known, a value of the wrong kind; names file and key.
    OSError
        The file cannot be opened.
    """
    return _Parser(file_name(path)).config(read_toml(path, "bad_config"))


def as_config(rules: Rules) -> Config:
    """Rules, however they are given.

    Parameters
    ----------
    rules : Config, mapping, str, Path or None
        What `read_config` made of a file; the tables of a `dynid.toml` as a mapping; a mapping of signals to columns,
        which is its table `columns`; the path of the file; None for none.

    Raises
    ------
    DataError
        As `read_config`, the mapping being called `config`.
    OSError
        The file cannot be opened.
    """
    if rules is None or isinstance(rules, Config):
        return Config() if rules is None else rules
    if isinstance(rules, str | Path):
        return read_config(rules)
    if not isinstance(rules, Mapping):
        raise ValueError(
            "config must be the path of a dynid.toml, its tables or its columns as a mapping, or what read_config "
            f"gives; found {type(rules).__name__}"
        )
    content = {str(key): _plain(value) for key, value in rules.items()}
    if content and not any(isinstance(value, dict) for value in content.values()):
        keys = [*SIGNALS, *known_keys()]
        for key in content:
            _Parser(MAPPING).known(key, key, keys)
        content = {"columns": content}
    return _Parser(MAPPING).config(content)


def _plain(value: Any) -> Any:
    """As TOML has it: tables are dicts, and tuples and arrays lists."""
    if isinstance(value, Mapping):
        return {str(key): _plain(own) for key, own in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    return list(value) if isinstance(value, tuple) else value


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
        keys = known_keys()
        for table, entries in content.items():
            self.known(f"[{table}]" if isinstance(entries, dict) else table, table, keys)
            if not isinstance(entries, dict):
                raise self.fault(table, f"must be a table, written as [{table}]")
            for name in entries:
                self.known(f"[{table}] {name}", name, keys[table])
        drive, gear, motor, robot, file = (
            content.get(table, {}) for table in ("drive", "gear", "motor", "robot", "file")
        )
        return Config(
            columns={name: self.column(name, rule) for name, rule in content.get("columns", {}).items()},
            units={name: self.unit(name, unit) for name, unit in content.get("units", {}).items()},
            drive_gain=self.positive("[drive] gain", drive["gain"]) if "gain" in drive else None,
            gear_ratio=self.positive("[gear] ratio", gear["ratio"]) if "ratio" in gear else None,
            gear_apply_to=self.apply_to(gear["apply_to"]) if "apply_to" in gear else Config.gear_apply_to,
            rotor_inertia=self.at_least_zero("[motor] rotor_inertia", motor["rotor_inertia"]) if motor else None,
            gear_of_robot="apply_to" in gear and "ratio" not in gear,
            signs={name: self.sign(name, value) for name, value in content.get("signs", {}).items()},
            topic=self.text("[file] topic", file.get("topic")),
            sheet=self.text("[file] sheet", file.get("sheet")),
            base=self.text("[robot] base", robot.get("base")),
            tip=self.text("[robot] tip", robot.get("tip")),
            gravity=self.vector("[robot] gravity", robot["gravity"]) if "gravity" in robot else None,
            joints=self.names("[robot] joints", robot["joints"]) if "joints" in robot else None,
            source=self.file,
        )

    def text(self, key: str, value: object) -> str | None:
        if value is not None and (not isinstance(value, str) or not value):
            raise self.fault(key, f"must be a name in quotes, got {shown_value(value)}")
        return value

    def vector(self, key: str, value: object) -> PerJoint:
        numbers = self.numbers(key, value)
        if len(numbers) != 3 or math.hypot(*numbers) > STRONGEST_GRAVITY:
            raise self.fault(
                key, f"must be three numbers in m/s^2, at most {STRONGEST_GRAVITY:g}, got {shown_value(value)}"
            )
        return numbers

    def names(self, key: str, value: object) -> tuple[str, ...]:
        if not isinstance(value, list) or not value or not all(isinstance(name, str) and name for name in value):
            raise self.fault(key, f"must be a list of joint names, got {shown_value(value)}")
        return tuple(value)

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
