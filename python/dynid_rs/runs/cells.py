"""Cells and stamps of a run: what no recording is made of, refused with its place and its mend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError

FloatArray = NDArray[np.float64]

TIME_UNITS: Mapping[str, float] = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "100ns": 1e-7,
    "min": 60.0,
    "h": 3600.0,
}
"""Seconds of every unit that a file's time may be in; .NET and Windows count 100 ns."""

MIN_SAMPLES = 20
"""Fewer rows than this carry no dynamics: filters alone need as many to start."""

MIN_SPAN = 5e-3
"""A joint that stays within this range [rad, m] does not move: less is encoder noise and sag."""

MAX_GAP_STEPS = 10.0
"""A longer step than this many median steps cannot be bridged: the run must be split there."""

BURSTS = (0.6, 1.5)
"""The median step over the mean: outside of this, stamps come in bursts."""

MIN_STEP = 1e-9
"""Shorter median steps [s] come from a wrong unit or damaged numbers."""

_LONG_AGO = 1e6
"""Time that starts so late [s] counts from an epoch, not from the start of a controller."""
_NO_FRACTION = 2.0**53
"""From here on every float64 is a whole number."""

ABSURD = 1e7
"""No position, torque or acceleration of an arm has this size, in degrees and N mm neither."""


def row_text(row: int, line_of: Callable[[int], int] | None = None) -> str:
    """Name a 0-based data row for people: counted from 1, with the line where the file has lines."""
    line = "" if line_of is None else f" (line {line_of(row)})"
    return f"row {row + 1}{line}"


def check_finite(values: FloatArray, *, file: str, column: str, line_of: Callable[[int], int] | None = None) -> None:
    """Check that a column (n,) holds numbers only.

    Raises
    ------
    DataError
        NaN, infinity or an empty cell; names file, row and column.
    """
    finite = np.isfinite(values)
    if finite.all():
        return
    wrong = np.flatnonzero(~finite)
    row = int(wrong[0])
    more = f" (and {wrong.size - 1} more in this column)" if wrong.size > 1 else ""
    raise DataError(
        f"{file}, {row_text(row, line_of)}, column {column}: {values[row]} is not a finite number{more}; "
        "cut these rows out or split the run there",
        code="not_finite",
        file=file,
        column=column,
        row=row,
    )


def check_size(
    values: FloatArray, scale: float = 1.0, *, file: str, column: str, line_of: Callable[[int], int] | None = None
) -> None:
    """Check that a column (n,) of finite numbers holds no number that is absurd once multiplied by `scale`, to SI.

    Raises
    ------
    DataError
        A number beyond `ABSURD`; names file, row, column, the number in the file, and the mend.
    """
    limit = ABSURD / abs(scale)
    if -limit <= values.min() and values.max() <= limit:
        return
    wrong = np.flatnonzero(np.abs(values) > limit)
    row = int(wrong[0])
    more = f" (and {wrong.size - 1} more in this column)" if wrong.size > 1 else ""
    mend = "cut these rows out or split the run there"
    if 2 * wrong.size > values.size:
        mend = "give its unit in dynid.toml under [units], or map another column under [columns]"
    raise DataError(
        f"{file}, {row_text(row, line_of)}, column {column}: {values[row]:g} is no value that an arm has (at most "
        f"{ABSURD:g} in SI){more}; {mend}",
        code="absurd_value",
        file=file,
        column=column,
        row=row,
    )


def seconds_of(values: NDArray[Any], factor: float = 1.0, *, stamps: bool = False) -> FloatArray:
    """Time (n,) [s] of numbers times `factor`, of numpy's moments and differences of them, or of `stamps` [ns].

    Moments, stamps and large numbers are counted from the first row; a moment that is missing is NaN.
    """
    if values.dtype.kind in "mM":
        ticks = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64)
        return np.where(np.isnat(values), np.nan, seconds_of(ticks, stamps=True))
    factor = TIME_UNITS["ns"] if stamps else factor
    # Ticks since 1970 do not fit a float64, or leave it little for the steps between samples.
    whole = values.size and values.dtype.kind in "iu"
    if values.size and values.dtype.kind == "f" and _NO_FRACTION <= abs(values[0]) < np.inf:
        values = values - values[0]  # whole numbers that some program kept as floats
    elif whole and (stamps or abs(int(values[0])) * factor > _LONG_AGO):
        first = int(values[0])
        values = np.array([int(v) - first for v in values]) if values.dtype.kind == "u" else values - first
    return np.ascontiguousarray(values.astype(np.float64) * factor)


SHARED = 0.1
"""Share of the steps that are zero, and that are not, from which on stamps are rounded: repeated rows are fewer."""
ROUNDING = 0.01
"""Relative difference up to which the steps of rounded stamps are one."""


