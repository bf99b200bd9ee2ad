"""How a text file is laid out: where its header is, what stands between cells, how numbers are written."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.stamps import is_stamp
from dynid_rs.runs.readers.table import looks_like
from dynid_rs.runs.readers.text_source import Text
from dynid_rs.runs.readers.units import is_row_of_units

MAX_LINE = 1 << 20
"""Bytes. A longer line is no row of numbers."""
MAX_NUMBER = 4096
"""Characters. A longer cell is no number: no float has more than 767 digits that count."""
COMMENTS = ("#", "%", "//", "!")
MOST_LINES = 500
"""A header does not stand behind more lines than this."""

_NEWLINE = re.compile(rb"\r\n|\n|\r")
_SPREADSHEET = re.compile(r"sep=(.?)")
# One way only to read any digits: with two, a long cell that is no number would take time by the square of its length.
NUMBER = re.compile(
    r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE | re.ASCII
)
_DECIMAL_COMMA = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_LONG_INTEGER = re.compile(r"\d{16,19}", re.ASCII)
_BINARY = (b"PAR1", b"PK\x03\x04", b"\x1f\x8b", b"\x89HDF", b"\x28\xb5\x2f\xfd")


@dataclass(frozen=True)
class Layout:
    """Where things stand in a text.

    `delimiter`: one character, or None for any number of spaces and tabs; `decimal`: "." or ","; `header`: names by
    place; `stamps`, `integers`: columns whose first cell is a moment, or a whole number that no
    float holds; `lists`: columns whose first cell is a list of numbers.
    """

    text: Text
    delimiter: str | None
    decimal: str
    header: tuple[str, ...]
    body_offset: int
    lines_before_body: int
    units: Mapping[str, str] = field(default_factory=dict)
    stamps: frozenset[str] = frozenset()
    integers: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()
    lists: tuple[str, ...] = ()

    @property
    def file(self) -> str:
        """Name for messages."""
        return self.text.file

    def position(self, name: str) -> int:
        """Place of a column in a row."""
        return self.header.index(name)


@dataclass(frozen=True)
class _Line:
    number: int
    text: str
    end: int

    @property
    def is_comment(self) -> bool:
        return self.text.startswith(COMMENTS)

    @property
    def said(self) -> str:
        """The line without the mark of a comment: numpy.savetxt and ROS write their header as one."""
        return self.text.lstrip("#%/! \t") if self.is_comment else self.text


def find_layout(text: Text) -> Layout:
    """Find the header and the first row.

    Raises
    ------
    DataError
        Not text, or no header.
    """
    with text.read() as stream:
        head = stream.read(MAX_LINE)
    if b"\0" in head or head.startswith(_BINARY):
        raise not_text(text.file, _nul_in_text(head) or looks_like(head))
    encoding = _encoding(head, complete=len(head) < MAX_LINE)
    lines = list(_lines(head, encoding, text.file))
    given = None
    if lines and (note := _SPREADSHEET.fullmatch(lines[0].text)):
        given, lines = note[1] or None, lines[1:]
    first = next((k for k, line in enumerate(lines) if not line.is_comment and _is_row(line.text, given)), None)
    header, row, units = _header(lines, first, given, text.file)
    delimiter = _delimiter(header.said, None if row is None else row.text, given)
    names = cells_of(header.said, delimiter)
    is_row = row is not None and row.number == header.number  # rows of messages hold words too: names of joints
    if not header.said or is_row or all(not name or NUMBER.fullmatch(name) for name in names):
        raise DataError(
            f"{text.file}, line {header.number}: expected a header line with column names such as t, q_0, tau_0, "
            f"found {shown(header.said)!r}; add one",
            code="no_header",
            file=text.file,
        )
    if not all(name.isprintable() for name in names):
        raise not_text(text.file, "its first line has control characters")
    if row is not None and len(names) == 1 and len(cells_of(row.text, None)) > 1:
        raise DataError(
            f"{text.file}, line {header.number}: the cells seem to be separated by spaces, and the header has other "
            "cells than the rows; separate them by commas, semicolons or tabs",
            code="no_delimiter",
            file=text.file,
        )
    before = (units or header) if row is None else max(units or header, header, key=lambda line: line.number)
    layout = _described(text, delimiter, names, before, row, units, encoding)
    after = next((line for line in lines if line.number > before.number and not line.is_comment), before)
    cells = zip(layout.header, cells_of(after.text, delimiter), strict=False)
    return replace(layout, lists=tuple(name for name, cell in cells if name and _is_list(cell)))


def cells_of(line: str, delimiter: str | None) -> tuple[str, ...]:
    """Cells of a line, stripped."""
    if delimiter is None:
        return tuple(line.split())
    try:
        return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [""]))
    except csv.Error:  # a field of more than 128 KiB: no number, but its neighbours keep their places
        return tuple(cell.strip() for cell in line.split(delimiter))


def not_text(file: str, reason: str) -> DataError:
    """Return the error for a file that is no text."""
    return DataError(
        f"{file}: expected a CSV file (UTF-8 text), but {reason}; save it as UTF-8 CSV or give it its right suffix",
        code="not_csv",
        file=file,
    )


def _encoding(head: bytes, *, complete: bool) -> str:
    """UTF-8, else what Windows programs write: names hold an umlaut or a degree sign."""
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        if complete or error.start < len(head) - 4:
            return "cp1252"
    return "utf-8"


def _lines(head: bytes, encoding: str, file: str) -> Iterator[_Line]:
    """Lines of the beginning that are not blank."""
    start, number = (3 if head.startswith(b"\xef\xbb\xbf") else 0), 0
    complete = len(head) < MAX_LINE
    while start < len(head) and number < MOST_LINES:
        number += 1
        newline = _NEWLINE.search(head, start)
        if newline is None and not complete:
            if number > 1:
                return
            raise DataError(
                f"{file}, line {number}: is longer than {MAX_LINE} bytes, expected a header of column names; "
                "is this a CSV file?",
                code="long_line",
                file=file,
            )
        raw = head[start : newline.start() if newline else None]
        start = newline.end() if newline else len(head)
        text = raw.decode(encoding, "replace").strip()
        if text:
            yield _Line(number, text, start)


def _nul_in_text(head: bytes) -> str | None:
    """Where the first NUL byte is, if what comes before it is lines of text."""
    before, nul, _ = head.partition(b"\0")
    lines = _NEWLINE.split(before)
    readable = lines[0].isascii() and lines[0].decode("ascii", "replace").isprintable()
    return f"line {len(lines)} holds a NUL byte" if nul and len(lines) > 1 and readable else None


def _is_number(cell: str) -> bool:
    return len(cell) <= MAX_NUMBER and bool(NUMBER.fullmatch(cell) or _DECIMAL_COMMA.fullmatch(cell) or is_stamp(cell))


def _is_list(cell: str) -> bool:
    """Whether a cell is a list, tuple or vector as Python writes them."""
    if (cell[:1], cell[-1:]) not in (("[", "]"), ("(", ")")):
        return False
    numbers = cell[1:-1].replace(",", " ").split()
    return bool(numbers) and all(map(_is_number, numbers))


def _is_row(line: str, given: str | None) -> bool:
    """Whether a line is a row of numbers: the first cell is one, and half of the others."""
    for delimiter in (given,) if given else (";", "\t", ",", None):
        cells = cells_of(line, delimiter)
        if len(cells) > 1 or delimiter is None:
            return _is_number(cells[0]) and 2 * sum(map(_is_number, cells)) >= len(cells)
    return False


def _header(
    lines: Sequence[_Line], first: int | None, given: str | None, file: str
) -> tuple[_Line, _Line | None, _Line | None]:
    """Header, first row, and the row of units between them; the last two may be missing."""
    if first is None:
        header = next((line for line in lines if not line.is_comment), lines[-1] if lines else _Line(1, "", 0))
        return header, None, None
    row, before = lines[first], list(lines[:first])
    units = None
    if len(before) > 1:
        cells = cells_of(before[-1].said, _delimiter(before[-1].said, row.text, given))
        if len(cells) > 1 and is_row_of_units(cells):
            units = before.pop()
    for line in reversed(before):
        delimiter = _delimiter(line.said, row.text, given)
        names = cells_of(line.said, delimiter)
        if len(names) == len(cells_of(row.text, delimiter)) and not all(map(_is_number, names)):
            return line, row, units
    if not before:
        return _Line(row.number, row.text, row.end), row, None
    plain = [line for line in before if not line.is_comment]
    return (plain or before)[-1], row, units


def _delimiter(header: str, row: str | None, given: str | None) -> str | None:
    """What stands between cells: what gives the header and the first row equally many."""
    if given:
        return given
    best = max(";\t,", key=header.count)
    if row is None:
        return best if best in header else None if len(header.split()) > 1 and "," not in header else ","
    for delimiter in sorted(";\t,", key=header.count, reverse=True):
        n = len(cells_of(header, delimiter))
        if n > 1 and n == len(cells_of(row, delimiter)):
            return delimiter
    if best not in header and len(header.split()) == len(row.split()) > 1:
        return None
    return best if best in header else ","


def _described(
    text: Text,
    delimiter: str | None,
    names: Sequence[str],
    before: _Line,
    row: _Line | None,
    units: _Line | None,
    encoding: str,
) -> Layout:
    """Units, kinds of numbers and notes of a layout whose header is known."""
    header, told = tuple(names), {}
    if units is not None:
        below = cells_of(units.said, delimiter)
        told = {name: unit.strip("[]()") for name, unit in zip(header, below, strict=False) if unit.strip("[]()- ")}
    cells = () if row is None else cells_of(row.text, delimiter)
    decimal = "," if delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell) for cell in cells[:MAX_LINE]) else "."
    notes = []
    if encoding != "utf-8":
        notes.append("the file is not UTF-8; its names were read as Windows-1252")
    if decimal == ",":
        notes.append("numbers are written with decimal commas")
    firsts = list(zip(header, cells, strict=False))
    return Layout(
        text,
        delimiter,
        decimal,
        header,
        before.end,
        before.number,
        told,
        frozenset(name for name, cell in firsts if is_stamp(cell)),
        frozenset(name for name, cell in firsts if _LONG_INTEGER.fullmatch(cell)),
        tuple(notes),
    )
