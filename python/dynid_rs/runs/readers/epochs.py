"""Clocks that the size of a stamp gives away: steps of 100 ns since year 1 (.NET), or since 1601 (Windows)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

from numpy.typing import NDArray

from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.table import Table

UNIT = "100ns"
_STEPS = 10_000_000
"""Of `UNIT` in a second."""
_ERAS = ((datetime(1, 1, 1), ".NET ticks"), (datetime(1601, 1, 1), "Windows FILETIME"))
_LOGGED = (datetime(2000, 1, 1), datetime(2100, 1, 1))
"""Logs are of these years. As ns since 1970, the only other unit with such numbers, they would be of 1974 or 1990."""


def by_size(stamps: NDArray[Any], column: str, table: Table, config: Config) -> tuple[Config, Sequence[str]]:
    """Adopt `UNIT` where nobody says the unit of time and the first stamp can be in no other.

    Parameters
    ----------
    stamps : ndarray (n,)
        Time as it stands in the file.
    column : str
        Its name.
    table : Table
        The file.
    config : Config
        What `dynid.toml`, the header or the kind of log say stands.

    Returns
    -------
    config : Config
        With the unit, where it was adopted.
    notes : sequence of str
        What was adopted, and the moment that the first stamp is.
    """
    if column in table.stamps or "time" in config.units or not len(stamps):
        return config, ()
    first = stamps[0]
    for start, name in _ERAS:
        low, high = (_STEPS * ((year - start) // timedelta(seconds=1)) for year in _LOGGED)
        if low <= first < high:
            moment = start + timedelta(microseconds=int(first) // 10)
            note = (
                f"{shown(column)} counts steps of 100 ns since {start.year:04} ({name}), by the size of its numbers: "
                f"the first is {moment.isoformat(' ', 'milliseconds')}"
            )
            return replace(config, units={**config.units, "time": UNIT}), (note,)
    return config, ()
