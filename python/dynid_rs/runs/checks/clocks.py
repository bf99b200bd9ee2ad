"""Time in another unit than it was read in: told by what logs of robots are like, and by the other runs of a set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.runs.cells import TIME_UNITS
from dynid_rs.runs.checks.motion import block_velocity
from dynid_rs.runs.recording import Recording

MIN_RATE, MAX_RATE = 2.0, 50_000.0
"""No log of a robot [Hz]: slower samples hold no dynamics, and no field bus is faster. It takes another unit."""
USUAL_RATES = (10.0, 20_000.0)
"""Rates [Hz] of the logs there are: from polled interfaces to a drive's current loop. Units are a thousand apart and
these are two thousand: at most two units fit, and `USUAL_SPEEDS` or the other runs decide between them."""
MIDDLE_RATE = float(np.sqrt(USUAL_RATES[0] * USUAL_RATES[1]))
"""What a rate is like [Hz] where no other run says: the middle of `USUAL_RATES` in their logarithm."""
USUAL_SPEEDS = (0.02, 30.0)
"""Speed [rad/s, m/s] of a run's fastest joint: a friction run creeps at a degree a second, no arm's joint does five
turns. Another unit of time divides it by a thousand as well."""
SHORTEST = 1.0
"""A run that would be shorter [s] in a unit is not in it."""
ANOTHER_CLOCK = 90.0
"""Runs of one set are sampled within this factor of each other: 50 Hz and 4 kHz may be one set. In between two units
(1000) and what no two loggers of one arm differ by."""
ALIKE = 3.0
"""A unit is proposed beside other runs where it brings a run within this factor of one of their rates: less than half
the way from 100 ns to the next unit, so that at most one unit is that near to a rate."""
SAME = 1.05
"""Rates of two logs of one logger are within this factor."""
TOP = 98
"""Percentile of the speed that stands for its top: damaged samples are fewer."""

WORDS = {
    "s": "seconds",
    "ms": "milliseconds",
    "us": "microseconds",
    "ns": "nanoseconds",
    "100ns": "steps of 100 ns",
    "min": "minutes",
    "h": "hours",
}
GUESSED = ("s", "ms", "us", "ns")
"""Units that a run's rate may tell from each other. 100 ns are too near to two of them: the size of stamps tells those,
or the rate of other runs."""
ROWS = "rows"
"""Where a unit stands otherwise: time that is the number of the row."""


@dataclass(frozen=True)
class Clock:
    """What tells the unit of a run's time.

    `rate` [Hz], `duration` [s] and `speed` of the fastest joint [rad/s, m/s], as time was read, in `unit`.
    """

    name: str
    rate: float
    duration: float
    speed: float
    unit: str = "s"

    @staticmethod
    def of(recording: Recording) -> Clock:
        """Clock of a run."""
        with np.errstate(over="ignore", invalid="ignore"):  # a damaged position of 1e300 is somebody else's matter
            speeds = np.percentile(np.abs(block_velocity(recording)), TOP, axis=0)
        fastest = float(np.max(speeds))
        return Clock(recording.name, recording.rate, recording.duration, fastest, recording.time_unit)

    def read_in(self, unit: str) -> Clock:
        """Return the same run with its time taken to be in `unit`."""
        factor = TIME_UNITS[unit] / TIME_UNITS[self.unit]
        return Clock(self.name, self.rate / factor, self.duration * factor, self.speed / factor, unit)

    def oddity(self, rate: float) -> float:
        """How far, in powers of e, this is from a run at about `rate` [Hz] whose speeds are those of an arm."""
        slowest, fastest = np.log(USUAL_SPEEDS)
        speed = np.log(max(self.speed, 1e-300))
        return float(abs(np.log(self.rate / rate)) + max(slowest - speed, speed - fastest, 0.0))

    def distance(self, rates: Sequence[float]) -> float:
        """How far, in powers of e, its rate is from the nearest of `rates` [Hz]."""
        return min(abs(float(np.log(self.rate / rate))) for rate in rates)

    @property
    def counts_rows(self) -> bool:
        """Whether time goes up by one from row to row, in its unit."""
        return abs(self.rate * TIME_UNITS[self.unit] - 1.0) < 1e-9

    @property
    def is_usual(self) -> bool:
        """Whether rate and duration are those of a robot's log."""
        return USUAL_RATES[0] <= self.rate <= USUAL_RATES[1] and self.duration >= SHORTEST

    @property
    def is_slow_or_fast(self) -> bool:
        """Whether no joint moves as an arm's does."""
        return not USUAL_SPEEDS[0] <= self.speed <= USUAL_SPEEDS[1]


def likely_unit(clock: Clock) -> str | None:
    """Unit that makes `clock`, by itself, a robot's log; None if there is none."""
    if clock.unit not in GUESSED and clock.is_usual:
        return clock.unit
    units = [unit for unit in GUESSED if clock.read_in(unit).is_usual]
    return min(units, key=lambda unit: clock.read_in(unit).oddity(MIDDLE_RATE), default=None)


