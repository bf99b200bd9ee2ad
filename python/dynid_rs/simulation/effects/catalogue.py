"""Every effect that the laboratory can put in: its name, where it acts by itself, and who builds it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from dynid_rs.simulation.arm import SimulatedArm
from dynid_rs.simulation.effects import column_kinds, kinds
from dynid_rs.simulation.effects.base import LabEffect
from dynid_rs.simulation.effects.site import Site

Where = Literal["every joint", "turning joints", "loaded joint", "loaded turning joint", "pair", "one joint", "robot"]
"""Where an effect acts when no joint is named: all joints it can have, the one that gravity loads most, a
joint and its neighbour at the wrist, the second joint, or the whole robot (then no joint can be named)."""

_TURNING = ("turning joints", "loaded turning joint")


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
    """

    name: str
    where: Where
    default: str
    build: Callable[[Site, tuple[int, ...], float], LabEffect]
    either_sign: bool = False


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

_BY_NAME = {kind.name: kind for kind in KINDS}


def kind_names() -> tuple[str, ...]:
    """Names of all kinds."""
    return tuple(_BY_NAME)


@dataclass(frozen=True)
class Wish:
    """An effect as it is asked for: `KIND[:joint[:size]]`."""

    kind: str
    joint: str | None = None
    size: float = 1.0


def parse_wish(text: str) -> Wish:
    """Read `KIND[:joint[:size]]`; an empty joint means the kind's own place.

    Raises
    ------
    ValueError
        Unknown kind, or a size that is not a finite number other than 0.
    """
    kind, _, rest = text.partition(":")
    joint, _, size_text = rest.partition(":")
    if kind not in _BY_NAME:
        raise ValueError(f"effect {kind!r} cannot be simulated; there are {', '.join(_BY_NAME)}")
    try:
        size = float(size_text) if size_text else 1.0
    except ValueError:
        size = float("nan")
    if not isfinite(size) or size == 0:
        raise ValueError(
            f"effect {text!r}: the size must be a number other than 0, got {size_text!r}; 1 is the default"
        )
    if size < 0 and not _BY_NAME[kind].either_sign:
        raise ValueError(f"effect {text!r}: the size of {kind} must be positive, got {size:g}")
    return Wish(kind, joint or None, size)


def build_effect(wish: Wish, arm: SimulatedArm) -> LabEffect:
    """Make an effect of a plausible size for an arm.

    Parameters
    ----------
    wish : Wish
        What is asked for.
    arm : SimulatedArm
        The arm with all its gears, as `typical_arm` gives it: default sizes follow it.

    Raises
    ------
    ValueError
        No such joint, or an effect that this arm or this joint cannot have.
    """
    kind, site = _BY_NAME[wish.kind], Site(arm)
    return kind.build(site, _joints(kind, wish.joint, site), wish.size)


def build_effects(wishes: Sequence[Wish], arm: SimulatedArm) -> tuple[LabEffect, ...]:
    """`build_effect` of each; the same kind must not act twice on one joint."""
    effects = tuple(build_effect(wish, arm) for wish in wishes)
    for index, effect in enumerate(effects):
        for other in effects[:index]:
            if other.kind == effect.kind and set(other.joints) & set(effect.joints):
                raise ValueError(f"effect {effect.kind!r} is there twice for the same joint; give it once, with a size")
    return effects


def _joints(kind: Kind, joint: str | None, site: Site) -> tuple[int, ...]:
    names = site.arm.robot.joint_names
    everywhere = tuple(range(site.n_joints))
    if kind.where == "robot":
        if joint is not None:
            raise ValueError(
                f"{kind.name} acts on the whole robot; leave the joint {joint!r} out, as in {kind.name}::2"
            )
        return everywhere
    able = tuple(j for j in everywhere if site.turning[j] or kind.where not in _TURNING)
    if not able:
        raise ValueError(f"{kind.name} needs a joint that turns, and this robot has none")
    if kind.where == "pair" and site.n_joints < 2:
        raise ValueError(f"{kind.name} needs two joints, and this robot has one")
    if joint is None:
        return _own_place(kind, able, site)
    index = _index(kind, joint, names)
    if index not in able:
        raise ValueError(f"{kind.name} needs a joint that turns, and joint {names[index]!r} slides")
    return _with_neighbour(index) if kind.where == "pair" else (index,)


def _own_place(kind: Kind, able: tuple[int, ...], site: Site) -> tuple[int, ...]:
    if kind.where in ("loaded joint", "loaded turning joint"):
        return (max(able, key=lambda j: site.holding[j]),)
    if kind.where == "one joint":
        return (able[min(1, len(able) - 1)],)
    if kind.where == "pair":
        return _with_neighbour(able[-1])
    return able


def _with_neighbour(joint: int) -> tuple[int, ...]:
    """The joint and the one before it; the first joint's neighbour is the second."""
    return (joint, joint - 1 if joint else 1)


def _index(kind: Kind, joint: str, names: Sequence[str]) -> int:
    if joint in names:
        return list(names).index(joint)
    if joint.isascii() and joint.isdigit() and int(joint) < len(names):
        return int(joint)
    known = ", ".join(names)
    raise ValueError(f"effect {kind.name}: there is no joint {joint!r}; joints are {known}, or 0 to {len(names) - 1}")
