"""Words and numbers of the report: escaped text, significant digits, units as people write them."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Sequence

DASH = "\u2013"
MINUS = "\u2212"
NBSP = "\u00a0"
PLUS_MINUS = "\u00b1"

_SUPERSCRIPTS = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
_MAX_DECIMALS = 9
_ABSURD = 1e3


def esc(value: object) -> str:
    """HTML-escaped text, safe in element content and in quoted attributes."""
    return html.escape(str(value), quote=True)


def plot_text(value: object) -> str:
    """Text for plotly, which reads markup but does not know the entity of a quotation mark."""
    return html.escape(str(value), quote=False)


def breakable(name: str) -> str:
    """Escaped name that may break after an underscore or a slash."""
    return re.sub(r"([_/])", r"\1<wbr>", esc(name))


def significant(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits, 1.50, 0.0120, 1.2 x 10^-6; a dash for None."""
    if value is None:
        return DASH
    if value == 0.0:
        return "0"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    if -4 <= exponent < 5:
        return _signed(f"{value:.{max(0, digits - 1 - exponent)}f}")
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    return _signed(f"{mantissa}\u00d710{str(int(power)).translate(_SUPERSCRIPTS)}")


def value_with_error(value: float | None, std_error: float | None) -> tuple[str, str]:
    """Value and standard error, rounded where the error has two significant digits."""
    if value is None or std_error is None or std_error <= 0.0:
        return significant(value, 4), significant(std_error, 2)
    exponent = int(f"{std_error:.1e}".partition("e")[2])
    decimals = max(0, 1 - exponent)
    if decimals > _MAX_DECIMALS or abs(value) >= 1e7 or std_error >= 1e7:
        return significant(value, 4), significant(std_error, 2)
    return _signed(f"{value:.{decimals}f}"), f"{std_error:.{decimals}f}"


def percent(ratio: float | None, *, signed: bool = False) -> str:
    """`ratio` = 0.049 as 4.9 %, two significant digits (whole numbers from 10 % on)."""
    if ratio is None:
        return DASH
    if abs(ratio) >= _ABSURD:
        return f"over{NBSP}{count(100.0 * _ABSURD)}{NBSP}%"
    number = 100.0 * ratio
    decimals = 0 if abs(number) >= 9.95 else 1 if abs(number) >= 0.095 else 2
    text = f"{number:+.{decimals}f}" if signed else f"{number:.{decimals}f}"
    return _signed(text) + NBSP + "%"


def interval(bounds: Sequence[float] | None, digits: int = 3) -> str:
    """1.40 to 1.60, or a dash."""
    if bounds is None:
        return DASH
    return f"{significant(bounds[0], digits)} to {significant(bounds[1], digits)}"


def count(number: float | None) -> str:
    """12 345, digits in groups of three that do not break."""
    return DASH if number is None else f"{int(number):,}".replace(",", "\u202f")


def plural(number: int, one: str, many: str | None = None) -> str:
    """`1 run`, `3 runs`."""
    return f"{count(number)}{NBSP}{one if number == 1 else many or one + 's'}"


def unit_text(unit: str | None) -> str:
    """``N*m*s^2/rad^2`` as people write it; nothing for the unit ``1``."""
    if not unit or unit == "1":
        return ""
    dotted = re.sub(r"\^(-?\d+)", lambda power: power[1].translate(_SUPERSCRIPTS), unit).replace("*", "\u00b7")
    return {"degC": "\u00b0C"}.get(dotted, dotted)


def with_unit(text: str, unit: str | None) -> str:
    """Join number and unit so that they stay on one line."""
    return f"{text}{NBSP}{unit_text(unit)}".rstrip(NBSP)


def words(identifier: str) -> str:
    """``load_dependent_friction`` as words."""
    return identifier.replace("_", " ")


def file_names(names: Sequence[str]) -> str:
    """HTML: names of files as code, or `none`."""
    return ", ".join(f"<code>{esc(name)}</code>" for name in names) or "none"


def join_words(items: Sequence[str]) -> str:
    """Join as in `a, b and c`."""
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1] if items else ""


def median(values: Sequence[float | None]) -> float | None:
    """Median of what is known; None where nothing is."""
    known = sorted(value for value in values if value is not None and math.isfinite(value))
    if not known:
        return None
    middle = len(known) // 2
    return known[middle] if len(known) % 2 else 0.5 * (known[middle - 1] + known[middle])


def geometric_mean(values: Sequence[float | None]) -> float | None:
    """Geometric mean of the positive numbers that are known; None where nothing is."""
    known = [value for value in values if value is not None and math.isfinite(value) and value > 0]
    return math.exp(sum(map(math.log, known)) / len(known)) if known else None


def ratio(value: float | None, reference: float | None) -> float | None:
    """`value / reference`; None where that means nothing."""
    if value is None or reference is None or reference <= 0.0:
        return None
    share = value / reference
    return share if math.isfinite(share) else None


def _signed(text: str) -> str:
    return text.replace("-", MINUS)
