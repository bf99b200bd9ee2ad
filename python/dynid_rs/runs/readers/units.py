"""Units that files write beside their columns: `q_0 [deg]`, `Time (ms)`, `q_0_deg`, or a row of them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from dynid_rs.runs.readers.words import meanings, roles

_SPELLINGS: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("time", "s"): ("s", "sec", "secs", "second", "seconds", "sek"),
    ("time", "ms"): ("ms", "msec", "millisecond", "milliseconds"),
    ("time", "us"): ("us", "µs", "μs", "usec", "microsecond", "microseconds"),
    ("time", "ns"): ("ns", "nsec", "nanosecond", "nanoseconds"),
    ("time", "100ns"): ("100ns", "filetime"),
    ("time", "min"): ("min", "mins", "minute", "minutes"),
    ("time", "h"): ("h", "hr", "hrs", "hour", "hours"),
    ("angle", "rad"): ("rad", "rads", "radian", "radians"),
    ("angle", "deg"): ("deg", "degs", "°", "degree", "degrees", "grad", "grd"),
    ("angle", "mrad"): ("mrad", "milliradian", "milliradians"),
    ("angle", "rev"): ("rev", "revs", "revolution", "revolutions", "turn", "turns"),
    ("velocity", "rad/s"): ("rad/s", "rad/sec", "rad s^-1", "rad s-1", "rad s⁻¹", "radians/s"),
    ("velocity", "deg/s"): (
        "deg/s",
        "°/s",
        "deg/sec",
        "°/sec",
        "grad/s",
        "degrees/s",
        "deg s^-1",
        "deg s-1",
        "deg s⁻¹",
    ),
    ("velocity", "rpm"): ("rpm", "1/min", "u/min", "r/min", "rev/min", "min^-1", "min⁻¹"),
    ("velocity", "mrad/s"): ("mrad/s",),
    ("velocity", "rev/s"): ("rev/s", "turns/s"),
    ("length", "m"): ("m", "metre", "meter", "metres", "meters"),
    ("length", "mm"): ("mm",),
    ("length", "cm"): ("cm",),
    ("length/s", "m"): ("m/s", "m/sec"),
    ("length/s", "mm"): ("mm/s", "mm/sec"),
    ("length/s", "cm"): ("cm/s", "cm/sec"),
    ("torque", "N*m"): ("nm", "newton metre", "newton meter", "newton metres", "newton meters"),
    ("torque", "mN*m"): ("mnm",),
    ("torque", "kN*m"): ("knm",),
    ("torque", "N*cm"): ("ncm",),
    ("torque", "lbf*ft"): ("lbf ft", "ft lbf", "lb ft", "ft lb", "ft lbs", "lbs ft", "foot pound", "foot pounds"),
    ("torque", "lbf*in"): ("lbf in", "in lbf", "lb in", "in lb", "in lbs", "lbs in", "inch pound", "inch pounds"),
    ("torque", "kgf*m"): ("kgf m", "kp m"),
    ("torque", "kgf*cm"): ("kgf cm", "kp cm"),
    ("current", "A"): ("a", "amp", "amps", "ampere", "amperes", "a rms", "a eff", "a pk"),
    ("current", "mA"): ("ma",),
    ("percent", "%"): ("%", "percent", "pct"),
    ("temperature", "degC"): ("degc", "°c", "c", "celsius", "grad c"),
    ("", ""): ("", "1", "rad/s^2", "rad/s2", "deg/s^2", "deg/s2", "°/s^2", "rad/s²", "deg/s²", "°/s²", "n"),
}
_BETWEEN = re.compile(r"(?<!\^)[\s\u00b7\u22c5\u2219\u2022*._-]+")
"""What stands between the parts of a unit, or does not: `N m`, `N*m`, `N·m`, `N-m`, `Nm`. Powers keep their sign."""


def _plain(text: str) -> str:
    return _BETWEEN.sub("", text.strip().strip("[]()").lower())


_OF = {_plain(word): unit for unit, words in _SPELLINGS.items() for word in words}
_BRACKETED = re.compile(r"^(.*?)(\s*)[\[(]([^\[\]()]{1,24})[\])]$")
_LABEL = re.compile(r"[^\W\d]+[ _-]?\d+", re.ASCII)
"""What counts channels: `A1`, `Axis 3`."""
_TAILS = (
    "ms",
    "us",
    "ns",
    "100ns",
    "filetime",
    "deg",
    "rad",
    "mrad",
    "sec",
    "nm",
    "mnm",
    "ncm",
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
    return _OF.get(_plain(text))


def in_brackets(name: str) -> tuple[str, str] | None:
    """A column's name less what stands in brackets behind it, and that; None where nothing does, or a number does."""
    found = _BRACKETED.match(name)
    if found is None or not found[1] or found[3].strip("- ").isdigit():
        return None
    return found[1], found[3].strip()


def without_unit(name: str) -> tuple[str, str | None]:
    """A column's name less a unit in brackets behind it, and that unit as it stands; None where there is none."""
    found = in_brackets(name)
    return (name, None) if found is None or unit_of(found[1]) is None else found


def may_be_unit(text: str) -> bool:
    """Whether what stands in brackets may be a unit that nobody knows: no word that tells which channel it is."""
    return not meanings(text) and not roles(text) and _LABEL.fullmatch(text) is None


def stem_of(name: str) -> str:
    """What the names of one array share: `position` of `position[elbow]`; else the name less its unit."""
    found = _BRACKETED.match(name)
    return name if found is None else found[1] if not found[2] else without_unit(name)[0]


def unit_in_name(name: str) -> str | None:
    """Unit that a name ends in: `time_ms`, `q1_deg`; None where it ends in none."""
    head, _, tail = name.replace(".", "_").rpartition("_")
    return tail.lower() if head and tail.lower() in _TAILS else None


def is_row_of_units(cells: Sequence[str]) -> bool:
    """Whether every cell of a row is a unit, and at least one says something."""
    return all(unit_of(cell) is not None for cell in cells) and any((unit_of(cell) or ("",))[0] for cell in cells)
