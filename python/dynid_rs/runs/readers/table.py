"""What every reader gives: the names of the columns at once, their numbers on demand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import NO_UTF_8, is_of_a_name, shown

MAX_BYTES = 4 * 2**30
"""Columns that would take more memory than this are refused before any of it is taken."""

Columns = dict[str, NDArray[Any]]
Texts = dict[str, list[str]]


@dataclass(frozen=True)
class Table:
    """An opened run file.

    Parameters
    ----------
    file : str
        Name for messages.
    kind : str
        The format, e.g. ``"Parquet"``.
    names : tuple of str
        Columns in the order of the file, each once.
    n_rows : int or None
        Number of data rows where the file says so before it is read.
    load : callable
        Reads some columns: names -> {name: (n,) array of floats or integers}. Raises `DataError`.
    line_of : callable, optional
        0-based data row -> 1-based line, for text files.
    first_line : callable, optional
        Number of rows -> line of the first one, for text files; None where lines between them are blank.
    units : mapping of str to str
        Units that the file itself gives, as they stand there: column -> unit.
    stamps : frozenset of str
        Columns that are moments, not numbers: `load` gives them as whole nanoseconds.
    notes : tuple of str
        What a person should know about how the file was read.
    texts : callable, optional
        Reads some columns as they stand there: names -> {name: one text per row}. Raises `DataError`.
    lists : tuple of str
        Columns of a text whose first cell is a list of numbers, which no text is read with.
    written : mapping of str to str
        Columns whose names are others in the file, with their units in brackets: name -> as it stands there.
    """

    file: str
    kind: str
    names: tuple[str, ...]
    n_rows: int | None
    load: Callable[[Sequence[str]], Columns]
    line_of: Callable[[int], int] | None = None
    first_line: Callable[[int], int | None] | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    stamps: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()
    texts: Callable[[Sequence[str]], Texts] | None = None
    lists: tuple[str, ...] = ()
    written: Mapping[str, str] = field(default_factory=dict)


def refuse_duplicates(names: Sequence[str], file: str) -> None:
    """Raise `DataError` when a column name stands twice: which one is meant cannot be known."""
    for name, count in Counter(names).items():
        if count > 1:
            raise DataError(
                f"{file}: column {shown(name)} appears {count} times; rename or remove all but one",
                code="duplicate_column",
                file=file,
                column=shown(name),
            )


def refuse_too_large(n_bytes: int, file: str) -> None:
    """Raise `DataError` when the declared size of the data is beyond `MAX_BYTES`."""
    if n_bytes > MAX_BYTES:
        raise DataError(
            f"{file}: declares {n_bytes / 2**30:.1f} GiB of data, more than the {MAX_BYTES / 2**30:.0f} GiB "
            "that one run may take; split the run, or write it again if the file is damaged",
            code="too_large",
            file=file,
        )


_MAGIC = (
    (b"PAR1", "Parquet"),
    (b"PK\x03\x04", "a zip archive or NPZ"),
    (b"PK\x05\x06", "an empty zip archive or NPZ"),
    (b"\x89HDF", "HDF5"),
    (b"\x93NUMPY", "a single NumPy array (.npy)"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"MATLAB 5.0", "MATLAB"),
    (b"MATLAB 7.3", "MATLAB 7.3"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive"),
    (b"ARROW1", "Feather"),
    (b"#ROSBAG", "a ROS 1 bag"),
    (b"\x89MCAP", "MCAP"),
    (b"SQLite format 3", "an SQLite database, perhaps of a ROS 2 bag"),
    (b"\xff\xfe\0\0", "UTF-32 text"),
    (b"\xff\xfe", "UTF-16 text"),
    (b"\xfe\xff", "UTF-16 text"),
)


def looks_like(head: bytes) -> str:
    """Guess from its first bytes what a file is, for the message that refuses it."""
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            return f"it looks like {kind}"
    if head and not head.strip(b"\0"):
        return "it holds only zero bytes"
    if head and b"\0" not in head and head[:64].isascii():
        return f"it starts with the text {shown(head[:24].decode('ascii'))!r}"
    return "it holds something else"


MAX_WIDTH = 1000
"""An array with more columns than this is no signal of an arm's joints."""


def damaged(kind: str, error: Exception, file: str) -> DataError:
    """Return the error for a file whose library stumbled: damage comes back as errors of many classes."""
    if is_of_a_name(error):
        return DataError(f"{file}: {NO_UTF_8}", code="bad_name", file=file)
    reason = shown(" ".join(str(error).split()) or type(error).__name__, 160)
    return DataError(
        f"{file}: this {kind} file is damaged ({reason}); copy or record it again", code="damaged", file=file
    )


def not_of_kind(kind: str, head: bytes, file: str, code: str) -> DataError:
    """Return the error for a file whose first bytes are those of another format."""
    return DataError(
        f"{file}: expected {kind}, but {looks_like(head)}; give the file the suffix of its format or write it again",
        code=code,
        file=file,
    )


def as_numbers(values: NDArray[Any], file: str, column: str) -> NDArray[Any]:
    """Return a column (n,) when it holds integers or floats.

    Raises
    ------
    DataError
        Text, flags, dates or objects.
    """
    if values.dtype.kind not in "fiu":
        raise DataError(
            f"{file}, column {shown(column)}: holds {values.dtype.name}, expected numbers; "
            "convert the column, or map another one in dynid.toml",
            code="not_numbers",
            file=file,
            column=shown(column),
        )
    return np.ascontiguousarray(values)
