"""A small arm under feedback: the controller sees the encoder's noise, and answers it with torque."""

import functools
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from dynid_rs import Recording, RobotModel
from helpers.small_arm import URDF

COULOMB, VISCOUS = np.array([2.0, 1.5, 0.6]), np.array([3.0, 2.0, 0.8])
WIDTH = 0.3
RATE = 500.0
STIFFNESS = 20.0
"""Bandwidth of the position loop [rad/s]."""


@dataclass(frozen=True)
class Loop:
    """What was run: true and measured positions, torque and reference."""

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    q_reference: np.ndarray
    measured: np.ndarray

    def recording(self, torque_noise=0.0, seed=0, *, with_reference=True, exact=False, name="loop"):
        rng = np.random.default_rng(seed)
        return Recording(
            t=self.t,
            q=self.q if exact else self.measured,
            tau=self.tau + torque_noise * rng.standard_normal(self.tau.shape),
            q_reference=self.q_reference if with_reference else None,
            name=f"{name}_{seed}",
        )


def robot():
    return RobotModel.from_urdf_string(URDF)


def friction(dq):
    """Eqs. 9-11 with a threshold of zero, Coulomb and first viscous order, both directions alike."""
    s = np.tanh(dq / WIDTH)
    return (1 + np.abs(s)) / 2 * (COULOMB * s + VISCOUS * dq)


@functools.cache
def run(encoder_noise, seed=0, duration=16.0, memory=0.0):
    """Semi-implicit steps at `RATE`: computed torque on the noisy position and its filtered derivative.

    With `memory`, from one sample to the next, there is as much noise of the encoder below the corner and none above.
    """
    arm = robot()
    rng = np.random.default_rng(seed)
    n, m, step = arm.n_joints, int(duration * RATE), 1 / RATE
    t = step * np.arange(m)
    reference, velocity, acceleration = fourier(t, rng)
    q, dq = reference[0].copy(), velocity[0].copy()
    noise = lfilter([1 - memory], [1, -memory], encoder_noise * rng.standard_normal((m, n)), axis=0)
    record, torque, seen = np.zeros((m, n)), np.zeros((m, n)), np.zeros((m, n))
    last, slow = q + noise[0], dq.copy()
    units = np.concatenate([np.zeros((1, n)), np.eye(n)])
    for k in range(m):
        measured = q + noise[k]
        slow = slow + 0.5 * ((measured - last) * RATE - slow)
        last = measured
        wanted = acceleration[k] + 2 * STIFFNESS * (velocity[k] - slow) + STIFFNESS**2 * (reference[k] - measured)
        tau = arm.inverse_dynamics([reference[k]], [velocity[k]], [wanted])[0] + friction(velocity[k])
        record[k], torque[k], seen[k] = q, tau, measured
        middle = dq  # the speed that central differences of q give: half a step on
        for _ in range(2):
            columns = arm.inverse_dynamics(np.tile(q, (n + 1, 1)), np.tile(middle, (n + 1, 1)), units)
            bias, mass = columns[0], (columns[1:] - columns[0]).T
            change = step * np.linalg.solve(mass, tau - bias - friction(middle))
            middle = dq + 0.5 * change
        dq = dq + change
        q = q + step * dq
    return Loop(t, record, torque, reference, seen)


def fourier(t, rng):
    """Position, velocity, acceleration (m, 3) of four harmonics of 0.15 Hz."""
    w = 2 * np.pi * 0.15 * np.arange(1, 5)
    a, b = rng.uniform(-0.35, 0.35, (2, 4, 3))
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q = sin @ a + cos @ b
    dq = cos @ (w[:, None] * a) - sin @ (w[:, None] * b)
    return q, dq, -(sin @ (w[:, None] ** 2 * a)) - cos @ (w[:, None] ** 2 * b)
