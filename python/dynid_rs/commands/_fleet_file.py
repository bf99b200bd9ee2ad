"""The file of a fleet: one robot per entry, TOML or CSV.

```toml
[defaults]                    # options of `dynid identify` for all of them
residual = "none"

[[robot]]
name = "cell_3"
robot = "cell_3/robot.urdf"   # paths are relative to this file
runs = ["cell_3/*.parquet"]   # in a CSV: one cell, with ; between
test = ["cell_3/held/run.parquet"]
output = "cell_3/result"      # left out: DIR/cell_3
type = "big_arm"              # arms that are pooled; left out: those of the same kinematics
drive_gain = "20,15,6"        # any option of `dynid identify`, with _ for -
```
"""

from __future__ import annotations

import csv
import difflib
import io
import os
import re
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NoReturn

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable, with_sentence
from dynid_rs.base.quoting import file_name, shown_ends, shown_value
from dynid_rs.commands._job import Job

MOST_BYTES = 16 << 20
LISTS = ("runs", "test", "friction")
PATHS = ("robot", "output", "config", "known")
NUMBERS = ("test_from", "cutoff")
SWITCHES = ("xacro", "physical")
OWN = ("name", "output", "type")
"""Keys that are no options of an identification."""
KEYS = ("name", "type", *(field.name for field in fields(Job) if field.name != "force"))
OTHER_NAMES = {"n": "name", "id": "name", "urdf": "robot", "run": "runs"}


@dataclass(frozen=True)
class FleetRobot:
    """One entry: `name`, the folder that paths are relative to, the options as they stand in the file, and a `type`."""

    name: str
    folder: Path
    output: Path
    options: tuple[tuple[str, Any], ...]
    type: str | None = None

    def job(self, home: Path = Path()) -> Job:
        """Identification with the patterns of files written out; `home` is what the output is relative to.

        Raises
        ------
        ValueError
            An option of the wrong type, or a pattern that no file matches.
        """
        given: dict[str, Any] = {}
        for key, value in self.options:
            if key in LISTS:
                given[key] = tuple(path for pattern in self._texts(key, value) for path in self._found(key, pattern))
            elif key in PATHS:
                given[key] = self.folder / self._text(key, value)
            elif key in NUMBERS:
                given[key] = self._number(key, value)
            elif key in SWITCHES:
                given[key] = self._switch(key, value)
            else:
                given[key] = self._text(key, value)
        for key in ("robot", "runs"):
            if not given.get(key):
                raise ValueError(f"{key} is missing; every robot has a robot and runs")
        # What is done is looked up before this; what is left has changed, and is done again.
        return Job(**(given | {"output": home / self.output, "force": True}))

    def _texts(self, key: str, value: Any) -> list[str]:
        if isinstance(value, str):
            return [part.strip() for part in value.split(";") if part.strip()]
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise ValueError(f"{key} must be a path or a list of paths, found {shown_value(value)}")
        return value

    def _found(self, key: str, pattern: str) -> list[Path]:
        if not any(letter in pattern for letter in "*?[") or (self.folder / pattern).exists():
            return [self.folder / pattern]
        place = Path(pattern)
        root = Path(place.anchor) if place.is_absolute() else self.folder
        try:
            found = sorted(root.glob(str(place.relative_to(place.anchor))))
        except (ValueError, NotImplementedError):
            raise ValueError(f"{key}: {shown_value(pattern)} is not a pattern of files") from None
        if not found:
            raise ValueError(f"{key}: no file matches {shown_value(pattern)} in {root}")
        return found

    @staticmethod
    def _text(key: str, value: Any) -> str:
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError(f"{key} must be text, found {shown_value(value)}")
        return str(value)

    @staticmethod
    def _number(key: str, value: Any) -> float:
        try:
            if isinstance(value, bool):
                raise TypeError
            return float(value)
        except (TypeError, ValueError):
            raise ValueError(f"{key} must be a number, found {shown_value(value)}") from None

    @staticmethod
    def _switch(key: str, value: Any) -> bool:
        words = {"true": True, "false": False, "yes": True, "no": False}
        found = value if isinstance(value, bool) else words.get(str(value).lower())
        if found is None:
            raise ValueError(f"{key} must be true or false, found {shown_value(value)}")
        return found


