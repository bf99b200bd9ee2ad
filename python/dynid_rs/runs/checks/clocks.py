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
ANOTHER_CLOCK = 100.0
"""Runs of one set are sampled within this factor of each other: 50 Hz and 4 kHz may be one set. In between two units
(1000) and what no two loggers of one arm differ by."""
TOP = 98
"""Percentile of the speed that stands for its top: damaged samples are fewer."""

WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds", "100ns": "steps of 100 ns"}
GUESSED = ("s", "ms", "us", "ns")
"""Units that a rate may tell from each other. 100 ns are too near to two of them: the size of stamps tells those."""


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

    @property
    def is_usual(self) -> bool:
        """Whether rate and duration are those of a robot's log."""
        return USUAL_RATES[0] <= self.rate <= USUAL_RATES[1] and self.duration >= SHORTEST

    @property
    def is_slow_or_fast(self) -> bool:
        """Whether no joint moves as an arm's does."""
        return not USUAL_SPEEDS[0] <= self.speed <= USUAL_SPEEDS[1]


def likely_unit(clock: Clock, rate: float | None = None) -> str | None:
    """Unit that makes `clock` a robot's log, of about `rate` [Hz] where other runs say so; None if there is none."""
    rate = MIDDLE_RATE if rate is None else rate
    if clock.unit not in GUESSED and clock.is_usual:
        return clock.unit
    units = [unit for unit in GUESSED if clock.read_in(unit).is_usual]
    return min(units, key=lambda unit: clock.read_in(unit).oddity(rate), default=None)


def clock_findings(clocks: Sequence[Clock]) -> dict[int, Finding]:
    """Runs of one set, or a lone run, whose time is in another unit than it was read in.

    A run by itself: its rate is none (`MIN_RATE`, `MAX_RATE`), or rate and speed are both unusual and another unit
    makes both usual. Beside others: its rate is another one by `ANOTHER_CLOCK`, and another unit brings it to theirs.

    Returns
    -------
    dict of int to Finding
        An error ``sampling_rate`` for each place in `clocks` of such a run.
    """
    wrong = {k: unit for k, clock in enumerate(clocks) if (unit := _alone(clock)) is not None}
    rates = [clock.rate for k, clock in enumerate(clocks) if k not in wrong]
    usual = float(np.median(rates)) if rates else None
    if usual is not None:
        wrong = {k: likely_unit(clocks[k], usual) or unit for k, unit in wrong.items()}
        wrong |= _among(clocks, [k for k in range(len(clocks)) if k not in wrong])
    return {k: _finding(clocks[k], wrong[k], lonely=len(wrong) == len(clocks)) for k in sorted(wrong)}


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


def _among(clocks: Sequence[Clock], places: Sequence[int]) -> dict[int, str]:
    """Runs at `places`, each possible by itself, that another unit makes like the rest: place and unit."""
    found: dict[int, str] = {}
    # Of two runs that contradict each other the odder one is taken to be wrong.
    for k in sorted(places, key=lambda place: -clocks[place].oddity(MIDDLE_RATE)):
        others = [clocks[other] for other in places if other != k and other not in found]
        if not others:
            continue
        rate = float(np.median([other.rate for other in others]))
        unit = likely_unit(clocks[k], rate)
        if unit is None or unit == clocks[k].unit:
            continue
        other_speed = max(float(np.median([other.speed for other in others])), 1e-300)
        before, after = (abs(np.log(max(c.speed, 1e-300) / other_speed)) for c in (clocks[k], clocks[k].read_in(unit)))
        far = max(clocks[k].rate / rate, rate / clocks[k].rate) > ANOTHER_CLOCK
        if far and after < before:
            found[k] = unit
    return found


def _finding(clock: Clock, unit: str, *, lonely: bool) -> Finding:
    meant = clock.read_in(unit)
    mend = f'say so in dynid.toml: [units] time = "{unit}"'
    if not lonely:
        mend = (
            f"write this file again with t in {WORDS[clock.unit]} like the others, or give it alone with dynid.toml: "
            f'[units] time = "{unit}"'
        )
    return Finding(
        "sampling_rate",
        "error",
        f"t is not in {WORDS[clock.unit]} (a median step of {1 / clock.rate:.4g} s, {clock.rate:.3g} Hz, "
        f"{clock.duration:.4g} s in all) but in {WORDS[unit]}, it seems ({meant.rate:.4g} Hz, "
        f"{meant.duration:.4g} s): {mend}",
        clock.name,
        "t",
        value=clock.rate,
        unit="Hz",
    )
