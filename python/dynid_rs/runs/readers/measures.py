"""What the columns of a signal may be measured in, and what is said of a unit that is none of these."""

from __future__ import annotations

from collections.abc import Mapping

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.config import UNITS

QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "t": ("time",),
    "q": ("angle", "length"),
    "q_motor": ("angle", "length"),
    "q_reference": ("angle", "length"),
    "dq": ("velocity", "length"),
    "dq_motor": ("velocity", "length"),
    "tau": ("torque", "current", "percent"),
    "current": ("current", "torque", "percent"),
    "temperature": ("temperature",),
}
"""Of other signals (accelerations, which are held against the position) no unit is looked at."""


def measured(signal: str, told: tuple[str, str]) -> tuple[str, str]:
    """Quantity and unit of a signal's column, where what a file says of a velocity may be an angle or a length."""
    quantity, unit = told
    if signal in ("dq", "dq_motor"):
        return {"angle": ("velocity", f"{unit}/s"), "length/s": ("length", unit)}.get(quantity, told)
    return told


def other_unit(file: str, column: str, unit: str, signal: str) -> DataError:
    """Return the error for a column in a unit of another quantity; `column` as the file calls it."""
    return DataError(
        f"{file}: {shown(unit)}, the unit of column {shown(column)}, is none of {signal}; {_mend(signal)}",
        code="unknown_unit",
        file=file,
        column=column,
    )


def unknown_unit(column: str, unit: str, signal: str) -> str:
    """Return the sentence on a column beside which something stands that may be a unit, and none that is known."""
    read = {"t": "s", "temperature": "degC"}.get(signal) or next(iter(UNITS[QUANTITIES[signal][0]]))
    return (
        f"{shown(unit)}, beside column {shown(column)}, is no unit that is known, and {signal} is read in {read}; "
        f"if it is a unit, {_mend(signal)}"
    )


def _mend(signal: str) -> str:
    if signal == "temperature":
        return f"write it in degC, or leave it out in dynid.toml: [columns] {signal} = false"
    keys = [quantity for quantity in QUANTITIES[signal] if quantity in UNITS]
    behind = "/s" if signal.startswith("d") else ""
    units = [unit + (behind if key == "length" else "") for key in keys for unit in UNITS[key]]
    of = " or ".join(f"[units] {key}" for key in keys)
    return f"write it in one of {', '.join(units)}, or say in dynid.toml which of them it is: {of}"
