"""From a recording to states on a uniform grid, and the band in which torques are compared.

Every column of the regressor and the torque go through the same zero-phase low-pass (parallel filtering), so the filter
cancels from the equation; only positions are filtered before they are differentiated, where their motion ends.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.runs.low_pass import butterworth, steady_state
from dynid_rs.runs.on_grid import linear, splined, uniform_grid
from dynid_rs.runs.positions import shown_positions
from dynid_rs.runs.recording import Delay, Recording
from dynid_rs.runs.sides import side_of
from dynid_rs.runs.slope import slope

FloatArray = NDArray[np.float64]
Filter = tuple[FloatArray, FloatArray, int]

ORDER = 4
"""Butterworth order of one pass; the two passes together fall off with twice that."""
MEMORY = 3.0
"""The band's filter remembers for this time over its cutoff: so long are runs continued at their ends, and so long is
what it makes of them off where they end in motion."""
WORK_RATE = 40.0
"""States are kept at this multiple of the cutoff at least; friction's corners live above the band."""
ROW_RATE = 4.0
"""Rows of the fit are kept at this multiple of the cutoff: twice what the band can hold."""
SLOWER = 2.0
"""A run narrows the band of others that are sampled more than this times as fast."""
STILL_SPEED = 0.01
"""A joint moves above this part of its greatest speed."""
STILL_TIME = 0.2
"""Shorter standstill [s] is a reversal, not a pause."""
REST_TIME = 1.0
"""The same of one joint while others move: smooth starts, and reversals where slow waves meet, take longer than that of
the whole arm, and what is below a rounded sign is told by them alone."""
LEAST_MOTION = 0.5
"""Shorter motion between two pauses [s] is a twitch (a brake opening), not motion."""
TOO_LITTLE = "too_little_motion"
"""Code of the error that a run does not move enough."""
LEAST_TOLD = 20
"""Rows in motion below which a joint is told by all of its rows, rests or not."""


@lru_cache(maxsize=64)
def _design(rate: float, cutoff: float) -> Filter | None:
    relative = cutoff / (rate / 2)
    if relative >= 0.95:
        return None
    sections = butterworth(ORDER, relative)
    return sections, steady_state(sections), int(MEMORY * rate / cutoff)


@dataclass(frozen=True)
class Band:
    """Where measured and predicted torque are compared: zero-phase Butterworth below `cutoff` [Hz].

    `slowest`: run whose sampling rate, lower than that of others, leaves less than the usual band, where one does.
    """

    cutoff: float
    slowest: str | None = field(default=None, compare=False)

    def too_little(self, name: str, text: str, mend: str) -> DataError:
        """Error that a run is too little for this band: of that run, or of the slower one that narrows the band."""
        if self.slowest in (None, name):
            return DataError(f"{name}: {text}; {mend}", code=TOO_LITTLE, file=name)
        return DataError(
            f"{self.slowest}: its sampling rate narrows the band of all runs to {self.cutoff:.3g} Hz: {name}: {text}; "
            "check its t, sample it as the others are sampled, or leave it out",
            code=TOO_LITTLE,
            file=self.slowest,
        )

    def design(self, rate: float, cutoff: float | None = None) -> Filter | None:
        """Second-order sections, their steady state and the padding, for `rate` [Hz]; None if nothing is cut."""
        return _design(rate, cutoff or self.cutoff)

    def apply(self, x: FloatArray, rate: float, cutoff: float | None = None) -> FloatArray:
        """Low-passed x (n, ...) sampled at `rate` [Hz]."""
        design = self.design(rate, cutoff)
        if design is None or x.size == 0:
            return x
        sections, steady, padding = design
        filtered = _core.low_pass(x.reshape(len(x), -1), (sections, steady, min(padding, len(x) - 1)))
        return filtered.reshape(x.shape)


_DIGESTS: dict[int, tuple[ref[Any], bytes]] = {}
"""Digests of signals by their identity, while they live: states that were made of others share signals with them."""


