"""Recordings from files and tables: one door, `read_recording`, whatever program wrote them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from dynid_rs.base import interrupt
from dynid_rs.base.findings import Finding
from dynid_rs.runs.parts import Split
from dynid_rs.runs.readers.columns import ColumnMap
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.config_file import Rules, read_config
from dynid_rs.runs.readers.reading import (
    PartsWarning,
    Robot,
    RobotLike,
    Source,
    count_parts,
    name_of,
    open_run,
    read,
)
from dynid_rs.runs.recording import Recording

__all__ = [
    "Config",
    "PartsWarning",
    "RobotLike",
    "Run",
    "count_parts",
    "open_run",
    "read_config",
    "read_recording",
    "read_recordings",
    "read_run",
]


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
        found += [Finding("unknown_unit", "warning", text, name, column) for column, text in self.columns.unknown_units]
        if self._are_radians():
            text = (
                '[units] angle is "deg", and no joint goes beyond 6.3 of them; if they are radians, take the rule out'
            )
            found.append(Finding("units_radians", "warning", text, name, self.columns.signals["q"][0]))
        if self.split is not None:
            row, line = self.split.row, self.split.line
            rows = (row - 1, row + 1)
            split = Finding(self.split.code, "warning", self.split.text, name, self.columns.time, rows, line=line)
            found.insert(0, split)
        return found

    def _are_radians(self) -> bool:
        """Whether positions that a rule calls degrees move as radians do: far, and within a turn of them."""
        largest = max(float(np.max(np.abs(part.q))) for part in self.parts)
        farthest = max(float(np.max(np.ptp(part.q, axis=0))) for part in self.parts)
        return (
            self.rules.units.get("angle") == "deg" and largest <= np.deg2rad(2 * np.pi) and farthest > np.deg2rad(1.0)
        )

    @property
    def has_torque(self) -> bool:
        """Whether the file holds torque or current; without them the recording's torque is zero."""
        return "tau" in self.columns.signals or "current" in self.columns.signals


def read_run(
    path: Source,
    robot: Robot = None,
    config: Rules = None,
    *,
    name: str | None = None,
    require_torque: bool = True,
) -> Run:
    """Read one file with the story of its columns; see `read_recording`.

    `name` stands for the file's own in messages and recordings, where several files have the same. With
    `require_torque` off a file without torque is read too, for those who only want its motion; see `Run.has_torque`.
    """
    interrupt.check()  # long commands that show no steps read one run after another
    found = read(path, robot, config, name=name, require_torque=require_torque)
    parts = tuple(Recording(**part) for part in found.parts)
    return Run(parts, found.kind, found.columns, found.rules, found.split)


def read_recording(path: Source, robot: Robot = None, config: Rules = None) -> Recording:
    """Read one run, one row per sample.

    Text (CSV and its kin, JSON lines), Parquet, Feather, NPZ, workbooks, HDF5, MATLAB, ROS bags, LeRobot data sets and
    DIAdem traces; the documentation's page how_to/logs has the list. Some need the extra `io`. Or a table in memory.

    Parameters
    ----------
    path : str, Path or data frame
        The file; its suffix says the format. Or the folder of a ROS 2 bag or of a LeRobot data set. Or a table:
        pandas, polars, pyarrow, or anything else that gives its columns as an Arrow stream.
    robot : robot model or sequence of str, optional
        A robot with `joint_names` and `joint_kinds`, or joint names in chain order (all turning). Without it
        the joints are counted in the file.
    config : Config, path or mapping, optional
        Names, units, gears, gains and signs of the columns, as a `dynid.toml` says them: the file's path, what
        `read_config` made of it, its tables as a mapping (``{"columns": {...}, "units": {"angle": "deg"}}``), or
        only the columns (``{"q": "actual_q_{i}"}``).

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
    found = read(path, robot, config)
    text = found.warning(name_of(path))
    if text is not None:
        warnings.warn(text, PartsWarning, stacklevel=2)
    return Recording(**found.longest)


def read_recordings(path: Source, robot: Robot = None, config: Rules = None) -> list[Recording]:
    """Read one file or table as `read_recording` does; every part of it where gaps or jumps of time split it."""
    return list(read_run(path, robot, config).parts)
