"""What is wrong with what is shown: torque channels that droop, scale or are late, encoders that are not centred."""

from __future__ import annotations

import numpy as np

from exam.effects import Effect, FloatArray, any_joint, loaded_joint, on
from exam.world import States, World, inverse_dynamics


def torque_saturation(rng: np.random.Generator, world: World) -> Effect:
    """A motor whose torque falls behind its current: the channel shows more than there is."""
    j = loaded_joint(rng, world)
    peak = max(float(np.abs(world.motor_torque(s)[:, j]).max()) for s in world.train)

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, size * world.motor_torque(s)[:, j] ** 3)

    return Effect("torque_saturation", (j,), "channel", part, 0.35 / peak**2)


def torque_gain(rng: np.random.Generator, world: World) -> Effect:
    """A channel that shows too much or too little."""
    j, sign = loaded_joint(rng, world), float(rng.choice([-1.0, 1.0]))

    def part(world: World, s: States, size: float) -> FloatArray:
        return on(s, j, sign * size * world.motor_torque(s)[:, j])

    return Effect("torque_gain", (j,), "channel", part, 0.35, lambda size: {"gain": sign * size})


def torque_delay(rng: np.random.Generator, world: World) -> Effect:
    """Torque channels that are late: those of all joints, now and then of one."""
    n = world.case.n_joints
    joints = tuple(range(n)) if rng.random() < 0.75 else (any_joint(rng, world),)
    chosen = np.isin(np.arange(n), joints)

    def part(world: World, s: States, size: float) -> FloatArray:
        torque = world.motor_torque(s)
        return chosen * (late(s.t, torque, size) - torque)

    return Effect("torque_delay", joints, "channel", part, 0.02, lambda size: {"delay": size})


def late(t: FloatArray, torque: FloatArray, delay: float) -> FloatArray:
    """Torque (n, n_joints) as it was `delay` [s] ago."""
    return np.stack([np.interp(t - delay, t, column) for column in torque.T], axis=1)


def encoder_eccentricity(rng: np.random.Generator, world: World) -> Effect:
    """An encoder that is not centred: it shows q + size sin(q + phase)."""
    j, phase = loaded_joint(rng, world), float(rng.uniform(0, 2 * np.pi))

    def part(world: World, s: States, size: float) -> FloatArray:
        q, dq, ddq = s.q[:, j], s.dq[:, j], s.ddq[:, j]
        sine, cosine = size * np.sin(q + phase), size * np.cos(q + phase)
        error = [on(s, j, x) for x in (sine, dq * cosine, ddq * cosine - dq**2 * sine)]
        right = inverse_dynamics(world.model, s.q, s.dq, s.ddq)
        return right - inverse_dynamics(world.model, s.q + error[0], s.dq + error[1], s.ddq + error[2])

    return Effect(
        "encoder_eccentricity", (j,), "encoder", part, 0.02,
        lambda size: {"cosine": size * np.sin(phase), "sine": size * np.cos(phase)}, shape={"phase": phase},
    )  # fmt: skip
