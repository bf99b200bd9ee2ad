"""Runs as JSON lines: one object per sample; lists and objects in it become columns."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.runs.cells import row_text
from dynid_rs.runs.readers.stamps import is_stamp, ticks
from dynid_rs.runs.readers.table import MAX_WIDTH, Columns, Table, Texts, refuse_duplicates
from dynid_rs.runs.readers.text_source import Text, text_of

MAX_LINE = 1 << 20
"""Bytes. A longer line is no sample."""
DEEPEST = 4
"""Objects within objects: `{"state": {"q": [..]}}` has two."""
_WHOLE = 2**63


def open_jsonlines(path: str | Path) -> Table:
    """Open JSON lines: one object per line; ``"q": [1, 2]`` gives q_0, q_1 and ``"q": {"elbow": 1}`` gives q_elbow.

    Raises
    ------
    DataError
        Not JSON, not an object, a cell that is no number, too large.
    OSError
        The file cannot be opened.
    """
    file = file_name(path)
    text = text_of(check_readable(path), file)
    first = next(_samples(text), None)
    if first is None:
        raise DataError(f"{file}: holds no line with a sample; record or copy it again", code="no_rows", file=file)
    names = tuple(first[1])
    refuse_duplicates(names, file)
    stamps = frozenset(name for name, value in first[1].items() if isinstance(value, str) and is_stamp(value))

    def load(wanted: Sequence[str]) -> Columns:
        columns: dict[str, list[Any]] = {name: [] for name in wanted}
        for row, (line, sample) in enumerate(_samples(text)):
            for name in wanted:
                columns[name].append(_value(sample, name, name in stamps, file, row, line))
        return {
            name: np.array(values, dtype=np.int64 if all(isinstance(v, int) for v in values) else np.float64)
            for name, values in columns.items()
        }

    def texts(wanted: Sequence[str]) -> Texts:
        columns: Texts = {name: [] for name in wanted}
        for _, sample in _samples(text):
            for name in wanted:
                columns[name].append(str(sample.get(name, "")))
        return columns

    def line_of(row: int) -> int:
        return next(line for k, (line, _) in enumerate(_samples(text)) if k == row)

    return Table(file, "JSON lines", names, None, load, line_of, stamps=stamps, texts=texts)


def _samples(text: Text) -> Iterator[tuple[int, dict[str, Any]]]:
    """Lines that are not blank: 1-based number, and the flat sample."""
    with text.read() as stream:
        line = 0
        while raw := stream.readline(MAX_LINE):
            line += 1
            if len(raw) >= MAX_LINE:
                raise _fault(text.file, line, f"is longer than {MAX_LINE} bytes, expected one sample per line")
            if not raw.strip():
                continue
            try:
                sample = json.loads(raw.removeprefix(b"\xef\xbb\xbf"))
            except RecursionError:
                raise _fault(text.file, line, "is nested too deep for a sample; write flat objects") from None
            except ValueError as error:  # also text that is not UTF-8, and integers of thousands of digits
                reason = shown(" ".join(str(error).split()), 100)
                raise _fault(text.file, line, f"expected one JSON object per line: {reason}") from None
            if not isinstance(sample, dict):
                raise _fault(text.file, line, "expected an object with names such as t, q_0, tau_0; write one per line")
            flat: dict[str, Any] = {}
            _flatten(flat, "", sample, text.file, line)
            yield line, flat


def _flatten(flat: dict[str, Any], prefix: str, sample: Any, file: str, line: int, depth: int = 0) -> None:
    if depth > DEEPEST or len(flat) + len(sample) > MAX_WIDTH:
        raise _fault(file, line, "is nested too deep or too wide for a sample; write flat objects")
    items = sample.items() if isinstance(sample, dict) else enumerate(sample)
    for key, value in items:
        name = f"{prefix}_{key}" if prefix else str(key)
        if isinstance(value, dict | list):
            _flatten(flat, name, value, file, line, depth + 1)
        else:
            flat[name] = value


def _value(sample: dict[str, Any], name: str, is_moment: bool, file: str, row: int, line: int) -> float | int:
    value = sample.get(name)
    if is_moment and isinstance(value, str):
        try:
            return int(ticks([value])[0])
        except ValueError:
            pass
    elif isinstance(value, float) or (type(value) is int and abs(value) < _WHOLE):
        return value
    expected = "a date with a time" if is_moment else "a number"
    place = f"{row_text(row, lambda _: line)}, column {shown(name)}"
    what = "is missing" if name not in sample else f"{shown(repr(value))} is not {expected}"
    raise DataError(
        f"{file}, {place}: {what}; correct the line, or cut it out", code="bad_cell", file=file, column=name, row=row
    )


def _fault(file: str, line: int, text: str) -> DataError:
    return DataError(f"{file}, line {line}: {text}", code="not_json", file=file)