def unit_beside(clock: Clock, rates: Sequence[float]) -> str | None:
    """Unit, or `ROWS`, that brings `clock` to one of the `rates` [Hz] of other runs; None if none does."""
    # A rate tells seconds from minutes no better than two loggers from each other.
    units = [unit for unit in dict.fromkeys((clock.unit, *GUESSED, "100ns")) if clock.read_in(unit).is_usual]
    unit = min(units, key=lambda unit: clock.read_in(unit).distance(rates), default=None)
    distance = np.inf if unit is None else clock.read_in(unit).distance(rates)
    if distance > np.log(SAME) and clock.counts_rows:
        return ROWS
    return unit if distance < np.log(ALIKE) else None


def clock_findings(clocks: Sequence[Clock]) -> dict[int, Finding]:
    """Runs of one set, or a lone run, whose time is in another unit than it was read in, or no time of theirs.

    A run by itself: its rate is none (`MIN_RATE`, `MAX_RATE`), or rate and speed are both unusual and another unit
    makes both usual. Beside others: its rate is another one by `ANOTHER_CLOCK`, and another unit brings it to theirs,
    or it is no usual one. There a unit is said only if it brings a run to the others' rate.

    Returns
    -------
    dict of int to Finding
        An error ``sampling_rate`` for each place in `clocks` of such a run.
    """
    wrong = {k: unit for k, clock in enumerate(clocks) if (unit := _alone(clock)) is not None}
    rates = [clock.rate for k, clock in enumerate(clocks) if k not in wrong]
    if not rates:
        return {k: _finding(clocks[k], unit, None) for k, unit in wrong.items()}
    beside = {k: unit_beside(clocks[k], rates) for k in wrong}
    beside = {k: unit for k, unit in beside.items() if unit != clocks[k].unit}
    beside |= _among(clocks, [k for k in range(len(clocks)) if k not in wrong])
    theirs = float(np.median([clock.rate for k, clock in enumerate(clocks) if k not in beside]))
    return {k: _finding(clocks[k], beside[k], theirs) for k in sorted(beside)}


def check_clocks(clocks: Sequence[Clock]) -> None:
    """Refuse runs of which one has its time in another unit.

    Raises
    ------
    DataError
        Names the first such run, the unit and the mend.
    """
    for finding in clock_findings(clocks).values():
        raise DataError(f"{finding.file}: {finding.message}", code=finding.code, file=finding.file, column="t")


def _alone(clock: Clock) -> str | None:
    """Unit of a run that cannot be in the one that it was read in; None if it may be."""
    unit = likely_unit(clock)
    if unit is None or unit == clock.unit:
        return None
    if not MIN_RATE <= clock.rate <= MAX_RATE:
        return unit
    unusual = not clock.is_usual and clock.is_slow_or_fast
    return unit if unusual and not clock.read_in(unit).is_slow_or_fast else None


def _among(clocks: Sequence[Clock], places: Sequence[int]) -> dict[int, str | None]:
    """Runs at `places`, each possible by itself, that are no runs of this set as they were read: place and unit."""
    found: dict[int, str | None] = {}
    # Of two runs that contradict each other the odder one is taken to be wrong.
    for k in sorted(places, key=lambda place: -clocks[place].oddity(MIDDLE_RATE)):
        others = [clocks[other] for other in places if other != k and other not in found]
        if not others:
            continue
        rates = [other.rate for other in others]
        rate = float(np.median(rates))
        if max(clocks[k].rate / rate, rate / clocks[k].rate) < ANOTHER_CLOCK:
            continue
        unit = unit_beside(clocks[k], rates)
        another = unit not in (None, ROWS, clocks[k].unit)
        if unit is not None and another and _is_as_fast(clocks[k].read_in(unit), clocks[k], others):
            found[k] = unit
        elif not clocks[k].is_usual:
            found[k] = ROWS if unit == ROWS else None
    return found


def _is_as_fast(after: Clock, before: Clock, others: Sequence[Clock]) -> bool:
    """Whether the speed of `after` is nearer to that of `others` than the speed of `before`."""
    theirs = max(float(np.median([other.speed for other in others])), 1e-300)
    new, old = (abs(np.log(max(clock.speed, 1e-300) / theirs)) for clock in (after, before))
    return bool(new < old)


def _finding(clock: Clock, unit: str | None, theirs: float | None) -> Finding:
    """Say it of `clock`; `theirs`: usual rate [Hz] of the runs that are right, None if there are none."""
    read = f"a median step of {1 / clock.rate:.4g} s, {clock.rate:.3g} Hz, {clock.duration:.4g} s in all"
    again = f"write this file again with t in {WORDS[clock.unit]} like the others"
    if unit is None:
        message = (
            f"its rate ({read}) is none of this set, whose other runs have {theirs:.3g} Hz, and no unit of time brings "
            f"it there: {again}, or leave it out"
        )
    elif unit == ROWS:
        assert theirs is not None
        step = 1 / theirs
        message = (
            f"t is not in {WORDS[clock.unit]} ({read}) but counts rows, it seems: {again}, at the {theirs:.4g} Hz that "
            f"those have 0, {step:.6g}, {2 * step:.6g}, ... s"
        )
    else:
        meant = clock.read_in(unit)
        key = f'dynid.toml: [units] time = "{unit}"'
        mend = f"say so in {key}" if theirs is None else f"{again}, or give it alone with {key}"
        message = (
            f"t is not in {WORDS[clock.unit]} ({read}) but in {WORDS[unit]}, it seems ({meant.rate:.4g} Hz, "
            f"{meant.duration:.4g} s): {mend}"
        )
    return Finding("sampling_rate", "error", message, clock.name, "t", value=clock.rate, unit="Hz")
