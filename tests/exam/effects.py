"""What an effect is: where it acts, what it adds to the torque, what is true of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from exam.world import States, World

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Effect:
    """One thing that is hidden.

    `part(world, states, size)` is the torque (n, n_joints) [N m] that it adds to what a right declared model says at
    what a recording shows (of a gear: the angle that two encoders show between them).

    `side` is where it acts: "arm" (the rigid body is another), "link", "motor", "channel" (of torque), "encoder" or
    "gear". `most` is the greatest size that physics allows; a `natural` one has size 1, whatever the noise.
    `truth(size)` are its parameters under the names that a report has for them, N m even where amperes are recorded;
    `torques` are those whose unit holds the torque's, which in amperes is another.
    """

    kind: str
    joints: tuple[int, ...]
    side: str
    part: Callable[[World, States, float], FloatArray]
    most: float
    truth: Callable[[float], dict[str, float]] = field(default=lambda size: {})
    torques: tuple[str, ...] = ()
    natural: bool = False
    shape: dict[str, float] = field(default_factory=dict)


def on(s: States, j: int, column: FloatArray) -> FloatArray:
    """Torque on one joint only."""
    torque = np.zeros_like(s.q)
    torque[:, j] = column
    return torque


def any_joint(rng: np.random.Generator, world: World) -> int:
    return int(rng.integers(world.case.n_joints))


def loaded_joint(rng: np.random.Generator, world: World) -> int:
    """A joint whose load varies well beyond its friction: what follows the load has to have one."""
    load = np.vstack([s.tau_rigid for s in world.train]).std(axis=0)
    chosen = np.flatnonzero(load > 2 * world.coulomb)
    return int(rng.choice(chosen)) if len(chosen) else int(np.argmax(load / world.coulomb))


def top_speed(world: World, j: int) -> float:
    return max(float(np.abs(s.dq[:, j]).max()) for s in world.train)