@dataclass(frozen=True, eq=False)
class States:
    """A run on a uniform grid; every matrix is (n, n_joints).

    `q, dq, ddq` link side, `q_motor, dq_motor, ddq_motor` motor side (the same arrays with one encoder), `tau` in the
    recording's unit. `moving` (n,) marks the samples that are fitted and scored, `rows` those of them that become
    rows of the fit; `resting` (n, n_joints) the joints that stand still meanwhile, whose torque no state tells; none by
    default.
    `notes` says what was done to the signals. `reference` is the position that the controller was asked for, with its
    derivatives, through the same filter; None where it was not recorded. `tau_link` is the rigid-body torque [N m]
    that a model predicts and `tau_motor` [torque unit] what it predicts at the motors, before effects beyond the
    declared model: for effects that depend on them; None before there is one. `temperature` [degC] as it
    was measured, on the grid; None where it was not. `torque_delay` (n_joints,) [s] of the torque channels was taken
    out of `tau`. `before`: the run up to here, where it is a part of one; what a model remembers comes from there.
    `recorded_rate` [Hz]: nothing is known of half of it and above.
    """

    name: str
    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    q_motor: FloatArray
    dq_motor: FloatArray
    ddq_motor: FloatArray
    tau: FloatArray
    rate: float
    band: Band
    moving: NDArray[np.bool_]
    two_encoders: bool
    notes: tuple[str, ...] = ()
    reference: tuple[FloatArray, FloatArray, FloatArray] | None = None
    tau_link: FloatArray | None = None
    tau_motor: FloatArray | None = None
    temperature: FloatArray | None = None
    resting: NDArray[np.bool_] = None  # type: ignore[assignment]
    before: States | None = None
    torque_delay: FloatArray = None  # type: ignore[assignment]
    recorded_rate: float = np.inf

    def __post_init__(self) -> None:
        if self.resting is None:
            object.__setattr__(self, "resting", np.zeros(self.q.shape, dtype=bool))  # the class is frozen
        if self.torque_delay is None:
            object.__setattr__(self, "torque_delay", np.zeros(self.q.shape[1]))

    def less_delay(self, delay: Delay) -> States:
        """Return the same states, of whose `tau` a delay [s], of all joints or of each, was taken out."""
        return replace(self, torque_delay=np.broadcast_to(delay, self.q.shape[1]).astype(np.float64))

    @cached_property
    def filter(self) -> Filter | None:
        """The band's filter at this rate."""
        return self.band.design(self.rate)

    @property
    def step(self) -> int:
        """Samples from one row to the next."""
        return max(1, int(self.rate / (ROW_RATE * self.band.cutoff)))

    @property
    def grid(self) -> NDArray[np.intp]:
        """Samples of the decimated grid, (n_grid,), standstill included."""
        return np.arange(0, len(self.t), self.step)

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Samples that become rows of the fit, (n_rows,)."""
        return self.grid[self.moving[self.grid]]

    @cached_property
    def counted(self) -> NDArray[np.bool_]:
        """Joints that move at the rows, (n_rows, n_joints): what is fitted and scored."""
        return ~self.resting[self.rows]

    @cached_property
    def kept(self) -> list[int]:
        """`rows` as the compiled module takes them."""
        result: list[int] = self.rows.tolist()
        return result

    def digest(self, name: str) -> bytes:
        """Digest of the numbers of a signal; nothing for one that is not there."""
        signal = getattr(self, name)
        if signal is None:
            return b""
        kept = _DIGESTS.get(id(signal))
        if kept is not None and kept[0]() is signal:
            return kept[1]
        digest, key = hashlib.sha256(np.ascontiguousarray(signal).data).digest(), id(signal)
        _DIGESTS[key] = ref(signal, lambda _: _DIGESTS.pop(key, None)), digest
        return digest

    @cached_property
    def motion(self) -> tuple[Any, ...]:
        """What columns in the band are made of beside the load."""
        names = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "temperature", "rows")
        return self.rate, self.band.cutoff, b"".join(self.digest(name) for name in names)

    def velocity_noise(self, j: int) -> float:
        """Standard deviation of joint j's motor-side velocity above the band [rad/s], by its median."""
        return self._velocity_noise[j]

    @cached_property
    def _velocity_noise(self) -> list[float]:
        above = (speed - self.band.apply(speed, self.rate) for speed in self.dq_motor.T)
        return [float(np.median(np.abs(own)) / 0.6745) for own in above]

    def in_band(self, x: FloatArray) -> FloatArray:
        """`x` (n, ...) through the band's filter, at the rows of the fit."""
        return self.band.apply(x, self.rate)[self.rows]

    def signals(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return q, dq, ddq, q_motor, dq_motor, ddq_motor."""
        return self.q, self.dq, self.ddq, self.q_motor, self.dq_motor, self.ddq_motor

    def aligned(self, encoder_delay: FloatArray, encoder_error: FloatArray | None = None) -> States:
        """Return the same run as a model sees it that knows about the encoders.

        Parameters
        ----------
        encoder_delay : ndarray (n_joints,)
            How late the link channel is behind the motor channel [s].
        encoder_error : ndarray (n_joints, 2), optional
            Cosine and sine part of what the link encoder shows too much [rad]; with one encoder the motor side is the
            same signal and shows it too.
        """
        seen = self.in_step(encoder_delay)
        q, dq, ddq = seen.q, seen.dq, seen.ddq
        q_motor, dq_motor, ddq_motor = seen.q_motor, seen.dq_motor, seen.ddq_motor
        if encoder_error is not None and np.any(encoder_error):
            q, dq, ddq = _core.true_motion(q, dq, ddq, encoder_error)
            if not self.two_encoders:
                q_motor, dq_motor, ddq_motor = q, dq, ddq
        if self.two_encoders:
            q, dq = _core.align_link_side(q, dq, ddq, encoder_delay)
        return replace(self, q=q, dq=dq, ddq=ddq, q_motor=q_motor, dq_motor=dq_motor, ddq_motor=ddq_motor)

    def in_step(self, encoder_delay: FloatArray) -> States:
        """Return the same run with the links' acceleration on the motor channel's clock, where a model has the rest.

        A model brings positions and speeds there by itself; the jerk, which the acceleration takes, only a record
        has. Inertia that comes late by `encoder_delay` (n_joints,) [s] would look like a torque channel that is early.
        """
        if not self.two_encoders or not np.any(encoder_delay):
            return self
        return replace(self, ddq=self.ddq + encoder_delay * slope(self.ddq, self.rate))


def is_of_load(signals: Collection[str]) -> bool:
    """Whether `signals` of an effect hold a torque that only a fitted model predicts."""
    return "tau_link" in signals or "tau_motor" in signals


def top_speed(runs: Sequence[States]) -> FloatArray:
    """Greatest speed of every joint's motor over all runs, (n_joints,) [rad/s]."""
    top: FloatArray = np.max([np.abs(states.dq_motor).max(axis=0) for states in runs], axis=0)
    return top


def common_rate(recordings: list[Recording]) -> float:
    """Mean sampling rate of the fastest run [Hz], a whole number where it is one; the grid of all of them."""
    rate = max((recording.n_samples - 1) / recording.duration for recording in recordings)
    return float(round(rate)) if rate > 10 else float(rate)


def choose_band(recordings: list[Recording], least: float = 5.0) -> Band:
    """Band that holds the motion: 5 Hz, or five times the frequency below which nine tenths of the speed's power lie.

    The median over joints and runs, so that one vibrating joint does not open the band to its noise.
    """
    frequencies = []
    for recording in recordings:
        rate = recording.rate
        grid = np.arange(recording.t[0], recording.t[-1], 1 / rate)
        q = Band(4 * least).apply(linear(recording.t, recording.q, grid), rate)
        power = np.cumsum(np.abs(np.fft.rfft(slope(q, rate), axis=0)) ** 2, axis=0)
        frequencies += [np.searchsorted(column, 0.9 * column[-1]) * rate / len(grid) for column in power.T]
    slowest = min(recordings, key=lambda recording: recording.rate)
    allowed = 0.8 * slowest.rate / 2
    cutoff = float(min(max(least, 5 * np.median(frequencies)), allowed))
    is_alone = max(recording.rate for recording in recordings) > SLOWER * slowest.rate
    return Band(cutoff, slowest.name if cutoff < least and is_alone else None)


def prepare(recording: Recording, band: Band, rate: float, *, standstill: bool = False) -> States:
    """States of `recording` at `rate` [Hz] or a whole fraction of it; a faster one is filtered before it is thinned.

    Recorded velocity and acceleration are taken as they are where both are there and belong together (a simulation, or
    a careful logger). Otherwise positions are low-passed where their motion ends, at twice the band at most, and
    differentiated; a recorded velocity replaces the derivative unless it lags behind, with its position up to twice the
    band. With `standstill` pauses are fitted and scored too: friction at rest is no function of the state, but a model
    with memory can know it.

    Raises
    ------
    DataError
        The run is too short for the band.
    """
    before = _states_before(recording, band, rate, standstill)
    thinned = max(1, round(recording.rate / rate))
    kept, rate = rate, rate * thinned
    grid = uniform_grid(recording.t, rate)
    if len(grid) / rate < 4 / band.cutoff:
        raise band.too_little(
            recording.name,
            f"{len(grid) / rate:.3g} s are too short for a band of {band.cutoff:.3g} Hz",
            f"at least {4 / band.cutoff:.3g} s are needed",
        )
    two_encoders = recording.q_motor is not None
    q, q_motor = splined(recording.t, recording.q, grid), recording.q_motor
    if q_motor is not None:
        q_motor = None if np.array_equal(q_motor, recording.q) else splined(recording.t, q_motor, grid)
    shown = shown_positions(q, q_motor, band, rate)
    link = side_of(recording, "q", grid, band, rate, shown.q)
    motor = link if q_motor is None else side_of(recording, "q_motor", grid, band, rate, shown.q_motor)
    notes = (*link.notes, *(() if motor is link else motor.notes))
    tau = linear(recording.t, recording.tau, grid)
    step = thinned if link.exact else thinned * max(1, int(kept / (WORK_RATE * band.cutoff)))
    if step > 1:
        tau = band.apply(tau, rate, max(0.4 * rate / step, 2 * band.cutoff))
    reference: list[FloatArray] | None = None
    if recording.q_reference is not None:
        asked = side_of(recording, "q_reference", grid, band, rate)
        notes += asked.notes
        reference = [np.ascontiguousarray(x[::step]) for x in asked.signals]
    temperature = recording.temperature
    if temperature is not None:
        temperature = np.ascontiguousarray(linear(recording.t, temperature, grid)[::step])
    # What was differentiated was filtered as narrowly as its position, and is off for longer at the ends.
    ends = float(np.max((link.derived | motor.derived) / shown.cutoff))
    moving, resting = find_motion(link.dq[::step], rate / step, band, standstill, ends)
    names = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")
    signals: dict[str, Any] = dict(
        zip(names, (np.ascontiguousarray(x[::step]) for x in (*link.signals, *motor.signals)), strict=True)
    )
    return States(
        name=recording.name,
        t=grid[::step],
        **signals,
        tau=np.ascontiguousarray(tau[::step]),
        rate=rate / step,
        band=band,
        moving=moving,
        resting=resting,
        two_encoders=two_encoders,
        notes=notes,
        reference=None if reference is None else (reference[0], reference[1], reference[2]),
        temperature=temperature,
        before=before,
        recorded_rate=min(recording.rate, rate),
    )


def _states_before(recording: Recording, band: Band, rate: float, standstill: bool) -> States | None:
    """States of what came before a part of a run; None where there is nothing, or too little to be filtered."""
    before = recording.before
    if before is None or before.duration < 4 / band.cutoff + 2 / rate:
        return None
    return prepare(before, band, rate, standstill=standstill)


def without(states: States, windows: Sequence[tuple[float, float]], guard: float | None = None) -> States:
    """Return the same run with windows (start, end) [s] neither fitted nor scored.

    `guard` [s] on both sides keeps out what the band's filter smears; one over the cutoff by default.
    """
    guard = 1 / states.band.cutoff if guard is None else guard
    outside = np.ones(len(states.t), dtype=bool)
    for start, end in windows:
        outside &= (states.t < start - guard) | (states.t > end + guard)
    return states if outside.all() else replace(states, moving=states.moving & outside)


def find_motion(
    dq: FloatArray, rate: float, band: Band, standstill: bool = False, ends: float = 0.0
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples in motion (n,), and joints that rest meanwhile (n, n_joints).

    Friction at rest is not a function of the state, so pauses are neither fitted nor scored: those of the arm, and
    those of a joint while others move. A guard on both sides of a pause, and at both ends of the run (`ends` [s] at
    least), keeps the filters' transients out.
    """
    top = np.abs(dq).max(axis=0)
    still = np.less_equal(np.abs(dq), STILL_SPEED * np.where(top > 0, top, np.inf))
    guard = int(rate / band.cutoff)
    moving, resting = np.ones(len(dq), dtype=bool), np.zeros(dq.shape, dtype=bool)
    if standstill:
        still[:] = False
    for first, last in stretches(np.all(still, axis=1)):
        at_an_end = first == 0 or last == len(still)
        if at_an_end or last - first > STILL_TIME * rate:
            moving[max(0, first - guard) : last + guard] = False
    for j in np.flatnonzero(top > 0):  # a joint that never moves is told by all of its samples, or by none
        for first, last in stretches(still[:, j]):
            if last - first > REST_TIME * rate:
                resting[max(0, first - guard) : last + guard, j] = True
    at_ends = max(guard, int(ends * rate))
    moving[:at_ends] = moving[-at_ends:] = False
    for first, last in stretches(moving):
        if last - first < LEAST_MOTION * rate:
            moving[first:last] = False
    told = np.sum(moving[:, None] & ~resting, axis=0)
    resting[:, told * ROW_RATE * band.cutoff < LEAST_TOLD * rate] = False
    return moving, resting


def stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open index ranges in which `mask` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]