def check_time(
    t: FloatArray,
    *,
    file: str,
    column: str = "t",
    line_of: Callable[[int], int] | None = None,
    grain: float | None = None,
) -> None:
    """Check that time (n,) [s] is finite and strictly increasing, without long gaps.

    `grain`: shortest step [s] that the column's numbers can hold where they are as large as they are in the file; by
    default, where they are as large as in `t`.

    Raises
    ------
    DataError
        Fewer than 20 samples, time that stands still or goes backwards, a step of more than 10 median
        steps; names file, row and column.
    """

    def fault(code: str, row: int | None, text: str) -> DataError:
        place = "" if row is None else f", {row_text(row, line_of)}"
        return DataError(f"{file}{place}, column {column}: {text}", code=code, file=file, column=column, row=row)

    if t.shape[0] < MIN_SAMPLES:
        raise fault("too_few_samples", None, f"{t.shape[0]} samples are too few; at least {MIN_SAMPLES} are needed")
    check_finite(t, file=file, column=column, line_of=line_of)
    with np.errstate(over="ignore"):  # a damaged stamp of 1e308 is a long gap like any other
        dt = np.diff(t)
    wrong = np.flatnonzero(dt <= 0)
    if wrong.size:
        row = int(wrong[0]) + 1
        backwards = t[row] < t[row - 1]
        mend = "split the run there" if backwards else _rounded(t, dt) or "remove the repeated rows"
        if np.all(dt < 0):
            mend = "the rows stand in the reverse order, sort them by time"
        elif not np.any(dt):
            mend = 'no clock counts in this column, name another one in dynid.toml: [columns] t = "..."'
        lost = _lost(t, dt, grain)
        if lost:
            raise fault("time_stands_still", row, lost)
        raise fault(
            "time_backwards" if backwards else "time_stands_still",
            row,
            f"time {'goes backwards' if backwards else 'stands still'} from "
            f"{t[row - 1]:.9g} s to {t[row]:.9g} s"
            f" ({wrong.size} such row{'s' if wrong.size > 1 else ''}); time must strictly increase: {mend}",
        )
    median = usual_step(dt)
    if median < MIN_STEP:
        text = f"a median step of {median:.3g} s is no sampling period; is the unit of time right?"
        raise fault("time_step", None, text)
    longest = int(np.argmax(dt))
    if dt[longest] > MAX_GAP_STEPS * median:
        raise fault(
            "long_gap",
            longest + 1,
            f"a gap of {dt[longest]:.4g} s before this row ({float(dt[longest]) / median:.0f} median "
            f"steps of {median:.4g} s) cannot be bridged; split the run there",
        )


LOST = 1e-3
"""A step [s] that numbers of time have to hold: the longest one of a robot's bus."""


def _lost(t: FloatArray, dt: FloatArray, grain: float | None) -> str:
    """That numbers of time (n,) [s] are too large for their steps (n - 1,), and the mend; nothing if they are not."""
    grain = float(np.spacing(np.abs(t).max())) if grain is None else grain
    forward = dt[dt > 0]
    if np.any(dt < 0) or (forward.min() > 1.5 * grain if forward.size else grain < LOST):
        return ""
    return (
        f"{np.count_nonzero(dt == 0)} rows repeat the time before them: the numbers are so large that they hold no "
        f"step shorter than {grain:.3g} s, and the digits below are lost; write the time since the run began, or whole "
        "numbers (nanoseconds as integers)"
    )


def _rounded(t: FloatArray, dt: FloatArray) -> str:
    """What stamps (n,) [s] with steps (n - 1,) are rounded to, and the mend; nothing where rows are there twice."""
    forward = dt[dt > 0]
    if forward.size < SHARED * dt.size or forward.size > (1 - SHARED) * dt.size or np.any(dt < 0):
        return ""
    step = float(np.median(forward))
    if np.max(np.abs(forward - step)) > ROUNDING * step:
        return ""
    rate = (len(t) - 1) / float(t[-1] - t[0])
    return (
        f"the stamps are rounded to {step:.4g} s, which about {dt.size / forward.size:.2g} rows share; write them with "
        f"more digits, or, if the rows are evenly spaced, t = 0, {1 / rate:.6g}, {2 / rate:.6g}, ... s (they come at "
        f"about {rate:.4g} Hz)"
    )


def usual_step(dt: FloatArray) -> float:
    """Median of steps (n,) of time; their mean where the two contradict each other.

    Samples that are stamped when a buffer of them arrives have short steps and a long one in turn. Their mean is the
    step of the samples; the longest hundredth is left out, or a few gaps would look like that.
    """
    median = float(np.median(dt))
    mean = float(np.mean(dt[dt <= np.quantile(dt, 0.99)])) if len(dt) >= 100 else float(np.mean(dt))
    return mean if np.isfinite(mean) and not BURSTS[0] < median / mean < BURSTS[1] else median
