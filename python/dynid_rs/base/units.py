"""Units as people write them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

SUPERSCRIPTS = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")


def unit_text(unit: str | None) -> str:
    """``N*m*s^2/rad^2`` as people write it; nothing for the unit ``1``."""
    if not unit or unit == "1":
        return ""
    dotted = re.sub(r"\^(-?\d+)", lambda power: power[1].translate(SUPERSCRIPTS), unit).replace("*", "\u00b7")
    return {"degC": "\u00b0C"}.get(dotted, re.sub(r"\((\w+)\)", r"\1", dotted))


def plain_unit(unit: str) -> str:
    """``1/(A)^2`` as it is typed, ``1/A^2``; nothing for the unit ``1``."""
    return "" if unit == "1" else re.sub(r"\((\w+)\)", r"\1", unit)


def angle_units(kinds: tuple[str, ...] | list[str]) -> list[str]:
    """Unit of each joint's position: rad where it turns, m where it slides."""
    return ["m" if kind == "prismatic" else "rad" for kind in kinds]


def torque_of(torque_unit: str, kind: str) -> str:
    """Unit of a joint's torque channel: a force where it slides."""
    return "N" if kind == "prismatic" and torque_unit == "N*m" else torque_unit


def torques_told(result: Mapping[str, Any]) -> list[str]:
    """Unit of each joint's torque as `result.json` holds it; earlier versions wrote one for all."""
    return list(result.get("torque_units") or [result["torque_unit"]] * len(result["joints"]))


def torques_said(units: Sequence[str]) -> str:
    """Units of all joints' torques in one heading: ``N*m``, or ``N*m, N where it slides``."""
    turning = [unit for unit in units if unit != "N"]
    return "N" if not turning else turning[0] + ", N where it slides" * ("N" in units)


def labelled(quantity: str, unit: str) -> str:
    """Label of an axis: ``torque [N·m]``."""
    text = unit_text(unit)
    return f"{quantity} [{text}]" if text else quantity