def read_fleet(path: Path, output: Path) -> list[FleetRobot]:
    """Robots of a fleet; `output` holds the results of those that name no folder.

    Raises
    ------
    DataError, OSError
        The file is not what it should be: unknown keys, names that are missing or there twice.
    """
    place = check_readable(path)
    if place.suffix.lower() not in (".toml", ".csv"):
        _refuse(path, f"the suffix {place.suffix or '(none)'} is not known; expected .toml or .csv")
    if place.stat().st_size > MOST_BYTES:
        _refuse(path, f"it is larger than {MOST_BYTES} bytes; a fleet is a short table")
    try:
        text = place.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise with_sentence(error, path, "read") from None
    except UnicodeDecodeError:
        _refuse(path, "it is not UTF-8 text")
    entries = _from_toml(path, text) if place.suffix.lower() == ".toml" else _from_csv(path, text)
    if not entries:
        _refuse(path, "it names no robot; give one [[robot]], or one row of a CSV table, for each")
    robots = [_robot(path, number, entry, output) for number, entry in enumerate(entries, 1)]
    _refuse_twice(path, "name", [robot.name for robot in robots])
    _refuse_twice(path, "output", [os.path.realpath(robot.output) for robot in robots])
    return robots


def _from_toml(path: Path, text: str) -> list[dict[str, Any]]:
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        _refuse(path, f"it is not valid TOML: {shown_ends(str(error))}")
    unknown = set(content) - {"defaults", "robot"}
    if unknown:
        _refuse(
            path, f"{shown_value(sorted(unknown)[0])} is not known; expected [defaults] and one [[robot]] per robot"
        )
    defaults, entries = content.get("defaults", {}), content.get("robot", [])
    if not isinstance(defaults, dict) or not isinstance(entries, list):
        _refuse(path, "expected [defaults] and one [[robot]] per robot")
    if not all(isinstance(entry, dict) for entry in entries):
        _refuse(path, "expected one [[robot]] per robot")
    return [defaults | entry for entry in entries]


def _from_csv(path: Path, text: str) -> list[dict[str, Any]]:
    try:
        rows = list(csv.reader(io.StringIO(text), strict=True))
    except csv.Error as error:
        _refuse(path, f"it is not valid CSV: {shown_ends(str(error))}")
    rows = [[cell.strip() for cell in row] for row in rows if any(cell.strip() for cell in row)]
    if not rows:
        return []
    header, *body = rows
    if len(header) == 1 and (other := re.search(r"[;\t]", header[0])):
        found = "';'" if other[0] == ";" else "tabs"
        _refuse(path, f"its columns are parted by {found}, expected commas (';' parts several files of one cell)")
    for key in header:
        if header.count(key) > 1:
            _refuse(path, f"the column {shown_value(key)} is there twice; keep one")
    for row in body:
        if len(row) != len(header):
            _refuse(path, f"the row of {shown_value(row[0])} has {len(row)} cells and the header {len(header)}")
    return [{key: cell for key, cell in zip(header, row, strict=True) if cell} for row in body]


def _robot(path: Path, number: int, entry: dict[str, Any], output: Path) -> FleetRobot:
    for key in entry:
        if key not in KEYS:
            near = OTHER_NAMES.get(key) or next(iter(difflib.get_close_matches(key, KEYS, 1)), None)
            hint = f"; did you mean {near!r}?" if near else f"; known are {', '.join(KEYS)}"
            _refuse(path, f"robot {number}: {shown_value(key)} is not known{hint}")
    name = entry.get("name")
    if not isinstance(name, str) or not re.fullmatch(r"\w[\w.-]*", name):
        _refuse(path, f"robot {number}: name must be letters, digits, '_', '-' and '.', found {shown_value(name)}")
    place = entry.get("output")
    if place is not None and not isinstance(place, str):
        _refuse(path, f"robot {number}: output must be a path, found {shown_value(place)}")
    kind = entry.get("type")
    if kind is not None and (not isinstance(kind, str) or not kind.strip()):
        _refuse(path, f"robot {number}: type must be a word, found {shown_value(kind)}")
    folder = path.absolute().parent
    options = tuple((key, entry[key]) for key in KEYS if key in entry and key not in OWN)
    return FleetRobot(name, folder, output / name if place is None else folder / place, options, kind)


def _refuse_twice(path: Path, key: str, values: list[str]) -> None:
    for value in values:
        if values.count(value) > 1:
            _refuse(path, f"the {key} {shown_value(value)} is there twice; every robot has its own")


def _refuse(path: Path, fault: str) -> NoReturn:
    raise DataError(f"{path}: {fault}", code="bad_fleet", file=file_name(path))
