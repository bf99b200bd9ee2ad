"""Pieces of a friction experiment: legs of constant speed, and bursts that are played forwards and backwards in time.

Every piece starts and ends at rest, with continuous acceleration, and is known in closed form.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.quoting import shown_value

FloatArray = NDArray[np.float64]
Motion = tuple[FloatArray, FloatArray, FloatArray]


class Segment(Protocol):
    """A motion from rest to rest."""

    @property
    def duration(self) -> float:
        """Time that it takes [s]."""

    @property
    def end(self) -> FloatArray:
        """Position after it, (n_joints,)."""

    def evaluate(self, t: FloatArray) -> Motion:
        """Position, velocity, acceleration at times `t` (n,) since its start, each (n, n_joints)."""

    def to_json(self) -> dict[str, Any]:
        """Return every number of it."""


@dataclass(frozen=True, eq=False)
class Leg:
    """All joints in proportion: a cycloidal ramp up to `velocity`, constant speed, and the same ramp down.

    With x the part of the ramp that is over, speed rises as ``x - sin(2 pi x) / (2 pi)`` and acceleration as
    ``1 - cos(2 pi x)``; a velocity of zero is a rest.

    Parameters
    ----------
    start : ndarray (n_joints,)
        Position before [rad, m].
    velocity : ndarray (n_joints,)
        Constant velocity between the ramps [rad/s, m/s]; zero where a joint rests.
    ramp, cruise : float
        Length of each ramp and of the stretch between them [s].
    """

    start: FloatArray
    velocity: FloatArray
    ramp: float
    cruise: float

    @property
    def duration(self) -> float:
        """Both ramps and the stretch between them [s]."""
        return 2 * self.ramp + self.cruise

    @property
    def end(self) -> FloatArray:
        """Position after it, (n_joints,)."""
        position: FloatArray = self.start + self.velocity * (self.ramp + self.cruise)
        return position

    def evaluate(self, t: FloatArray) -> Motion:
        """Position, velocity, acceleration at times `t` (n,) since its start, each (n, n_joints)."""
        # The way down is the way up, seen from the end.
        down = t > self.ramp + self.cruise
        since = np.clip(np.where(down, self.duration - t, t), 0.0, None)
        ramp = max(self.ramp, 1e-12)
        x = np.clip(since / ramp, 0.0, 1.0)
        turn = 2 * np.pi * x
        way = ramp * (x**2 / 2 + (np.cos(turn) - 1) / (4 * np.pi**2)) + np.clip(since - self.ramp, 0.0, None)
        speed = x - np.sin(turn) / (2 * np.pi)
        rise = np.where(since < self.ramp, (1 - np.cos(turn)) / ramp, 0.0)
        way = np.where(down, self.ramp + self.cruise - way, way)
        rise = np.where(down, -rise, rise)
        return (
            self.start + np.outer(way, self.velocity),
            np.outer(speed, self.velocity),
            np.outer(rise, self.velocity),
        )

    def to_json(self) -> dict[str, Any]:
        """Return every number of it."""
        return {"kind": "leg"} | {key: _plain(value) for key, value in asdict(self).items()}


@dataclass(frozen=True, eq=False)
class ReversedPair:
    """Sines of all joints at once, played forwards and then backwards in time.

    ``q(s) = centre + e(s) amplitude sin(omega s)`` for s up to `half`, then the same with s running back: the same
    positions with -dq and +ddq (Eq. 5 has -ddq, which leaves inertia in Eq. 7), so that inertia, Coriolis torque and
    gravity cancel from half the difference of the torques at any speed. The envelope e rises and falls over `rise`,
    with two continuous derivatives.

    Parameters
    ----------
    centre, amplitude, omega : ndarray (n_joints,)
        Of the sines [rad], [rad], [rad/s].
    half : float
        Time from the start to the turning point [s].
    rise : float
        Time over which the envelope rises, and falls again before the turning point [s].
    pause : float
        Rest at the turning point [s]: it shows where to look for the mirror.
    """

    centre: FloatArray
    amplitude: FloatArray
    omega: FloatArray
    half: float
    rise: float
    pause: float = 0.4

    @property
    def duration(self) -> float:
        """Forwards, the pause and backwards [s]."""
        return 2 * self.half + self.pause

    @property
    def end(self) -> FloatArray:
        """Position after it, (n_joints,)."""
        return self.centre

    def evaluate(self, t: FloatArray) -> Motion:
        """Position, velocity, acceleration at times `t` (n,) since its start, each (n, n_joints)."""
        backwards = t > self.half
        s = np.clip(np.where(t > self.duration / 2, self.duration - t, t), 0.0, self.half)
        e, de, dde = self._envelope(s)
        angle = np.outer(s, self.omega)
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * self.omega * np.cos(angle)
        q = self.centre + e * sine
        dq = de * sine + e * cosine
        ddq = dde * sine + 2 * de * cosine - e * self.omega**2 * sine
        return q, np.where(backwards[:, None], -dq, dq), ddq

    def _envelope(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Quintic step up and down, and its two derivatives, (n, 1) each."""
        falling = s > self.half / 2
        x = np.clip(np.where(falling, self.half - s, s) / self.rise, 0.0, 1.0)
        sign = np.where(falling, -1.0, 1.0)
        e = x**3 * (10 - 15 * x + 6 * x**2)
        de = sign * 30 * x**2 * (1 - x) ** 2 / self.rise
        dde = 60 * x * (1 - x) * (1 - 2 * x) / self.rise**2
        return e[:, None], de[:, None], dde[:, None]

    def to_json(self) -> dict[str, Any]:
        """Return every number of it."""
        return {"kind": "reversed_pair"} | {key: _plain(value) for key, value in asdict(self).items()}


