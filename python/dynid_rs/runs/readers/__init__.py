"""Recordings from files: one door, `read_recording`, whatever program wrote them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.runs.parts import Split, find_parts
from dynid_rs.runs.readers.columns import ColumnMap, match_columns
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.config_file import read_config
from dynid_rs.runs.readers.convert import seconds, to_recordings
from dynid_rs.runs.readers.dialects import speak
from dynid_rs.runs.readers.formats import open_table
from dynid_rs.runs.readers.joints import infer_joints
from dynid_rs.runs.readers.table import Table
from dynid_rs.runs.readers.told import adopt_units
from dynid_rs.runs.recording import Recording

__all__ = [
    "Config",
    "PartsWarning",
    "Run",
    "count_parts",
    "open_run",
    "read_config",
    "read_recording",
    "read_recordings",
    "read_run",
]


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


@dataclass(frozen=True, eq=False)
class Run:
    """What a file holds and where it comes from.

    Parameters
    ----------
    parts : tuple of Recording
        The numbers, in SI: one recording, or one per part where time breaks.
    kind : str
        The format, e.g. ``"Parquet"``.
    columns : ColumnMap
        Which column became which signal, and which were ignored.
    rules : Config
        Rules that were followed: those given, and those that the file brings itself.
    split : Split, optional
        Where and why the run falls into parts.
    """

    parts: tuple[Recording, ...]
    kind: str
    columns: ColumnMap
    rules: Config
    split: Split | None = None

    @property
    def recording(self) -> Recording:
        """The run; of several parts the longest."""
        return max(self.parts, key=lambda part: part.n_samples)

    def findings(self, name: str | None = None) -> list[Finding]:
        """What is to be said of how the file was read; `name` stands for its own in messages."""
        name = self.recording.name if name is None else name
        found = [Finding("read_as", "info", note, name) for note in self.columns.notes]
        if self.split is not None:
            row, line = self.split.row, self.split.line
            split = Finding(self.split.code, "warning", self.split.text, name, "t", (row - 1, row + 1), line=line)
            found.insert(0, split)
        return found

    @property
    def has_torque(self) -> bool:
        """Whether the file holds torque or current; without them the recording's torque is zero."""
        return "tau" in self.columns.signals or "current" in self.columns.signals


@dataclass(frozen=True)
class _Opened:
    """A file with the rules that hold for it."""

    table: Table
    config: Config
    joints: tuple[str, ...]
    kinds: tuple[str, ...]
    notes: tuple[str, ...]


def open_run(path: str | Path, joints: Sequence[str] | None = None, config: Config | None = None) -> Table:
    """Open a run by its suffix, without reading the numbers.

    Raises
    ------
    DataError
        Unknown suffix, or not what the suffix says.
    MissingLibraryError
        A library of the extra `io` is not installed.
    OSError
        The file cannot be opened.
    """
    return open_table(path, joints, Config() if config is None else config)


def read_run(
    path: str | Path,
    robot: RobotLike | Sequence[str] | None = None,
    config: Config | None = None,
    *,
    require_torque: bool = True,
) -> Run:
    """Read one file with the story of its columns; see `read_recording`.

    With `require_torque` off a file without torque is read too, for those who only want its motion;
    see `Run.has_torque`.
    """
    opened = _open(path, robot, config)
    table, joints = opened.table, opened.joints
    columns = match_columns(table.names, joints, opened.config, table.file, require_torque=require_torque)
    told = adopt_units(columns, table.units, opened.config, table.file)
    rules = told.config.with_gears(getattr(robot, "gear_ratio", None))
    converted = to_recordings(table, told.columns, joints, opened.kinds, rules)
    return Run(
        converted.recordings,
        table.kind,
        told.columns.with_notes(*opened.notes, *told.notes),
        rules,
        converted.split,
    )


def _open(path: str | Path, robot: RobotLike | Sequence[str] | None, config: Config | None) -> _Opened:
    config = Config() if config is None else config
    names = None if robot is None else tuple(robot.joint_names if isinstance(robot, RobotLike) else robot)
    if names is not None and not names:
        raise ValueError("a robot has at least one joint, got no joint names")
    _check_joints(names, config)
    table = open_run(path, names, config)
    config, notes = speak(table.names, config, table.file)
    joints = infer_joints(table.names, config, table.file) if names is None else names
    kinds = tuple(robot.joint_kinds) if isinstance(robot, RobotLike) else ("revolute",) * len(joints)
    return _Opened(table, config, joints, kinds, (*table.notes, *notes))


def _check_joints(names: tuple[str, ...] | None, config: Config) -> None:
    if names is not None and config.joints is not None and names != config.joints:
        raise DataError(
            f"{config.source}, [robot] joints: was written for {', '.join(config.joints)}, and the robot has "
            f"{', '.join(names)}; give the robot it was written for, or write it again with dynid init",
            code="bad_config",
            file=config.source,
            column="[robot] joints",
        )


def count_parts(path: str | Path, robot: RobotLike | Sequence[str] | None = None, config: Config | None = None) -> int:
    """How many recordings a file gives, from its time alone; 1 where that cannot be read: reading it says why."""
    try:
        opened = _open(path, robot, config)
        columns = match_columns(opened.table.names, opened.joints, opened.config, "", require_torque=False)
        told = adopt_units(columns, opened.table.units, opened.config, "")
        t = seconds(opened.table.load([columns.time])[columns.time], opened.table, columns.time, told.config)
        return len(find_parts(t).rows)
    except (ValueError, OSError):
        return 1


def read_recording(
    path: str | Path, robot: RobotLike | Sequence[str] | None = None, config: Config | None = None
) -> Recording:
    """Read one run, one row per sample.

    Text (CSV and its kin, JSON lines), Parquet, Feather, NPZ, workbooks, HDF5, MATLAB, ROS bags, LeRobot data sets and
    DIAdem traces; docs/how_to/logs.md has the list. Some need the extra `io`.

    Parameters
    ----------
    path : str or Path
        The file; its suffix says the format. Or the folder of a ROS 2 bag or of a LeRobot data set.
    robot : robot model or sequence of str, optional
        A robot with `joint_names` and `joint_kinds`, or joint names in chain order (all turning). Without it
        the joints are counted in the file.
    config : Config, optional
        Names, units, gears, gains and signs of the file; see `read_config`.

    Returns
    -------
    Recording
        SI, link side; `torque_unit` is ``"A"`` for currents without a drive gain. Where a gap or a jump of time splits
        the run, the longest part; a `PartsWarning` says so, and `read_recordings` gives all.

    Raises
    ------
    DataError
        Anything about the content, with file, row, column and the mend.
    MissingLibraryError
        A library of the extra `io` is not installed.
    FileNotFoundError, PermissionError, IsADirectoryError, OSError
        The file cannot be opened.
    """
    run = read_run(path, robot, config)
    if run.split is not None:
        text = f"{Path(path).name}: {run.split.text}"
        if len(run.parts) > 1:
            text += f"; this is {run.recording.name}, the longest, and read_recordings gives all"
        warnings.warn(text, PartsWarning, stacklevel=2)
    return run.recording


def read_recordings(
    path: str | Path, robot: RobotLike | Sequence[str] | None = None, config: Config | None = None
) -> list[Recording]:
    """Read one file as `read_recording` does; every part of it where gaps or jumps of time split it."""
    return list(read_run(path, robot, config).parts)
