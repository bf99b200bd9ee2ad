"""A run as a few rows of the arm's equation of motion, cheap to make anew with other signs, orders and clocks.

Positions and torques go through one low-pass and are thinned; the regressor is made of what is left. That is less exact
than filtering every column beside the torque (`regression/columns.py`), and enough to tell which channel is which.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.runs.preprocessing import States
from dynid_rs.sensors.arm import Arm

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WIDTH = 0.02
"""Of a joint's top speed: within this its friction changes its sign."""
N_OWN = 4
"""Columns of a joint's own: offset, viscous, Coulomb, rotor; the last three are never negative."""


@dataclass(frozen=True, eq=False)
class ArmRows:
    """Rows of one run; every matrix is (n_rows, n_joints).

    `t` (n_rows,) is uniform; `sign` is that of the motors' speed, through the low-pass; `told` marks what is fitted:
    joints that move; `steepness` (n_joints,) as below.
    """

    name: str
    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    dq_motor: FloatArray
    ddq_motor: FloatArray
    sign: FloatArray
    tau: FloatArray
    told: BoolArray
    steepness: FloatArray
    _regressor: list[tuple[Arm, FloatArray]] = field(default_factory=list, init=False)

    @staticmethod
    def of(states: States) -> ArmRows:
        """Rows of a prepared run."""
        top = np.maximum(np.abs(states.dq_motor).max(axis=0), 1e-9)
        sign = np.stack(
            [
                _core.friction_basis(np.ascontiguousarray(speed), 0.0, WIDTH * peak)[:, :2].sum(axis=1)
                for speed, peak in zip(states.dq_motor.T, top, strict=True)
            ],
            axis=1,
        )
        matrices = (*states.signals(), sign, states.tau)
        whole = states.band.apply(np.concatenate(matrices, axis=1), states.rate)[states.grid]
        parts = [np.ascontiguousarray(x) for x in np.split(whole, len(matrices), axis=1)]
        q, dq, ddq, _, dq_motor, ddq_motor, sign, tau = parts
        told = states.moving[states.grid, None] & ~states.resting[states.grid]
        t = states.t[states.grid]
        return ArmRows(states.name, t, q, dq, ddq, dq_motor, ddq_motor, sign, tau, told, steepness(states.tau))

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def turned(self, factors: FloatArray) -> ArmRows:
        """The same run with positions times `factors` (n_joints,), each 1 or -1."""
        names = ("q", "dq", "ddq", "dq_motor", "ddq_motor", "sign")
        changed: dict[str, Any] = {name: getattr(self, name) * factors for name in names}
        return replace(self, **changed)

    def scaled(self, factor: float) -> ArmRows:
        """The same run with positions in another unit."""
        changed: dict[str, Any] = {
            name: getattr(self, name) * factor for name in ("q", "dq", "ddq", "dq_motor", "ddq_motor")
        }
        return replace(self, **changed)

    def shifted(self, j: int, by: float) -> ArmRows:
        """The same run with the position of joint j counted from another zero, `by` [rad] further."""
        q = self.q.copy()
        q[:, j] += by
        return replace(self, q=q)

    def ordered(self, order: Sequence[int]) -> ArmRows:
        """The same run with positions of the joints in another order."""
        names = ("q", "dq", "ddq", "dq_motor", "ddq_motor", "sign")
        changed: dict[str, Any] = {name: np.ascontiguousarray(getattr(self, name)[:, list(order)]) for name in names}
        return replace(self, **changed)

    def regressor(self, arm: Arm) -> FloatArray:
        """Columns of the base parameters, (n_rows, n_joints, n_base); the last arm's is kept."""
        for kept, columns in self._regressor[:]:  # at once: others may ask for another arm meanwhile
            if kept is arm:
                return columns
        columns = arm.regressor(self.q, self.dq, self.ddq)
        self._regressor[:] = [(arm, columns)]
        return columns

    def columns(self, arm: Arm, j: int) -> FloatArray:
        """Columns of joint j, (n_rows, n): of what it feels of the links, and its own.

        Its own: offset, viscous, Coulomb, rotor.
        """
        links = self.regressor(arm)[:, j, arm.first(j) :]
        columns = np.empty((len(self.q), links.shape[1] + N_OWN))
        columns[:, :-N_OWN] = links
        own = (1.0, self.dq_motor[:, j], self.sign[:, j], self.ddq_motor[:, j])
        for k, column in enumerate(own, links.shape[1]):
            columns[:, k] = column
        return columns


