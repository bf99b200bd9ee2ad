"""Units of a model's numbers, joint by joint."""

from __future__ import annotations

from dynid_rs import _core
from dynid_rs.base.units import torque_of

UNITS: dict[str, str] = {c["name"]: c["unit"] for entry in _core.effect_catalogue() for c in entry["coefficients"]}
"""Of every coefficient, with places for the units of torque and angle."""
SHAPE_UNITS: dict[str, str] = {s["name"]: s["unit"] for entry in _core.effect_catalogue() for s in entry["shape"]}
"""Of every shape parameter, likewise."""


def own_unit(name: str, torque_unit: str, kind: str) -> str:
    """Unit of a joint's own coefficient `name`; `kind` is the joint's."""
    angle = "rad" if kind == "revolute" else "m"
    if name == "rotor_inertia":
        torque = torque_of(torque_unit, kind)
        return f"{torque}*s^2/{angle}" if torque == "A" else {"rad": "kg*m^2", "m": "kg"}[angle]
    return filled(UNITS.get(name, "{torque}"), torque_unit, kind)


def shape_unit(name: str, torque_unit: str, kind: str) -> str:
    """Unit of a shape parameter of a joint's effect."""
    return filled(SHAPE_UNITS.get(name, "1"), torque_unit, kind)


def load_unit(torque_unit: str, mass: str = "kg") -> str:
    """Unit of a load, or of its first moments (`mass`: kg*m): of currents it is known up to a gain."""
    return mass if torque_unit == "N*m" else f"{mass} {torque_unit}/(N*m)"


def torque_units(model: _core.TorqueModel) -> list[str]:
    """Unit of every joint's torque channel."""
    return [torque_of(model.torque_unit, kind) for kind in model.robot.joint_kinds]


def filled(unit: str, torque_unit: str, kind: str) -> str:
    """Unit of a joint's number, from one with places for the units of torque and angle; `kind` is the joint's."""
    return unit.format(torque=torque_of(torque_unit, kind), angle="rad" if kind == "revolute" else "m")
