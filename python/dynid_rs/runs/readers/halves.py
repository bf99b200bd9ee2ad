"""Stamps in two columns, whole seconds and the nanoseconds beside them, as ROS writes its time: joined to one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown
from dynid_rs.runs.cells import FloatArray, check_finite, row_text
from dynid_rs.runs.readers.table import Columns, Table
from dynid_rs.runs.readers.words import meanings

_SECONDS = re.compile(r"(.*[^0-9A-Za-z])?(sec|secs|seconds)", re.IGNORECASE)
_BESIDE = {
    "sec": ("nanosec", "nsec"),
    "secs": ("nsecs", "nanosecs"),
    "seconds": ("nanos", "nanoseconds"),
}
"""What the other half is called: ROS 2 says sec and nanosec, ROS 1 secs and nsecs, protobuf seconds and nanos."""
_NANO = 10**9
_MOST_SECONDS = 2**63 // _NANO
"""More do not fit 64 bits of nanoseconds: the year 2262."""


def join_stamps(table: Table) -> Table:
    """Return a table whose stamps in two columns are one of whole nanoseconds each.

    ``header.stamp.sec`` and ``header.stamp.nanosec`` give ``header.stamp``; where no word of time stands before,
    ``stamp`` is put for it. A column of that name that is there already is the time, and stays so.
    """
    pairs = {
        name: halves
        for name, halves in _pairs(table.names)
        if name not in table.names and not table.stamps.intersection(halves)
    }
    if not pairs:
        return table
    joined = {half: name for name, halves in pairs.items() for half in halves}
    names = tuple(dict.fromkeys(joined.get(name, name) for name in table.names))

    def load(wanted: Sequence[str]) -> Columns:
        sources = [half for name in wanted for half in pairs.get(name, (name,))]
        read = table.load(list(dict.fromkeys(sources)))
        return {name: _joined(table, pairs[name], read) if name in pairs else read[name] for name in wanted}

    notes = [f"{shown(name)} is joined of {' and '.join(map(shown, halves))}" for name, halves in pairs.items()]
    units = {name: unit for name, unit in table.units.items() if name not in joined}
    return replace(
        table,
        names=names,
        load=load,
        units=units,
        stamps=table.stamps | frozenset(pairs),
        notes=(*table.notes, *notes),
    )


def _pairs(names: Sequence[str]) -> Iterator[tuple[str, tuple[str, str]]]:
    """Name of each joined column, and its halves."""
    there = {name.lower(): name for name in names}
    for name in names:
        found = _SECONDS.fullmatch(name)
        if found is None:
            continue
        head, word = found[1] or "", found[2]
        if f"{head}microseconds".lower() in there:
            continue  # a difference of time in its parts, as pandas takes it to pieces
        beside = next(
            (there[low] for other in _BESIDE[word.lower()] if (low := f"{head}{other}".lower()) in there), None
        )
        if beside is not None:
            stem = head.rstrip("._/: ")
            yield stem if "time" in meanings(stem) else f"{head}stamp", (name, beside)


def _joined(table: Table, halves: tuple[str, str], read: Columns) -> NDArray[np.int64]:
    """Whole nanoseconds (n,) of seconds and the nanoseconds beside them."""
    seconds, rest = (_whole(table, name, read[name]) for name in halves)
    _refuse(table, halves[0], read[halves[0]], np.abs(seconds) < _MOST_SECONDS, "seconds before the year 2262")
    _refuse(table, halves[1], read[halves[1]], (rest >= 0) & (rest < _NANO), f"nanoseconds from 0 to {_NANO - 1}")
    return seconds.astype(np.int64) * _NANO + rest.astype(np.int64)


def _whole(table: Table, name: str, values: NDArray[np.generic]) -> FloatArray:
    """One half (n,) as floats, which hold whole seconds and nanoseconds exactly."""
    numbers = values.astype(np.float64)
    check_finite(numbers, file=table.file, column=name, line_of=table.line_of)
    _refuse(table, name, values, numbers == np.floor(numbers), "whole numbers")
    return numbers


def _refuse(table: Table, name: str, values: NDArray[np.generic], good: NDArray[np.bool_], expected: str) -> None:
    if good.all():
        return
    row = int(np.argmin(good))
    raise DataError(
        f"{table.file}, {row_text(row, table.line_of)}, column {shown(name)}: {values[row]:.12g} is no half of a "
        f"stamp, expected {expected}; write time as one column of seconds, and name it in dynid.toml: [columns] t",
        code="bad_stamp",
        file=table.file,
        column=name,
        row=row,
    )
