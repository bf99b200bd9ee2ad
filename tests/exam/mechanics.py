"""What mechanics the declared model lacks: teeth, mountings, springs, gears that yield. Sizes are found later."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from exam.arm import GRAVITY
from exam.draw import log_uniform
from exam.effects import Effect, FloatArray, any_joint, loaded_joint, on
from exam.world import States, World, gravity_difference, inverse_dynamics


def torque_ripple(rng: np.random.Generator, world: World) -> Effect:
    """Teeth and magnets, few or many to a turn."""
    j = any_joint(rng, world)
    cycles = float(rng.integers(4, 12)) if rng.random() < 0.5 else float(np.round(log_uniform(rng, 20, 180), 1))
    first, second = rng.uniform(0, 2 * np.pi, 2)
    harmonic = float(rng.uniform(0.2, 0.5)) if rng.random() < 0.5 else 0.0

    def part(world: World, s: States, size: float) -> FloatArray:
        q = s.q_motor[:, j]
        return on(s, j, size * (np.cos(cycles * q + first) + harmonic * np.cos(2 * cycles * q + second)))

    return Effect(
        "torque_ripple", (j,), "motor", part, world.torque_std[j],
        lambda size: {"cycles": cycles, "amplitude": size}, ("amplitude",), shape={"cycles": cycles},
    )  # fmt: skip


def inertial_coupling(rng: np.random.Generator, world: World) -> Effect:
    """A rotor that is turned by two joints."""
    j = int(rng.integers(world.case.n_joints - 1))
    k, sign = j + 1, float(rng.choice([-1.0, 1.0]))

    def part(world: World, s: States, size: float) -> FloatArray:
        return sign * size * (on(s, j, s.ddq_motor[:, k]) + on(s, k, s.ddq_motor[:, j]))

    most = 0.8 * float(np.sqrt(world.rotor[j] * world.rotor[k]))
    return Effect("inertial_coupling", (j, k), "motor", part, most)


def gravity_tilt(rng: np.random.Generator, world: World) -> Effect:
    """A base that is not level, or stands on a wall or hangs."""
    down = np.array([0.0, 0.0, -GRAVITY])
    if rng.random() < 0.75:
        roll, pitch = (float(x) for x in np.radians(rng.uniform(0.3, 3.0, 2) * rng.choice([-1.0, 1.0], 2)))
        # A base turned by Ry(pitch) Rx(roll): gravity in its own frame is turned the other way.
        turned = (pin.rpy.rpyToMatrix(0.0, pitch, 0.0) @ pin.rpy.rpyToMatrix(roll, 0.0, 0.0)).T @ down
        truth = {"roll": roll, "pitch": pitch}
    else:
        axes = np.vstack([np.eye(3), -np.eye(3)])[[0, 1, 2, 3, 4]]
        turned, truth = GRAVITY * axes[rng.integers(5)], {}

    def part(world: World, s: States, size: float) -> FloatArray:
        return gravity_difference(world.model, turned - down, s.q)

    shape = dict(zip("xyz", turned.tolist(), strict=True))
    n = world.case.n_joints
    return Effect(
        "gravity_tilt", tuple(range(n)), "arm", part, 1.0, lambda size: truth, natural=True, shape=shape
    )  # fmt: skip


def kinematic_error(rng: np.random.Generator, world: World) -> Effect:
    """A joint that is some millimetres off its place in the file."""
    j = int(rng.integers(1, world.case.n_joints - 1))
    direction = rng.normal(size=3)
    shift = direction / np.linalg.norm(direction) * float(rng.uniform(1e-3, 8e-3))

    def part(world: World, s: States, size: float) -> FloatArray:
        moved = world.arm.model({j: shift}, world.model.gravity.linear)
        return inverse_dynamics(moved, s.q, s.dq, s.ddq) - inverse_dynamics(world.model, s.q, s.dq, s.ddq)

    shape = dict(zip("xyz", shift.tolist(), strict=True))
    return Effect("kinematic_error", (j,), "arm", part, 1.0, natural=True, shape=shape)


def joint_spring(rng: np.random.Generator, world: World) -> Effect:
    """A spring or a bundle of hoses across one joint."""
    j, rest = any_joint(rng, world), float(rng.uniform(-0.5, 0.5))

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * (s.q[:, j] - rest))

    return Effect(
        "joint_spring", (j,), "link", part, np.inf, lambda size: {"spring_stiffness": size},
        ("spring_stiffness",), shape={"rest": rest},
    )  # fmt: skip


def counterbalance(rng: np.random.Generator, world: World) -> Effect:
    """A cylinder between two pins, with gas or a coil in it."""
    j = loaded_joint(rng, world)
    ratio, phase = float(rng.uniform(0.15, 0.6)), float(rng.uniform(-np.pi, np.pi))
    gas = bool(rng.random() < 0.7)
    stiff = float(rng.uniform(0.1, 0.6)) / (2 * ratio)

    def part(world: World, s: States, size: float) -> FloatArray:
        angle = s.q[:, j] + phase
        length = np.sqrt(1 + ratio**2 + 2 * ratio * np.cos(angle))
        way = length - (1 - ratio)
        force = 1 / (1 - stiff * way) if gas else 1 + stiff * way
        return on(s, j, -size * force * ratio * np.sin(angle) / length)

    shape = {"ratio": ratio, "phase": phase, "stiff": stiff, "gas": float(gas)}
    return Effect("counterbalance", (j,), "link", part, np.inf, shape=shape)


def backlash(rng: np.random.Generator, world: World) -> Effect:
    """A gap in a gear: what is seen of it is in the difference of two encoders, (n, n_joints) [rad]."""
    j = loaded_joint(rng, world)

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size / 2 * np.tanh(s.tau_link[:, j] / (0.1 * world.torque_std[j])))

    return Effect("backlash", (j,), "gear", part, 5e-3, lambda size: {"gap": size})


def joint_elasticity(rng: np.random.Generator, world: World) -> Effect:
    """A gear that yields while the others do not."""
    j = loaded_joint(rng, world)

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * s.tau_link[:, j])

    return Effect("joint_elasticity", (j,), "gear", part, 5e-3 / world.torque_std[j], lambda c: {"stiffness": 1 / c})
