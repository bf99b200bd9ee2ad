"""Standard parameters that bodies can have: positive masses, admissible inertias, as near to the torque as that allows.

The torque determines the base parameters only; many sets of standard parameters share them, and of a noisy estimate
perhaps none that a body could have. Among the bodies that can be built from points of positive mass, those whose
pseudo-inertia is positive definite (Wensing, Kim and Slotine 2018, IEEE RA-L 3), this looks for the one that leaves the
least torque, and pulls weakly towards the inertials that the robot file declares, so that what the motion says nothing
about stays as declared. A semidefinite program of 4 x 4 blocks, one per link, on the triangular factors of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from dynid_rs import _core
from dynid_rs.columns import Observations, Plan
from dynid_rs.errors import MissingLibraryError
from dynid_rs.links import LinkDynamicsIdentifier, residual_power, weighted_system

FloatArray = NDArray[np.float64]

LEAST_RADIUS = 0.05
"""A declared body has at least this radius of gyration in every direction, relative to its greatest..."""
THINNEST = 2e-3
"""...and this one [m]: points and rods are no bodies to measure distances with."""
UNKNOWN_MASS, UNKNOWN_RADIUS = 1.0, 0.1
"""Mass [kg] and radius of gyration [m] that stand for a link of which the robot file says nothing."""
LEAST_NOISE = 1e-4
"""Noise below this part of a joint's torque is taken for this: a fit without noise would weigh nothing else."""
WEIGHTS = (1e-4, 1e6)
"""Weights of the declared inertials between which is searched, in rows of the fit: with 1 a body as different from its
declaration as none at all costs one standard deviation of noise in one row."""
NEGLIGIBLE = 1e-12
"""Relative singular values below this are rounding."""


