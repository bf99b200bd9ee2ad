"""Words and numbers of the report: escaped text, significant digits, units as people write them.

Numbers are those of the terminal (`base/numbers.py`), set as print sets them: a minus sign, spaces that do not break.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base import numbers
from dynid_rs.base.units import SUPERSCRIPTS, unit_text

DASH = "\u2013"
MINUS = "\u2212"
NBSP = "\u00a0"
PLUS_MINUS = "\u00b1"

_MAX_DECIMALS = 9


def esc(value: object) -> str:
    """HTML-escaped text, safe in element content and in quoted attributes."""
    return html.escape(str(value), quote=True)


def breakable(name: str) -> str:
    """Escaped name that may break after an underscore or a slash."""
    return re.sub(r"([_/])", r"\1<wbr>", esc(name))


def typeset(text: str) -> str:
    """A number of the terminal as print sets it."""
    if text == numbers.DASH:
        return DASH
    text = re.sub(r"e([+-]\d+)", lambda power: f"\u00d710{str(int(power[1])).translate(SUPERSCRIPTS)}", text)
    text = text.replace("100000 %", "100\u202f000 %").replace("over ", f"over{NBSP}")
    return text.replace("-", MINUS).replace(" %", f"{NBSP}%")


def significant(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant digits, 1.50, 0.0120, 1.20 x 10^-6; a dash for None."""
    return typeset(numbers.significant(value, digits))


def value_with_error(value: float | None, std_error: float | None) -> tuple[str, str]:
    """Value and standard error, rounded where the error has two significant digits."""
    if value is None or std_error is None or std_error <= 0.0:
        return significant(value, 4), significant(std_error, 2)
    exponent = int(f"{std_error:.1e}".partition("e")[2])
    decimals = max(0, 1 - exponent)
    if decimals > _MAX_DECIMALS or abs(value) >= 1e7 or std_error >= 1e7:
        return significant(value, 4), significant(std_error, 2)
    return typeset(f"{value:.{decimals}f}"), f"{std_error:.{decimals}f}"


def percent(ratio: float | None, *, signed: bool = False) -> str:
    """`ratio` = 0.049 as 4.9 %, two significant digits (whole numbers from 10 % on)."""
    return typeset(numbers.percent(ratio, signed=signed))


def interval(bounds: Sequence[float] | None, digits: int = 3) -> str:
    """1.40 to 1.60, or a dash."""
    return typeset(numbers.interval(bounds, digits))


def percent_interval(bounds: Sequence[float] | None) -> str:
    """Interval of a change, or a dash."""
    return typeset(numbers.percent_interval(bounds))


def change(after: float | None, before: float | None) -> str:
    """By how much an error changed, or a dash."""
    return typeset(numbers.change(after, before))


def count(number: float | None) -> str:
    """12 345, digits in groups of three that do not break."""
    return DASH if number is None else f"{int(number):,}".replace(",", "\u202f")


def plural(number: int, one: str, many: str | None = None) -> str:
    """`1 run`, `3 runs`."""
    return f"{count(number)}{NBSP}{one if number == 1 else many or one + 's'}"


def urgent_words(findings: Sequence[Mapping[str, Any]]) -> str:
    """`1 error and 2 warnings` among findings; `0 warnings` where there is neither."""
    bad = sum(finding["severity"] == "error" for finding in findings)
    others = sum(finding["severity"] not in ("error", "info") for finding in findings)
    listed = [plural(bad, "error")] if bad else []
    return join_words([*listed, *([plural(others, "warning")] if others or not bad else [])])


def with_unit(text: str, unit: str | None) -> str:
    """Join number and unit so that they stay on one line."""
    return f"{text}{NBSP}{unit_text(unit)}".rstrip(NBSP)


def words(identifier: str) -> str:
    """``load_dependent_friction`` as people write it."""
    return identifier.replace("_dependent_", "-dependent ").replace("_", " ")


def capital(text: str) -> str:
    """A sentence's first letter."""
    return text[:1].upper() + text[1:]


def file_names(names: Sequence[str]) -> str:
    """HTML: names of files as code, or `none`."""
    return ", ".join(f"<code>{esc(name)}</code>" for name in names) or "none"


def join_words(items: Sequence[str], last: str = "and") -> str:
    """Join as in `a, b and c`."""
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + f" {last} " + items[-1] if items else ""


def with_code(text: str) -> str:
    """HTML of a sentence; what stands between backticks is a command."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", esc(text))


def short_names(names: Sequence[str]) -> list[str]:
    """Names without the words that all of them begin with, where what is left still tells them apart."""
    if len(names) < 2:
        return list(names)
    parts = [re.findall(r"[^_/.\-]+[_/.\-]*|[_/.\-]+", name) for name in names]
    shared = 0
    while all(len(part) > shared + 2 for part in parts) and len({part[shared] for part in parts}) == 1:
        shared += 1
    short = ["".join(part[shared:]) for part in parts]
    return short if len(set(short)) == len(names) else list(names)


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
