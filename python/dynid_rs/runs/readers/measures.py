"""What the columns of a signal may be measured in, and the refusal of a unit that is none of these."""

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


def unknown_unit(file: str, column: str, unit: str, signal: str) -> DataError:
    """Return the error for a column in a unit that is not known for its signal; `column` as the file calls it."""
    if signal == "temperature":
        mend = f"write it in degC, or leave it out in dynid.toml: [columns] {signal} = false"
    else:
        keys = [quantity for quantity in QUANTITIES[signal] if quantity in UNITS]
        behind = "/s" if signal.startswith("d") else ""
        units = [unit + (behind if key == "length" else "") for key in keys for unit in UNITS[key]]
        of = " or ".join(f"[units] {key}" for key in keys)
        mend = f"write it in one of {', '.join(units)}, or say in dynid.toml which of them it is: {of}"
    return DataError(
        f"{file}: the unit {shown(unit)!r} of column {shown(column)} is not known for {signal}; {mend}",
        code="unknown_unit",
        file=file,
        column=column,
    )
