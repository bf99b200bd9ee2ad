"""What the robot file says about inertia, as a prior on the unknowns of a fit.

``x ~ N(mean, s^2 K S K')``: the declared inertials through the regrouping K of the base parameters, S from plain
relative uncertainties (a link's mass by its mass, its first moments by mass times size, its inertia by mass times
size squared, a rotor by its inertia), times one number s: how far off the file is. s is found by the evidence, see
`evidence.py`. Friction, offsets and whatever the file does not declare have no prior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.columns import Plan

FloatArray = NDArray[np.float64]

LEAST_SIZE = 1e-3
"""Least size of a link [m] (root mean square distance of its mass from its frame)."""


@dataclass(frozen=True, eq=False)
class InertialPrior:
    """Declared inertials among the unknowns of a fit.

    Parameters
    ----------
    mean : ndarray (n_columns,)
        Declared base parameters and rotors; zeros where nothing is declared.
    root : ndarray (rank, n_columns)
        ``|root (x - mean)|^2 / s^2`` is the squared distance from the prior; its rank is below the number of base
        parameters where links are not declared.
    """

    mean: FloatArray
    root: FloatArray

    @property
    def rank(self) -> int:
        """Directions in which the file says something."""
        return len(self.root)

    def rows(self, spread: float) -> FloatArray:
        """Rows ``[A | b]`` that pull x to the mean, (rank, n_columns + 1), at relative uncertainty `spread`."""
        return np.column_stack([self.root, self.root @ self.mean]) / spread

    def std(self, spread: float) -> FloatArray:
        """Standard deviation of every unknown (n_columns,) at this uncertainty; infinite where nothing is declared."""
        inverse = np.linalg.pinv(self.root, rcond=1e-12)
        silent = np.eye(self.root.shape[1]) - inverse @ self.root
        said = np.abs(np.diag(silent)) < 1e-9
        std: FloatArray = np.where(said, spread * np.linalg.norm(inverse, axis=1), np.inf)
        return std

    def up_to_gain(self) -> InertialPrior:
        """Return the prior of an unknown multiple of the mean, the multiple integrated out (flat)."""
        along = self.root @ self.mean
        across = _left_null_space(along[:, None])
        return InertialPrior(np.zeros_like(self.mean), across @ self.root)

    def gain_of(self, x: FloatArray) -> float:
        """Multiple of the mean that is nearest to x."""
        along = self.root @ self.mean
        return float(along @ (self.root @ x) / (along @ along))


def inertial_prior(plan: Plan) -> InertialPrior:
    """Prior of the plan's robot on the unknowns of `plan`.

    Raises
    ------
    ValueError
        The robot file declares no link's inertia.
    """
    robot = plan.robot
    phi, rotors = np.asarray(robot.phi), np.asarray(robot.rotor_inertia)
    link_spread = np.concatenate([_spread(phi[10 * i : 10 * i + 10]) for i in range(robot.n_links)])
    if not np.any(link_spread):
        raise ValueError(
            f"the robot {robot.name!r} declares no link's inertia, so there is no prior in it; add <inertial> to its "
            "links, or fit without a prior"
        )
    regroup = _regrouping(plan)
    # An offset that base parameters absorb (gravity on a vertical slide) is not declared: its spread stays zero.
    value = np.concatenate([phi, rotors, np.zeros(robot.n_joints)])
    spread = np.concatenate([link_spread, rotors, np.zeros(robot.n_joints)])
    declared = spread > 0
    silent = regroup[:, ~declared]
    rows = np.flatnonzero(np.any(regroup, axis=1))
    outside = _left_null_space(silent[rows])
    _, factor = np.linalg.qr((outside @ regroup[np.ix_(rows, declared)] * spread[declared]).T)
    root = np.zeros((len(outside), plan.n_columns))
    root[:, rows] = np.linalg.solve(factor.T, outside)
    mean = regroup[:, declared] @ value[declared]
    return InertialPrior(mean, root)


def declares_inertia(robot: _core.RobotModel) -> bool:
    """True if the robot file declares at least one link's mass."""
    return bool(np.any(np.asarray(robot.phi)[::10] > 0))


def _spread(phi: FloatArray) -> FloatArray:
    """Standard deviation of a link's ten parameters at relative uncertainty one; zeros if it is not declared."""
    mass = phi[0]
    if mass <= 0:
        return np.zeros(10)
    # Half the trace of the inertia about the frame is the mass times its mean square distance from it.
    size = max(np.sqrt(max(phi[4] + phi[6] + phi[9], 0.0) / (2 * mass)), np.linalg.norm(phi[1:4]) / mass, LEAST_SIZE)
    spread: FloatArray = mass * np.concatenate([[1.0], np.full(3, size), np.full(6, size**2)])
    return spread


def _regrouping(plan: Plan) -> FloatArray:
    """K (n_columns, 10 n_links + 2 n_joints): unknowns of the fit from links, rotors and offsets."""
    robot = plan.robot
    n = robot.n_joints
    base = robot.base_parameters()
    K = np.zeros((plan.n_columns, 12 * n))
    K[np.arange(plan.n_base), np.asarray(base.pivots)] = 1.0
    K[: plan.n_base, np.asarray(base.dependent)] = base.beta
    kinds = [effect.kind for effect in plan.effects for _ in range(effect.n_columns)]
    for column, kind in enumerate(kinds):
        if kind not in ("rotor_inertia", "torque_offset"):
            continue
        first = 10 * n if kind == "rotor_inertia" else 11 * n
        for j in range(n):
            if (j, column) in plan.absorbed:
                K[: plan.n_base, first + j] = plan.absorbed[j, column]
            elif kind == "rotor_inertia" and plan.own[j, column]:
                K[plan.n_base + j * plan.n_own + column, first + j] = 1.0
    return K


def _left_null_space(matrix: FloatArray) -> FloatArray:
    """Orthonormal rows N with ``N matrix = 0``."""
    norms = np.linalg.norm(matrix, axis=0)
    matrix = matrix[:, norms > 0] / norms[norms > 0]
    u, s, _ = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.sum(s > 1e-10 * s[0])) if len(s) else 0
    null: FloatArray = u[:, rank:].T
    return null
