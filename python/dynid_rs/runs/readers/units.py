"""Units that files write beside their columns: `q_0 [deg]`, `Time (ms)`, `q_0_deg`, or a row of them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

_SPELLINGS: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("time", "s"): ("s", "sec", "secs", "second", "seconds", "sek"),
    ("time", "ms"): ("ms", "msec", "millisecond", "milliseconds"),
    ("time", "us"): ("us", "µs", "μs", "usec", "microsecond", "microseconds"),
    ("time", "ns"): ("ns", "nsec", "nanosecond", "nanoseconds"),
    ("time", "100ns"): ("100ns", "100 ns", "filetime"),
    ("angle", "rad"): ("rad", "radian", "radians"),
    ("angle", "deg"): ("deg", "°", "degree", "degrees", "grad", "grd"),
    ("velocity", "rad/s"): ("rad/s", "rad/sec", "rad s^-1"),
    ("velocity", "deg/s"): ("deg/s", "°/s", "deg/sec", "grad/s", "degrees/s"),
    ("velocity", "rpm"): ("rpm", "1/min", "u/min", "r/min", "min^-1"),
    ("length", "m"): ("m",),
    ("length", "mm"): ("mm",),
    ("torque", "N*m"): ("nm", "n*m", "n m", "n·m", "n.m", "newton metre", "newton meter"),
    ("torque", "mN*m"): ("mnm", "mn*m", "mn m", "mn·m"),
    ("torque", "kN*m"): ("knm", "kn*m", "kn m", "kn·m"),
    ("current", "A"): ("a", "amp", "amps", "ampere", "amperes", "arms", "a rms"),
    ("current", "mA"): ("ma",),
    ("percent", "%"): ("%", "percent", "pct"),
    ("temperature", "degC"): ("degc", "°c", "c", "celsius", "grad c"),
    ("", ""): ("", "-", "1", "[]", "rad/s^2", "rad/s2", "deg/s^2", "deg/s2", "°/s^2", "rad/s²", "deg/s²", "°/s²", "n"),
}
_OF = {word: unit for unit, words in _SPELLINGS.items() for word in words}
_BRACKETED = re.compile(r"^(.*?)\s*[\[(]([^\[\]()]{1,24})[\])]$")
_TAILS = (
    "ms",
    "us",
    "ns",
    "100ns",
    "filetime",
    "deg",
    "rad",
    "sec",
    "nm",
    "mnm",
    "rpm",
    "ma",
    "degc",
    "amps",
    "percent",
    "pct",
)
"""Units that names end in, after an underscore; ``_s`` and ``_a`` are too short to be sure of."""


def unit_of(text: str) -> tuple[str, str] | None:
    """Quantity and unit, as `dynid.toml` spells it, that a file's words mean; None for words that are no unit."""
    return _OF.get(text.strip().strip("[]()").strip().lower())


def without_unit(name: str) -> tuple[str, str | None]:
    """A column's name less a unit in brackets behind it, and that unit as it stands; None where there is none."""
    found = _BRACKETED.match(name)
    if found is None or not found[1] or unit_of(found[2]) is None or found[2].strip().isdigit():
        return name, None
    return found[1], found[2]


def unit_in_name(name: str) -> str | None:
    """Unit that a name ends in: `time_ms`, `q1_deg`; None where it ends in none."""
    head, _, tail = name.replace(".", "_").rpartition("_")
    return tail.lower() if head and tail.lower() in _TAILS else None


def is_row_of_units(cells: Sequence[str]) -> bool:
    """Whether every cell of a row is a unit, and at least one says something."""
    return all(unit_of(cell) is not None for cell in cells) and any((unit_of(cell) or ("",))[0] for cell in cells)
