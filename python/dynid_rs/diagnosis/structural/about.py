"""What a hypothesis about geometry, gravity or a channel needs of a fit: a full set of inertials, and its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.linear_model import Columns
from dynid_rs.regression.priors import declares_inertia, link_spread

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class About:
    """A fit with inertials (10 n_links,) [torque unit per N m included] behind its base parameters.

    Base parameters give the torque of the geometry and gravity that they belong to. How that torque changes with either
    depends on parameters that nothing has seen; the weak prior is the best guess of those. `root` (10 n_links, k): what
    stays unknown of them, a root of their covariance.
    """

    fit: ThreeLoopIdentifier
    phi: FloatArray
    root: FloatArray

    @staticmethod
    def of(fit: ThreeLoopIdentifier) -> About:
        """Condition the weak prior's inertials on the fitted base parameters."""
        robot, posterior = fit.robot, fit.links_.posterior_
        assert posterior is not None  # every fit that is diagnosed has the weak prior
        base = robot.base_parameters()
        unit = posterior.prior.unit
        declared = np.asarray(robot.phi) if declares_inertia(robot) else np.zeros(10 * robot.n_joints)
        spread = link_spread(declared) * unit * posterior.choice.width
        mean = unit * posterior.choice.centre * declared
        regroup = np.zeros((base.n_base, len(declared)))
        regroup[np.arange(base.n_base), np.asarray(base.pivots)] = 1.0
        regroup[:, np.asarray(base.dependent)] = base.beta
        wide = regroup * spread
        u, s, vt = np.linalg.svd(wide, full_matrices=True)
        seen = s > 1e-9 * s[0]
        step = vt[: len(s)][seen].T @ ((u[:, : len(s)][:, seen].T @ (fit.links_.phi_base_ - regroup @ mean)) / s[seen])
        unseen = vt[int(seen.sum()) :].T
        return About(fit, mean + spread * step, spread[:, None] * unseen)

    def in_band(self, per_run: Sequence[FloatArray]) -> Columns:
        """Columns of all runs from link torques (n, n_joints, k) at every sample of each, at the rows of the fit."""
        scale = self.fit.links_.torque_scale_[:, None]
        rows = [states.in_band(torque) * scale for states, torque in zip(self.fit.runs_, per_run, strict=True)]
        stacked = np.concatenate(rows)
        return {j: np.ascontiguousarray(stacked[:, j]) for j in range(stacked.shape[1]) if np.any(stacked[:, j])}
