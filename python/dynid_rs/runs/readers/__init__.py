"""Recordings from files: Parquet, CSV and NPZ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.runs.readers.columns import ColumnMap, match_columns
from dynid_rs.runs.readers.config import Config, read_config
from dynid_rs.runs.readers.convert import to_recording
from dynid_rs.runs.readers.csv import open_csv
from dynid_rs.runs.readers.joints import infer_joints
from dynid_rs.runs.readers.npz import open_npz
from dynid_rs.runs.readers.parquet import open_parquet
from dynid_rs.runs.readers.table import Table
from dynid_rs.runs.recording import Recording

__all__ = ["Config", "Run", "open_run", "read_config", "read_recording", "read_run"]

_OPENERS = {".parquet": open_parquet, ".csv": open_csv, ".npz": open_npz}
_NO_RUNS = {".urdf", ".xacro", ".toml"}


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
    """A recording and where it comes from.

    Parameters
    ----------
    recording : Recording
        The numbers, in SI.
    kind : str
        ``"Parquet"``, ``"CSV"`` or ``"NPZ"``.
    columns : ColumnMap
        Which column became which signal, and which were ignored.
    """

    recording: Recording
    kind: str
    columns: ColumnMap

    @property
    def has_torque(self) -> bool:
        """Whether the file holds torque or current; without them the recording's torque is zero."""
        return "tau" in self.columns.signals or "current" in self.columns.signals


def open_run(path: str | Path) -> Table:
    """Open a run by its suffix, without reading the numbers.

    Raises
    ------
    DataError
        Unknown suffix, or not what the suffix says.
    OSError
        The file cannot be opened.
    """
    place = Path(path)
    opener = _OPENERS.get(place.suffix.lower())
    if opener is None:
        check_readable(place)  # a path that does not exist matters more than its suffix
        robot = " (this is a robot or a config, and the robot comes before the runs)"
        hint = robot if place.suffix.lower() in _NO_RUNS else ""
        raise DataError(
            f"{place.name}: the suffix {place.suffix or '(none)'} is not known; expected a run as "
            f"{', '.join(_OPENERS)}{hint}",
            code="unknown_suffix",
            file=place.name,
        )
    return opener(place)


def read_run(
    path: str | Path,
    robot: RobotLike | Sequence[str] | None = None,
    config: Config | None = None,
    *,
    require_torque: bool = True,
) -> Run:
    """Read one run with the story of its columns; see `read_recording`.

    With `require_torque` off a file without torque is read too, for those who only want its motion;
    see `Run.has_torque`.
    """
    config = Config() if config is None else config
    table = open_run(path)
    if robot is None:
        joints = infer_joints(table.names, config, table.file)
    else:
        joints = tuple(robot.joint_names if isinstance(robot, RobotLike) else robot)
    kinds = tuple(robot.joint_kinds) if isinstance(robot, RobotLike) else ("revolute",) * len(joints)
    if not joints:
        raise ValueError("a robot has at least one joint, got no joint names")
    columns = match_columns(table.names, joints, config, table.file, require_torque=require_torque)
    config = config.with_gears(getattr(robot, "gear_ratio", None))
    recording = to_recording(table, columns, joints, kinds, config)
    return Run(recording, table.kind, columns)


def read_recording(
    path: str | Path, robot: RobotLike | Sequence[str] | None = None, config: Config | None = None
) -> Recording:
    """Read one run: Parquet, CSV or NPZ, one row per sample.

    Parameters
    ----------
    path : str or Path
        The file; its suffix says the format.
    robot : robot model or sequence of str, optional
        A robot with `joint_names` and `joint_kinds`, or joint names in chain order (all turning). Without it
        the joints are counted in the file.
    config : Config, optional
        Names, units, gears, gains and signs of the file; see `read_config`.

    Returns
    -------
    Recording
        SI, link side; `torque_unit` is ``"A"`` for currents without a drive gain.

    Raises
    ------
    DataError
        Anything about the content, with file, row, column and the mend.
    FileNotFoundError, PermissionError, IsADirectoryError, OSError
        The file cannot be opened.
    """
    return read_run(path, robot, config).recording
