"""Columns weighed beside the whole declared model: what it can absorb of them is taken out first.

Rows of all joints and runs stand under each other, each over its joint's noise, ``W x = y``. With Q an orthonormal
basis of W, a column z counts with ``z - Q Q' z`` only: its coefficient is the one that a fit with everything else would
give.

Of the four modules of this kind only this one gives the coefficients of many columns with one covariance between them,
from stretches of the runs, so that parts of a torque can be asked whether they agree about a delay or a gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.systems import NEGLIGIBLE, stack_one

FloatArray = NDArray[np.float64]

BLOCK = 1.5
"""Stretches of a run [s] whose residuals are taken as independent: longer than the residual's memory in the band."""
LEAST_LEFT = 1e-3
"""A column of which the declared model leaves less than this share cannot be told from it."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """Coefficients of columns beside the whole model.

    `value` (k,), NaN where a column cannot be told from the model; `covariance` (k, k) honest under residuals that are
    correlated in time and between joints; `dof` blocks that it was estimated from, less the columns.
    """

    value: FloatArray
    covariance: FloatArray
    dof: int

    @property
    def std_error(self) -> FloatArray:
        """(k,)."""
        result: FloatArray = np.sqrt(np.diag(self.covariance))
        return result


class Beside:
    """The declared model's rows, ready to have columns weighed beside them.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted; its rows, noise and drive gains are used.
    scale : ndarray (n_joints,), optional
        Torque channel per link torque, instead of the fit's.

    Attributes
    ----------
    Q : ndarray (n_rows_all + n_prior_rows, rank)
        Orthonormal basis of the declared columns, drive gains included where they are fitted, on the rows
        of the fit and, below them, those of its prior.
    weights : ndarray (n_joints,)
        One over the noise per joint.
    block : ndarray (n_rows_all,)
        Number of the stretch that a row belongs to; the same for all joints.
    """

    def __init__(self, fit: ThreeLoopIdentifier, scale: FloatArray | None = None) -> None:
        self.fit = fit
        observations, links = fit.observations_, fit.links_
        self.scale: FloatArray = links.torque_scale_ if scale is None else scale
        plan = observations.plan
        self.n_joints: int = plan.robot.n_joints
        rows = [observations.by_run([block.rows[j] for block in observations.blocks]) for j in range(self.n_joints)]
        size = np.array([np.sqrt(np.mean(np.concatenate([run[:, -1] for run in joint]) ** 2)) for joint in rows])
        self.weights: FloatArray = 1 / np.maximum(links.noise_std_, 1e-9 * np.maximum(size, 1e-300))
        wide = np.concatenate(
            [self.weights[j] * stack_one(plan, j, np.concatenate(joint), self.scale) for j, joint in enumerate(rows)]
        )
        self._columns, self._torque = wide[:, :-1], wide[:, -1]
        self._used = plan.estimable()
        count = sum(len(run) for run in rows[0])
        self._joint = np.repeat(np.arange(self.n_joints), count)
        blocks = self._blocks()
        self.block = np.tile(blocks, self.n_joints)
        self._pull = links._alike(observations) if links.posterior_ is None else links.posterior_.pull
        in_ampere = fit.torque_unit_ == "A"
        self._scaled_joints = list(range(1, self.n_joints)) if in_ampere else list(fit.free_gains)
        self.Q = self._basis()

    def _blocks(self) -> NDArray[np.intp]:
        first, parts = 0, []
        for states in self.fit.runs_:
            time = states.t[states.rows]
            length = min(BLOCK, max(np.ptp(states.t) / 8, 1e-9))
            number = ((time - states.t[0]) / length).astype(int)
            parts.append(first + np.unique(number, return_inverse=True)[1])
            first = int(parts[-1].max(initial=first - 1)) + 1
        return np.concatenate(parts)

    def _basis(self) -> FloatArray:
        plan, links = self.fit.observations_.plan, self.fit.links_
        columns = np.concatenate([self._columns, self._pull[:, :-1]])
        changes = np.zeros((len(columns), len(self._scaled_joints)))
        for place, j in enumerate(self._scaled_joints):
            own = self._joint == j
            load = self._columns[own][:, : plan.n_base] @ links.phi_base_
            changes[: len(self._joint)][own, place] = load / self.scale[j]
        columns = np.concatenate([columns[:, self._used], changes], axis=1)
        norms = np.linalg.norm(columns, axis=0)
        columns = columns[:, norms > NEGLIGIBLE * norms.max(initial=0.0)]
        ridge = float(links.ridge_)
        if ridge > 0:
            unit = np.linalg.norm(columns, axis=0)
            top = np.linalg.norm(columns / unit, 2)
            columns = np.concatenate([columns, np.diag(ridge * top * unit)])
        Q, _ = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))
        return np.ascontiguousarray(Q)

    @cached_property
    def load(self) -> FloatArray:
        """Rigid-body torque that these columns fit, weighted and with the channel's gain, (n_rows_all, n_joints)."""
        n_base = self.fit.observations_.plan.n_base
        norms = np.linalg.norm(self._columns, axis=0)
        norms[norms == 0] = 1.0
        x = np.zeros(self._columns.shape[1])
        A = np.concatenate([self._columns, self._pull[:, :-1]])[:, self._used] / norms[self._used]
        b = np.concatenate([self._torque, self._pull[:, -1]])
        x[self._used] = np.linalg.lstsq(A, b, rcond=NEGLIGIBLE)[0] / norms[self._used]
        return self._by_joint(self._columns[:, :n_base] @ x[:n_base])

    @cached_property
    def torque(self) -> FloatArray:
        """Weighted torque of all rows."""
        return self._torque

    def stacked(self, runs: Sequence[FloatArray]) -> FloatArray:
        """Rows (n_rows, n_joints) of every run, one signal for all joints, as one weighted column of all rows."""
        return np.concatenate(
            [self.weights[j] * np.concatenate([run[:, j] for run in runs]) for j in range(self.n_joints)]
        )

    def apart(self, runs: Sequence[FloatArray]) -> FloatArray:
        """The same, with a column per joint: (n_rows_all, n_joints)."""
        return self._by_joint(self.stacked(runs))

    def _by_joint(self, total: FloatArray) -> FloatArray:
        columns = np.zeros((len(total), self.n_joints))
        for j in range(self.n_joints):
            own = self._joint == j
            columns[own, j] = total[own]
        return columns

    def left(self, x: FloatArray) -> FloatArray:
        """What the declared model leaves of rows (n_rows_all, ...); below them what it costs its prior."""
        below = np.zeros((len(self.Q) - len(x), *x.shape[1:]))
        result: FloatArray = np.concatenate([x, below]) - self.Q @ (self.Q[: len(x)].T @ x)
        return result

    def weigh(self, columns: FloatArray, torque: FloatArray | None = None) -> Weighed:
        """Coefficients of `columns` (n_rows_all, k) beside the model, on the measured torque or on `torque`."""
        k = columns.shape[1]
        residual = self.left(self._torque if torque is None else torque)
        kept = self.left(columns)
        norms = np.linalg.norm(kept, axis=0)
        before = np.linalg.norm(columns, axis=0)
        good = (norms > LEAST_LEFT * before) & (before > NEGLIGIBLE * before.max(initial=0.0))
        value, covariance = np.full(k, np.nan), np.full((k, k), np.nan)
        n_blocks = int(self.block.max()) + 1
        dof = n_blocks - int(good.sum())
        if not good.any() or dof < 2:
            return Weighed(value, covariance, dof)
        Z = kept[:, good] / norms[good]
        inverse = np.linalg.pinv(Z.T @ Z, rcond=1e-9, hermitian=True)
        c = inverse @ (Z.T @ residual)
        error = residual - Z @ c
        rows = len(self.block)
        n_free = rows - self.Q.shape[1] - int(good.sum())
        plain = inverse * float(error[:rows] @ error[:rows]) / n_free
        scores = np.zeros((n_blocks, Z.shape[1]))
        np.add.at(scores, self.block, Z[:rows] * error[:rows, None])
        robust = inverse @ (scores.T @ scores) @ inverse * n_blocks / dof
        # Few blocks: their variances can be had, their correlations hardly; those are the plain ones.
        scale = np.sqrt(np.maximum(np.diag(robust) / np.diag(plain), 1.0))
        value[good] = c / norms[good]
        covariance[np.ix_(good, good)] = plain * np.outer(scale / norms[good], scale / norms[good])
        return Weighed(value, covariance, dof)
