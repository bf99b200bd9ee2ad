"""Named arrays, as HDF5 and MATLAB files hold them, become columns: vectors, and matrices whose long side is time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.runs.readers.table import MAX_WIDTH, refuse_duplicates

TIMES = ("t", "time", "timestamp", "timestamps", "stamp", "zeit", "tout", "time_s", "time_ms", "time_us", "time_ns")


@dataclass(frozen=True)
class Place:
    """Where a column stands.

    Its `array`, its `index` along the short side (None: a vector), and whether samples lie `across`, along the second.
    """

    array: str
    index: int | None = None
    across: bool = False

    def of(self, array: NDArray[Any]) -> NDArray[Any]:
        """The column (n,) of its array, whose sides of one sample are dropped."""
        values = np.squeeze(array)
        column = values if self.index is None else values[self.index] if self.across else values[:, self.index]
        return np.atleast_1d(column)


def columns_of(shapes: Mapping[str, Sequence[int]], file: str, *, across: bool = False) -> tuple[dict[str, Place], int]:
    """Columns of arrays, and how many samples they have.

    A matrix gives one column per joint, numbered; which side is time is told by the time vector, else by what most
    arrays share. Arrays of other lengths are no signals.

    Parameters
    ----------
    shapes : mapping of str to sequence of int
        Array -> its shape.
    file : str
        Name for messages.
    across : bool
        Where both sides are as long: whether samples lie along the second.

    Raises
    ------
    DataError
        No array is a signal.
    """
    sides = {name: [side for side in shape if side != 1] or [1] for name, shape in shapes.items()}
    times = [sides[name][0] for name in shapes if _last(name) in TIMES and len(sides[name]) == 1]
    count = Counter(side for shape in sides.values() if len(shape) <= 2 for side in set(shape) if side > 1)
    n = times[0] if times else max(count, key=lambda side: (count[side], side), default=0)
    found: list[tuple[str, Place]] = []
    for name, shape in sides.items():
        if shape == [n]:
            found.append((name, Place(name)))
        elif len(shape) == 2 and n in shape and min(shape) <= MAX_WIDTH:
            second = shape[1] == n and (across or shape[0] != n)
            found += [(f"{name}_{k}", Place(name, k, second)) for k in range(shape[0] if second else shape[1])]
    if not found:
        raise DataError(
            f"{file}: holds no array with samples; save t (n), q and tau (n, n_joints)", code="empty_file", file=file
        )
    refuse_duplicates([name for name, _ in found], file)
    return dict(found), n


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Last parts of paths where they are unique, else whole paths with dots: path -> name."""
    lasts = Counter(path.rpartition("/")[2] for path in paths)
    return {
        path: last if lasts[last := path.rpartition("/")[2]] == 1 else path.strip("/").replace("/", ".")
        for path in paths
    }


def _last(name: str) -> str:
    return name.rpartition(".")[2].lower()
