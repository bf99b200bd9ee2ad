"""A robot's links in as few numbers as its torques can tell apart, whichever way gravity points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]

ASLANT = (17**0.5, 29**0.5, 47**0.5)
"""Gravity along no joint's axis, as no file writes such a one: what torques tell apart under some gravity, they do
under this one."""


@dataclass(frozen=True, eq=False)
class Arm:
    """`Y phi = Y[..., pivots] regroup phi` for the regressor Y of `robot` under any gravity.

    `pivots` (n_base,), ascending; `regroup` (n_base, 10 n_links).
    """

    robot: _core.RobotModel
    pivots: NDArray[np.int64]
    regroup: FloatArray

    @staticmethod
    def of(robot: _core.RobotModel) -> Arm:
        """Base parameters of a robot, as those under a gravity that every joint feels."""
        base = robot.with_gravity(list(ASLANT)).base_parameters(0)
        regroup = np.zeros((base.n_base, base.n_standard))
        regroup[np.arange(base.n_base), base.pivots] = 1.0
        regroup[:, base.dependent] = base.beta
        return Arm(robot, base.pivots, regroup)

    def with_gravity(self, gravity: FloatArray) -> Arm:
        """The arm under another gravity (3,) [m/s^2]."""
        return replace(self, robot=self.robot.with_gravity(gravity.tolist()))

    def regressor(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Columns of the base parameters, (n_rows, n_joints, n_base); joint j feels those from `first(j)` on."""
        return self.robot.joint_torque_regressor(q, dq, ddq)[:, :, self.pivots]

    def first(self, j: int) -> int:
        """Place of the first base parameter that joint j feels: a joint does not feel the links before it."""
        return int(np.searchsorted(self.pivots, 10 * j))
