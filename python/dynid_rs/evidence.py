"""How much to trust a prior, decided by the evidence: the probability of the data with every unknown integrated out.

With factors R_j of every joint, noise sigma_j and the prior's covariance S = (P'P)^-1 (see `priors.py`), x is Gaussian
with precision ``H = sum_j w_j^2 R_j' R_j + P'P``, ``w_j^2 = eta_j / sigma_j^2``, and the logarithm of the evidence is

    - sum_j (n_j log sigma_j + eta_j |r_j|^2 / (2 sigma_j^2)) - |P (x - mean)|^2 / 2 - log det(S) / 2 - log det(H) / 2

up to a constant. It is maximised over the prior's relative uncertainties s (one number for the links, one for the
rotors where they are declared) by a search, and over sigma_j by MacKay's fixed point
``sigma_j^2 = eta_j |r_j|^2 / (n_j - gamma_j)`` (1992, Neural Computation 4), gamma_j the directions that joint j
determines.

Neighbouring samples are not independent: ``n_j = eta_j n_rows`` is what they are worth (`memory.inflation`), found from
the residual of the fit itself. Counting every sample would trust the data far too much and wash any prior out.

The evidence believes the model. Where an effect is missing that base parameters can imitate, it holds the robot file
for wrong and loosens the prior until they do; one joint is enough for that, since s is one for all links. No likelihood
can tell "the file is wrong" from "the model lacks something" without a second model to compare with. So models with and
without a term are compared twice: under the same s, found with the declared terms in (a missing effect then shows as an
error), and each under its own (how well the base parameters can imitate it), see `separability.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.columns import Observations, Plan
from dynid_rs.links import ASYMMETRY, alike_rows
from dynid_rs.memory import column_memory, inflation
from dynid_rs.priors import InertialPrior, inertial_prior
from dynid_rs.scales import improve_scale
from dynid_rs.systems import block_residuals, residual_power, stack_one

FloatArray = NDArray[np.float64]

SPREADS = (1e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
"""Relative uncertainties that are tried first."""
CLOSE = 0.05
"""Logarithms of relative uncertainties are found this closely."""
NEAR = 3.0
"""After the first round a search in one dimension stays within this factor."""
MOST_TRIES = 60
"""Most points of a search in two dimensions."""
SETTLED = 0.05
"""The logarithm of the relative uncertainty has settled when it changes less than this."""
FRICTION_SPREAD = 0.2
"""Size of a viscous term (root mean square over the rows) beside the joint's torque that counts as usual. Six
cancelling terms per joint are too many for a short run; on seven training sets of three robots the evidence was
greatest between 0.05 and 0.2, and flat in between. Coulomb friction's size has no prior."""
MAX_ROUNDS = 6
"""Most rounds of relative uncertainty and correlation in time."""
MAX_FIXED_POINT = 20
"""Most steps of the noise's fixed point."""
CHANGE = 1e-3
"""Relative change of the noise at which they stop."""
MOST_TAKEN = 0.9
"""At most this part of a joint's independent samples counts as used up by the unknowns."""
NEGLIGIBLE = 1e-12
"""Relative singular values below this are rounding."""
CLEAR = 1e-7
"""Diagonals of a triangular factor of unit columns above this need no singular values to be inverted."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Solution under a prior whose weight the evidence has found.

    Parameters
    ----------
    x : ndarray (n_columns,)
        Most probable unknowns.
    noise_std : ndarray (n_joints,)
        sigma_j [torque unit].
    spreads : ndarray (1,) or (2,)
        Relative uncertainties s of links and rotors; in ampere times the gain.
    evidence : float
        Logarithm, up to a constant that every fit of the same rows shares.
    n_determined : float
        Of the prior's directions, how many the data determines.
    n_effective : ndarray (n_joints,)
        Independent samples that the rows are worth.
    weights : ndarray (n_joints,)
        ``w_j`` of the joints' rows.
    scale : ndarray (n_joints,)
        Torque channel per link torque relative to the first joint's.
    gain : float
        Torque unit per N m of the prior's mean; 1 where the torque is in N m.
    prior, used_prior : InertialPrior
        As the file declares it, and as it was used: up to the gain where that is unknown.
    pull : ndarray (n_rows, n_columns + 1)
        Rows ``[A | b]`` of all that stood beside the data: `used_prior` and friction's weak one.
    n_rounds, converged : int, bool
        Of the search for `spread` and `n_effective` in turn.
    """

    x: FloatArray
    noise_std: FloatArray
    spreads: FloatArray
    evidence: float
    n_determined: float
    n_effective: FloatArray
    weights: FloatArray
    scale: FloatArray
    gain: float
    prior: InertialPrior
    used_prior: InertialPrior
    pull: FloatArray
    n_rounds: int
    converged: bool

    @property
    def relative_uncertainty(self) -> FloatArray:
        """How far off the declared links, and rotors if any, are, as the evidence sees it."""
        return self.spreads / self.gain