class PhysicalIdentifier(BaseEstimator):  # type: ignore[misc]
    """Physically consistent standard parameters from the triangular factors of a fit.

    Minimises ``|R x - r|^2 / noise^2 + w (sum_i |M_i - 1|_F^2 + sum_j (J_j - J_declared,j)^2 / J_ref,j^2)`` over
    pseudo-inertias ``P_i = T_i M_i T_i'`` (T_i of the declared link i) with ``M_i >= margin``, rotor inertias ``J_j >= 0``
    and free friction and offsets. The weight w is the greatest that costs no joint more than `growth`. Where the torque
    channel is in ampere, its common gain is the one with which the declared inertials explain the torque best.

    Parameters
    ----------
    growth : float
        How much of its error on the training rows a joint may give for a set nearer to the declared inertials,
        relative to the physically consistent set that leaves least.
    margin : float
        Least eigenvalue of the pseudo-inertia relative to the declared one's.
    mass_range : tuple of float
        Least and greatest mass of a link relative to the declared one; ignored where none is declared. The last link
        may carry a payload: its bound is the declared mass of the whole arm.

    Attributes
    ----------
    phi_ : ndarray (10 n_links,)
        Inertial parameters [kg, kg*m, kg*m^2].
    rotor_inertia_ : ndarray (n_joints,)
        Reflected to the link side [kg*m^2, kg].
    drive_gain_ : ndarray (n_joints,)
        Torque per unit of the torque channel [N*m per N*m or A]; ones where torques were fitted.
    prior_weight_ : float
        Weight of the declared inertials in use.
    own_ : ndarray (n_joints, n_own)
        Friction and offset beside these bodies [torque unit], rotor inertias in their places.
    """

    def __init__(
        self, *, growth: float = 0.001, margin: float = 1e-3, mass_range: tuple[float, float] = (0.5, 2.0)
    ) -> None:
        self.growth = growth
        self.margin = margin
        self.mass_range = mass_range

    def fit(
        self, observations: Observations, links: LinkDynamicsIdentifier, *, torque_unit: str = "N*m"
    ) -> PhysicalIdentifier:
        """Fit beside a free fit of the same observations, whose weights and torque scales it takes over.

        Raises
        ------
        ValueError
            A parameter is out of its range; ampere without declared inertials; no such set was found.
        MissingLibraryError
            cvxpy is not installed.
        """
        if not 0 < self.growth < np.inf:
            raise ValueError(f"growth must be a positive number, found {self.growth!r}")
        if not 0 < self.margin < 1:
            raise ValueError(f"margin must lie between 0 and 1, found {self.margin!r}")
        low, high = self.mass_range
        if not 0 <= low < 1 < high:
            raise ValueError(f"mass_range must hold 1, found {self.mass_range!r}")
        plan = observations.plan
        robot = plan.robot
        declared = _declared_bodies(robot)
        if torque_unit == "A" and not declared.known.any():
            raise ValueError(
                f"the robot {robot.name!r} declares no masses, and currents alone do not tell them; give --drive-gain "
                "(N*m/A, one per joint), or a robot file with inertials"
            )
        problem = _reduce(observations, links)
        gain = _declared_gain(problem) if torque_unit == "A" else 1.0
        program = _Program(problem, declared, self.margin, self.mass_range, gain)
        psi, rotor = self._nearest(program, problem, observations, links)
        self.phi_ = psi / gain
        self.rotor_inertia_ = rotor / gain
        self.drive_gain_ = 1 / (gain * links.torque_scale_) if torque_unit == "A" else np.ones(robot.n_joints)
        self.own_ = problem.own(psi, rotor, links.torque_scale_)
        self._channel_phi = psi
        return self

    def torque_model(self, like: _core.TorqueModel) -> _core.TorqueModel:
        """Torque model of this set, in the unit of `like`; all that is not identified here is that of `like`."""
        check_is_fitted(self, "phi_")
        effects, first = [], 0
        for effect, _ in like.effects:
            effects.append((effect, self.own_[:, first : first + effect.n_columns]))
            first += effect.n_columns
        return _core.TorqueModel(
            like.robot,
            self._channel_phi,
            effects,
            residual=like.residual,
            torque_scale=like.torque_scale.tolist(),
            encoder_delay=like.encoder_delay.tolist(),
            noise_std=like.noise_std.tolist(),
            domain=like.domain,
            torque_unit=like.torque_unit,
        )

    def physical_set(self, like: _core.TorqueModel) -> _core.PhysicalSet:
        """Return what goes into `model.json` and a URDF; friction as Coulomb and viscous torque of both directions."""
        damping, friction = coulomb_viscous(self.torque_model(like))
        return _core.PhysicalSet(
            self.phi_,
            self.rotor_inertia_,
            damping=self.drive_gain_ * damping,
            friction=self.drive_gain_ * friction,
            drive_gain=self.drive_gain_,
        )

    def _nearest(
        self, program: _Program, problem: _Problem, observations: Observations, links: LinkDynamicsIdentifier
    ) -> tuple[FloatArray, FloatArray]:
        """Solution of the greatest weight that no joint pays more than `growth` for, by bisection of its logarithm."""
        factors, scale = observations.factors(), links.torque_scale_

        def solved(weight: float) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
            solution = program.solve(weight)
            x = problem.unknowns(*solution)
            return solution, np.sqrt(residual_power(observations.plan, factors, x, scale))

        low, high = np.log10(WEIGHTS)
        best, least = solved(WEIGHTS[0])
        self.prior_weight_ = WEIGHTS[0]
        while high - low > 0.1:
            middle = 0.5 * (low + high)
            solution, error = solved(10**middle)
            if np.all(error <= (1 + self.growth) * least + 1e-300):
                best, low = solution, middle
                self.prior_weight_ = float(10**middle)
            else:
                high = middle
        return best


class _Program:
    """The semidefinite program, set up once and solved for several weights of the declared inertials."""

    def __init__(
        self,
        problem: _Problem,
        declared: _Bodies,
        margin: float,
        mass_range: tuple[float, float],
        gain: float,
    ) -> None:
        cp = _cvxpy()
        n = len(declared.roots)
        self._maps = [_body_map(root) for root in declared.roots]
        self._bodies = [cp.Variable((4, 4), symmetric=True) for _ in range(n)]
        self._rotors = cp.Variable(n, nonneg=True)  # relative to their references
        self._root_weight = cp.Parameter(nonneg=True)
        self._reference, self._least = problem.rotor_reference, margin * gain
        psi = cp.hstack([L @ cp.vec(M, order="F") for L, M in zip(self._maps, self._bodies, strict=True)])
        left = problem.matrix @ cp.hstack([psi, cp.multiply(self._reference, self._rotors)]) - problem.right
        away = [cp.vec(M - gain * np.eye(4), order="F") for M in self._bodies]
        away.append(self._rotors - gain * (problem.plan.robot.rotor_inertia / self._reference))
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


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Declared bodies: roots T (n, 4, 4) of their pseudo-inertias T T', masses [kg], which are really declared."""

    roots: FloatArray
    masses: FloatArray
    known: NDArray[np.bool_]


