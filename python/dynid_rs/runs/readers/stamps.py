"""Stamps of rows: ISO 8601 and times of day to whole nanoseconds; integers stay exact."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

_STAMP = re.compile(
    r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d:\d\d:\d\d)(?:[.,](\d{1,9})\d*)?\s*(Z|[+-]\d\d(?::?\d\d)?)?", re.ASCII
)
_NANO = 10**9
_FIRST_DAY = "1970-01-01"


def is_stamp(text: str) -> bool:
    """Whether a cell is a date with a time (ISO 8601), or a time of day."""
    return len(text) <= 64 and _STAMP.fullmatch(text.strip()) is not None


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
        day, clock, fraction, zone = parts.groups()
        zone = {None: "+00:00", "Z": "+00:00"}.get(zone, zone)
        try:
            moment = datetime.fromisoformat(f"{day or _FIRST_DAY}T{clock}{zone}")
        except ValueError:
            raise ValueError(row, cell) from None
        seconds = round((moment - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds())
        found.append(seconds * _NANO + int((fraction or "0").ljust(9, "0")))
    try:
        return np.array(found, dtype=np.int64)
    except OverflowError:
        raise ValueError(0, "years beyond 2262") from None
