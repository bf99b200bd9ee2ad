"""Runs made on the fly, as many as one likes: each is its seed, and the same wherever it is read."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from dynid_rs import Recording, RobotModel, _core
from dynid_rs.archive.fingerprint import fingerprint
from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks import check_recording
from dynid_rs.simulation import bundled_robot

WIDTH = 0.01
SIZE = np.array([40.0, 160.0, 50.0, 4.0, 6.0, 0.8])
"""About the joints' torques [N m]."""
STIFFNESS = 1e3 * SIZE
FRICTION = np.array([0.1, 0.12, 0.05, 0.05, 0.0, 0.0, 0.0, 0.0])
"""The paper's friction over the joint's torque."""
N_HARMONICS = 5
OMEGA = 2 * np.pi * 0.1 * np.arange(1, N_HARMONICS + 1)
"""Of the motion [rad/s]."""


@functools.cache
def arm() -> RobotModel:
    """The bundled arm of six joints."""
    return RobotModel.from_urdf(bundled_robot())


@functools.lru_cache(maxsize=2)
def harmonics(duration: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) and ``[sine | cosine]`` of every harmonic (n, 2 * N_HARMONICS): those of all runs of a kind."""
    t = np.arange(int(duration * rate)) / rate
    angle = t[:, None] * OMEGA
    return t, np.concatenate([np.sin(angle), np.cos(angle)], axis=1)


@dataclass(frozen=True)
class MadeRun:
    """A Fourier motion of the bundled arm, its torque with friction, and white noise on both.

    `duration` [s], `rate` [Hz]; `two_encoders` adds a motor side that yields with the load.
    """

    seed: int
    duration: float = 20.0
    rate: float = 1000.0
    two_encoders: bool = True

    @property
    def name(self) -> str:
        return f"made_{self.seed}"

    def content(self) -> str:
        return fingerprint(self.seed, self.duration, self.rate, self.two_encoders)

    def read(self) -> tuple[Recording, list[Finding]]:
        recording = self.recording()
        return recording, check_recording(recording, arm())

    def signals(self) -> Recording:
        return self.recording()

    def recording(self) -> Recording:
        robot = arm()
        rng = np.random.default_rng(self.seed)
        n = robot.n_joints
        t, waves = harmonics(self.duration, self.rate)
        size, phase = rng.uniform(0.1, 0.4, (N_HARMONICS, n)), rng.uniform(0, 2 * np.pi, (N_HARMONICS, n))
        a, b = size * np.cos(phase), size * np.sin(phase)
        omega = OMEGA[:, None]
        q = waves @ np.concatenate([a, b])
        q += rng.uniform(-1, 1, n)
        dq = waves @ np.concatenate([-omega * b, omega * a])
        ddq = waves @ np.concatenate([-(omega**2) * a, -(omega**2) * b])
        tau = robot.inverse_dynamics(q, dq, ddq)
        q_motor = q + tau / STIFFNESS if self.two_encoders else None
        for j in range(n):
            tau[:, j] += _core.friction_basis(dq[:, j], 0.0, WIDTH) @ (SIZE[j] * FRICTION)
        for signal, noise in ((tau, 0.005 * SIZE), (q, 1e-5)):
            added = rng.standard_normal(signal.shape)
            added *= noise
            signal += added
        return Recording(t, q, tau=tau, q_motor=q_motor, name=self.name, joints=tuple(robot.joint_names))
