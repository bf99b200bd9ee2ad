"""Standard parameters that bodies can have: positive masses, admissible inertias, as near to the torque as that allows.

The torque determines the base parameters only; many sets of standard parameters share them, and of a noisy estimate
perhaps none that a body could have. Among the bodies that can be built from points of positive mass, those whose
pseudo-inertia is positive definite (Wensing, Kim and Slotine 2018, IEEE RA-L 3), this looks for the one that leaves the
least torque, and pulls weakly towards the inertials that the robot file declares, so that what the motion says nothing
about stays as declared. A semidefinite program of 4 x 4 blocks, one per link, on the triangular factors of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.base.wording import is_friction
from dynid_rs.model.assembly import declared_temperature, with_parts
from dynid_rs.model.bodies import Program, Terms, declared_bodies
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.regression.fitted import FittedLinks, weighted_system
from dynid_rs.regression.is_fitted import check_is_fitted
from dynid_rs.regression.systems import residual_power

FloatArray = NDArray[np.float64]

LEAST_NOISE = 1e-4
"""Noise below this part of a joint's torque is taken for this: a fit without noise would weigh nothing else."""
WEIGHTS = (1e-4, 1e6)
"""Weights of the declared inertials between which is searched, in rows of the fit: with 1 a body as different from its
declaration as none at all costs one standard deviation of noise in one row."""
NEGLIGIBLE = 1e-12
"""Relative singular values below this are rounding."""


class PhysicalIdentifier(Estimator):
    """Physically consistent standard parameters from the triangular factors of a fit.

    Minimises ``|R x - r|^2 / noise^2 + w (sum_i |M_i - 1|_F^2 + sum_j (J_j - J_declared,j)^2 / J_ref,j^2)`` over
    pseudo-inertias ``P_i = T_i M_i T_i'`` (T_i of the declared link i) with ``M_i >= margin``, rotor inertias
    ``J_j >= 0`` and free friction and offsets. The weight w is the greatest that costs no joint more than `growth`.
    Where the torque channel is in ampere, its common gain is the one with which the declared inertials explain the
    torque best.

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

    def fit(self, observations: Observations, links: FittedLinks, *, torque_unit: str = "N*m") -> PhysicalIdentifier:
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
        declared = declared_bodies(robot)
        if torque_unit == "A" and not declared.known.any():
            raise ValueError(
                f"the robot {robot.name!r} declares no masses, and currents alone do not tell them; give --drive-gain "
                "(N*m/A, one per joint), or a robot file with inertials"
            )
        problem = _reduce(observations, links)
        gain = _declared_gain(problem) if torque_unit == "A" else 1.0
        program = Program(problem.terms, declared, margin=self.margin, mass_range=self.mass_range, gain=gain)
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
        for effect, coefficients in like.effects:
            fitted = first < self.own_.shape[1]  # known terms stand last and stay
            effects.append((effect, self.own_[:, first : first + effect.n_columns] if fitted else coefficients))
            first += effect.n_columns
        return with_parts(like, self._channel_phi, effects)

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
        self, program: Program, problem: _Problem, observations: Observations, links: FittedLinks
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


@dataclass(frozen=True, eq=False)
class _Problem:
    """The fit in the unknowns of the bodies, friction and offsets eliminated: `terms`.

    `system`, `free`: the whitened rows of all unknowns, and which are eliminated. `to_unknowns`
    (n_columns, 11 n_links): base parameters and rotor columns from phi and rotors, both in the first joint's unit.
    """

    plan: Plan
    system: FloatArray
    free: NDArray[np.bool_]
    to_unknowns: FloatArray
    terms: Terms

    def unknowns(self, psi: FloatArray, rotor: FloatArray) -> FloatArray:
        """All unknowns of the fit (n_columns,): base parameters of these bodies, friction and offsets beside them."""
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


def _reduce(observations: Observations, links: FittedLinks) -> _Problem:
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
    for j in range(n):
        if place is None:
            break
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
    terms = Terms(factor[:, :-1], factor[:, -1], robot.rotor_inertia, _rotor_reference(plan, links))
    return _Problem(plan, system, free, to_unknowns, terms)


def _declared_gain(problem: _Problem) -> float:
    """Torque unit per N*m [A/(N*m)] of the first joint: the declared inertials' best multiple beside all else.

    Raises
    ------
    ValueError
        The declared inertials explain nothing of the torque.
    """
    from scipy.optimize import nnls

    n = 10 * problem.plan.robot.n_joints
    columns = np.column_stack([problem.terms.matrix[:, :n] @ problem.plan.robot.phi, problem.terms.matrix[:, n:]])
    gain = float(nnls(columns, problem.terms.right)[0][0])
    if gain <= 0:
        raise ValueError(
            "the declared inertials explain nothing of the currents, so that the drives' gain stays unknown; give "
            "--drive-gain (N*m/A, one per joint)"
        )
    return gain


def _rotor_reference(plan: Plan, links: FittedLinks) -> FloatArray:
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


WAY, N_STEPS = 0.1, 50
"""Way [rad, m] before friction at a speed is read, ten times what bristles of gears bend, and its steps."""


def _friction_on_the_way(model: _core.TorqueModel, j: int, speed: FloatArray, places: list[int]) -> FloatArray:
    """Friction (n_speeds,) of joint j at `speed`, all of one sign, after a way in that direction; no channel late."""
    n, n_states = model.robot.n_joints, N_STEPS + len(speed)
    q, dq = np.tile(np.mean(model.domain[0], axis=1), (n_states, 1)), np.zeros((n_states, n))
    q[:, j] += np.sign(speed[0]) * WAY * (np.arange(n_states) / N_STEPS - 1)
    dq[:, j] = np.concatenate([np.full(N_STEPS, speed[0]), speed])
    still, temperature = model.with_torque_delay(0.0), declared_temperature([effect for effect, _ in model.effects], q)
    terms = still.evaluate(q, dq, np.zeros_like(dq), temperature=temperature)[1]
    friction: FloatArray = terms[N_STEPS:, places, j].sum(axis=1)
    return friction


def coulomb_viscous(model: _core.TorqueModel) -> tuple[FloatArray, FloatArray]:
    """Viscous and Coulomb coefficient (n_joints,) nearest to the model's friction over the speeds that it has seen.

    Of the odd part of every friction term (forwards minus backwards), least squares over 50 speeds per joint, neither
    coefficient below zero: what `<dynamics damping friction>` of a URDF can hold. Each speed is held for a way on which
    friction that remembers turns round.
    """
    from scipy.optimize import nnls

    n = model.robot.n_joints
    fastest = np.asarray(model.domain[1])
    grid = (np.arange(50) + 0.5) / 50
    places = [1 + k for k, (effect, _) in enumerate(model.effects) if is_friction(effect.kind)]
    result = np.zeros((n, 2))
    for j in range(n):
        if fastest[j] <= 0:
            continue
        speed = fastest[j] * grid
        forwards, backwards = (_friction_on_the_way(model, j, sign * speed, places) for sign in (1, -1))
        result[j] = nnls(np.column_stack([speed, np.ones(50)]), 0.5 * (forwards - backwards))[0]
    return result[:, 0], result[:, 1]