def fit_with_prior(
    observations: Observations,
    *,
    free: NDArray[np.bool_] | None = None,
    spreads: FloatArray | None = None,
    unknown_gain: bool = False,
) -> Posterior:
    """Fit all unknowns under the prior of the plan's robot.

    Parameters
    ----------
    observations : Observations
        Rows and factors.
    free : ndarray (n_joints,), optional
        Joints whose drive gains relative to the others are estimated too; none by default.
    spreads : ndarray (1,) or (2,), optional
        Relative uncertainty of the links, and of the rotors if they are declared; found by the evidence if None.
    unknown_gain : bool
        The torque's unit is an unknown multiple of N m, one number for all joints that is estimated too.

    Raises
    ------
    ValueError
        The robot declares no inertia, or the data gives no positive gain.
    """
    plan, n_rows = observations.plan, observations.n_rows
    n = plan.robot.n_joints
    declared = inertial_prior(plan)
    prior = declared.up_to_gain() if unknown_gain else declared
    factors = observations.factors()
    memory = [column_memory(observations.by_run([b.rows[j][:, :-1] for b in observations.blocks])) for j in range(n)]
    size = np.array([max(np.linalg.norm(R[:, -1]) / np.sqrt(n_rows), 1e-300) for R in factors])
    scale, n_effective = np.ones(n), np.full(n, 0.3 * n_rows)
    rounds: list[_Point] = []
    converged = False
    while not converged and len(rounds) < MAX_ROUNDS:
        problem = _Problem(plan, factors, scale, prior, n_rows, n_effective, 1e-9 * size)
        found = problem.best(0.1 * size, rounds[-1:]) if spreads is None else problem.at(spreads, 0.1 * size)
        if free is not None and free.any():
            pull = problem.pull(found.spreads)[0]
            scale = improve_scale(plan, factors, problem.weights(found), scale, found.x, free, pull)
        left = observations.by_run(block_residuals(observations, found.x, scale))
        n_effective = np.array([n_rows / inflation([run[:, j] for run in left], memory[j]) for j in range(n)])
        converged = bool(rounds) and bool(np.all(np.abs(np.log(found.spreads / rounds[-1].spreads)) < SETTLED))
        rounds.append(found)
    problem = _Problem(plan, factors, scale, prior, n_rows, n_effective, 1e-9 * size)
    found = problem.at(rounds[-1].spreads, rounds[-1].noise_std)
    gain = declared.gain_of(found.x, found.spreads.tolist()) if unknown_gain else 1.0
    if gain <= 0:
        raise ValueError(
            "the prior from the robot file does not fit this data in ampere: the drive gain comes out as "
            f"{gain:.3g} A/(N*m); give the drive gains, or fit without a prior"
        )
    return Posterior(
        found.x,
        found.noise_std,
        found.spreads,
        found.evidence,
        found.n_determined,
        n_effective,
        problem.weights(found),
        scale,
        gain,
        declared,
        prior,
        problem.pull(found.spreads)[0],
        len(rounds),
        converged,
    )


