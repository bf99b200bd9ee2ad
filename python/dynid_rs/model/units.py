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
    return _filled(UNITS.get(name, "{torque}"), torque_unit, kind)


def shape_unit(name: str, torque_unit: str, kind: str) -> str:
    """Unit of a shape parameter of a joint's effect."""
    return _filled(SHAPE_UNITS.get(name, "1"), torque_unit, kind)


def torque_units(model: _core.TorqueModel) -> list[str]:
    """Unit of every joint's torque channel."""
    return [torque_of(model.torque_unit, kind) for kind in model.robot.joint_kinds]


def _filled(unit: str, torque_unit: str, kind: str) -> str:
    return unit.format(torque=torque_of(torque_unit, kind), angle="rad" if kind == "revolute" else "m")
