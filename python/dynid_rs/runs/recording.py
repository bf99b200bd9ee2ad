"""One measured run: arrays that are checked once, here, and trusted everywhere else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid_rs.runs.cells import check_finite, check_time, usual_step

FloatArray = NDArray[np.float64]

GAP_STEPS = 2.5
"""A step of more than this many median steps is a gap: samples were lost, interpolation bridges it."""

TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds of every unit that a file's time may be in."""

_MATRICES = ("q", "tau", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "q_reference", "temperature")
_REQUIRED = ("q", "tau")

OptionalSignal = Literal["dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "q_reference", "temperature"]


@dataclass(frozen=True, eq=False)
class Recording:
    """One measured run of one robot; link side, SI.

    Arrays that are given are kept, not copied; what was once found out about them is remembered, so they have to stay
    as they are (`dataclasses.replace` makes a run with others).

    Parameters
    ----------
    t : ndarray (n,)
        Time [s], strictly increasing, no step of more than 10 median steps.
    q : ndarray (n, n_joints)
        Link-side position [rad, m]; with one encoder per joint, the only one.
    dq, ddq : ndarray (n, n_joints), optional
        Velocity [rad/s, m/s] and acceleration [rad/s^2, m/s^2] as recorded.
    tau : ndarray (n, n_joints)
        Torque at the joint [`torque_unit`].
    q_motor, dq_motor, ddq_motor : ndarray (n, n_joints), optional
        Motor encoder divided by the gear ratio [rad, m], its velocity and its acceleration.
    q_reference : ndarray (n, n_joints), optional
        Position that the controller was asked for [rad, m], free of measurement noise.
    temperature : ndarray (n, n_joints), optional
        Temperature of the joint [degC].
    name : str
        Short name of the run, used in every message; readers put the file name here.
    joints : tuple of str
        Names along the chain; ``"0"``, ``"1"``, ... when left out.
    torque_unit : {"N*m", "A"}
        Unit of `tau`; ampere when a motor current without drive gain stands for torque.
    time_unit : str
        Unit that the file's time was read in (`t` is in seconds all the same); said where it looks wrong.
    first_line : int, optional
        Line of the first row in its file, where that is a text whose rows follow each other line by line.
    before : Recording, optional
        What the same measurement holds before this part of it: a model with memory (warm gears) comes from there.

    Raises
    ------
    ValueError
        Shapes that do not fit each other.
    DataError
        Numbers that are not finite, time that does not increase, gaps that are too long, too few samples.
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray | None = None
    ddq: FloatArray | None = None
    tau: FloatArray = None  # type: ignore[assignment]  # needed all the same; in the order of the signals' derivatives
    q_motor: FloatArray | None = None
    dq_motor: FloatArray | None = None
    ddq_motor: FloatArray | None = None
    q_reference: FloatArray | None = None
    temperature: FloatArray | None = None
    name: str = "recording"
    joints: tuple[str, ...] = ()
    torque_unit: str = "N*m"
    time_unit: str = "s"
    first_line: int | None = None
    before: Recording | None = None

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)  # the only way in, the class is frozen

        put("t", _as_floats(self.t, "t"))
        if self.t.ndim != 1:
            raise ValueError(f"{self.name}: t must be (n_samples,), got {self.t.shape}")
        for name in _MATRICES:
            value = getattr(self, name)
            if value is not None or name in _REQUIRED:
                put(name, _as_floats(value, name))
        self._check_shapes()
        put("joints", tuple(self.joints) or tuple(map(str, range(self.n_joints))))
        if len(self.joints) != self.n_joints or len(set(self.joints)) != self.n_joints:
            raise ValueError(f"{self.name}: joints must be {self.n_joints} different names, got {list(self.joints)}")
        if self.torque_unit not in ("N*m", "A"):
            raise ValueError(f"{self.name}: torque_unit must be 'N*m' or 'A', got {self.torque_unit!r}")
        if self.time_unit not in TIME_UNITS:
            raise ValueError(f"{self.name}: time_unit must be one of {', '.join(TIME_UNITS)}, got {self.time_unit!r}")
        for name in _MATRICES:
            value = getattr(self, name)
            if value is not None and not np.isfinite(value).all():
                for joint in range(self.n_joints):
                    check_finite(value[:, joint], file=self.name, column=f"{name}_{joint}")
        check_time(self.t, file=self.name)

    def _check_shapes(self) -> None:
        shape = np.shape(self.q)
        if len(shape) != 2 or shape[1] == 0:
            raise ValueError(f"{self.name}: q must be (n_samples, n_joints), got {shape}")
        if shape[0] != self.t.shape[0]:
            raise ValueError(f"{self.name}: t has {self.t.shape[0]} samples and q has {shape[0]}")
        for name in _MATRICES:
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise ValueError(f"{self.name}: {name} must be {shape} like q, got {value.shape}")

    @property
    def n_samples(self) -> int:
        """Number of rows."""
        return int(self.q.shape[0])

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @cached_property
    def median_step(self) -> float:
        """Time from one sample to the next [s]: the median, or the mean where stamps come in bursts."""
        return usual_step(np.diff(self.t))

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]: one over the median step."""
        return 1.0 / self.median_step

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def has_motor_encoder(self) -> bool:
        """Whether motor positions were recorded beside the link positions."""
        return self.q_motor is not None

    def slice(self, start: int | None = None, stop: int | None = None) -> Recording:
        """Rows `start` to `stop` (as in Python: half-open, negative from the end) as a run of its own.

        Raises
        ------
        DataError
            Fewer than 20 rows are left.
        """
        rows = slice(start, stop)
        cut: dict[str, Any] = {"t": self.t[rows]}
        for name in _MATRICES:
            value = getattr(self, name)
            cut[name] = None if value is None else value[rows]
        if self.first_line is not None:
            cut["first_line"] = self.first_line + rows.indices(self.n_samples)[0]
        return replace(self, **cut)

    def less_torque_delay(self, delay: float) -> Recording:
        """Return the same run with its torque `delay` seconds earlier, linear between samples, the ends held."""
        if delay == 0.0:
            return self
        tau = np.stack([np.interp(self.t + delay, self.t, column) for column in self.tau.T], axis=1)
        return replace(self, tau=tau)

    def line_of(self, row: int) -> int | None:
        """1-based line of a row in the run's file; None where it has no lines."""
        return None if self.first_line is None else self.first_line + row

    def without(self, *signals: OptionalSignal) -> Recording:
        """Return the same run without optional signals, e.g. a `dq` that contradicts q."""
        optional = {field.name for field in fields(self)} & (set(_MATRICES) - set(_REQUIRED))
        unknown = set(signals) - optional
        if unknown:
            raise ValueError(f"only {sorted(optional)} can be left out, got {sorted(unknown)}")
        nothing: dict[str, Any] = dict.fromkeys(signals)
        return replace(self, **nothing)


def _as_floats(values: ArrayLike, name: str) -> FloatArray:
    try:
        if values is None:
            raise TypeError
        return np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be an array of numbers, got {type(values).__name__}") from None


def gaps(recording: Recording) -> Sequence[tuple[int, float]]:
    """Short gaps in time: (0-based row after the gap, length in median steps) each."""
    steps = np.diff(recording.t) / recording.median_step
    return [(int(row) + 1, float(steps[row])) for row in np.flatnonzero(steps > GAP_STEPS)]
