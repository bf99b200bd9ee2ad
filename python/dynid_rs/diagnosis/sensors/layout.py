"""How well torque channels belong to joints and signs: declared columns against every channel, on parts left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.friction import friction_effect
from dynid_rs.identification.loops import FIRST_WIDTH, declared_plan
from dynid_rs.regression.columns import Block, Observations, observe
from dynid_rs.regression.systems import solve, stack
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

RIDGE = 1e-3
"""Relative to the columns' greatest singular value; parts that are left out must not be extrapolated wildly."""
PRIOR_PAYS = 0.5
"""The file's inertials say something of a joint's torque where they leave less than this of the power."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of the declared columns, per block and joint, and the torque of every channel there.

    `observations` of all joints; `torque` per block (n_rows, n_joints) in the band.
    """

    observations: Observations
    torque: list[FloatArray]

    @staticmethod
    def of(robot: _core.RobotModel, runs: Sequence[States]) -> Rows:
        """Rows of `runs` with the first friction that a fit begins with."""
        n = robot.n_joints
        plan = declared_plan(robot, friction_effect(np.zeros(n), np.full(n, FIRST_WIDTH)))
        # A channel in the wrong column rests with another joint: everything counts here.
        observations = observe(plan, [replace(run, resting=np.zeros_like(run.resting)) for run in runs])
        torque = [np.column_stack([x[:, -1] for x in block.rows]) for block in observations.blocks]
        return Rows(observations, torque)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.observations.plan.robot.n_joints

    def with_signs(self, sign: FloatArray) -> Rows:
        """Return the same rows with the torque of joint j times `sign[j]`."""
        blocks = []
        for block in self.observations.blocks:
            rows = [np.column_stack([x[:, :-1], s * x[:, -1]]) for x, s in zip(block.rows, sign, strict=True)]
            factors = [np.column_stack([R[:, :-1], s * R[:, -1]]) for R, s in zip(block.factors, sign, strict=True)]
            blocks.append(replace(block, rows=rows, factors=factors))
        return Rows(replace(self.observations, blocks=blocks), [tau * sign for tau in self.torque])

    def shares(self) -> FloatArray:
        """Residual power over power of channel k on the columns of joint j alone, left out, (n_joints, n_joints)."""
        plan, n = self.observations.plan, self.n_joints
        result = np.zeros((n, n))
        total = np.concatenate(self.torque)
        for j in range(n):
            wide = [
                np.column_stack([b.rows[j][:, :-1], tau])
                for b, tau in zip(self.observations.blocks, self.torque, strict=True)
            ]
            factors = [_core.triangular_factor(x) for x in wide]
            used = np.concatenate([plan.own[j], np.ones(wide[0].shape[1] - n - plan.n_own, dtype=bool)])
            for k, rows in enumerate(wide):
                R = _core.merge_factors([R for other, R in enumerate(factors) if other != k])
                x = _ridge(R[:, :-n][:, used], R[:, -n:])
                result[j] += np.sum((rows[:, -n:] - rows[:, :-n][:, used] @ x) ** 2, axis=0)
        power = np.maximum(np.sum((total - total.mean(axis=0)) ** 2, axis=0), 1e-300)
        return np.asarray(result / power)

    def whole_shares(self) -> FloatArray:
        """Residual power over power per joint, left out, when all joints share the links' parameters, (n_joints,)."""
        blocks = self.observations.blocks
        return sum(
            (self._left([block], self.observations.factors(leave_out=k)) for k, block in enumerate(blocks)),
            start=np.zeros(self.n_joints),
        )

    def pooled_shares(self) -> FloatArray:
        """The same with nothing left out: what no links' parameters explain, (n_joints,)."""
        return self._left(self.observations.blocks, self.observations.factors())

    def _left(self, blocks: Sequence[Block], factors: Sequence[FloatArray]) -> FloatArray:
        """Residual power of blocks under a fit to `factors`, over the torque's power in all blocks, (n_joints,)."""
        plan, n = self.observations.plan, self.n_joints
        total = np.concatenate(self.torque)
        power = np.maximum(np.sum((total - total.mean(axis=0)) ** 2, axis=0), 1e-300)
        x = solve(plan, stack(plan, factors, 1 / np.sqrt(power), np.ones(n)), (RIDGE,))[0]
        left = np.zeros(n)
        for block in blocks:
            for j, rows in enumerate(block.rows):
                left[j] += np.sum((rows[:, -1] - rows[:, :-1] @ x[plan.unknowns(j)]) ** 2)
        return np.asarray(left / power)

    def prior_slopes(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Torque over what the robot file's inertials predict, beside own columns, and where that says something."""
        plan, n = self.observations.plan, self.n_joints
        declared = plan.robot.base_parameters().project(plan.robot.phi)
        slope, sure = np.zeros(n), np.zeros(n, dtype=bool)
        for j, R in enumerate(self.observations.factors()):
            load = R[:, plan.n_own : -1] @ declared[plan.pivots >= 10 * j]
            own = R[:, : plan.n_own][:, plan.own[j]]
            alone = R[:, -1] - own @ _ridge(own, R[:, -1:])[:, 0]
            wide = np.column_stack([own, load])
            x = _ridge(wide, R[:, -1:])[:, 0]
            slope[j] = x[-1]
            sure[j] = np.sum((R[:, -1] - wide @ x) ** 2) < PRIOR_PAYS * np.sum(alone**2)
        return slope, sure

    def dissipation(self) -> FloatArray:
        """Correlation of every joint's fitted friction with its speed, (n_joints,): friction that resists has about 1.

        Fitted joint by joint, so that no joint's sign can spoil another's; NaN where friction explains next to nothing.
        """
        plan, n = self.observations.plan, self.n_joints
        _, places = plan.friction
        result = np.full(n, np.nan)
        for j, (R, rows) in enumerate(zip(self.observations.factors(), self.observations.joint_rows(), strict=True)):
            used = np.concatenate([plan.own[j], np.ones(R.shape[1] - 1 - plan.n_own, dtype=bool)])
            at = np.flatnonzero(used)
            x = np.zeros(R.shape[1] - 1)
            x[at] = _ridge(R[:, at], R[:, -1:])[:, 0]
            friction = rows[:, places] @ x[places]
            left = rows[:, -1] - rows[:, :-1] @ x
            if np.std(friction) < np.std(left):
                continue
            # The odd Coulomb column is the sign of the speed, in the band.
            sign = rows[:, places][:, :2].sum(axis=1)
            if np.ptp(sign) == 0 or np.ptp(friction) == 0:
                continue  # one direction at one speed: nothing to correlate
            result[j] = np.corrcoef(friction, sign)[0, 1]
        return result


def _ridge(A: FloatArray, b: FloatArray) -> FloatArray:
    """Least squares (columns, k) with a little ridge on unit-norm columns."""
    norms = np.linalg.norm(A, axis=0)
    norms[norms == 0] = 1.0
    u, s, vt = np.linalg.svd(A / norms, full_matrices=False)
    x: FloatArray = (vt.T @ ((s / (s**2 + (RIDGE * s[0]) ** 2))[:, None] * (u.T @ b))) / norms[:, None]
    return x
