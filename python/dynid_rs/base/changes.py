"""Changes of a model that is watched, in words: what has changed, by how much, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence

from dynid_rs.base.numbers import interval, percent, percent_interval, significant

KIND_WORDS = {"offset": "constant torque"}
"""Kinds as people say them, where that is not how they are called in files."""
RELATIVE = ("friction", "gain", "unknown")
"""Kinds whose size is relative; the others have a unit."""
WITHDRAWN = "Nothing: it has passed, or is no larger than what is tolerated."
"""What to do about a change that was withdrawn."""

_REFIT = "f it is to stay so, identify friction anew."
_CHANNEL = "look at the drive, its torque constant and the current sensor; after an exchange identify anew."
_GROWN = {
    "friction": f"Look at lubrication, wear and the temperature of this joint; i{_REFIT}",
    "gain": f"The channel shows more than before: {_CHANNEL}",
    "offset": "Set the sensor's zero again; if it stays, look for a spring, a balancer or a cable that pulls.",
    "load": "Weigh it: `dynid payload MODEL.json RUN`; take it off, or tell the controller.",
    "unknown": "Look for a collision, a loose part or a sensor at fault; `dynid diagnose ROBOT RUN... "
    "--reference MODEL.json` looks for a name.",
}
_FALLEN = {
    "friction": f"Has the joint warmed up, run in or been lubricated? I{_REFIT}",
    "gain": f"The channel shows less than before: {_CHANNEL}",
    "load": "Something is missing at the last link: mount it again, or weigh it, `dynid payload MODEL.json RUN`.",
}


def kind_words(kind: str) -> str:
    """``"offset"`` as people say it, `constant torque`."""
    return KIND_WORDS.get(kind, kind)


def size_words(kind: str, size: float, unit: str) -> str:
    """`+21 %`, `0.244 kg`."""
    if kind in RELATIVE:
        return percent(size, signed=True)
    return f"{significant(size)} {unit}".rstrip()


def interval_words(kind: str, bounds: Sequence[float]) -> str:
    """`+19 to +22 %`, `0.243 to 0.246`."""
    return percent_interval(bounds) if kind in RELATIVE else interval(bounds)


def advice(kind: str, size: float) -> str:
    """One sentence: what to do about a change of this kind, grown or fallen; commands stand between backticks.

    Raises
    ------
    KeyError
        There is no such kind.
    """
    return _GROWN[kind] if size > 0 else _FALLEN.get(kind, _GROWN[kind])
