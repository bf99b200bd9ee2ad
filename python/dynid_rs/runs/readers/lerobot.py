"""Runs in LeRobot data sets: Parquet files whose columns are named in meta/info.json, episode after episode."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.runs.readers.parquet import open_parquet
from dynid_rs.runs.readers.table import MAX_WIDTH, Columns, Table, refuse_duplicates, refuse_too_large

INFO = "meta/info.json"
MAX_INFO = 1 << 20
MOST_FILES = 10_000
_FEATURES = {
    "observation.state": "q",
    "observation.velocity": "dq",
    "observation.effort": "tau",
    "observation.torque": "tau",
    "observation.current": "current",
    "action": "q_reference",
}
"""Feature -> signal of those of its numbers whose names say no more."""
_TAILS = {
    "pos": "q",
    "position": "q",
    "vel": "dq",
    "velocity": "dq",
    "torque": "tau",
    "effort": "tau",
    "current": "current",
    "temp": "temperature",
}


def info_beside(path: Path) -> Path | None:
    """`meta/info.json` of the data set that a Parquet file or a folder belongs to; None where there is none."""
    folders = [path] if path.is_dir() else [path.parent, *path.parents[1:3]]
    return next((folder / INFO for folder in folders if (folder / INFO).is_file()), None)


def open_lerobot(path: str | Path, info: Path) -> Table:
    """Open a data set, or one file of it: every episode is a part of the run.

    Time is the number of the frame over the rate: `timestamp` is a float32.

    Raises
    ------
    DataError
        The data set is not what its meta/info.json says, or its files differ.
    OSError
        A file cannot be opened.
    """
    place, file = Path(path), file_name(path)
    content = _info(info)
    files = sorted(place.glob("data/**/*.parquet"))[:MOST_FILES] if place.is_dir() else [place]
    if not files:
        raise DataError(f"{file}: this LeRobot data set holds no data/**/*.parquet", code="no_rows", file=file)
    tables = [open_parquet(one) for one in files]
    first = tables[0]
    odd = next((one for one in tables if one.names != first.names), None)
    if odd is not None:
        raise DataError(f"{odd.file}: has other columns than {first.file}; give one of them", file=file)
    fps = content.get("fps")
    by_frame = isinstance(fps, int | float) and math.isfinite(fps) and fps > 0 and "frame_index" in first.names
    names = _names(content.get("features"), first.names)
    if by_frame:
        names["t"] = "frame_index"
        names.pop("timestamp", None)
    refuse_duplicates(tuple(names), file)
    n_rows = sum(table.n_rows or 0 for table in tables)

    def load(wanted: Sequence[str]) -> Columns:
        refuse_too_large(8 * n_rows * len(wanted), file)
        sources = list(dict.fromkeys(names[name] for name in wanted))
        loaded = [table.load(sources) for table in tables]
        columns = {name: np.concatenate([part[names[name]] for part in loaded]) for name in wanted}
        if by_frame and "t" in columns:
            assert isinstance(fps, int | float)
            columns["t"] = columns["t"] / float(fps)
        return columns

    note = f"time is frame_index over the {fps:g} frames a second of {INFO}" if by_frame else ""
    table = replace(first, file=file, kind="LeRobot", names=tuple(names), n_rows=n_rows, load=load)
    return replace(table, notes=(note,) if note else ())


def _info(place: Path) -> dict[str, Any]:
    check_readable(place)
    try:
        if place.stat().st_size > MAX_INFO:
            raise ValueError("it is too large")
        content = json.loads(place.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError("it is no object")
    except (ValueError, RecursionError) as error:
        reason = shown(" ".join(str(error).split()), 100)
        raise DataError(f"{INFO}: is not what LeRobot writes ({reason})", code="damaged", file=INFO) from None
    return content


def _names(features: Any, columns: Sequence[str]) -> dict[str, str]:
    """Name for a run -> column of the Parquet file: `observation.state_0` is `q_shoulder_pan`, say."""
    names = {column: column for column in columns}
    for feature, signal in _FEATURES.items():
        about = features.get(feature) if isinstance(features, dict) else None
        for k, joint in enumerate(_listed(about)):
            column = f"{feature}_{k}"
            head, _, tail = joint.rpartition(".")
            of = _TAILS.get(tail.lower())
            if feature == "action":
                of = "q_reference" if of in (None, "q") else None
            if column in names and (of or not head):
                del names[column]
                names[f"{of or signal}_{head if head and of else joint}"] = column
    return names


def _listed(about: Any) -> list[str]:
    """Names of a feature's numbers; some versions have them in a table."""
    names = about.get("names") if isinstance(about, Mapping) else None
    if isinstance(names, Mapping):
        names = next(iter(names.values()), None)
    if not isinstance(names, list) or len(names) > MAX_WIDTH or not all(isinstance(name, str) for name in names):
        return []
    return names
