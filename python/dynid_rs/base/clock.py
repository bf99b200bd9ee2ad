"""Times of a wall clock, and times since something began."""

from __future__ import annotations

from datetime import UTC, datetime

_FIRST, _LAST = 946_684_800.0, 4_102_444_800.0
"""Years 2000 to 2100 in Unix time: runs are of these, and no controller has been running for thirty years."""


def is_wall_clock(t: float) -> bool:
    """Whether a run's time [s] is Unix time."""
    return _FIRST <= t < _LAST


def time_words(t: float) -> str:
    """`2026-03-01 14:30:05 UTC` of a wall clock, `13.6 s` of any other."""
    if not is_wall_clock(t):
        return f"{t:.1f} s"
    return f"{datetime.fromtimestamp(t, UTC):%Y-%m-%d %H:%M:%S} UTC"
