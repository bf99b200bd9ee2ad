"""Rows of all joints among all unknowns, from factors or samples: stacked, solved, and what they leave (Eqs. 20-25)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.regression.columns import Observations, Plan

FloatArray = NDArray[np.float64]

NEGLIGIBLE = 1e-12
"""Relative singular values below this are rounding."""


def stack_one(plan: Plan, j: int, rows: FloatArray, scale: FloatArray) -> FloatArray:
    """Rows of joint j among all unknowns, (n_rows, n_columns + 1)."""
    wide = np.zeros((len(rows), plan.n_columns + 1))
    wide[:, plan.unknowns(j)] = rows[:, :-1]
    wide[:, : plan.n_base] *= scale[j]
    wide[:, -1] = rows[:, -1]
    return wide


def stack(plan: Plan, factors: Sequence[FloatArray], weights: FloatArray, scale: FloatArray) -> FloatArray:
    """Weighted factors of all joints as one system ``[columns | torque]``, (rows, n_columns + 1) (Eq. 23)."""
    return np.concatenate([weights[j] * stack_one(plan, j, R, scale) for j, R in enumerate(factors)])


def solve(plan: Plan, system: FloatArray, ridges: Sequence[float]) -> list[FloatArray]:
    """Solutions (n_columns,) of ``[A | b]``, per ridge l: ``min |A x - b|^2 + (l s_max)^2 |D x|^2``, D the norms."""
    from scipy.linalg import svd

    R = _core.triangular_factor(system)
    A, b = R[:-1, :-1], R[:-1, -1]
    norms = np.linalg.norm(A, axis=0)
    used = plan.estimable() & (norms > NEGLIGIBLE * norms.max(initial=0.0))
    # gesvd: the divide-and-conquer driver failed to converge on real factors.
    u, s, vt = svd(A[:, used] / norms[used], full_matrices=False, lapack_driver="gesvd")
    good = s > NEGLIGIBLE * s[0]
    projected = u.T @ b
    solutions = []
    for ridge in ridges:
        gain = np.where(good, s / (s**2 + (ridge * s[0]) ** 2 + ~good), 0.0)
        x = np.zeros(plan.n_columns)
        x[used] = (vt.T @ (gain * projected)) / norms[used]
        solutions.append(x)
    return solutions


def _residual(plan: Plan, j: int, rows: FloatArray, x: FloatArray, scale: FloatArray) -> FloatArray:
    """Torque left of joint j's rows (or factor rows)."""
    coefficients = x[plan.unknowns(j)]
    coefficients[plan.n_own :] *= scale[j]
    left: FloatArray = rows[:, -1] - rows[:, :-1] @ coefficients
    return left


def residual_power(plan: Plan, factors: Sequence[FloatArray], x: FloatArray, scale: FloatArray) -> FloatArray:
    """Sum of squared residuals per joint, (n_joints,), from the factors alone: over n_rows it is Eq. 22's variance."""
    return np.array([np.sum(_residual(plan, j, R, x, scale) ** 2) for j, R in enumerate(factors)])


def block_residuals(observations: Observations, x: FloatArray, scale: FloatArray) -> list[FloatArray]:
    """Residuals of every block, (n_rows, n_joints) each: E of Eq. 21."""
    plan = observations.plan
    return [
        np.stack([_residual(plan, j, rows, x, scale) for j, rows in enumerate(block.rows)], axis=1)
        for block in observations.blocks
    ]


def residual_covariance(
    observations: Observations, x: FloatArray, scale: FloatArray, *, as_printed: bool = False
) -> FloatArray:
    """Covariance of the residual between joints (Eq. 24), divisor rows minus the rank's share of a joint.

    `as_printed`: the divisor is rows minus the whole rank, as if each joint had paid for all parameters. The paper's
    estimate (Eq. 25) is the same with either; noise and intervals are not, and the share is the unbiased one.
    """
    plan = observations.plan
    left = np.concatenate(block_residuals(observations, x, scale))
    rank = plan.estimable().sum()
    share = rank if as_printed else rank / plan.robot.n_joints
    freedom = np.sqrt(np.maximum(observations.n_counted - share, 1.0))
    covariance: FloatArray = left.T @ left / np.outer(freedom, freedom)
    return covariance


def whitened(observations: Observations, covariance: FloatArray, scale: FloatArray) -> FloatArray:
    """Factor of all rows after whitening across joints (Eq. 25): one more pass, joints of one sample side by side."""
    plan = observations.plan
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    factors = []
    for block in observations.blocks:
        wide = np.stack([stack_one(plan, j, rows, scale) for j, rows in enumerate(block.rows)], axis=1)
        factors.append(_core.triangular_factor(np.ascontiguousarray((whitener @ wide).reshape(-1, wide.shape[2]))))
    return _core.merge_factors(factors)
