"""Changes of a model that is watched, in words: what has changed, by how much, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dynid_rs.base.numbers import interval, percent, percent_interval, significant

FROZEN = "frozen"
"""A torque channel that shows the same value all the time: nothing of the model has changed, nothing is taken off."""
KIND_WORDS = {"offset": "constant torque", "slip": "encoder slip", FROZEN: "frozen channel"}
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
    "delay": "The torque comes later than the positions: look at filters, firmware and the bus of this channel.",
    "slip": "The position that is shown is off: look at the encoder's coupling and its cable, and calibrate its zero.",
    FROZEN: "Look at the torque sensor, its cable and its drive: the channel shows one value all the time. Until it "
    "changes again nothing else is said of this joint.",
    "unknown": "Look for a collision, a loose part or a sensor at fault; `dynid diagnose ROBOT RUN... "
    "--reference MODEL.json` looks for a name.",
}
_FALLEN = {
    "friction": f"Has the joint warmed up, run in or been lubricated? I{_REFIT}",
    "gain": f"The channel shows less than before: {_CHANNEL}",
    "delay": "The positions come later than they did: look at filters, firmware and the bus of this joint's encoders.",
    "load": "Something is missing: mount it again, or weigh it, `dynid payload MODEL.json RUN`.",
}


@dataclass(frozen=True)
class Change:
    """What of the model no longer holds.

    Attributes
    ----------
    t : float
        When it was said, in the run's time [s].
    kind : str
        ``"friction"``, ``"gain"``, ``"offset"``, ``"load"``, ``"delay"``, ``"slip"``, ``"unknown"`` or ``"frozen"``.
    joint : str
        Where; the last one of a load.
    size : float
        Friction, gain and unknown relative, offset in the torque's unit, load in kg (where torque is in ampere, in
        ampere per N m times kg), delay in s, slip in rad or m; of a frozen channel the torque that it shows.
    interval : tuple of float
        Where the size lies with 95 %.
    moments : tuple of float, optional
        First moments of a load in the last link's frame [kg m].
    said : str
        ``"named"`` just now; twenty seconds of motion later ``"settled"``, when it is taken for granted, or
        ``"withdrawn"`` where it has passed or is no larger than what is tolerated. A frozen channel is withdrawn when
        it changes again, settled or not; other changes may be said in between.
    either : str, optional
        What else it may be, ``"gain of elbow"``, where the data do not tell.
    """

    t: float
    kind: str
    joint: str
    size: float
    interval: tuple[float, float]
    moments: tuple[float, float, float] | None = None
    said: str = "named"
    either: str | None = None
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.t:.1f} s: {self.place}{self.what}{'' if self.said == 'named' else f' ({self.said})'}"

    @property
    def place(self) -> str:
        """Joint and colon, before `what`; nothing of a load."""
        return "" if self.kind == "load" else f"{self.joint}: "

    @property
    def what(self) -> str:
        """Kind, size and interval in words, and what else it may be."""
        if self.kind == "unknown":
            what = f"the error has grown by {percent(self.size)}, no name says why: look again"
        elif self.kind == FROZEN:
            does = "changes again" if self.said == "withdrawn" else "does not change any more"
            what = f"the torque channel {does}, {size_words(FROZEN, self.size, self.unit)}"
        else:
            size, bounds = size_words(self.kind, self.size, self.unit), interval_words(self.kind, self.interval)
            what = f"{kind_words(self.kind)} {size} ({bounds})"
        return f"{what}, or {self.either}" if self.either else what

    def to_json(self) -> dict[str, Any]:
        """As `dynid watch --json` prints it."""
        return asdict(self)


def kind_words(kind: str) -> str:
    """``"offset"`` as people say it, `constant torque`."""
    return KIND_WORDS.get(kind, kind)


def size_words(kind: str, size: float, unit: str) -> str:
    """`+21 %`, `0.244 kg`."""
    if kind in RELATIVE:
        return percent(size, signed=True)
    if kind == "delay":
        return f"{significant(1e3 * size)} ms"
    return f"{significant(size)} {unit}".rstrip()


def interval_words(kind: str, bounds: Sequence[float]) -> str:
    """`+19 to +22 %`, `0.243 to 0.246`."""
    if kind == "delay":
        bounds = [1e3 * bound for bound in bounds]
    return percent_interval(bounds) if kind in RELATIVE else interval(bounds)


def advice(kind: str, size: float) -> str:
    """One sentence: what to do about a change of this kind, grown or fallen; commands stand between backticks.

    Raises
    ------
    KeyError
        There is no such kind.
    """
    return _GROWN[kind] if size > 0 else _FALLEN.get(kind, _GROWN[kind])
