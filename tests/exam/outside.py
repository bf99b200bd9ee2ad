"""What the declared model lacks and the catalogue has no name for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from exam.effects import Effect, on
from exam.world import States, World

FloatArray = NDArray[np.float64]


def hose(rng: np.random.Generator, world: World) -> Effect:
    """A hose past two joints that is slack up to a sum of their angles, and pulls at both beyond."""
    j = int(rng.integers(world.case.n_joints - 2))
    k = j + int(rng.integers(1, 3))
    sign = float(rng.choice([-1.0, 1.0]))
    slack = float(np.quantile(_seen(world, j) + sign * _seen(world, k), rng.uniform(0.3, 0.7)))

    def part(world: World, s: States, size: float) -> FloatArray:
        pull = size * _beyond(s.q[:, j] + sign * s.q[:, k] - slack, 0.02)
        return on(s, j, pull) + on(s, k, sign * pull)

    return Effect("hose", (j, k), "link", part, np.inf)


def window_brake(rng: np.random.Generator, world: World) -> Effect:
    """A brake that drags in a window of the angle."""
    j = int(rng.integers(world.case.n_joints))
    middle = float(np.quantile(_seen(world, j), rng.uniform(0.2, 0.8)))
    half = float(rng.uniform(0.1, 0.4) * np.ptp(_seen(world, j)) / 2)

    def part(world: World, s: States, size: float) -> FloatArray:
        edge = 0.1 * half
        inside = 0.5 * (np.tanh((s.q[:, j] - middle + half) / edge) - np.tanh((s.q[:, j] - middle - half) / edge))
        return on(s, j, size * inside * world.sign(s.dq_motor)[:, j])

    return Effect("window_brake", (j,), "motor", part, 3 * world.coulomb[j])


def cable_stop(rng: np.random.Generator, world: World) -> Effect:
    """A cable that is drawn tight near one end of the way."""
    j = int(rng.integers(world.case.n_joints))
    start = float(np.quantile(_seen(world, j), rng.uniform(0.6, 0.85)))

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * np.maximum(s.q[:, j] - start, 0.0) ** 2)

    return Effect("cable_stop", (j,), "link", part, np.inf)


def neighbour_drag(rng: np.random.Generator, world: World) -> Effect:
    """A seal or a fluid that takes one joint along with another one's speed."""
    j, k = (int(x) for x in rng.choice(world.case.n_joints, 2, replace=False))

    def part(world: World, s: States, size: float) -> FloatArray:
        v = s.dq_motor[:, k]
        return on(s, j, size * v * np.abs(v))

    return Effect("neighbour_drag", (j, k), "motor", part, np.inf)


def _seen(world: World, j: int) -> FloatArray:
    return np.concatenate([s.q[:, j] for s in world.train])


def _beyond(x: FloatArray, width: float) -> FloatArray:
    """Nothing below zero, x above, and a narrow bend between."""
    return 0.5 * (x + np.sqrt(x**2 + width**2))
