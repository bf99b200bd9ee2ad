"""Causes in words: where, what, how much, and how far that is from the type."""

from __future__ import annotations

from dynid_rs.base.changes import kind_words
from dynid_rs.base.numbers import percent, significant
from dynid_rs.base.units import plain_unit
from dynid_rs.pooling.causes import Cause


def sentence_of(cause: Cause) -> str:
    """`elbow: friction +34 % (type 12.1 +- 1.1 N*m at 0.80 rad/s, 9.4 deviations)`."""
    return f"{cause.place}: {what(cause)} ({known(cause)})"


def what(cause: Cause) -> str:
    """`friction +34 %`, `load or another tool, +0.510 kg`: what has changed and by how much, without the place."""
    if cause.kind == "load":
        if cause.std_error is None or cause.std_error > 0.5 * abs(cause.size):
            return "load or another tool, its mass not told"
        size = f"{_signed(cause.size)} +- {significant(cause.std_error, 2)} {plain_unit(cause.unit)}"
        return f"load or another tool, {size}"
    if cause.kind == "error":
        return f"error on test runs {percent(cause.change, signed=True)}, and no parameter says why"
    name = {"coefficient": cause.name.replace("_", " "), "base": _short(cause.name)}.get(
        cause.kind, kind_words(cause.kind)
    )
    size = f"{_signed(cause.size)} {plain_unit(cause.unit)}".rstrip()
    return f"{name} {size if cause.change is None else percent(cause.change, signed=True)}"


def known(cause: Cause) -> str:
    """`type 12.1 +- 1.1 N*m at 0.80 rad/s, 9.4 deviations`."""
    far = f"{abs(cause.deviations):.1f} deviations"
    if cause.mean is None or cause.kind == "error":
        return far
    if cause.kind == "gain":
        return f"type +- {percent(cause.spread)}, {far}"
    at = "" if cause.at is None else f" at {significant(cause.at, 2)} {cause.at_unit}"
    unit = plain_unit(cause.unit)
    return f"type {significant(cause.mean)} +- {significant(cause.spread, 2)} {unit}{at}, {far}"


def _signed(value: float) -> str:
    return f"{'-' if value < 0 else '+'}{significant(abs(value))}"


def _short(name: str) -> str:
    first, _, rest = name.partition(" ")
    return f"{first} and what moves with it" if rest else first