def _declared_bodies(robot: _core.RobotModel) -> _Bodies:
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
    return _Bodies(roots, roots[:, 3, 3] ** 2, known)


def _body_map(root: FloatArray) -> FloatArray:
    """(10, 16) with ``phi = map @ vec(M)`` for the pseudo-inertia ``root M root'``, M symmetric."""
    columns = root[:, None, :, None] * root[None, :, None, :]  # (4, 4, 4, 4): row, column of P; row, column of M
    stacked = columns.reshape(4, 4, 16).transpose(2, 0, 1)
    wide: FloatArray = _core.phi_from_pseudo_inertia(np.ascontiguousarray(stacked)).reshape(16, 10).T
    return wide


@dataclass(frozen=True, eq=False)
class _Problem:
    """Rows ``matrix @ [psi | rotors] - right`` (whitened) after friction and offsets are eliminated.

    `system`, `free`: the whitened rows of all unknowns, and which are eliminated. `to_unknowns`
    (n_columns, 10 n_links + n_joints): base parameters and rotor columns from psi and rotors (in the first joint's unit).
    """

    plan: Plan
    system: FloatArray
    free: NDArray[np.bool_]
    to_unknowns: FloatArray
    matrix: FloatArray
    right: FloatArray
    rotor_reference: FloatArray

    def unknowns(self, psi: FloatArray, rotor: FloatArray) -> FloatArray:
        """All unknowns of the fit (n_columns,): base parameters of these bodies, and friction and offsets beside them."""
        x: FloatArray = self.to_unknowns @ np.concatenate([psi, rotor])
        x[self.free] = _least_squares(self.system[:, :-1][:, self.free], self.system[:, -1] - self.system[:, :-1] @ x)
        return x

    def own(self, psi: FloatArray, rotor: FloatArray, scale: FloatArray) -> FloatArray:
        """Own coefficients (n_joints, n_own) beside these bodies, rotors in their places."""
        plan = self.plan
        own = self.unknowns(psi, rotor)[plan.n_base :].reshape(-1, plan.n_own).copy()
        place = _rotor_column(plan)
        if place is not None:
            own[:, place] = scale * rotor
        return own


def _reduce(observations: Observations, links: LinkDynamicsIdentifier) -> _Problem:
    """Bring the fit's system into the unknowns of the bodies."""
    plan, scale = observations.plan, links.torque_scale_
    robot = plan.robot
    n = robot.n_joints
    system = weighted_system(observations, links, least_noise=LEAST_NOISE)
    base = robot.base_parameters()
    to_unknowns = np.zeros((plan.n_columns, 11 * n))
    to_unknowns[np.arange(plan.n_base), plan.pivots] = 1.0
    if base.beta.size:
        to_unknowns[: plan.n_base, base.dependent] = base.beta
    place = _rotor_column(plan)
    free = plan.estimable()
    free[: plan.n_base] = False
    for j in range(n if place is not None else 0):
        column = plan.n_base + j * plan.n_own + place
        free[column] = False
        if plan.own[j, place]:
            to_unknowns[column, 10 * n + j] = scale[j]
        elif (j, place) in plan.absorbed:
            to_unknowns[: plan.n_base, 10 * n + j] = plan.absorbed[j, place]
    if links.ridge_ > 0:
        system = np.concatenate([system, _ridge_rows(plan, system, free, links.ridge_)])
    known = _range_of(system[:, :-1][:, free])
    wide = np.column_stack([system[:, :-1] @ to_unknowns, system[:, -1]])
    wide -= known @ (known.T @ wide)
    factor = _core.triangular_factor(np.ascontiguousarray(wide))
    reference = _rotor_reference(plan, links)
    return _Problem(plan, system, free, to_unknowns, factor[:, :-1], factor[:, -1], reference)


