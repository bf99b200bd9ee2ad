"""Friction that the declared model lacks: formulas of our own, places and shapes drawn, sizes found later."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from exam.draw import log_uniform
from exam.effects import Effect, any_joint, loaded_joint, on, top_speed
from exam.world import States, World, warm_time

FloatArray = NDArray[np.float64]


def stribeck(rng: np.random.Generator, world: World) -> Effect:
    """Friction that falls with speed."""
    j = any_joint(rng, world)
    velocity = float(top_speed(world, j) * log_uniform(rng, 0.03, 0.25))
    exponent, backward = float(rng.uniform(1.0, 2.0)), float(rng.uniform(0.85, 1.15))

    def part(world: World, s: States, size: float) -> FloatArray:
        v = s.dq_motor[:, j]
        peak = np.exp(-((np.abs(v) / velocity) ** exponent))
        return on(s, j, size * np.where(v > 0, 1.0, backward) * world.sign(s.dq_motor)[:, j] * peak)

    return Effect(
        "stribeck", (j,), "motor", part, 2 * world.coulomb[j],
        lambda size: {"stribeck_pos": size, "stribeck_neg": size * backward, "stribeck_velocity": velocity},
        ("stribeck_pos", "stribeck_neg"), shape={"velocity": velocity, "exponent": exponent},
    )  # fmt: skip


def load_dependent_friction(rng: np.random.Generator, world: World) -> Effect:
    """Friction that grows with the torque that the gear carries."""
    j = loaded_joint(rng, world)

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * np.abs(s.tau_link[:, j]) * world.sign(s.dq_motor)[:, j])

    return Effect("load_dependent_friction", (j,), "motor", part, 0.35, lambda size: {"load_friction": size})


def load_hysteresis(rng: np.random.Generator, world: World) -> Effect:
    """The same, with bristles that bend before they slip."""
    j, way = loaded_joint(rng, world), float(log_uniform(rng, 3e-3, 3e-2))

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * np.abs(s.tau_link[:, j]) * bristles(s.q_motor[:, j], way))

    return Effect(
        "load_hysteresis", (j,), "motor", part, 0.35,
        lambda size: {"load_hysteresis": size, "presliding_distance": way}, shape={"way": way},
    )  # fmt: skip


def bearing_friction(rng: np.random.Generator, world: World) -> Effect:
    """Friction of a bearing that the next joint's torque tilts, or that of the joint before."""
    j, n = any_joint(rng, world), world.case.n_joints
    beside = int(rng.choice([k for k in (j - 1, j + 1) if 0 <= k < n]))

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * np.abs(s.tau_link[:, beside]) * world.sign(s.dq_motor)[:, j])

    return Effect(
        "bearing_friction", (j,), "motor", part, 0.35,
        lambda size: {"bearing_friction": size}, shape={"side": float(beside - j)},
    )  # fmt: skip


def friction_hysteresis(rng: np.random.Generator, world: World) -> Effect:
    """Bristles (Dahl) that add to Coulomb friction."""
    j, way = any_joint(rng, world), float(log_uniform(rng, 2e-3, 5e-2))

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * bristles(s.q_motor[:, j], way))

    return Effect(
        "friction_hysteresis", (j,), "motor", part, 2 * world.coulomb[j],
        lambda size: {"hysteresis": size, "presliding_distance": way}, ("hysteresis",), shape={"way": way},
    )  # fmt: skip


def bristles(q: FloatArray, way: float) -> FloatArray:
    """Return the Dahl state along positions (n,): dz = dx / way (1 - z sign dx), from zero.

    Between two reversals it is closed: z = s + (z_0 - s) exp(-|x - x_0| / way).
    """
    step = np.sign(np.diff(q))
    turns = np.flatnonzero(np.diff(step)) + 1
    z, state = np.zeros(len(q)), 0.0
    for first, last in zip([0, *turns], [*turns, len(q) - 1], strict=True):
        s = step[first] if first < len(step) else 0.0
        if s:
            z[first : last + 1] = s + (state - s) * np.exp(-np.abs(q[first : last + 1] - q[first]) / way)
        else:
            z[first : last + 1] = state
        state = z[last]
    return z


def position_dependent_friction(rng: np.random.Generator, world: World) -> Effect:
    """A gear that runs harder at some angles."""
    j, cycles, phase = any_joint(rng, world), int(rng.integers(1, 6)), float(rng.uniform(0, 2 * np.pi))

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * world.sign(s.dq_motor)[:, j] * np.cos(cycles * s.q[:, j] + phase))

    return Effect(
        "position_dependent_friction", (j,), "motor", part, 0.9 * world.coulomb[j],
        lambda size: {
            "position_friction_cos": size * np.cos(phase), "position_friction_sin": -size * np.sin(phase),
        },
        ("position_friction_cos", "position_friction_sin"), shape={"cycles": cycles, "phase": phase},
    )  # fmt: skip


def thermal_friction(rng: np.random.Generator, world: World) -> Effect:
    """Friction that falls as the joint warms up: of one joint, or of all."""
    n = world.case.n_joints
    joints = tuple(range(n)) if rng.random() < 0.5 else (any_joint(rng, world),)
    chosen = np.isin(np.arange(n), joints)

    def part(world: World, s: States, size: float) -> FloatArray:
        return -size * chosen * s.warm * world.friction(s.dq_motor)

    time = {} if world.case.temperature else {"time_constant": warm_time(world.case)}
    return Effect("thermal_friction", joints, "motor", part, 0.7, lambda size: time)


def coupled_friction(rng: np.random.Generator, world: World) -> Effect:
    """A stage that turns with the sum of two joints' speeds."""
    j = world.case.n_joints - 2 if rng.random() < 0.7 else int(rng.integers(world.case.n_joints - 1))
    ratio = float(rng.choice([-1.0, -0.5, 0.5, 1.0]))
    width = float(np.mean(world.width[[j, j + 1]]))
    k = j + 1

    def part(world: World, s: States, size: float) -> FloatArray:
        speed = s.dq_motor[:, j] + ratio * s.dq_motor[:, k]
        torque = size * world.sign((speed / width)[:, None] * world.width)[:, j]
        return on(s, j, torque) + on(s, k, ratio * torque)

    most = 1.5 * float(min(world.coulomb[j], world.coulomb[k]))
    return Effect("coupled_friction", (j, k), "motor", part, most, shape={"ratio": ratio})
