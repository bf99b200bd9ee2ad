"""Every effect that the laboratory can put in: its name, where it acts by itself, and who builds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from dynid_rs.simulation.effects import column_kinds, kinds
from dynid_rs.simulation.effects.base import LabEffect
from dynid_rs.simulation.effects.site import Site

Where = Literal["every joint", "turning joints", "loaded joint", "loaded turning joint", "pair", "one joint", "robot"]
"""Where an effect acts when no joint is named: all joints it can have, the one that gravity loads most, a
joint and its neighbour at the wrist, the second joint, or the whole robot (then no joint can be named)."""

TURNING = ("turning joints", "loaded turning joint")


@dataclass(frozen=True)
class Kind:
    """One kind of effect.

    Parameters
    ----------
    name : str
        As in reports.
    where : str
        Where it acts when no joint is named.
    default : str
        What size 1 means, for people.
    build : callable
        (site, joints, size) -> LabEffect.
    either_sign : bool
        Whether the size may be negative.
    needs_another : bool
        Whether another joint has to be there, although it acts on one alone.
    """

    name: str
    where: Where
    default: str
    build: Callable[[Site, tuple[int, ...], float], LabEffect]
    either_sign: bool = False
    needs_another: bool = False


KINDS: tuple[Kind, ...] = (
    Kind(
        "joint_elasticity",
        "turning joints",
        "2 mrad of wind-up at the effort limit, with damping, hysteresis and 4 arc seconds of kinematic error",
        kinds.joint_elasticity,
    ),
    Kind(
        "nonlinear_elasticity",
        "turning joints",
        "the same gears, 20 % stiffer at the effort limit",
        kinds.nonlinear_elasticity,
        either_sign=True,
    ),
    Kind("backlash", "every joint", "a gap of 0.3 mrad (mm), closed within 1 % of the effort limit", kinds.backlash),
    Kind(
        "gravity_tilt",
        "robot",
        "base turned by a roll of 2 and a pitch of -1.5 degrees",
        kinds.gravity_tilt,
        either_sign=True,
    ),
    Kind("payload", "robot", "a box on the last link that weighs 15 % of an effort limit", kinds.payload),
    Kind(
        "kinematic_error",
        "one joint",
        "frame of the second joint off by (3, -2, 3) mm and (6, 6, -4) mrad",
        kinds.kinematic_error,
        either_sign=True,
    ),
    Kind("torque_gain", "every joint", "torque channel shows 5 % too much", kinds.torque_gain, either_sign=True),
    Kind("torque_delay", "every joint", "torque channel 5 ms late", kinds.torque_delay),
    Kind(
        "encoder_delay", "robot", "link channel 2.8 ms behind the motor channel", kinds.encoder_delay, either_sign=True
    ),
    Kind(
        "encoder_eccentricity",
        "turning joints",
        "link encoder errs by 1 mrad once per turn",
        kinds.encoder_eccentricity,
        either_sign=True,
    ),
    Kind("contact", "robot", "pushes on the last link that take 30 % of an effort limit", kinds.contact),
    Kind(
        "thermal_drift",
        "robot",
        "friction falls by 30 % as the arm warms up over the session, time constant 120 s; adds thermometers",
        kinds.thermal_drift,
    ),
    Kind(
        "stribeck",
        "every joint",
        "3 % of the effort limit at standstill, falling over 5 % of the greatest speed",
        column_kinds.stribeck,
    ),
    Kind(
        "load_dependent_friction",
        "every joint",
        "6 % of the link torque, 8 % at the greatest speed",
        column_kinds.load_dependent_friction,
    ),
    Kind(
        "bearing_friction",
        "turning joints",
        "4 % of the link torque of the joint behind (of the last joint: before it)",
        column_kinds.bearing_friction,
        needs_another=True,
    ),
    Kind(
        "position_dependent_friction",
        "turning joints",
        "2.2 % of the effort limit, once per turn",
        column_kinds.position_dependent_friction,
        either_sign=True,
    ),
    Kind(
        "friction_hysteresis",
        "every joint",
        "3 % of the effort limit, turning round over 10 mrad (mm)",
        column_kinds.friction_hysteresis,
    ),
    Kind(
        "load_hysteresis",
        "every joint",
        "6 % of the link torque, turning round over 10 mrad (mm)",
        column_kinds.load_hysteresis,
    ),
    Kind(
        "coupled_friction",
        "pair",
        "3 % of the weaker joint's effort limit on both, at the sum of their speeds",
        column_kinds.coupled_friction,
    ),
    Kind(
        "torque_ripple",
        "turning joints",
        "1.1 % of the effort limit 16 times per turn, and a third of that 32 times",
        column_kinds.torque_ripple,
        either_sign=True,
    ),
    Kind(
        "inertial_coupling",
        "pair",
        "30 % of the mean rotor inertia of two neighbours, each feeling the other",
        column_kinds.inertial_coupling,
        either_sign=True,
    ),
    Kind(
        "joint_spring",
        "loaded joint",
        "10 % of the effort limit per rad (m) from the middle of the range",
        column_kinds.joint_spring,
    ),
    Kind(
        "counterbalance",
        "loaded turning joint",
        "gas cylinder of up to 30 % of the effort limit, mounted against gravity",
        column_kinds.counterbalance,
    ),
    Kind(
        "torque_saturation",
        "every joint",
        "5 % too much torque at the effort limit, with the cube of the load",
        column_kinds.torque_saturation,
        either_sign=True,
    ),
    Kind(
        "thermal_friction",
        "every joint",
        "friction falls by 30 % with a time constant of 60 s in every run, which starts cold",
        column_kinds.thermal_friction,
    ),
)
"""In the order of the documentation."""

BY_NAME = {kind.name: kind for kind in KINDS}


def kind_names() -> tuple[str, ...]:
    """Names of all kinds."""
    return tuple(BY_NAME)