def _declared_gain(problem: _Problem) -> float:
    """Torque unit per N*m [A/(N*m)] of the first joint: the declared inertials' best multiple, rotors and friction free.

    Raises
    ------
    ValueError
        The declared inertials explain nothing of the torque.
    """
    from scipy.optimize import nnls

    n = 10 * problem.plan.robot.n_joints
    columns = np.column_stack([problem.matrix[:, :n] @ problem.plan.robot.phi, problem.matrix[:, n:]])
    gain = float(nnls(columns, problem.right)[0][0])
    if gain <= 0:
        raise ValueError(
            "the declared inertials explain nothing of the currents, so that the drives' gain stays unknown; give "
            "--drive-gain (N*m/A, one per joint)"
        )
    return gain


def _rotor_reference(plan: Plan, links: LinkDynamicsIdentifier) -> FloatArray:
    """Size (n_joints,) that a rotor inertia is measured by: as declared, or else as the free fit has it.

    A gear squares the rotor's inertia, so that the link's own says nothing about it. Where the free fit cannot tell a
    rotor from its link, the greatest of the others.
    """
    place = _rotor_column(plan)
    size = plan.robot.rotor_inertia.copy()
    if place is not None:
        free = np.abs(links.own_[:, place]) / links.torque_scale_
        size = np.where(size > 0, size, free)
    size = np.where(size > 0, size, size.max(initial=0.0))
    return np.where(size > 0, size, 1.0)


def _ridge_rows(plan: Plan, system: FloatArray, free: NDArray[np.bool_], ridge: float) -> FloatArray:
    """Rows of the free fit's own ridge, for the columns that are eliminated."""
    norms = np.linalg.norm(system[:, :-1], axis=0)
    used = plan.estimable() & (norms > NEGLIGIBLE * norms.max(initial=0.0))
    greatest = np.linalg.svd(system[:, :-1][:, used] / norms[used], compute_uv=False)[0]
    places = np.flatnonzero(free)
    rows = np.zeros((len(places), system.shape[1]))
    rows[np.arange(len(places)), places] = ridge * greatest * norms[places]
    return rows


def _rotor_column(plan: Plan) -> int | None:
    """Place of the rotor inertia among a joint's own columns."""
    names = [name for effect in plan.effects for name in effect.coefficient_names]
    return names.index("rotor_inertia") if "rotor_inertia" in names else None


def _range_of(columns: FloatArray) -> FloatArray:
    """Orthonormal basis (rows, rank) of what `columns` span."""
    norms = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns[:, norms > 0] / norms[norms > 0], full_matrices=False)
    basis: FloatArray = u[:, s > NEGLIGIBLE * s.max(initial=0.0)]
    return basis


def _least_squares(columns: FloatArray, right: FloatArray) -> FloatArray:
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0] = 1.0
    x: FloatArray = np.linalg.lstsq(columns / norms, right, rcond=NEGLIGIBLE)[0] / norms
    return x


def coulomb_viscous(model: _core.TorqueModel) -> tuple[FloatArray, FloatArray]:
    """Viscous and Coulomb coefficient (n_joints,) nearest to the model's friction over the speeds that it has seen.

    Of the odd part of every friction term (forwards minus backwards), least squares over 50 speeds per joint, neither
    coefficient below zero: what `<dynamics damping friction>` of a URDF can hold.
    """
    from scipy.optimize import nnls

    n = model.robot.n_joints
    limits, fastest = model.domain[0], np.asarray(model.domain[1])
    grid = (np.arange(50) + 0.5) / 50
    places = [k for k, name in enumerate(model.term_names) if "friction" in name]
    result = np.zeros((n, 2))
    for j in range(n):
        if fastest[j] <= 0:
            continue
        q, dq, zero = np.tile(np.mean(limits, axis=1), (50, 1)), np.zeros((50, n)), np.zeros((50, n))
        dq[:, j] = fastest[j] * grid
        forwards, backwards = (model.evaluate(q, side, zero)[1][:, places, j].sum(axis=1) for side in (dq, -dq))
        result[j] = nnls(np.column_stack([dq[:, j], np.ones(50)]), 0.5 * (forwards - backwards))[0]
    return result[:, 0], result[:, 1]


def _cvxpy() -> Any:
    """cvxpy, which takes seconds to import and which few need."""
    try:
        import clarabel  # noqa: F401
        import cvxpy
    except ImportError as error:
        raise MissingLibraryError(error.name or "cvxpy", "physical", "physically consistent parameters") from None
    return cvxpy