_KINDS: dict[str, type[Leg] | type[ReversedPair]] = {"leg": Leg, "reversed_pair": ReversedPair}


@dataclass(frozen=True, eq=False)
class FrictionExperiment:
    """Legs, pairs and the moves between them, one after the other; a trajectory like any other.

    Parameters
    ----------
    segments : tuple of Segment
        Each starts where the one before it ends.
    """

    segments: tuple[Leg | ReversedPair, ...]
    _edges: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        edges = np.concatenate([[0.0], np.cumsum([segment.duration for segment in self.segments])])
        object.__setattr__(self, "_edges", edges)  # the only way in, the class is frozen

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self._edges[-1])

    def evaluate(self, t: FloatArray) -> Motion:
        """Position, velocity and acceleration at times `t` (n,) [s], each (n, n_joints); at rest outside."""
        t = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        which = np.clip(np.searchsorted(self._edges, t, side="right") - 1, 0, len(self.segments) - 1)
        q, dq, ddq = (np.empty((len(t), len(self.segments[0].end))) for _ in range(3))
        for k in np.unique(which):
            at = which == k
            q[at], dq[at], ddq[at] = self.segments[k].evaluate(t[at] - self._edges[k])
        return q, dq, ddq

    def to_json(self) -> dict[str, Any]:
        """Return every number of the experiment."""
        segments = [segment.to_json() for segment in self.segments]
        return {"format": "dynid-friction-experiment", "version": 1, "segments": segments}

    @classmethod
    def from_json(cls, stored: dict[str, Any]) -> FrictionExperiment:
        """Return the experiment that `to_json` wrote.

        Raises
        ------
        ValueError
            Not a friction experiment, or not of this version.
        """
        if stored.get("format") != "dynid-friction-experiment" or stored.get("version") != 1:
            raise ValueError(
                "expected a friction experiment of version 1, found format "
                f"{shown_value(stored.get('format'))}, version {shown_value(stored.get('version'))}"
            )
        segments = []
        for fields in stored["segments"]:
            values = {key: _as_stored(value) for key, value in fields.items() if key != "kind"}
            segments.append(_KINDS[fields["kind"]](**values))
        return cls(tuple(segments))


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else float(value)


def _as_stored(value: Any) -> Any:
    return np.asarray(value, dtype=np.float64) if isinstance(value, list) else float(value)
