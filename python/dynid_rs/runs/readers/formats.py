"""Which reader opens which file: by its suffix, or by what a folder holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name
from dynid_rs.runs.readers.bag import open_bag_file
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.csv import open_csv
from dynid_rs.runs.readers.diadem import is_diadem, open_diadem
from dynid_rs.runs.readers.excel import open_excel
from dynid_rs.runs.readers.feather import open_feather
from dynid_rs.runs.readers.hdf5 import open_hdf5
from dynid_rs.runs.readers.jsonlines import open_jsonlines
from dynid_rs.runs.readers.lerobot import MOST_FILES, info_beside, open_lerobot
from dynid_rs.runs.readers.matlab import open_matlab
from dynid_rs.runs.readers.npz import open_npz
from dynid_rs.runs.readers.parquet import open_parquet
from dynid_rs.runs.readers.table import Table
from dynid_rs.runs.readers.text_source import PACKED

_PLAIN: dict[str, Callable[[Path], Table]] = {
    ".parquet": lambda path: _open_parquet(path),
    **dict.fromkeys((".csv", ".tsv", ".txt", ".log", ".asc"), open_csv),
    ".dat": lambda path: open_diadem(path) if is_diadem(check_readable(path)) else open_csv(path),
    **dict.fromkeys((".jsonl", ".ndjson"), open_jsonlines),
    **dict.fromkeys((".feather", ".arrow", ".ipc"), open_feather),
    ".npz": open_npz,
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), open_hdf5),
    ".mat": open_matlab,
}
_BOOKS = (".xlsx", ".xlsm", ".xls", ".ods")
_BAGS = (".bag", ".db3", ".mcap")
_TEXTS = (".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".jsonl", ".ndjson")
SUFFIXES = (*_PLAIN, *_BOOKS, *_BAGS, *(f".csv{packed}" for packed in PACKED))
"""Suffixes of runs; every text may be packed."""
_NO_RUNS = {".urdf", ".xacro", ".toml"}


def suffix_of(path: Path) -> str:
    """Suffix of a run in small letters, without that of a packer."""
    last = path.suffix.lower()
    return path.with_suffix("").suffix.lower() if last in PACKED else last


def open_table(path: str | Path, joints: Sequence[str] | None, config: Config) -> Table:
    """Open a run by its suffix, without reading the numbers; `joints` and `config` choose where a file holds several.

    Raises
    ------
    DataError
        Unknown suffix, or not what the suffix says.
    MissingLibraryError
        A library of the extra `io` is not installed.
    OSError
        The file cannot be opened.
    """
    place = Path(path)
    suffix, packed = suffix_of(place), place.suffix.lower() in PACKED
    if _is_folder(place):
        if (place / "metadata.yaml").is_file():
            return open_bag_file(place, joints, config)
        if (info := info_beside(place)) is not None:
            return open_lerobot(place, info)
        check_readable(place)  # a folder that is no run
    if packed and suffix not in _TEXTS:
        suffix = ""
    if suffix in _BAGS:
        check_readable(place)
        return open_bag_file(place, joints, config)
    if suffix in _BOOKS:
        return open_excel(place, config)
    if suffix in _PLAIN:
        return _PLAIN[suffix](place)
    check_readable(place)  # a path that does not exist matters more than its suffix
    robot = " (this is a robot or a config, and the robot comes before the runs)"
    hint = robot if suffix in _NO_RUNS else ""
    raise DataError(
        f"{file_name(place)}: the suffix {place.suffix or '(none)'} is not known; expected a run as "
        f"{', '.join(SUFFIXES)}, or the folder of a ROS 2 bag or of a LeRobot data set{hint}",
        code="unknown_suffix",
        file=file_name(place),
    )


def files_of(path: Path) -> list[Path]:
    """Files that a run is read from: of a folder all of them, else the file and what lies beside it and is read too."""
    if _is_folder(path):
        return sorted(file for file in path.rglob("*") if file.is_file())[:MOST_FILES]
    beside = [info] if path.suffix.lower() == ".parquet" and (info := info_beside(path)) is not None else []
    traces = sorted(path.parent.glob("*.[rR]64")) if path.suffix.lower() == ".dat" else []
    return [path, *beside, *traces]


def _is_folder(place: Path) -> bool:
    try:
        return place.is_dir()
    except (OSError, ValueError):  # a name that is too long, a NUL byte: `check_readable` says so
        return False


def _open_parquet(path: Path) -> Table:
    check_readable(path)
    info = info_beside(path)
    return open_parquet(path) if info is None else open_lerobot(path, info)
