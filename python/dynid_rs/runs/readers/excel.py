"""Runs in workbooks: Excel (.xlsx, .xlsm, .xls) and OpenDocument (.ods)."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Sequence
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs.base.errors import DataError, MissingLibraryError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown, shown_names
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.stamps import is_stamp, ticks
from dynid_rs.runs.readers.table import Columns, Table, damaged, not_of_kind, refuse_duplicates, refuse_too_large
from dynid_rs.runs.readers.units import is_row_of_units

MOST_LINES = 50
"""A header does not stand below more rows than this."""
_PER_BYTE = 8
"""Memory of a cell once read, over its bytes in the unpacked sheet, as measured with the library."""
_XLS = b"\xd0\xcf\x11\xe0"


def open_excel(path: str | Path, config: Config) -> Table:
    """Open a workbook: the named sheet, or the first that holds a header and rows of numbers.

    Raises
    ------
    DataError
        No workbook, damaged, no such sheet, no header, a cell that is no number, too large.
    MissingLibraryError
        The library is not installed.
    OSError
        The file cannot be opened.
    """
    file = file_name(path)
    place = check_readable(path)
    _check(place, file)
    try:
        import python_calamine
    except ImportError:
        raise MissingLibraryError("python_calamine", "io", f"{file}: workbooks") from None
    try:
        book = python_calamine.CalamineWorkbook.from_filelike(io.BytesIO(place.read_bytes()))
        sheets = list(book.sheet_names)
        wanted = sheets if config.sheet is None else [name for name in sheets if name == config.sheet]
        read = [(name, book.get_sheet_by_name(name).to_python(skip_empty_area=False)) for name in wanted]
    except Exception as error:  # the library's own errors, and what its parser of XML says
        raise damaged("workbook", error, file) from None
    if not read:
        raise DataError(
            f"{file}: has no sheet {shown(config.sheet or '')!r}; its sheets are {shown_names(sheets)}",
            code="no_sheet",
            file=file,
        )
    found = next(((name, rows, k) for name, rows in read if (k := _header(rows)) is not None), None)
    if found is None:
        raise DataError(
            f"{file}: no sheet has a header with column names such as t, q_0, tau_0 above rows of numbers; add one, "
            "or name the sheet in dynid.toml: [file] sheet",
            code="no_header",
            file=file,
        )
    sheet, rows, top = found
    return _table(file, sheet, rows, top, len(sheets))


def _check(place: Path, file: str) -> None:
    with place.open("rb") as stream:
        head = stream.read(64)
    if head.startswith(_XLS):
        refuse_too_large(_PER_BYTE * place.stat().st_size, file)
        return
    if not head.startswith(b"PK"):
        raise not_of_kind("a workbook (.xlsx)", head, file, "not_a_workbook")
    try:
        with zipfile.ZipFile(place) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except Exception as error:
        raise damaged("workbook", error, file) from None
    refuse_too_large(_PER_BYTE * size, file)


def _header(rows: Sequence[Sequence[Any]]) -> int | None:
    """Row of the header: text, with numbers in most cells of the row below it, or below that if it is one of units."""
    for k, row in enumerate(rows[:MOST_LINES]):
        names = [cell for cell in row if isinstance(cell, str) and cell.strip()]
        if len(names) < 2:
            continue
        below = rows[k + 2] if _has_units(rows, k) and k + 2 < len(rows) else rows[k + 1] if k + 1 < len(rows) else ()
        if sum(_is_value(cell) for cell in below) >= len(names) / 2:
            return k
    return None


def _has_units(rows: Sequence[Sequence[Any]], top: int) -> bool:
    cells = rows[top + 1] if top + 1 < len(rows) else ()
    return bool(cells) and all(isinstance(cell, str) for cell in cells) and is_row_of_units([str(c) for c in cells])


def _is_value(cell: Any) -> bool:
    return isinstance(cell, int | float | date | time | timedelta) or (isinstance(cell, str) and is_stamp(cell))


def _table(file: str, sheet: str, rows: Sequence[Sequence[Any]], top: int, n_sheets: int) -> Table:
    with_units = _has_units(rows, top)
    header = [str(cell).strip() for cell in rows[top]]
    places = {name: k for k, name in reversed(list(enumerate(header))) if name}
    names = tuple(name for name in header if name)
    refuse_duplicates(names, file)
    units = {}
    if with_units:
        units = {name: str(rows[top + 1][k]).strip("[]() ") for name, k in places.items() if rows[top + 1][k] != ""}
    first = top + 2 if with_units else top + 1
    body = list(rows[first:])
    while body and not any(cell != "" for cell in body[-1]):
        body.pop()  # formatted, empty
    stamps = frozenset(n for n, k in places.items() if body and not isinstance(body[0][k], int | float))

    def load(wanted: Sequence[str]) -> Columns:
        columns = {}
        for name in wanted:
            cells = [_number(row[places[name]], name, r, r + first + 1, file) for r, row in enumerate(body)]
            columns[name] = np.array(cells, dtype=np.int64 if name in stamps else np.float64)
        return columns

    notes = (f"read from sheet {shown(sheet)} of {n_sheets}",) if n_sheets > 1 else ()
    line_of = _Shift(first + 1)
    return Table(file, "workbook", names, len(body), load, line_of, None, units, stamps, notes)


class _Shift:
    """0-based data row to the sheet's own number of it."""

    def __init__(self, by: int) -> None:
        self.by = by

    def __call__(self, row: int) -> int:
        return row + self.by


def _since(cell: date | time | timedelta) -> timedelta:
    """Time since 1970, or since midnight; at midnight the library gives a moment as its day alone."""
    if isinstance(cell, timedelta):
        return cell
    if isinstance(cell, time):
        return datetime.combine(date.min, cell) - datetime.min
    moment = cell if isinstance(cell, datetime) else datetime.combine(cell, time.min)
    return moment.replace(tzinfo=None) - datetime(1970, 1, 1)


def _number(cell: Any, name: str, row: int, line: int, file: str) -> float | int:
    if isinstance(cell, bool):
        pass
    elif isinstance(cell, int | float) and math.isfinite(cell):
        return float(cell)
    elif isinstance(cell, date | time | timedelta):
        ticks_there = 1000 * (_since(cell) // timedelta(microseconds=1))
        if abs(ticks_there) < 2**63:
            return ticks_there
    elif isinstance(cell, str) and is_stamp(cell):
        return int(ticks([cell])[0])
    what = "the cell is empty, expected a number" if cell == "" else f"{shown(repr(cell))} is not a number"
    if isinstance(cell, date | timedelta):
        what = f"{shown(str(cell))} is no time before 2262"
    raise DataError(
        f"{file}, row {row + 1} (line {line} of the sheet), column {shown(name)}: {what}; correct the cell, or cut the "
        "row out",
        code="bad_cell",
        file=file,
        column=name,
        row=row,
    )
