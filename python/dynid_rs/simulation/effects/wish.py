"""Effects as they are asked for, `KIND[:joint[:size]]`, and the refusals of what cannot be had."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from dynid_rs.simulation.arm import SimulatedArm
from dynid_rs.simulation.effects.base import LabEffect
from dynid_rs.simulation.effects.catalogue import BY_NAME, TURNING, Kind
from dynid_rs.simulation.effects.site import Site


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
    if kind not in BY_NAME:
        raise ValueError(f"effect {kind!r} cannot be simulated; there are {', '.join(BY_NAME)}")
    try:
        size = float(size_text) if size_text else 1.0
    except ValueError:
        size = float("nan")
    if not isfinite(size) or size == 0:
        raise ValueError(
            f"effect {text!r}: the size must be a number other than 0, got {size_text!r}; 1 is the default"
        )
    if size < 0 and not BY_NAME[kind].either_sign:
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
    kind, site = BY_NAME[wish.kind], Site(arm)
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
    able = tuple(j for j in everywhere if site.turning[j] or kind.where not in TURNING)
    if not able:
        raise ValueError(f"{kind.name} needs a joint that turns, and this robot has none")
    if (kind.where == "pair" or kind.needs_another) and site.n_joints < 2:
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
