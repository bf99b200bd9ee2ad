"""Stamps of rows: ISO 8601, day.month.year and times of day to whole nanoseconds; integers stay exact."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

_STAMP = re.compile(
    r"(?:(?:(\d{4}-\d\d-\d\d)|(\d\d?)\.(\d\d?)\.(\d{4}))[T ]\s*)?"
    r"(\d\d:\d\d:\d\d)(?:[.,](\d{1,9})\d*)?\s*(Z|[+-]\d\d(?::?\d\d)?)?",
    re.ASCII,
)
"""Dots between day, month and year: nobody who writes them puts the month first."""
_DATE = re.compile(r"\d{1,4}([-/. ])(?:\d{1,2}|[A-Za-z]{3,9})\1\d{1,4}\b.*", re.ASCII)
_NANO = 10**9
_FIRST_DAY = "1970-01-01"


def is_stamp(text: str) -> bool:
    """Whether a cell is a date (ISO 8601, or day.month.year) with a time, or a time of day."""
    return len(text) <= 64 and _STAMP.fullmatch(text.strip()) is not None


def is_date(text: str) -> bool:
    """Whether a cell looks like a date as people write it, in whatever order."""
    return len(text) <= 64 and _DATE.fullmatch(text.strip()) is not None


def ticks(cells: Iterable[str]) -> NDArray[np.int64]:
    """Nanoseconds (n,) of stamps since 1970, or since midnight where no date stands.

    Raises
    ------
    ValueError
        A cell is no stamp; its number and text are the error's arguments.
    """
    found = []
    for row, cell in enumerate(cells):
        parts = _STAMP.fullmatch(cell.strip()) if len(cell) <= 64 else None
        if parts is None:
            raise ValueError(row, cell)
        date, day, month, year, clock, fraction, zone = parts.groups()
        if day is not None:
            date = f"{year}-{month:0>2}-{day:0>2}"
        zone = {None: "+00:00", "Z": "+00:00"}.get(zone, zone)
        try:
            moment = datetime.fromisoformat(f"{date or _FIRST_DAY}T{clock}{zone}")
        except ValueError:
            raise ValueError(row, cell) from None
        seconds = round((moment - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds())
        found.append(seconds * _NANO + int((fraction or "0").ljust(9, "0")))
    try:
        return np.array(found, dtype=np.int64)
    except OverflowError:
        raise ValueError(0, "years beyond 2262") from None
