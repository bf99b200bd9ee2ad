"""The whole fitted model as one weighted system, so that columns can be weighed beside it.

Of the four modules of this kind only this one keeps what the fit's priors leave as rows of their own, with the torque
scales that the fit estimated among the unknowns: Gauss-Newton steps on the robot or on a channel need both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.candidate import RunColumns
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import States
from dynid_rs.scales import SCALE_SPREAD, free_scales
from dynid_rs.systems import block_residuals, stack_one

FloatArray = NDArray[np.float64]

NEGLIGIBLE = 1e-10
"""Relative singular values below this are rounding."""
LEAST_NOISE = 1e-9
"""No joint's noise counts as less than this part of its torque."""


@dataclass(frozen=True, eq=False)
class Beside:
    """Rows of a fit, one over its noise each: joint by joint, run by run; rows of its priors stand below.

    Unknowns are those of the fit and the torque scales that it estimated.
    """

    fit: ThreeLoopIdentifier

    @cached_property
    def weights(self) -> FloatArray:
        """One over the residual's standard deviation (n_joints,)."""
        observations = self.fit.observations_
        size = np.array([np.linalg.norm(R[:, -1]) for R in observations.factors()]) / np.sqrt(observations.n_rows)
        weights: FloatArray = 1 / np.maximum(self.fit.links_.noise_std_, np.maximum(LEAST_NOISE * size, 1e-300))
        return weights

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """Which of the fit's unknowns and of the torque scales are estimated, (n_columns + n_joints,)."""
        fit = self.fit
        n = fit.robot.n_joints
        free = free_scales(n, fit.torque_unit_ == "A", () if fit.torque_unit_ == "A" else fit.free_gains)
        return np.concatenate([fit.observations_.plan.estimable(), free])

    @cached_property
    def columns(self) -> FloatArray:
        """Weighted columns of the unknowns in use, (n_all_rows, n_used); rows of the priors are the last."""
        return np.concatenate([self._data, self.prior[:, :-1]])

    @cached_property
    def residual(self) -> FloatArray:
        """Weighted residual of the fit (n_all_rows,), that of its priors too."""
        fit, links = self.fit, self.fit.links_
        left = fit.observations_.by_run(block_residuals(fit.observations_, links.x_, links.torque_scale_))
        data = [w * np.concatenate([run[:, j] for run in left]) for j, w in enumerate(self.weights)]
        return np.concatenate([*data, self.prior[:, -1]])

    @cached_property
    def _data(self) -> FloatArray:
        fit, links = self.fit, self.fit.links_
        plan = fit.observations_.plan
        n = plan.robot.n_joints
        parts = []
        for j, weight in enumerate(self.weights):
            rows = np.concatenate(fit.observations_.by_run([block.rows[j] for block in fit.observations_.blocks]))
            wide = stack_one(plan, j, rows, links.torque_scale_)[:, :-1]
            scale = np.zeros((len(rows), n))
            scale[:, j] = rows[:, plan.n_own : -1] @ links.x_[plan.unknowns(j)[plan.n_own :]]
            parts.append(weight * np.concatenate([wide, scale], axis=1)[:, self.used])
        return np.concatenate(parts)

    @cached_property
    def prior(self) -> FloatArray:
        """Rows ``[A | what the fit leaves of b]`` of everything that held the unknowns, (n_rows, n_used + 1)."""
        fit, links = self.fit, self.fit.links_
        plan = fit.observations_.plan
        n = plan.robot.n_joints
        pull = links._alike(fit.observations_) if links.posterior_ is None else links.posterior_.pull
        rows = np.zeros((len(pull) + n, plan.n_columns + n + 1))
        rows[: len(pull), : plan.n_columns] = pull[:, :-1]
        rows[: len(pull), -1] = pull[:, -1] - pull[:, :-1] @ links.x_
        rows[len(pull) :, plan.n_columns : -1] = np.eye(n) / SCALE_SPREAD
        rows[len(pull) :, -1] = (1 - links.torque_scale_) / SCALE_SPREAD
        kept = np.append(np.ones(len(pull), dtype=bool), self.used[plan.n_columns :])
        rows = rows[kept][:, np.append(self.used, True)]
        if links.ridge_ > 0:
            norms = np.linalg.norm(self._data, axis=0)
            greatest = np.linalg.svd(self._data / np.where(norms > 0, norms, 1.0), compute_uv=False)[0]
            x = np.concatenate([links.x_, np.zeros(n)])[self.used]
            held = links.ridge_ * greatest * norms
            rows = np.concatenate([rows, np.column_stack([np.diag(held), -held * x])])
        return rows

    @cached_property
    def _norms(self) -> FloatArray:
        norms = np.linalg.norm(self.columns, axis=0)
        return np.where(norms > 0, norms, 1.0)

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        """Orthonormal and triangular factor of the columns at unit length: singular values are those of the second."""
        Q, R = np.linalg.qr(self.columns / self._norms)
        return Q, R

    @cached_property
    def _basis(self) -> FloatArray:
        Q, R = self._factors
        u, s, _ = np.linalg.svd(R)
        basis: FloatArray = Q @ u[:, s > NEGLIGIBLE * s[0]]
        return basis

    def stacked(self, columns: Sequence[RunColumns]) -> FloatArray:
        """Weighted rows (n_all_rows, k) of a candidate's columns; zeros in the priors' rows."""
        width = next(part.shape[1] for run in columns for part in run.values())
        n_rows = [len(states.rows) for states in self.fit.runs_]
        parts = [
            weight * run.get(j, np.zeros((length, width)))
            for j, weight in enumerate(self.weights)
            for run, length in zip(columns, n_rows, strict=True)
        ]
        return np.concatenate([*parts, np.zeros((len(self.prior), width))])

    def left(self, rows: FloatArray) -> FloatArray:
        """What the model cannot imitate of weighted rows (n_all_rows, ...)."""
        rest = rows - self._basis @ (self._basis.T @ rows)
        rest -= self._basis @ (self._basis.T @ rest)
        return rest

    def base_covariance(self) -> FloatArray:
        """Covariance of the base parameters (n_base, n_base), residuals taken as independent."""
        _, s, vt = np.linalg.svd(self._factors[1])
        n_base = self.fit.observations_.plan.n_base
        root = (vt[:, :n_base].T / np.maximum(s, NEGLIGIBLE * s[0])) / self._norms[:n_base, None]
        covariance: FloatArray = root @ root.T
        return covariance


def in_band(fit: ThreeLoopIdentifier, states: States, torque: FloatArray) -> RunColumns:
    """Columns of one run from link torques (n, n_joints, k) [N m] at every sample, in the torque unit at its rows."""
    rows = states.in_band(torque) * fit.links_.torque_scale_[:, None]
    return {j: rows[:, j] for j in range(rows.shape[1]) if np.any(rows[:, j])}
