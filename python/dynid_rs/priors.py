"""What the robot file says about inertia, as a prior on the unknowns of a fit.

``x ~ N(mean, K (s_l^2 S_l + s_r^2 S_r) K')``: the declared inertials through the regrouping K of the base parameters,
S from plain relative uncertainties (a link's mass by its mass, its first moments by mass times size, its inertia by
mass times size squared; a rotor by its inertia). s_l says how far off the links' inertials are, s_r the rotors', where
they are declared: they come from another document. Both are found by the evidence, see `evidence.py`. Friction, offsets
and whatever the file does not declare have no prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    span : ndarray (rank, n_columns)
        Orthonormal directions in which the file says something: fewer than the base parameters where links are not
        declared.
    roots : sequence of ndarray (rank, ...)
        Roots of the covariance of ``span x`` at relative uncertainty one: of the links, and of the rotors if any is
        declared.
    unknown_gain : bool
        x is an unknown multiple of what is declared; the multiple is integrated out (flat).
    """

    mean: FloatArray
    span: FloatArray
    roots: tuple[FloatArray, ...]
    unknown_gain: bool = False

    @property
    def rank(self) -> int:
        """Directions in which the file says something."""
        return len(self.span) - self.unknown_gain

    def up_to_gain(self) -> InertialPrior:
        """Return the prior of an unknown multiple of the mean."""
        return replace(self, unknown_gain=True)

    def rows(self, spreads: Sequence[float]) -> tuple[FloatArray, float]:
        """Rows ``[A | b]`` that pull x to the mean, (rank, n_columns + 1), and the covariance's log-determinant.

        `spreads`: relative uncertainty of the links, and of the rotors if they are declared.
        """
        root, log_det = self._root(spreads)
        along = root @ self.mean
        if not self.unknown_gain:
            return np.column_stack([root, along]), log_det
        across = _left_null_space(along[:, None])
        return np.column_stack([across @ root, np.zeros(len(across))]), log_det + float(np.log(along @ along))

    def gain_of(self, x: FloatArray, spreads: Sequence[float]) -> float:
        """Multiple of the mean that is nearest to x."""
        root, _ = self._root(spreads)
        along = root @ self.mean
        return float(along @ (root @ x) / (along @ along))

    def std(self, spreads: Sequence[float]) -> FloatArray:
        """Standard deviation of every unknown (n_columns,); infinite where nothing is declared."""
        spread = self.span.T @ np.column_stack([s * root for s, root in zip(spreads, self.roots, strict=True)])
        said = np.abs(1 - np.sum(self.span**2, axis=0)) < 1e-9
        std: FloatArray = np.where(said, np.linalg.norm(spread, axis=1), np.inf)
        return std

    def _root(self, spreads: Sequence[float]) -> tuple[FloatArray, float]:
        _, factor = np.linalg.qr(np.column_stack([s * root for s, root in zip(spreads, self.roots, strict=True)]).T)
        root: FloatArray = np.linalg.solve(factor.T, self.span)
        return root, 2 * float(np.sum(np.log(np.abs(np.diag(factor)))))


def inertial_prior(plan: Plan) -> InertialPrior:
    """Prior of the plan's robot on the unknowns of `plan`.

    Raises
    ------
    ValueError
        The robot file declares no link's inertia.
    """
    robot = plan.robot
    phi, rotors = np.asarray(robot.phi), np.asarray(robot.rotor_inertia)
    n_phi, n = len(phi), robot.n_joints
    if not declares_inertia(robot):
        raise ValueError(
            f"the robot {robot.name!r} declares no link's inertia, so there is no prior in it; add <inertial> to its "
            "links, or fit without a prior"
        )
    regroup = _regrouping(plan)
    # An offset that base parameters absorb (gravity on a vertical slide) is not declared: its spread stays zero.
    spread = np.concatenate(
        [*(link_spread(phi[first : first + 10]) for first in range(0, n_phi, 10)), rotors, np.zeros(n)]
    )
    declared = spread > 0
    known = np.flatnonzero(np.any(regroup, axis=1))
    outside = _left_null_space(regroup[np.ix_(known, ~declared)])
    span = np.zeros((len(outside), plan.n_columns))
    span[:, known] = outside
    is_rotor = (np.arange(len(spread)) >= n_phi) & declared
    kinds = [declared & ~is_rotor, is_rotor] if is_rotor.any() else [declared]
    value = np.concatenate([phi, rotors, np.zeros(n)])
    mean = regroup[:, declared] @ value[declared]
    return InertialPrior(mean, span, tuple((span @ regroup * spread)[:, kind] for kind in kinds))


def declares_inertia(robot: _core.RobotModel) -> bool:
    """True if the robot file declares at least one link's mass."""
    return bool(np.any(np.asarray(robot.phi)[::10] > 0))


def link_spread(phi: FloatArray) -> FloatArray:
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
