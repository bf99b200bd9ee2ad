"""One change that a watch has said: what of the model no longer holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dynid_rs.base.changes import interval_words, kind_words, size_words
from dynid_rs.base.numbers import percent
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.recording import FloatArray


@dataclass(frozen=True)
class Change:
    """What of the model no longer holds.

    Attributes
    ----------
    t : float
        When it was said, in the run's time [s].
    kind : str
        ``"friction"``, ``"gain"``, ``"offset"``, ``"load"`` or ``"unknown"``.
    joint : str
        Where; the last one of a load.
    size : float
        Friction, gain and unknown relative, offset in the torque's unit, load in kg (where torque is in ampere, in
        ampere per N m times kg).
    interval : tuple of float
        Where the size lies with 95 %.
    moments : tuple of float, optional
        First moments of a load in the last link's frame [kg m].
    said : str
        ``"named"`` just now; twenty seconds of motion later ``"settled"``, when it is taken for granted, or
        ``"withdrawn"`` where it has passed or is no larger than what is tolerated.
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
        where = "" if self.kind == "load" else f"{self.joint}: "
        return f"{self.t:.1f} s: {where}{self.what}{'' if self.said == 'named' else f' ({self.said})'}"

    @property
    def what(self) -> str:
        """Kind, size and interval in words, and what else it may be."""
        if self.kind == "unknown":
            what = f"the error has grown by {percent(self.size)}, no name says why: look again"
        else:
            size, bounds = size_words(self.kind, self.size, self.unit), interval_words(self.kind, self.interval)
            what = f"{kind_words(self.kind)} {size} ({bounds})"
        return f"{what}, or {self.either}" if self.either else what

    def to_json(self) -> dict[str, Any]:
        """As `dynid watch --json` prints it."""
        return asdict(self)


def change_of(said: dict[str, Any], t: FloatArray, joints: Sequence[str], torque_unit: str) -> Change:
    """What the compiled watch has said at a sample of the times `t` (n,) [s]."""
    kind, size, std = said["kind"], said["size"], said["std"]
    mass = "kg" if torque_unit == "N*m" else f"kg {torque_unit}/(N*m)"
    either = said["or"]
    return Change(
        float(t[said["sample"]]),
        kind,
        joints[said["joint"]],
        size,
        (size - NORMAL_95 * std, size + NORMAL_95 * std),
        tuple(said["moments"]) if kind == "load" else None,
        said["said"],
        None
        if either is None
        else ("a load" if either[0] == "load" else f"{kind_words(either[0])} of {joints[either[1]]}"),
        {"load": mass, "offset": torque_unit}.get(kind, ""),
    )
