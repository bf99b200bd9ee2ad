"""Runs as text: a fast road for clean files, and a slow one that says exactly what is wrong."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.arrow_arrays import to_numpy
from dynid_rs.base.arrow_files import arrow_file
from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.runs.cells import row_text
from dynid_rs.runs.readers.stamps import is_date, ticks
from dynid_rs.runs.readers.table import Columns, Table, Texts, refuse_duplicates
from dynid_rs.runs.readers.text_layout import (
    COMMENTS,
    MAX_LINE,
    MAX_NUMBER,
    NUMBER,
    Layout,
    cells_of,
    find_layout,
)
from dynid_rs.runs.readers.text_source import text_of

if TYPE_CHECKING:
    from pyarrow import NativeFile

_SPACES = re.compile(rb"[ \t]+")
_ENDS = re.compile(rb"(?m)^ | ?\r?$")
_INTEGER = re.compile(r"[+-]?\d{1,18}|[+-]?[1-8]\d{18}", re.ASCII)


def open_csv(path: str | Path) -> Table:
    """Open a text file: one header line, one row per sample.

    Between cells stand commas, semicolons, tabs or spaces; numbers have a point or, where no comma separates cells, a
    comma. Lines of a preamble and comments may stand before the header, a row of units behind it. The file may be
    packed by gzip or zstd.

    Numbers are read to the nearest float64, so that what was written with 17 digits (or as the shortest
    decimal) comes back bit for bit; whole numbers of more than 15 digits and stamps (ISO 8601) as whole numbers. Cells
    of columns that nobody asks for are not looked at.

    Raises
    ------
    DataError
        Not text, no header, columns twice, a broken cell (with row, line and column), too large.
    OSError
        The file cannot be opened.
    """
    file = file_name(path)
    layout = find_layout(text_of(check_readable(path), file))
    names = tuple(name for name in layout.header if name)  # a comma at the end of the line names nothing
    refuse_duplicates(names, file)

    def load(wanted: Sequence[str]) -> Columns:
        fast = _load_fast(layout, wanted)
        return _load_exact(layout, wanted) if fast is None else fast

    def texts(wanted: Sequence[str]) -> Texts:
        columns: Texts = {name: [] for name in wanted}
        for _, _, cells in _cells(layout):
            for name in wanted:
                columns[name].append(cells[layout.position(name)])
        return columns

    def line_of(row: int) -> int:
        return next(line for k, (line, _) in enumerate(_rows(layout)) if k == row)

    def first_line(n_rows: int) -> int | None:
        return layout.lines_before_body + 1 if _lines(layout) == n_rows else None

    told = dict(layout.units), layout.stamps, layout.notes
    return Table(file, "CSV", names, None, load, line_of, first_line, *told, texts, layout.lists)


def _lines(layout: Layout) -> int:
    """Lines of the body, the last of which may have no end."""
    count, last = 0, b"\n"
    with layout.text.read(layout.body_offset) as stream:
        while block := stream.read(MAX_LINE):
            count += block.count(b"\n")
            last = block[-1:]
    return count + (last != b"\n")


def _load_fast(layout: Layout, wanted: Sequence[str]) -> Columns | None:
    """All columns by pyarrow; None when it stumbles: its messages lack lines and names."""
    import pyarrow as pa
    import pyarrow.csv as pv

    labels = [str(k) for k in range(len(layout.header))]
    asked = [labels[layout.position(name)] for name in wanted]
    types = {name: pa.string() if name in layout.stamps else pa.float64() for name in wanted}
    types |= {name: pa.int64() for name in wanted if name in layout.integers}
    try:
        with _body(layout) as stream:
            table = pv.read_csv(
                stream,
                read_options=pv.ReadOptions(column_names=labels, block_size=4 * MAX_LINE),
                parse_options=pv.ParseOptions(delimiter=layout.delimiter or " "),
                convert_options=pv.ConvertOptions(
                    include_columns=asked,
                    column_types={label: types[name] for name, label in zip(wanted, asked, strict=True)},
                    null_values=[],
                    check_utf8=False,
                    decimal_point=layout.decimal,
                ),
            )
        columns = {name: table.column(label) for name, label in zip(wanted, asked, strict=True)}
        return {
            name: ticks(column.to_pylist()) if name in layout.stamps else to_numpy(column)
            for name, column in columns.items()
        }
    except DataError:
        raise
    except (pa.ArrowException, OSError, ValueError):
        return None


def _body(layout: Layout) -> NativeFile:
    """The text of the cells as a file of pyarrow's own.

    It is read ahead by a thread, which would ask a file of Python's for more while the interpreter ends, and abort it.
    """
    import pyarrow as pa

    text = layout.text
    if layout.delimiter and text.packer is None and text.encoding is None:
        file = arrow_file(text.place)
        file.seek(layout.body_offset)
        return file
    with text.read(layout.body_offset) as stream:
        found = stream.read()
    return pa.BufferReader(found if layout.delimiter else _single_spaces(found))


def _single_spaces(text: bytes) -> bytes:
    """Columns that were aligned by spaces, with one space between cells."""
    return _ENDS.sub(b"", _SPACES.sub(b" ", text))


def _rows(layout: Layout) -> Iterator[tuple[int, str]]:
    """Lines of the body that are neither blank nor comments, each with its 1-based number."""
    with layout.text.read(layout.body_offset) as raw:
        stream = io.TextIOWrapper(raw, encoding="utf-8", errors="replace")
        line = layout.lines_before_body
        while text := stream.readline(MAX_LINE):
            line += 1
            if len(text) >= MAX_LINE:
                raise DataError(
                    f"{layout.file}, line {line}: is longer than {MAX_LINE} characters; is this a CSV file?",
                    code="long_line",
                    file=layout.file,
                )
            if text.strip() and not text.lstrip().startswith(COMMENTS):
                yield line, text.rstrip("\r\n")


def _load_exact(layout: Layout, wanted: Sequence[str]) -> Columns:
    """All columns cell by cell: the same numbers, or the first fault with its place."""
    positions = [layout.position(name) for name in wanted]
    columns: dict[str, list[Any]] = {name: [] for name in wanted}
    for row, line, cells in _cells(layout):
        for name, k in zip(wanted, positions, strict=True):
            columns[name].append(_value(layout, row, line, k, cells[k]))
    return {name: _array(values) for name, values in columns.items()}


def _cells(layout: Layout) -> Iterator[tuple[int, int, Sequence[str]]]:
    """Rows of the body, each with its 0-based number and its 1-based line; as many cells as the header has."""
    names = list(layout.header)
    for row, (line, text) in enumerate(_rows(layout)):
        cells = cells_of(text, layout.delimiter)
        if len(cells) == len(names) + 1 and not cells[-1]:
            cells = cells[:-1]  # every row ends in a delimiter
        if list(cells) == names:
            raise _fault(layout, row, line, None, "the header appears a second time; two runs in one file: split it")
        if len(cells) != len(names):
            raise _fault(layout, row, line, None, _miscounted(layout, cells))
        yield row, line, cells


def _array(values: list[Any]) -> NDArray[Any]:
    whole = bool(values) and all(isinstance(value, int) for value in values)
    return np.array(values, dtype=np.int64 if whole else np.float64)


def _miscounted(layout: Layout, cells: Sequence[str]) -> str:
    missing = "; the file may be cut off here: take the row out" if len(cells) < len(layout.header) else ""
    if layout.delimiter == "," and len(cells) > len(layout.header):
        missing = "; are these decimal commas? Write points, or separate cells by semicolons"
    return f"has {len(cells)} cells, the header has {len(layout.header)}{missing}"


def _value(layout: Layout, row: int, line: int, position: int, cell: str) -> float | int:
    name = layout.header[position]
    if name in layout.stamps:
        try:
            return int(ticks([cell])[0])
        except ValueError:
            text = f"{shown(cell)!r} is no date with a time like those before; correct the cell"
            raise _fault(layout, row, line, name, text) from None
    if name in layout.integers and _INTEGER.fullmatch(cell):
        return int(cell)
    number = cell.replace(",", ".") if layout.decimal == "," else cell
    if len(number) <= MAX_NUMBER and NUMBER.fullmatch(number):
        return float(number)
    if not cell:
        raise _fault(layout, row, line, name, "the cell is empty, expected a number; cut the row out")
    points = len(cell) <= MAX_NUMBER and NUMBER.fullmatch(cell.replace(",", "."))
    mend = "write decimal points, not commas" if points else "correct the cell"
    if is_date(cell):
        text = (
            f"{shown(cell)!r} is a date whose order of day and month is not certain, or that has no time; write "
            "2024-05-01T12:00:00.010 (ISO 8601) or 01.05.2024 12:00:00.010 (day first), or seconds as a number"
        )
        raise _fault(layout, row, line, name, text)
    raise _fault(layout, row, line, name, f"{shown(cell)!r} is not a number; {mend}")


def _fault(layout: Layout, row: int, line: int, column: str | None, text: str) -> DataError:
    where = f", column {shown(column)}" if column else ""
    return DataError(
        f"{layout.file}, {row_text(row, lambda _: line)}{where}: {text}",
        code="bad_cell" if column else "bad_row",
        file=layout.file,
        column=column,
        row=row,
    )
