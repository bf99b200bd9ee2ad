"""From a file, or a table in memory, to the arguments of recordings, with the story of its columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import file_name
from dynid_rs.runs.parts import Split, find_parts
from dynid_rs.runs.readers.columns import ColumnMap, match_columns
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.config_file import Rules, as_config
from dynid_rs.runs.readers.convert import seconds, to_parts
from dynid_rs.runs.readers.dialects import speak
from dynid_rs.runs.readers.epochs import by_size
from dynid_rs.runs.readers.formats import open_table
from dynid_rs.runs.readers.frame import is_frame, open_frame
from dynid_rs.runs.readers.halves import join_stamps
from dynid_rs.runs.readers.headers import by_plain_names, plain_names
from dynid_rs.runs.readers.joints import infer_joints
from dynid_rs.runs.readers.list_cells import lists_explained
from dynid_rs.runs.readers.messages import by_joint
from dynid_rs.runs.readers.table import Table
from dynid_rs.runs.readers.told import adopt_units


class PartsWarning(UserWarning):
    """A run falls into parts, of which one was given."""


@runtime_checkable
class RobotLike(Protocol):
    """The part of a robot model that a reader needs; its `gear_ratio`, if it has one, is read too."""

    @property
    def joint_names(self) -> Sequence[str]:
        """Names in chain order."""

    @property
    def joint_kinds(self) -> Sequence[str]:
        """``"revolute"`` or ``"prismatic"`` per joint."""


Source = Any
"""A path (str or Path), or a data frame."""
Robot = RobotLike | Sequence[str] | None


@dataclass(frozen=True, eq=False)
class Read:
    """What a source holds: arguments of `Recording`, part by part, and the story of its columns.

    `rows`: half-open rows of every part; `n_rows` of the whole source.
    """

    parts: tuple[dict[str, Any], ...]
    rows: tuple[tuple[int, int], ...]
    kind: str
    columns: ColumnMap
    rules: Config
    n_rows: int
    split: Split | None = None

    @property
    def longest(self) -> dict[str, Any]:
        """Arguments of the longest part."""
        return max(self.parts, key=lambda part: len(part["t"]))

    def warning(self, name: str) -> str | None:
        """What to say where only the longest part is given; None where there is one part and nothing was lost."""
        if self.split is None:
            return None
        text = f"{name}: {self.split.text}"
        if len(self.parts) > 1:
            text += f"; this is {self.longest['name']}, the longest, and read_recordings gives all"
        return text


@dataclass(frozen=True)
class _Opened:
    """A source with the rules that hold for it."""

    table: Table
    config: Config
    joints: tuple[str, ...]
    kinds: tuple[str, ...]
    notes: tuple[str, ...]


def name_of(source: Source) -> str:
    """How messages call a source."""
    return "data frame" if is_frame(source) else file_name(source)


def open_run(
    path: str | Path, joints: Sequence[str] | None = None, config: Config | None = None, *, name: str | None = None
) -> Table:
    """Open a run by its suffix, without reading the numbers; `name` stands for the file's in messages.

    Raises
    ------
    DataError
        Unknown suffix, or not what the suffix says.
    MissingLibraryError
        A library of the extra `io` is not installed.
    OSError
        The file cannot be opened.
    """
    with _called(path, name):
        table = open_table(path, joints, Config() if config is None else config)
        return _arranged(table if name is None else replace(table, file=name))


def _arranged(table: Table) -> Table:
    return join_stamps(by_joint(plain_names(table)))


@contextmanager
def _called(source: Source, name: str | None) -> Iterator[None]:
    """Let errors about the content of a file say `name` in the place of its own, which another run may have too."""
    try:
        yield
    except DataError as error:
        own = name_of(source)
        if name is None or error.file != own:
            raise
        text = str(error)
        said = name + text.removeprefix(own) if text.startswith(own) else text
        raise DataError(said, code=error.code, file=name, column=error.column, row=error.row) from None


def read(
    source: Source, robot: Robot = None, config: Rules = None, *, name: str | None = None, require_torque: bool = True
) -> Read:
    """Read a file or a data frame; `readers.read_recording` says what is taken and what is refused.

    `name` stands for the source's own in messages and recordings. Without torque, where that is allowed, it is zero.
    """
    if is_frame(source):
        try:
            return _read(source, robot, config, name, require_torque)
        except DataError as error:
            raise in_python(error) from None
    with _called(source, name):
        return _read(source, robot, config, name, require_torque)


def in_python(error: DataError) -> DataError:
    """Return an error of a data frame, whose owner may have no `dynid.toml`, with how Python says the mend."""
    text = str(error)
    if "in dynid.toml" not in text:
        return error
    mend = 'a mapping says the same: config={"q": "actual_q_{i}", ...}'
    return DataError(f"{text}; {mend}", code=error.code, file=error.file, column=error.column, row=error.row)


def _read(source: Source, robot: Robot, config: Rules, name: str | None, require_torque: bool) -> Read:
    opened = _open(source, robot, config, name)
    table, joints = opened.table, opened.joints
    with lists_explained(table, joints):
        columns = match_columns(table, joints, opened.config, require_torque=require_torque)
    told = adopt_units(columns, table, opened.config, joints)
    rules = told.config.with_gears(getattr(robot, "gear_ratio", None))
    loaded = table.load(told.columns.used())
    rules, sized = by_size(loaded[told.columns.time], told.columns.time, table, rules)
    converted = to_parts(table, loaded, told.columns, joints, opened.kinds, rules)
    story = told.columns.with_notes(*opened.notes, *told.notes, *sized)
    return Read(converted.parts, converted.rows, table.kind, story, rules, converted.n_rows, converted.split)


def count_parts(source: Source, robot: Robot = None, config: Rules = None) -> int:
    """How many recordings a source gives; 1 where it cannot be read: reading it says why.

    Its time says whether they are several; which of them hold motion, only its positions.
    """
    try:
        opened = _open(source, robot, config)
        columns = match_columns(opened.table, opened.joints, opened.config, require_torque=False)
        told = adopt_units(columns, opened.table, opened.config, opened.joints)
        stamps = opened.table.load([columns.time])[columns.time]
        rules, _ = by_size(stamps, columns.time, opened.table, told.config)
        parts = find_parts(seconds(stamps, opened.table, columns.time, rules))
        return 1 if len(parts.rows) == 1 else len(_read(source, robot, config, None, require_torque=False).parts)
    except (ValueError, OSError):
        return 1


def _open(source: Source, robot: Robot, config: Rules, name: str | None = None) -> _Opened:
    rules = as_config(config)
    if isinstance(robot, str | PathLike):
        raise ValueError(
            f"robot must be a RobotModel or the names of its joints, got {str(robot)!r}; read a file with read_robot"
        )
    names = None if robot is None else tuple(robot.joint_names if isinstance(robot, RobotLike) else robot)
    if names is not None and not names:
        raise ValueError("a robot has at least one joint, got no joint names")
    _check_joints(names, rules)
    if is_frame(source):
        table = _arranged(open_frame(source, name or name_of(source)))
    else:
        table = open_run(source, names, rules, name=name)
    rules, notes = speak(table.names, by_plain_names(rules, table.written), table.file, table.stamps)
    with lists_explained(table):
        joints = infer_joints(table, rules) if names is None else names
    kinds = tuple(robot.joint_kinds) if isinstance(robot, RobotLike) else ("revolute",) * len(joints)
    return _Opened(table, rules, joints, kinds, (*table.notes, *notes))


def _check_joints(names: tuple[str, ...] | None, config: Config) -> None:
    if names is not None and config.joints is not None and names != config.joints:
        raise DataError(
            f"{config.source}, [robot] joints: was written for {', '.join(config.joints)}, and the robot has "
            f"{', '.join(names)}; give the robot it was written for, or write it again with dynid init",
            code="bad_config",
            file=config.source,
            column="[robot] joints",
        )