def lost_evidence(observations: Observations, posterior: Posterior, spread: float) -> float:
    """By how much the logarithm of the evidence falls under another relative uncertainty than what was found.

    `spread`: in ampere times the gain, as `Posterior.spreads`.

    Samples count as many as they did for `posterior`, so that the two can be compared.
    """
    problem = _Problem(
        observations.plan,
        observations.factors(),
        posterior.scale,
        posterior.used_prior,
        observations.n_rows,
        posterior.n_effective,
        1e-9 * posterior.noise_std,
    )
    at = problem.at(np.full(len(posterior.spreads), spread), posterior.noise_std)
    return problem.at(posterior.spreads, posterior.noise_std).evidence - at.evidence


def left_out_power(
    observations: Observations, left_out: Sequence[Sequence[FloatArray]], posterior: Posterior
) -> FloatArray:
    """Residual power per joint on every block when the others are fitted with `posterior`'s prior, (n_joints,).

    `left_out`: factors of all blocks but one, block by block.
    """
    power = np.zeros(len(posterior.noise_std))
    n_rows = observations.n_rows
    for block, factors in zip(observations.blocks, left_out, strict=True):
        share = (n_rows - block.n_rows) / n_rows
        # What the posterior took from the left-out block is its weight alone, one number or two.
        least = 1e-9 * posterior.noise_std
        problem = _Problem(
            observations.plan,
            factors,
            posterior.scale,
            posterior.used_prior,
            n_rows - block.n_rows,
            share * posterior.n_effective,
            least,
        )
        x = problem.at(posterior.spreads, posterior.noise_std).x
        power += residual_power(observations.plan, block.factors, x, posterior.scale)
    return power


@dataclass(frozen=True, eq=False)
class _Point:
    """Solution at given relative uncertainties."""

    spreads: FloatArray
    x: FloatArray
    noise_std: FloatArray
    evidence: float
    n_determined: float


