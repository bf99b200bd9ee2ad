"""What changes while an arm is watched: kind, joint and size are drawn, the truth stands beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from exam.effects import any_joint, loaded_joint
from exam.world import States, World, inverse_dynamics
from numpy.typing import NDArray
from pinocchio import SE3, Inertia

from campaigns.watch_arm import Change, Ready

FloatArray = NDArray[np.float64]

AT = 20.0
"""A change begins here in its run [s]."""
ENDS = 100.0
"""End of that run [s]."""
REACH = 0.1
"""The centre of a load is no further than this from the last link's origin [m]."""
PUTTING_ON = 0.1
"""A load is put on within this time [s]: gears that yield take no jump."""
OFFSET = 4.0
"""A constant torque, over what the rows of its joint usually leave."""


@dataclass(frozen=True)
class Truth:
    """Names that are right, of which joint (None: of the arm), and the size under the first of them (None: none)."""

    kinds: tuple[str, ...]
    joint: int | None
    size: float | None


LATE = (10, 20)
"""A torque channel becomes later by so many samples, of 1 ms."""
SLIPPED = (0.02, 0.05)
"""An encoder slips by so much, to either side [rad], on a joint on which that makes as much as a constant torque."""

Put = Callable[[np.random.Generator, Ready], tuple[Change, Truth]]


def _late(n_joints: int, joint: int, size: float, n: int = round(ENDS * 1000)) -> FloatArray:
    """`size` (n, n_joints) on one joint from the beginning of the change on."""
    late = np.zeros((n, n_joints))
    late[round(AT * 1000) :, joint] = size
    return late


def _friction(size: float) -> Put:
    def put(rng: np.random.Generator, ready: Ready) -> tuple[Change, Truth]:
        j = any_joint(rng, ready.arm.world)
        return Change(friction=1 + _late(len(ready.arm.joints), j, size)), Truth(("friction",), j, size)

    return put


def _gain(size: float) -> Put:
    """On a joint that carries something: elsewhere a gain and friction are the same."""

    def put(rng: np.random.Generator, ready: Ready) -> tuple[Change, Truth]:
        j = loaded_joint(rng, ready.arm.world)
        factor = 1 + _late(len(ready.arm.joints), j, size)
        return Change(shown=lambda torque: factor * torque), Truth(("gain",), j, size)

    return put


def _offset(rng: np.random.Generator, ready: Ready) -> tuple[Change, Truth]:
    j = any_joint(rng, ready.arm.world)
    size = float(rng.choice([-1.0, 1.0]) * OFFSET * ready.deviation[j])
    more = _late(len(ready.arm.joints), j, size)
    return Change(shown=lambda torque: torque + more), Truth(("offset",), j, size)


def _load(share: float) -> Put:
    def put(rng: np.random.Generator, ready: Ready) -> tuple[Change, Truth]:
        direction = rng.normal(size=3)
        centre = REACH * rng.random() ** (1 / 3) * direction / np.linalg.norm(direction)
        mass = share * ready.arm.rated

        def link(world: World, s: States) -> FloatArray:
            model = world.model.copy()
            model.appendBodyToJoint(model.njoints - 1, Inertia(mass, centre, np.zeros((3, 3))), SE3.Identity())
            x = np.clip((s.t - s.t[0] - AT) / PUTTING_ON, 0.0, 1.0)[:, None]
            late = x[:, 0] > 0
            more = np.zeros_like(s.q)
            state = (s.q[late], s.dq[late], s.ddq[late])
            more[late] = inverse_dynamics(model, *state) - inverse_dynamics(world.model, *state)
            return (3 * x**2 - 2 * x**3) * more

        return Change(link=link), Truth(("load",), None, mass)

    return put


def _delay(rng: np.random.Generator, ready: Ready) -> tuple[Change, Truth]:
    """On a joint that carries something: the torque of others hardly goes up and down but where they turn round."""
    j, at, late = loaded_joint(rng, ready.arm.world), round(AT * 1000), int(rng.integers(LATE[0], LATE[1] + 1))

    def channel(torque: FloatArray) -> FloatArray:
        shown = torque.copy()
        shown[at:, j] = torque[at - late : -late, j]
        return shown

    return Change(channel=channel), Truth(("delay",), j, late / 1000)


def _slip(rng: np.random.Generator, ready: Ready) -> tuple[Change, Truth]:
    world = ready.arm.world
    n, size = world.case.n_joints, float(rng.choice([-1.0, 1.0]) * rng.uniform(*SLIPPED))

    def shows(j: int) -> float:
        """What it makes on the joint on which it shows most, over what rows usually leave."""
        squares = []
        for s in world.train:
            further = inverse_dynamics(world.model, s.q + size * np.eye(n)[j], s.dq, s.ddq)
            squares.append((further - inverse_dynamics(world.model, s.q, s.dq, s.ddq)) ** 2)
        return float(np.max(np.sqrt(np.vstack(squares).mean(axis=0)) / ready.deviation))

    parts = np.array([shows(j) for j in range(n)])
    chosen = np.flatnonzero(parts >= OFFSET)
    j = int(rng.choice(chosen)) if len(chosen) else int(np.argmax(parts))
    return Change(position=_late(n, j, size)), Truth(("slip",), j, size)


def _fault(kinds: tuple[str, ...], *, frozen: bool) -> Put:
    """A torque channel that stays where it was, or shows nothing."""

    def put(rng: np.random.Generator, ready: Ready) -> tuple[Change, Truth]:
        j, at = any_joint(rng, ready.arm.world), round(AT * 1000)

        def channel(torque: FloatArray) -> FloatArray:
            shown = torque.copy()
            shown[at:, j] = torque[at, j] if frozen else 0.0
            return shown

        return Change(channel=channel), Truth(kinds, j, None)

    return put


CHANGES: dict[str, Put] = {
    "friction +20 %": _friction(0.2),
    "friction -20 %": _friction(-0.2),
    "gain +10 %": _gain(0.1),
    "gain -10 %": _gain(-0.1),
    "constant torque": _offset,
    "load, 5 % of rated": _load(0.05),
    "load, 20 % of rated": _load(0.2),
    "channel late": _delay,
    "encoder slips": _slip,
    "channel frozen": _fault(("frozen",), frozen=True),
    "channel lost": _fault(("frozen", "gain"), frozen=False),
}
"""What is put in. A channel that shows nothing has lost its gain: that name is right too."""