def steepness(tau: FloatArray) -> FloatArray:
    """Density of every channel's noise from 0.36 to 0.72 of its band over that in the octave before, (n_joints,).

    Above that a run on its grid has been low-passed. The median over short stretches: jumps, of friction at a reversal
    say, are in few of them.
    """
    length = min(64, len(tau))
    parts = np.stack([tau[k : k + length] for k in range(0, len(tau) - length + 1, max(1, length // 2))])
    parts = np.diff(parts - parts.mean(axis=1, keepdims=True), n=2, axis=1)
    window = np.hanning(parts.shape[1] + 2)[1:-1, None]
    n = 4 * length
    power = np.abs(np.fft.rfft(parts * window, n, axis=1)) ** 2
    omega = np.pi * np.arange(power.shape[1]) / (power.shape[1] - 1)
    density = np.median(power, axis=0)[1:] / (2 * np.sin(omega[1:] / 2))[:, None] ** 4
    low, middle, high = (int(share * len(density)) for share in (0.18, 0.36, 0.72))
    return np.asarray(density[middle:high].mean(axis=0) / np.maximum(density[low:middle].mean(axis=0), 1e-300))


@dataclass(frozen=True, eq=False)
class Moments:
    """Products of a run's columns, per joint: all that a fit needs.

    `columns` (n_joints, n, n) of the links' base parameters and the joint's own, four or more; `cross` (n_joints, n, k)
    of them with every channel of torque; `power` (n_joints, k) of the channels on the joint's rows; `count`
    (n_joints,).
    """

    columns: FloatArray
    cross: FloatArray
    power: FloatArray
    count: FloatArray

    @staticmethod
    def of(arm: Arm, rows: ArmRows, seen: Callable[[int], FloatArray] | None = None) -> Moments:
        """Moments of a run of an arm; `seen` is what the torque channels make of the columns of a joint."""
        n = rows.n_joints
        parts = [rows.columns(arm, j) if seen is None else seen(j) for j in range(n)]
        width = parts[0].shape[1]  # the first joint moves all links
        columns, cross = np.zeros((n, width, width)), np.zeros((n, width, n))
        power, whole = np.empty((n, n)), bool(rows.told.all())
        for j, A in enumerate(parts):
            tau = rows.tau
            if not whole:
                A, tau = A[rows.told[:, j]], tau[rows.told[:, j]]
            first = width - A.shape[1]
            columns[j, first:, first:] = A.T @ A
            cross[j, first:] = A.T @ tau
            power[j] = np.sum(tau**2, axis=0)
        return Moments(columns, cross, power, rows.told.sum(axis=0).astype(float))

    def where(self, joints: NDArray[np.bool_], other: Moments) -> Moments:
        """These moments, those of `other` on some joints (n_joints,)."""
        names = ("columns", "cross", "power", "count")
        mixed = {}
        for name in names:
            mine, theirs = getattr(self, name), getattr(other, name)
            mixed[name] = np.where(joints.reshape(-1, *[1] * (mine.ndim - 1)), theirs, mine)
        return replace(self, **mixed)

    def with_body(self, arm: Arm, *, carried: bool) -> Moments:
        """Moments with ten more columns before the joints' own: a body on the last link, if it is `carried`."""
        n, (n_links, body) = self.columns.shape[1], arm.regroup[:, -10:].shape
        T = np.zeros((n, n + body))
        T[:n_links, :n_links], T[n_links:, n_links + body :] = np.eye(n_links), np.eye(n - n_links)
        T[:n_links, n_links : n_links + body] = float(carried) * arm.regroup[:, -body:]
        return replace(self, columns=T.T @ self.columns @ T, cross=T.T @ self.cross)

    def picked(self, channel: Sequence[int], factor: FloatArray | float = 1.0) -> Moments:
        """Moments with one channel per joint, times a factor (n_joints,)."""
        joints, factors = np.arange(len(self.power)), np.broadcast_to(factor, (len(self.power),))
        cross = self.cross[joints, :, channel] * factors[:, None]
        return replace(self, cross=cross[:, :, None], power=(self.power[joints, channel] * factors**2)[:, None])
