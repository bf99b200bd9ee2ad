"""What counts as the right name: equal names of one thing, kinds without a joint, parameters as a report calls them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

WHOLE_ROBOT = ("gravity_tilt", "payload", "encoder_delay")
"""Kinds that have no joint: a report may name any."""
ACCEPTED = {
    # A session that warms up: told by thermometers or by time, both are right.
    "thermal_drift": ("thermal_drift", "thermal_friction", "temperature_friction"),
}
"""Kind that was put in to the names that are right; its own name by default."""
COMPANIONS = {
    # The laboratory's elastic gears have tooth friction with a memory and a gear error besides.
    "joint_elasticity": ("friction_hysteresis", "torque_ripple", "encoder_eccentricity"),
    "nonlinear_elasticity": ("joint_elasticity", "friction_hysteresis", "torque_ripple", "encoder_eccentricity"),
}
"""Kind that was put in to further kinds that are true of the same joints, but need not be named."""
AS_FINDING = ("torque_delay", "encoder_delay", "torque_gain", "encoder_eccentricity")
"""Faults of sensors and clocks may be named as findings instead of effects."""
LOUD = ("warning", "error")
"""Severities of findings that accuse; an "info" may be right but is never a false attribution."""
CONTACT = "contact"
"""Codes of findings that name windows of contact hold this word."""


def accepted(kind: str) -> tuple[str, ...]:
    """Names that are right for a kind that was put in."""
    return ACCEPTED.get(kind, (kind,))


def signal_name(name: str) -> str:
    """One name per signal: with rigid gears both sides are one, and a load is a load."""
    for old, new in (("dq_motor_", "dq_"), ("q_motor_", "q_"), ("load_", "tau_link_"), ("tau_predicted_", "tau_link_")):
        if name.startswith(old):
            name = new + name.removeprefix(old)
    return name


def expected(told: Mapping[str, Any], joint: str) -> dict[str, float]:
    """True parameters of one effect at one joint, under every name that a report may use for them.

    Parameters
    ----------
    told : mapping
        The effect as the truth tells it.
    joint : str
        One of its joints.
    """
    at = told["joints"].index(joint) if joint in told["joints"] else 0
    numbers: dict[str, float] = {}
    for parameter in told["parameters"]:
        name, value = parameter["name"], parameter["value"]
        if name in _PARTS.get(told["kind"], {}):
            numbers |= dict(zip(_PARTS[told["kind"]][name], value, strict=True))
        elif isinstance(value, list):
            numbers[name] = value[at]
        else:
            numbers[name] = value
    if told["kind"] == "encoder_eccentricity":
        # amplitude sin(q + phase) = cosine cos q + sine sin q
        numbers["cosine"] = numbers["amplitude"] * np.sin(numbers["phase"])
        numbers["sine"] = numbers["amplitude"] * np.cos(numbers["phase"])
    return {alias: float(value) for name, value in numbers.items() for alias in _ALIASES.get(name, (name,))}


_PARTS = {
    "payload": {"parameters": ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")},
    "kinematic_error": {"offset": ("x", "y", "z"), "turn": ("rx", "ry", "rz")},
}
"""Parameters whose list is no list per joint, and the names of its parts."""
_ALIASES = {
    "m": ("m", "mass"),
    "x": ("x", "offset_x"),
    "y": ("y", "offset_y"),
    "z": ("z", "offset_z"),
    "rx": ("rx", "turn_x"),
    "ry": ("ry", "turn_y"),
    "rz": ("rz", "turn_z"),
    "delay": ("delay", "torque_delay", "encoder_delay"),
    "gain": ("gain", "torque_gain"),
    "cosine": ("cosine", "eccentricity_cos"),
    "sine": ("sine", "eccentricity_sin"),
}
"""True parameters and what a report may call them."""
