"""How far the predicted load may be off: directions of the inertial parameters that the torque leaves open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.uncertainty import parameter_covariance

if TYPE_CHECKING:
    from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

WEAK = 1e-12
"""Directions below this part of the greatest variance (in standard deviations of their own) do not count."""


@dataclass(frozen=True, eq=False)
class LoadDirections:
    """Independent directions in which the identified load may be off.

    Parameters
    ----------
    robot : RobotModel
        Geometry and gravity.
    pivots : ndarray (n_base,)
        Places of the base parameters in phi.
    root : ndarray (n_base, n_directions)
        Root of their covariance.
    torque_scale : ndarray (n_joints,)
        Of every joint's torque channel.
    rotor_hidden : tuple of int
        Joints whose rotor is not told from the link's own inertia by the torque. Only the link's part goes through the
        gear, so nothing is known of how the load follows this joint's acceleration.
    """

    robot: _core.RobotModel
    pivots: NDArray[np.int64]
    root: FloatArray
    torque_scale: FloatArray
    rotor_hidden: tuple[int, ...]

    def torques(self, q: FloatArray, dq: FloatArray, ddq: FloatArray, load: FloatArray) -> list[FloatArray]:
        """Load per standard deviation of every direction along a run: per joint (n, n_directions) [torque unit]."""
        base = self.robot.joint_torque_regressor(q, dq, ddq)[:, :, self.pivots]
        errors = []
        for j in range(self.robot.n_joints):
            own = self.pivots >= 10 * j
            error = base[:, j, own] @ self.root[own] * self.torque_scale[j]
            # One standard deviation of what nothing is known of: as much as the whole load.
            hidden = ddq[:, j] * (load[:, j].std() / max(float(ddq[:, j].std()), 1e-300))
            errors.append(np.column_stack([error, hidden if j in self.rotor_hidden else np.zeros(len(q))]))
        return errors


def load_directions(fit: ThreeLoopIdentifier) -> LoadDirections:
    """Directions of the load's uncertainty after a fit, honest under correlated residuals."""
    plan = fit.observations_.plan
    covariance = parameter_covariance(fit.observations_, fit.links_, fit.runs_)[: plan.n_base, : plan.n_base]
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    variances, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    kept = variances > WEAK * variances[-1]
    root = std[:, None] * vectors[:, kept] * np.sqrt(variances[kept])
    rotor = [effect.kind for effect in plan.effects].index("rotor_inertia")
    column = sum(effect.n_columns for effect in plan.effects[:rotor])
    hidden = tuple(j for j in range(plan.robot.n_joints) if (j, column) in plan.absorbed)
    return LoadDirections(plan.robot, plan.pivots, root, fit.links_.torque_scale_, hidden)
