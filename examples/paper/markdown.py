"""Tables and sentences in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

JOINTS = tuple(f"joint {j + 1}" for j in range(6))


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; numbers stand to the right."""
    lines = [list(header), ["---", *["---:"] * (len(header) - 1)], *(list(row) for row in rows)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines) + "\n"


def numbers(values: Iterable[float], digits: int) -> list[str]:
    """Values with that many digits behind the point."""
    return [f"{value:.{digits}f}" for value in values]


def significant(values: Iterable[float], digits: int = 4) -> list[str]:
    """Values with that many digits in all, none of them in powers of ten."""
    return [np.format_float_positional(value, digits, fractional=False, trim="-") for value in values]


def percent(changes: Iterable[float]) -> list[str]:
    """Changes in percent with their sign."""
    return [f"{100 * change:+.1f}" for change in changes]


def listed(words: Sequence[str]) -> str:
    """Words as an enumeration: "1, 2 and 3"."""
    words = [str(word) for word in words]
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def joints_where(condition: np.ndarray) -> str:
    """Words for the joints that meet a condition (n_joints,): "joints 2 and 4"."""
    found = [str(j + 1) for j in np.flatnonzero(condition)]
    if not found:
        return "no joint"
    if len(found) == len(condition):
        return "every joint"
    return ("joint " if len(found) == 1 else "joints ") + listed(found)


def duration(seconds: float) -> str:
    """A time in a unit that suits it."""
    if seconds >= 1:
        return f"{seconds:.1f} s"
    return f"{1e3 * seconds:.3g} ms" if seconds >= 1e-3 else f"{1e6 * seconds:.2g} µs"
