"""What is wrong with a set of runs, and what has to be said of it."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bad_data.sets import Columns, RunSet

ROBOT = "robot.urdf"


@dataclass(frozen=True)
class Wanted:
    """What has to be said.

    `codes`: any of them is the right name. `files`: names of the bad files; one of them has to be named. `columns`: any
    of them (empty: the column says nothing). `rows`: the true range of rows, which the finding's has to touch; None
    where all rows are concerned. `words`: a word of the message that says the cause; empty if the code says it.
    `also`: codes that may be said as errors of the bad files too, because they follow. `everywhere`: all runs are bad,
    and it may be said of all at once.
    """

    codes: tuple[str, ...]
    files: tuple[str, ...]
    columns: tuple[str, ...] = ()
    rows: tuple[int, int] | None = None
    words: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    everywhere: bool = False


@dataclass(eq=False)
class Story:
    """A spoiled set with its words: `what` was done; `suffixes` of the files; `wanted` of the answer."""

    what: str
    spoiled: RunSet
    wanted: Wanted
    suffixes: tuple[str, ...] = ()
    texts: dict[int, dict[tuple[int, str], str]] | None = None
    """Cells that are written as they stand, by run, row and column: what no number is."""

    def write(self, folder: Path) -> list[Path]:
        """Write robot and runs, and return the runs' paths."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ROBOT).write_text(self.spoiled.robot, encoding="utf-8")
        paths = []
        for k, columns in enumerate(self.spoiled.columns):
            path = folder / name_of(k, self.suffixes)
            _write(path, columns, (self.texts or {}).get(k, {}))
            paths.append(path)
        return paths


def name_of(k: int, suffixes: tuple[str, ...] = ()) -> str:
    """File name of a run."""
    return f"run_{k}{suffixes[k] if suffixes else '.parquet'}"


def _write(path: Path, columns: Columns, texts: dict[tuple[int, str], str]) -> None:
    if path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path)
        return
    names = list(columns)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for row in range(len(columns["t"])):
            writer.writerow([texts.get((row, name), _cell(columns[name][row])) for name in names])


def _cell(value: object) -> str:
    return str(int(value)) if isinstance(value, np.integer) else repr(float(value))


def any_joint(rng: np.random.Generator, spoiled: RunSet) -> int:
    """Any joint."""
    return int(rng.integers(spoiled.n_joints))


def any_run(rng: np.random.Generator, spoiled: RunSet) -> int:
    """Any run."""
    return int(rng.integers(spoiled.n_runs))


def some_or_all(rng: np.random.Generator, spoiled: RunSet) -> tuple[int, ...]:
    """One run, or all of them, at even odds."""
    return (any_run(rng, spoiled),) if rng.random() < 0.5 else tuple(range(spoiled.n_runs))


def files_of(runs: tuple[int, ...], suffixes: tuple[str, ...] = ()) -> tuple[str, ...]:
    """File names of runs."""
    return tuple(name_of(k, suffixes) for k in runs)


def columns_of(signal: str, joints: list[int] | tuple[int, ...] | range) -> tuple[str, ...]:
    """Column names of joints."""
    return tuple(f"{signal}_{j}" for j in joints)


def inner_row(rng: np.random.Generator, n: int) -> int:
    """A row that is not near an end."""
    return int(rng.integers(int(0.1 * n), int(0.9 * n)))
