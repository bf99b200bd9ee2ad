"""Signals as people call them: what stands on an axis, with its unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base.units import unit_text
from dynid_rs.base.wording import QUANTITY_WORDS
from dynid_rs.report.figures import label
from dynid_rs.report.text import words

_SIGNALS = {
    "q": "angle",
    "q_motor": "motor angle",
    "dq": "speed",
    "dq_motor": "motor speed",
    "ddq": "acceleration",
    "ddq_motor": "motor acceleration",
    "tau_link": "gear torque",
    "tau_motor": "motor torque",
    "tau_rate": "rate of the torque",
    "temperature": "temperature",
    "t": "time since the start of the run",
    "way": "way since the joint last turned round",
    "angle_in_cycle": "angle within one cycle",
    "stage_speed": "speed of the stage that both joints turn",
    "deflection": "deflection of the gear",
    "column": "the effect\u2019s own signal",
}
_VALUES = ("partial", "curve", "curve_low", "curve_high", "mean")
_THOUSANDTHS = {"rad": "mrad", "m": "mm"}
_SMALL = 0.05
_PRISMATIC = {"q": "position", "q_motor": "motor position", "way": _SIGNALS["way"]}


def signal_name(signal: str, joints: Sequence[str], unit: str | None = None) -> tuple[str, str]:
    """``dq_joint_2`` as `speed` and `joint_2`; a signal that is not known stays as it is, of no joint."""
    for joint in sorted(joints, key=len, reverse=True):
        name = signal.removesuffix(f"_{joint}")
        if name != signal and name in _SIGNALS:
            return (_PRISMATIC if unit in ("m", "mm") else {}).get(name, _SIGNALS[name]), joint
    return _SIGNALS.get(signal, words(signal)), ""


def signal_words(signal: str, joints: Sequence[str], short: Mapping[str, str] | None = None) -> str:
    """``dq_joint_2`` as `speed of joint_2`; `short`: joints as they are called where there is little room.

    Words that fit joints that slide as well: without an axis there is no unit that tells them from those that turn.
    """
    name, joint = signal_name(signal, joints)
    name = {"angle": "position", "motor angle": "motor position"}.get(name, name)
    return f"{name} of {(short or {}).get(joint, joint)}" if joint else name


def axis_labels(plot: Mapping[str, Any], joints: Sequence[str]) -> tuple[str, str]:
    """Labels of both axes of an effect's curve."""
    name, joint = signal_name(plot["signal"], joints, plot.get("unit"))
    where = f" of {joint}" if joint and joint != plot.get("joint", joint) else ""
    quantity = QUANTITY_WORDS.get(plot.get("quantity") or "torque", "torque")
    return label(name + where, unit_text(plot.get("unit"))), label(quantity, unit_text(plot["value_unit"]))


def readable(plot: Mapping[str, Any], torque_unit: str) -> dict[str, Any]:
    """The plot in units whose numbers are easy to read: small angles and ways in thousandths."""
    shown = {**plot, "value_unit": plot.get("value_unit") or torque_unit}
    for unit, keys in (("unit", ("x", "curve_x")), ("value_unit", _VALUES)):
        largest = max((abs(value) for key in keys for value in plot.get(key) or []), default=0.0)
        if shown.get(unit) in _THOUSANDTHS and largest < _SMALL:
            shown |= {key: [1e3 * value for value in plot[key]] for key in keys if plot.get(key)}
            shown[unit] = _THOUSANDTHS[shown[unit]]
    return shown
