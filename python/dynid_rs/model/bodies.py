"""The semidefinite program behind physically consistent parameters: one 4 x 4 pseudo-inertia per link.

``P_i = T_i M_i T_i'`` with T_i from the declared link i, so that every unknown is of order one and "as declared" is the
unit matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import MissingLibraryError

FloatArray = NDArray[np.float64]

LEAST_RADIUS = 0.05
"""A declared body has at least this radius of gyration in every direction, relative to its greatest..."""
THINNEST = 2e-3
"""...and this one [m]: points and rods are no bodies to measure distances with."""
UNKNOWN_MASS, UNKNOWN_RADIUS = 1.0, 0.1
"""Mass [kg] and radius of gyration [m] that stand for a link of which the robot file says nothing."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Declared bodies: roots T (n, 4, 4) of their pseudo-inertias T T', masses [kg], which are really declared."""

    roots: FloatArray
    masses: FloatArray
    known: NDArray[np.bool_]


def declared_bodies(robot: _core.RobotModel) -> Bodies:
    """Bodies of the robot file, made thick enough to be bodies."""
    pseudo = _core.pseudo_inertia(robot.phi)
    roots, known = np.empty_like(pseudo), np.zeros(len(pseudo), dtype=bool)
    for k, P in enumerate(pseudo):
        mass = P[3, 3]
        known[k] = mass > 0
        if not known[k]:
            roots[k] = np.sqrt(UNKNOWN_MASS) * np.diag([UNKNOWN_RADIUS, UNKNOWN_RADIUS, UNKNOWN_RADIUS, 1.0])
            continue
        centre = P[:3, 3] / mass
        squares, axes = np.linalg.eigh(P[:3, :3] / mass - np.outer(centre, centre))
        least = max(LEAST_RADIUS * np.sqrt(max(squares[-1], 0.0)), THINNEST)
        roots[k] = 0.0
        roots[k, :3, :3] = axes * np.sqrt(np.maximum(squares, least**2))
        roots[k, :3, 3] = centre
        roots[k, 3, 3] = 1.0
        roots[k] *= np.sqrt(mass)
    return Bodies(roots, roots[:, 3, 3] ** 2, known)


def _body_map(root: FloatArray) -> FloatArray:
    """(10, 16) with ``phi = map @ vec(M)`` for the pseudo-inertia ``root M root'``, M symmetric."""
    columns = root[:, None, :, None] * root[None, :, None, :]  # (4, 4, 4, 4): row, column of P; row, column of M
    stacked = columns.reshape(4, 4, 16).transpose(2, 0, 1)
    wide: FloatArray = _core.phi_from_pseudo_inertia(np.ascontiguousarray(stacked)).reshape(16, 10).T
    return wide


@dataclass(frozen=True, eq=False)
class Terms:
    """Whitened rows ``matrix @ [phi | rotors] - right``, (rows, 11 n_links) and (rows,), and what holds the rotors.

    `rotor_declared`, `rotor_reference` (n_joints,) [kg*m^2]: declared values, and the size of a deviation from them.
    """

    matrix: FloatArray
    right: FloatArray
    rotor_declared: FloatArray
    rotor_reference: FloatArray


class Program:
    """The semidefinite program, set up once and solved for several weights of the declared inertials."""

    def __init__(
        self,
        terms: Terms,
        declared: Bodies,
        *,
        margin: float,
        mass_range: tuple[float, float],
        gain: float = 1.0,
    ) -> None:
        cp = import_cvxpy()
        n = len(declared.roots)
        self._maps = [_body_map(root) for root in declared.roots]
        self._bodies = [cp.Variable((4, 4), symmetric=True) for _ in range(n)]
        self._rotors = cp.Variable(n, nonneg=True)  # relative to their references
        self._root_weight = cp.Parameter(nonneg=True)
        self._reference, self._least = terms.rotor_reference, margin * gain
        psi = cp.hstack([L @ cp.vec(M, order="F") for L, M in zip(self._maps, self._bodies, strict=True)])
        left = terms.matrix @ cp.hstack([psi, cp.multiply(self._reference, self._rotors)]) - terms.right
        away = [cp.vec(M - gain * np.eye(4), order="F") for M in self._bodies]
        away.append(self._rotors - gain * (terms.rotor_declared / self._reference))
        pull = self._root_weight * cp.hstack(away)
        constraints = []
        heaviest = mass_range[1] * declared.masses
        heaviest[-1] = max(heaviest[-1], declared.masses.sum())
        for k, (L, M) in enumerate(zip(self._maps, self._bodies, strict=True)):
            constraints.append(M - self._least * np.eye(4) >> 0)
            if declared.known[k]:
                mass = L[:1] @ cp.vec(M, order="F")
                constraints.append(mass >= mass_range[0] * declared.masses[k] * gain)
                constraints.append(mass <= heaviest[k] * gain)
        self._solver, self._errors = cp.CLARABEL, cp.error.SolverError
        self._program = cp.Problem(cp.Minimize(cp.sum_squares(left) + cp.sum_squares(pull)), constraints)

    def solve(self, weight: float) -> tuple[FloatArray, FloatArray]:
        """Parameters (10 n_links,) and rotor inertias (n_joints,), times gain.

        Raises
        ------
        ValueError
            The solver found none.
        """
        import warnings

        self._root_weight.value = np.sqrt(weight)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # an inaccurate solution is judged by its eigenvalues
                self._program.solve(solver=self._solver)
        except self._errors as error:
            reason = str(error).split(".")[0]
            raise ValueError(f"no physically consistent set was found: the solver gave up ({reason})") from None
        values = [np.zeros((4, 4)) if M.value is None else 0.5 * (M.value + M.value.T) for M in self._bodies]
        if min(float(np.linalg.eigvalsh(M)[0]) for M in values) < 0.5 * self._least:
            raise ValueError(
                f"no physically consistent set was found: the solver ended with {self._program.status}; are torque, "
                "gear ratios and units right?"
            )
        psi = np.concatenate([L @ M.ravel(order="F") for L, M in zip(self._maps, values, strict=True)])
        return psi, self._reference * np.maximum(self._rotors.value, 0.0)


def import_cvxpy() -> Any:
    """cvxpy, which takes seconds to import and which few need."""
    try:
        import clarabel  # noqa: F401
        import cvxpy
    except ImportError as error:
        raise MissingLibraryError(error.name or "cvxpy", "physical", "physically consistent parameters") from None
    return cvxpy
