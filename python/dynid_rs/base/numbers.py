"""Numbers as people read them, in plain ASCII: the terminal prints them so, and the report sets the same ones."""

from __future__ import annotations

from collections.abc import Sequence

DASH = "-"
"""Stands where nothing can be said."""
_ABSURD = 1e3


def significant(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits: 1.50, 0.0120, 1.20e-06; a dash for None."""
    if value is None:
        return DASH
    if value == 0.0:
        return "0"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    if -4 <= exponent < 5:
        return f"{value:.{max(0, digits - 1 - exponent)}f}"
    return f"{value:.{digits - 1}e}"


def percent(ratio: float | None, *, signed: bool = False) -> str:
    """`ratio` = 0.049 as 4.9 %, two significant digits (whole numbers from 10 % on)."""
    if ratio is None:
        return DASH
    if abs(ratio) >= _ABSURD:
        return f"over {100.0 * _ABSURD:.0f} %"
    number = 100.0 * ratio
    decimals = 0 if abs(number) >= 9.95 else 1 if abs(number) >= 0.095 else 2
    text = f"{number:+.{decimals}f}" if signed else f"{number:.{decimals}f}"
    return f"{text} %" if float(text) else "0 %"


def interval(bounds: Sequence[float] | None, digits: int = 3) -> str:
    """1.40 to 1.60, with as many digits as its ends need to differ; a dash for None."""
    if bounds is None:
        return DASH
    low, high = bounds
    while low != high and digits < 7 and significant(low, digits) == significant(high, digits):
        digits += 1
    return f"{significant(low, digits)} to {significant(high, digits)}"


def percent_interval(bounds: Sequence[float] | None) -> str:
    """Interval of a change: -79 to -56 %."""
    if bounds is None:
        return DASH
    low, high = (percent(bound, signed=True) for bound in bounds)
    return f"{low.removesuffix(' %')} to {high}"


def change(after: float | None, before: float | None) -> str:
    """By how much an error changed: -70 %; a dash where there was none to compare with."""
    if after is None or before is None or before <= 0.0:
        return DASH
    return percent(after / before - 1.0, signed=True)