@dataclass(frozen=True, eq=False)
class _Problem:
    """Factors, prior and correlation in time, for any relative uncertainties."""

    plan: Plan
    factors: Sequence[FloatArray]
    scale: FloatArray
    prior: InertialPrior
    n_rows: int
    n_effective: FloatArray
    least_std: FloatArray

    def weights(self, point: _Point) -> FloatArray:
        """w_j, (n_joints,)."""
        result: FloatArray = np.sqrt(self.n_effective / self.n_rows) / point.noise_std
        return result

    def pull(self, spreads: FloatArray) -> tuple[FloatArray, float]:
        """Rows ``[A | b]`` of the inertials' prior, then of friction's weak one; the former's ``log det(S)``."""
        rows, log_det = self.prior.rows(spreads.tolist())
        return np.concatenate([rows, self._weak]), log_det

    @cached_property
    def _weak(self) -> FloatArray:
        """Viscous terms: the size of each beside the joint's torque, over `FRICTION_SPREAD`; Coulomb's directions."""
        names = [name for effect in self.plan.effects for name in effect.coefficient_names]
        rows = []
        for j, R in enumerate(self.factors):
            size = np.linalg.norm(R[:, -1])
            for column in (k for k, name in enumerate(names) if name.startswith("viscous") and size > 0):
                row = np.zeros(self.plan.n_columns + 1)
                row[self.plan.n_base + j * self.plan.n_own + column] = np.linalg.norm(R[:, column]) / size
                rows.append(row / FRICTION_SPREAD)
        alike = alike_rows(self.plan, self.factors, self.n_rows, ASYMMETRY)
        return np.concatenate([np.array(rows).reshape(-1, self.plan.n_columns + 1), alike])

    @cached_property
    def _wide(self) -> list[FloatArray]:
        return [stack_one(self.plan, j, R, self.scale) for j, R in enumerate(self.factors)]

    def best(self, noise_std: FloatArray, near: Sequence[_Point]) -> _Point:
        """Point of the greatest evidence; `near` holds a point that is close to it, if one is known."""
        from scipy.optimize import minimize, minimize_scalar

        n_spreads = len(self.prior.roots)
        if near:
            start, least, most = near[0], near[0].spreads / NEAR, near[0].spreads * NEAR
        else:
            points: list[_Point] = []
            for spread in SPREADS:
                points.append(self.at(np.full(n_spreads, spread), points[-1].noise_std if points else noise_std))
            k = max(range(len(points)), key=lambda k: points[k].evidence)
            start, least, most = points[k], points[max(k - 1, 0)].spreads, points[min(k + 1, len(points) - 1)].spreads
        low, high = np.log(SPREADS[0]), np.log(SPREADS[-1])
        last = start  # its noise is close to the next point's

        def less(x: Any) -> float:
            nonlocal last
            last = self.at(np.exp(np.clip(np.atleast_1d(x), low, high)), last.noise_std)
            return -last.evidence

        if n_spreads == 1:
            bounds = (max(float(np.log(least[0])), low), min(float(np.log(most[0])), high))
            x: Any = minimize_scalar(less, bounds=bounds, method="bounded", options={"xatol": CLOSE}).x
        else:
            at_start, step = np.log(start.spreads), np.log(NEAR) / (2 if near else 1)
            simplex = at_start + step * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
            options: Any = {"initial_simplex": simplex, "xatol": CLOSE, "fatol": CLOSE, "maxfev": MOST_TRIES}
            x = minimize(less, at_start, method="Nelder-Mead", options=options).x
        return self.at(np.exp(np.clip(np.atleast_1d(x), low, high)), last.noise_std)

    def at(self, spreads: FloatArray, noise_std: FloatArray) -> _Point:
        """Most probable unknowns and noise at these relative uncertainties; the noise is searched from `noise_std`."""
        plan, share = self.plan, self.n_effective / self.n_rows
        pull, log_det = self.pull(spreads)
        for _ in range(MAX_FIXED_POINT):
            weights = np.sqrt(share) / noise_std
            solution = _solve(np.concatenate([*(w * R for w, R in zip(weights, self._wide, strict=True)), pull]), plan)
            power = residual_power(plan, self.factors, solution.x, self.scale)
            used_up = np.array([w**2 * solution.trace(R) for w, R in zip(weights, self._wide, strict=True)])
            left = np.maximum(self.n_effective - used_up, (1 - MOST_TAKEN) * self.n_effective)
            update = np.maximum(np.sqrt(share * power / left), self.least_std)
            change = float(np.max(np.abs(update / noise_std - 1)))
            noise_std = update
            if change < CHANGE:
                break
        distance = float(np.sum((pull[:, :-1] @ solution.x - pull[:, -1]) ** 2))
        evidence = -float(np.sum(self.n_effective * np.log(noise_std) + share * power / (2 * noise_std**2)))
        evidence -= (distance + log_det + solution.log_det) / 2
        n_determined = self.prior.rank - solution.trace(pull[: self.prior.rank])
        return _Point(spreads, solution.x, noise_std, evidence, n_determined)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Least squares of one system: unknowns, ``log det H`` and a root of ``H^-1``."""

    x: FloatArray
    log_det: float
    root: FloatArray

    def trace(self, rows: FloatArray) -> float:
        """``tr(A H^-1 A')`` for rows ``[A | b]``."""
        return float(np.sum((rows[:, :-1] @ self.root) ** 2))


def _solve(system: FloatArray, plan: Plan) -> _Solution:
    from scipy.linalg import svd
    from scipy.linalg.lapack import dtrtri

    norms = np.linalg.norm(system[:, :-1], axis=0)
    used = plan.estimable() & (norms > NEGLIGIBLE * norms.max(initial=0.0))
    R = _core.triangular_factor(np.ascontiguousarray(system[:, np.append(used, True)]))
    A, b = R[:-1, :-1], R[:-1, -1]
    A = A / norms[used]
    diagonal = np.abs(np.diag(A))
    root = np.zeros((plan.n_columns, len(diagonal)))
    if diagonal.min() > CLEAR:
        root[used] = dtrtri(A)[0] / norms[used, None]
        return _Solution(root @ b, 2 * float(np.sum(np.log(diagonal * norms[used]))), root)
    # gesvd: the divide-and-conquer driver failed to converge on real factors.
    u, s, vt = svd(A, full_matrices=False, lapack_driver="gesvd")
    good = s > NEGLIGIBLE * s[0]
    root = np.zeros((plan.n_columns, int(good.sum())))
    root[used] = (vt[good].T / s[good]) / norms[used, None]
    return _Solution(root @ (u.T @ b)[good], 2 * float(np.sum(np.log(s[good])) + np.sum(np.log(norms[used]))), root)
