"""One measured run: arrays that are checked once, here, and trusted everywhere else."""

from __future__ import annotations

import builtins
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid_rs.base.masked import unmasked
from dynid_rs.runs.cells import TIME_UNITS, check_finite, check_time, seconds_of, usual_step

if TYPE_CHECKING:
    from dynid_rs.runs.readers.config_file import Rules
    from dynid_rs.runs.readers.reading import Robot
    from dynid_rs.runs.recordings import Recordings

FloatArray = NDArray[np.float64]
Delay = float | FloatArray
"""How late torque channels are [s]: one number for all joints, or (n_joints,)."""

_MATRICES = ("q", "tau", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "q_reference", "temperature")
_REQUIRED = ("q", "tau")

OptionalSignal = Literal["dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "q_reference", "temperature"]


@dataclass(frozen=True, eq=False)
class Recording:
    """One measured run of one robot; link side, SI.

    Arrays that are given are kept, not copied; what was once found out about them is remembered, so they have to stay
    as they are (`dataclasses.replace` makes a run with others).

    ``recording[2.0:5.0]`` is what was recorded from 2 s to 5 s on the clock of `t`, half-open; whole numbers count
    rows, as everywhere in Python: ``recording[200:500]``. Either end may be left out, and rows may count from the end.

    Parameters
    ----------
    t : ndarray (n,)
        Time [s], strictly increasing, no step of more than 10 median steps. Of numpy's moments and differences of them
        (`datetime64`, `timedelta64`) seconds are made, from the first row on.
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
    first_row : int
        Row of its file that the first row is; 0 but in a part of a run.
    before : Recording, optional
        What the same measurement holds before this part of it: a model with memory (warm gears) comes from there.
    kinds : tuple of str
        ``"revolute"`` or ``"prismatic"`` per joint, for the units of labels; all turn when left out.

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
    first_row: int = 0
    before: Recording | None = None
    kinds: tuple[str, ...] = ()

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
        put("kinds", tuple(self.kinds) or ("revolute",) * self.n_joints)
        if len(self.kinds) != self.n_joints or not set(self.kinds) <= {"revolute", "prismatic"}:
            raise ValueError(
                f"{self.name}: kinds must be 'revolute' or 'prismatic' for each of {self.n_joints} joints, "
                f"got {list(self.kinds)}"
            )
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

    @classmethod
    def from_dataframe(
        cls, frame: Any, robot: Robot = None, config: Rules = None, *, name: str = "data frame"
    ) -> Recording:
        """Make a recording of a table in memory, one row per sample.

        Parameters
        ----------
        frame : pandas, polars or pyarrow table
            Or anything else that gives its columns as an Arrow stream. An index is a column too (``index``, if it has
            no name), time may be numbers, moments or differences of them.
        robot, config, name
            As for `read_recording`: `config` says which column is which signal, ``{"q": "actual_q_{i}"}``. `name`
            stands in messages.

        Returns
        -------
        Recording
            Where a gap or a jump of time splits the table, the longest part; a `PartsWarning` says so, and
            `read_recordings` gives all.

        Raises
        ------
        DataError
            A column is missing or there twice, a cell is not a finite number, time does not increase.
        """
        from dynid_rs.runs.readers.frame import is_frame
        from dynid_rs.runs.readers.reading import PartsWarning, read

        if not is_frame(frame):
            raise ValueError(
                f"frame must be a data frame (pandas, polars, Arrow), got {type(frame).__name__}; files are read by "
                "read_recording"
            )
        found = read(frame, robot, config, name=name)
        text = found.warning(name)
        if text is not None:
            warnings.warn(text, PartsWarning, stacklevel=2)
        return cls(**found.longest)

    def to_dataframe(self, kind: Literal["pandas", "polars", "pyarrow"] = "pandas") -> Any:
        """All signals as one table: ``t`` [s], ``q_JOINT``, ``tau_JOINT``, ... (``current_JOINT`` in ampere).

        pandas unless something else is asked for, so that the answer does not hang on what happens to be installed;
        ``"pyarrow"`` needs nothing more. Polars, DuckDB and others also take the recording itself, as an Arrow stream.
        `from_dataframe` takes the table back.

        Raises
        ------
        MissingLibraryError
            pandas or polars is not installed.
        """
        from dynid_rs.runs.frames import as_kind, to_table

        return as_kind(to_table(self), kind)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Arrow's PyCapsule interface: `polars.DataFrame(recording)` and `pyarrow.table(recording)`."""
        from dynid_rs.runs.frames import to_table

        return to_table(self).__arrow_c_stream__(requested_schema)

    def concat(recordings: Recording | Sequence[Recording], *others: Recording) -> Recordings:
        """Put recordings of one arm together: what continues is joined, what does not stays a part of its own.

        `Recording.concat([one, other])`, or `one.concat(other)`.

        A run that begins at most 10 median steps after the one before it ended continues it. Across a longer gap, or
        a clock that starts again, nothing may be filtered or differentiated: such parts stay apart, as they do when
        files are read, and fits, scores and splits take the list of them.

        Raises
        ------
        ValueError
            None are given, or something else.
        DataError
            They are of different arms, or their torque has different units.
        """
        from dynid_rs.runs.recordings import joined

        first = [recordings] if isinstance(recordings, Recording) else list(recordings)
        return joined([*first, *others])

    def plot(
        self, signals: Sequence[str] = ("q", "tau"), *, joints: Sequence[str | int] | None = None, axes: Any = None
    ) -> NDArray[Any]:
        """Draw signals over time, one row of panels per joint.

        Parameters
        ----------
        signals : sequence of str
            One column of panels each: ``"q"``, ``"tau"``, ``"dq"``, ``"temperature"``, ...; with q stand the motor's
            and the asked-for position, where they were recorded.
        joints : sequence of str or int, optional
            Names or indices; all by default.
        axes : array of matplotlib Axes, optional
            To draw into; a new figure by default.

        Returns
        -------
        ndarray of matplotlib Axes
            ``(n_joints, n_signals)``, or a line of them where there is one row or column.

        Raises
        ------
        MissingLibraryError
            matplotlib, which the extra `plot` brings, is not installed.
        ValueError
            A signal that was not recorded, or an unknown joint.
        """
        from dynid_rs.runs.plots import plot_signals

        return plot_signals(self, signals, joints, axes)

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that were recorded, position first."""
        return tuple(name for name in _MATRICES if getattr(self, name) is not None)

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

    def __len__(self) -> int:
        return self.n_samples

    def __getitem__(self, key: builtins.slice) -> Recording:
        """Part of the run: seconds on the clock of `t` between floats, rows between whole numbers; half-open.

        Raises
        ------
        TypeError
            Not a slice, one with a step, or one whose ends are of two kinds.
        DataError
            Fewer than 20 samples lie there.
        """
        from dynid_rs.runs.cutting import rows_of

        return self.slice(*rows_of(self, key))

    __iter__: ClassVar[None] = None  # a run is no sequence of runs

    def __repr__(self) -> str:
        from dynid_rs.runs.words import said_of

        return f"<Recording {said_of(self)}>"

    def _repr_html_(self) -> str:
        from dynid_rs.runs.words import html_of

        return html_of(self)

    def slice(self, start: int | None = None, stop: int | None = None) -> Recording:
        """Rows `start` to `stop` (as in Python: half-open, negative from the end) as a run of its own.

        Raises
        ------
        DataError
            Fewer than 20 rows are left.
        """
        rows = slice(start, stop)
        first = rows.indices(self.n_samples)[0]
        cut: dict[str, Any] = {"t": self.t[rows], "first_row": self.first_row + first}
        for name in _MATRICES:
            value = getattr(self, name)
            cut[name] = None if value is None else value[rows]
        if self.first_line is not None:
            cut["first_line"] = self.first_line + first
        return replace(self, **cut)

    def less_torque_delay(self, delay: Delay) -> Recording:
        """Return the same run with its torques `delay` seconds earlier, linear between samples, the ends held.

        One number is that of all joints; (n_joints,) are each joint's.
        """
        delays = np.broadcast_to(delay, self.tau.shape[1])
        if not delays.any():
            return self
        columns = zip(self.tau.T, delays, strict=True)
        tau = np.stack([np.interp(self.t + delay, self.t, column) for column, delay in columns], axis=1)
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
    kind = type(values).__name__
    try:
        if values is None:
            raise TypeError
        given = np.asarray(unmasked(values))
        if given.dtype.kind in "mM":  # as numbers they are counts of some unit
            if name == "t" and given.ndim == 1:
                return seconds_of(given)
            kind = given.dtype.name
            raise TypeError
        return np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be an array of numbers, got {kind}") from None
