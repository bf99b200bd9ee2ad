"""Runs as CSV: a fast road for clean files, and a slow one that says exactly what is wrong."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import shown
from dynid_rs.runs.cells import row_text
from dynid_rs.runs.readers.table import Columns, Table, looks_like, refuse_duplicates, refuse_too_large
from dynid_rs.runs.recording import FloatArray

MAX_LINE = 1 << 20
"""Bytes. A longer line is no row of numbers."""
MAX_NUMBER = 4096
"""Characters. A longer cell is no number: no float has more than 767 digits that count."""

_DELIMITERS = ",;\t"
_NEWLINE = re.compile(rb"\r\n|\n|\r")
_SPREADSHEET = re.compile(r"sep=.?")
# One way only to read any digits: with two, a long cell that is no number would take time by the square of its length.
_NUMBER = re.compile(
    r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE | re.ASCII
)


@dataclass(frozen=True)
class _Layout:
    file: str
    place: Path
    delimiter: str
    header: tuple[str, ...]
    body_offset: int
    lines_before_body: int

    def position(self, name: str) -> int:
        return self.header.index(name)


def open_csv(path: str | Path) -> Table:
    """Open a CSV file: one header line, one row per sample; comma, semicolon or tab between cells.

    Numbers are read to the nearest float64, so that what was written with 17 digits (or as the shortest
    decimal) comes back bit for bit. Cells of columns that nobody asks for are not looked at.

    Raises
    ------
    DataError
        Not text, no header, columns twice, a broken cell (with row, line and column), too large.
    OSError
        The file cannot be opened.
    """
    place = check_readable(path)
    file = Path(path).name
    refuse_too_large(place.stat().st_size, file)
    layout = _layout(place, file)
    names = tuple(name for name in layout.header if name)  # a comma at the end of the line names nothing
    refuse_duplicates(names, file)

    def load(wanted: Sequence[str]) -> Columns:
        fast = _load_fast(layout, wanted)
        return _load_exact(layout, wanted) if fast is None else fast

    def line_of(row: int) -> int:
        return next(line for k, (line, _) in enumerate(_rows(layout)) if k == row)

    def first_line(n_rows: int) -> int | None:
        return layout.lines_before_body + 1 if _lines(layout) == n_rows else None

    return Table(file, "CSV", names, None, load, line_of, first_line)


def _layout(place: Path, file: str) -> _Layout:
    """Find the header line and the delimiter."""
    with place.open("rb") as stream:
        head = stream.read(MAX_LINE)
        complete = len(head) < MAX_LINE
    if b"\0" in head or head.startswith((b"PAR1", b"PK\x03\x04", b"\x1f\x8b", b"\x89HDF")):
        raise _not_text(file, _nul_in_text(head) or looks_like(head))
    start, lines = (3 if head.startswith(b"\xef\xbb\xbf") else 0), 0
    comment: tuple[str, int, int] | None = None
    while True:
        newline = _NEWLINE.search(head, start)
        if newline is None and not complete:
            raise DataError(
                f"{file}, line {lines + 1}: is longer than {MAX_LINE} bytes, expected a "
                "header of column names; "
                "is this a CSV file?",
                code="long_line",
                file=file,
            )
        raw = head[start : newline.start() if newline else None]
        end = newline.end() if newline else len(head)
        try:
            text = raw.decode("utf-8").strip()
        except UnicodeDecodeError:
            raise _not_text(file, f"line {lines + 1} is not UTF-8") from None
        if text.startswith("#"):
            comment = (text.lstrip("# \t"), end, lines + 1)
        elif text or newline is None:
            break
        start, lines = end, lines + 1
        if newline is None:
            break
    header, body_offset, lines_before = text, end, lines + 1
    first = _cells(text, _sniff(text))
    if comment is not None and (not text or text.startswith("#") or _NUMBER.fullmatch(first[0])):
        header, body_offset, lines_before = comment  # numpy.savetxt writes its header as a comment
    delimiter = _sniff(header)
    if _SPREADSHEET.fullmatch(header):
        raise DataError(
            f"{file}, line {lines_before}: {header} is a spreadsheet's own note, expected a header of column names; "
            "delete the line",
            code="no_header",
            file=file,
        )
    names = _cells(header, delimiter)
    if not header or all(not name or _NUMBER.fullmatch(name) for name in names):
        raise DataError(
            f"{file}, line {lines_before}: expected a header line with column names such as t, q_0, tau_0, "
            f"found {shown(header)!r}; add one",
            code="no_header",
            file=file,
        )
    if not all(name.isprintable() for name in names):
        raise _not_text(file, "its first line has control characters")
    if len(names) == 1 and len(header.split()) > 1:
        raise DataError(
            f"{file}, line {lines_before}: the cells seem to be separated by spaces; "
            "separate them by commas, semicolons or tabs",
            code="no_delimiter",
            file=file,
        )
    return _Layout(file, place, delimiter, names, body_offset, lines_before)


def _nul_in_text(head: bytes) -> str | None:
    """Where the first NUL byte is, if what comes before it is lines of text."""
    before, nul, _ = head.partition(b"\0")
    lines = _NEWLINE.split(before)
    readable = lines[0].isascii() and lines[0].decode("ascii", "replace").isprintable()
    return f"line {len(lines)} holds a NUL byte" if nul and len(lines) > 1 and readable else None


def _lines(layout: _Layout) -> int:
    """Lines of the body, the last of which may have no end."""
    count, last = 0, b"\n"
    with layout.place.open("rb") as stream:
        stream.seek(layout.body_offset)
        while block := stream.read(MAX_LINE):
            count += block.count(b"\n")
            last = block[-1:]
    return count + (last != b"\n")


def _not_text(file: str, reason: str) -> DataError:
    return DataError(
        f"{file}: expected a CSV file (UTF-8 text), but {reason}; save it as UTF-8 CSV or give it its right suffix",
        code="not_csv",
        file=file,
    )


def _sniff(line: str) -> str:
    return max(_DELIMITERS, key=line.count)


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    try:
        return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [""]))
    except csv.Error:  # a field of more than 128 KiB: no number, but its neighbours keep their places
        return tuple(cell.strip() for cell in line.split(delimiter))


def _load_fast(layout: _Layout, wanted: Sequence[str]) -> Columns | None:
    """All columns by pyarrow; None when it stumbles: its messages lack lines and names."""
    import pyarrow as pa
    import pyarrow.csv as pv

    labels = [str(k) for k in range(len(layout.header))]
    asked = [labels[layout.position(name)] for name in wanted]
    with layout.place.open("rb") as stream:
        stream.seek(layout.body_offset)
        try:
            table = pv.read_csv(
                stream,
                read_options=pv.ReadOptions(column_names=labels, block_size=4 * MAX_LINE),
                parse_options=pv.ParseOptions(delimiter=layout.delimiter),
                convert_options=pv.ConvertOptions(
                    include_columns=asked,
                    column_types=dict.fromkeys(asked, pa.float64()),
                    null_values=[],
                    check_utf8=False,
                ),
            )
        except (pa.ArrowException, OSError, ValueError):
            return None
    return {name: table.column(label).to_numpy() for name, label in zip(wanted, asked, strict=True)}


def _rows(layout: _Layout) -> Iterator[tuple[int, str]]:
    """Lines of the body that are not blank, each with its 1-based number."""
    with layout.place.open("rb") as raw:
        raw.seek(layout.body_offset)
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
            if text.strip():
                yield line, text.rstrip("\r\n")


def _load_exact(layout: _Layout, wanted: Sequence[str]) -> Columns:
    """All columns cell by cell: the same numbers, or the first fault with its place."""
    positions = [layout.position(name) for name in wanted]
    values: list[list[float]] = []
    for row, (line, text) in enumerate(_rows(layout)):
        cells = _cells(text, layout.delimiter)
        if cells == layout.header:
            raise _fault(layout, row, line, None, "the header appears a second time; two runs in one file: split it")
        if len(cells) != len(layout.header):
            missing = "; the file may be cut off" if len(cells) < len(layout.header) else ""
            raise _fault(
                layout,
                row,
                line,
                None,
                f"has {len(cells)} cells, the header has {len(layout.header)}{missing}",
            )
        values.append([_number(layout, row, line, k, cells[k]) for k in positions])
    matrix: FloatArray = np.array(values, dtype=np.float64).reshape(len(values), len(wanted))
    return {name: np.ascontiguousarray(matrix[:, k]) for k, name in enumerate(wanted)}


def _number(layout: _Layout, row: int, line: int, position: int, cell: str) -> float:
    if len(cell) <= MAX_NUMBER and _NUMBER.fullmatch(cell):
        return float(cell)
    name = layout.header[position]
    if not cell:
        raise _fault(layout, row, line, name, "the cell is empty, expected a number; cut the row out")
    points = len(cell) <= MAX_NUMBER and _NUMBER.fullmatch(cell.replace(",", "."))
    mend = "write decimal points, not commas" if points else "correct the cell"
    raise _fault(layout, row, line, name, f"{shown(cell)!r} is not a number; {mend}")


def _fault(layout: _Layout, row: int, line: int, column: str | None, text: str) -> DataError:
    where = f", column {shown(column)}" if column else ""
    return DataError(
        f"{layout.file}, {row_text(row, lambda _: line)}{where}: {text}",
        code="bad_cell" if column else "bad_row",
        file=layout.file,
        column=column,
        row=row,
    )
