"""Fourier series that start and end at rest, as a linear space (Eqs. 15, 17, 18)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.trajectory import FourierTrajectory

FloatArray = NDArray[np.float64]


class FourierSeries:
    """Motions of Eq. 15 over one period that satisfy Eq. 18: what is left free after elimination.

    Eq. 18 says sum a = 0 (velocity), sum l b = 0 (acceleration) and q(0) = start; the offset takes the last, and the
    null space of the first two leaves 2 n_harmonics - 2 coefficients per joint, which may be anything.

    Parameters
    ----------
    n_harmonics : int
        At least 2.
    duration : float
        One period [s].
    """

    def __init__(self, n_harmonics: int, duration: float) -> None:
        self.n_harmonics = n_harmonics
        self.duration = duration
        self.fundamental = 2 * np.pi / duration
        self.n_free = 2 * n_harmonics - 2
        order = np.arange(1.0, n_harmonics + 1)
        self._sin_space = _null_space(np.ones_like(order))
        self._cos_space = _null_space(order)

    @property
    def top_frequency(self) -> float:
        """Angular frequency of the highest harmonic [rad/s]."""
        return self.n_harmonics * self.fundamental

    def trajectory(self, x: FloatArray, start: FloatArray) -> FourierTrajectory:
        """Trajectory of the free coefficients `x` (n_free, n_joints) that starts and ends at `start` (n_joints,)."""
        half = self.n_harmonics - 1
        sin_coef, cos_coef = self._sin_space @ x[:half], self._cos_space @ x[half:]
        omega = self.fundamental * np.arange(1.0, self.n_harmonics + 1)
        return FourierTrajectory(
            offset=start + (cos_coef / omega[:, None]).sum(axis=0),
            sin_coef=sin_coef,
            cos_coef=cos_coef,
            fundamental=self.fundamental,
            rest=0.0,
        )

    def matrices(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Displacement from the start, velocity and acceleration per free coefficient at `t` (n,): (n, n_free) each."""
        # One "joint" per coefficient: the series itself stays where it is written.
        return self.trajectory(np.eye(self.n_free), np.zeros(self.n_free)).evaluate(t)

    def falling(self, x: FloatArray, power: FloatArray) -> FloatArray:
        """Motions (n_free, n_joints) whose velocity's harmonic l is `l ** -power` (n_joints,) of what it is in `x`.

        As near to that as Eq. 18 allows. The greater the power, the wider a joint sweeps at the same speed.
        """
        half = self.n_harmonics - 1
        share = np.arange(1.0, self.n_harmonics + 1)[:, None] ** -power
        parts = zip((self._sin_space, self._cos_space), (x[:half], x[half:]), strict=True)
        return np.concatenate([space.T @ (share * (space @ part)) for space, part in parts])

    def grid(self, step: float) -> FloatArray:
        """Times from 0 to the end, both among them, at most `step` apart [s]."""
        return np.linspace(0.0, self.duration, int(np.ceil(self.duration / step - 1e-9)) + 1)


def sufficient_bounds(trajectory: FourierTrajectory) -> FloatArray:
    """Eq. 17: what position, velocity and acceleration cannot exceed, (3, n_joints); sufficient, not necessary."""
    size = np.hypot(trajectory.sin_coef, trajectory.cos_coef)
    omega = trajectory.fundamental * np.arange(1.0, len(size) + 1)[:, None]
    position = (size / omega).sum(axis=0) + np.abs(trajectory.offset)
    return np.stack([position, size.sum(axis=0), (size * omega).sum(axis=0)])


def _null_space(row: FloatArray) -> FloatArray:
    """Orthonormal basis (n, n - 1) of the vectors on which `row` (n,) vanishes."""
    basis, _ = np.linalg.qr(np.column_stack([row, np.eye(row.size)[:, 1:]]))
    return np.asarray(basis[:, 1:])
