"""Second loop: link dynamics and every linear coefficient beside them (Eqs. 19-25), on triangular factors alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.regression.evidence import Posterior, fit_with_prior
from dynid_rs.regression.fitted import Beside, Weighting
from dynid_rs.regression.linear_model import Choice, Known
from dynid_rs.regression.scales import free_scales, improve_scale
from dynid_rs.regression.systems import residual_covariance, residual_power, solve, stack, whitened

FloatArray = NDArray[np.float64]
Start = Literal["torque", "least_squares"]

RE_WEIGHTINGS = 3
"""Rounds in which rows beside the training runs find their weight under a prior."""
ALIKE = 1e-6
"""Columns that differ by less of their length are one: it is less than encoders and filters leave of any motion."""


@dataclass(frozen=True, eq=False)
class RowGroup:
    """Rows with a noise of their own beside the training runs': a factor per joint and its rows, (n_joints,)."""

    factors: list[FloatArray]
    n_rows: NDArray[np.int64]


class LinkDynamicsIdentifier(Estimator):
    """Base parameters and own coefficients of all joints in one least-squares problem (Eq. 19).

    Parameters
    ----------
    weighting : {"joint_variance", "full_covariance", None}
        Weights from the residual's variance per joint (Eqs. 21-23, iterated), from its full covariance between joints
        (Eqs. 24-25), or none (plain least squares).
    prior : {"auto", "robot", None}
        ``"auto"``: a weak prior whose width and centre the evidence chooses (`regression/priors.py`, `evidence.py`).
        ``"robot"``: the robot file's inertials are its centre, and its width is small. None: plain (weighted) least
        squares, as the paper has it.
    ridge : float
        Ridge on unit-norm columns, relative to the greatest singular value. With one, or without weights, ``"auto"`` is
        none: there is nothing that a prior could be weighed against.
    start : {"torque", "least_squares"}
        Weights of the first step: from the torque's own power per joint, or none, as the paper has it. Its weighted
        least squares as printed (Eqs. 21-23: one plain step, one re-weighting) is
        ``prior=None, start="least_squares", max_iter=2``; where it converges, the start makes no difference.
    max_iter : int
        Most steps; each after the first is a re-weighting.
    tol : float
        Relative change of the weights at which re-weighting stops.
    least_noise : ndarray (n_joints,), optional
        [torque unit] Under a prior joints weigh against each other as if none had less noise.
    elsewhere : ndarray (n, n_joints, 10 n_links), optional
        With `least_noise`, columns of the links at states that no run has shown: what joints' rows say more exactly
        leaves the others' torques there as they are.
    believed : Choice, optional
        How far the prior is believed, instead of what the evidence chooses.
    known : Known, optional
        Unknowns that are known already, under a prior: all others are fitted beside them.
    gains_of : Posterior, optional
        Earlier fit whose gains stay, under a prior.

    Attributes
    ----------
    x_ : ndarray (n_columns,)
        All unknowns: base parameters, then own coefficients joint by joint (zeros where not told apart).
    phi_base_ : ndarray (n_base,)
        Base parameters [kg, kg*m, kg*m^2]; in ampere times those over N*m where currents were fitted.
    own_ : ndarray (n_joints, n_own)
        Own coefficients.
    torque_scale_ : ndarray (n_joints,)
        Torque channel per link torque, relative to the first joint's; ones unless asked for.
    noise_std_ : ndarray (n_joints,)
        Standard deviation of the residual [torque unit]: sigma_delta of Eq. 20, one per joint.
    covariance_ : ndarray (n_joints, n_joints)
        Covariance of the residual between joints (Eq. 24).
    ridge_ : float
        Ridge in use.
    beside_ : list of Beside
        Rows that counted beside the observations', as they were weighted.
    worth_ : ndarray (n_joints,)
        Independent samples that a row counts as; ones without a prior, where only ratios matter.
    posterior_ : Posterior or None
        How much the prior was trusted, and what it is; None without one.
    n_iter_, converged_ : int, bool
        Of the re-weighting.
    """

    def __init__(
        self,
        weighting: Weighting = "joint_variance",
        *,
        prior: Literal["auto", "robot"] | None = "auto",
        ridge: float = 0.0,
        start: Start = "torque",
        max_iter: int = 30,
        tol: float = 1e-3,
        least_noise: FloatArray | None = None,
        elsewhere: FloatArray | None = None,
        believed: Choice | None = None,
        known: Known | None = None,
        gains_of: Posterior | None = None,
    ) -> None:
        self.weighting = weighting
        self.prior = prior
        self.ridge = ridge
        self.start = start
        self.max_iter = max_iter
        self.tol = tol
        self.least_noise = least_noise
        self.elsewhere = elsewhere
        self.believed = believed
        self.known = known
        self.gains_of = gains_of

    def fit(
        self,
        observations: Observations,
        *,
        fit_scale: bool = False,
        free_gains: Sequence[int] = (),
        beside: Sequence[RowGroup] = (),
        again: bool = False,
        scale: FloatArray | None = None,
    ) -> LinkDynamicsIdentifier:
        """Fit; `fit_scale` also estimates the drive gains of joints relative to the first (data in ampere).

        `free_gains`: joints whose gain is estimated although the unit is that of the others (data in N m).

        `beside` are rows that count too, each group weighted by its own residual (those of the friction experiment).
        `scale` (n_joints,): where the search for gains begins.
        `again`: the prior's choice, and how much the data count, stay as the last fit found them.

        Raises
        ------
        ValueError
            `weighting`, `ridge`, `prior` or `start` is not one of the choices, or two contradict each other.
        """
        if self.weighting not in (None, "joint_variance", "full_covariance"):
            raise ValueError(f"weighting must be 'joint_variance', 'full_covariance' or None, found {self.weighting!r}")
        if not (isinstance(self.ridge, int | float) and self.ridge >= 0):
            raise ValueError(f"ridge must be a number of at least 0, found {self.ridge!r}")
        if self.prior not in (None, "auto", "robot"):
            raise ValueError(f"prior must be 'auto', 'robot' or None, found {self.prior!r}")
        if self.start not in ("torque", "least_squares"):
            raise ValueError(f"start must be 'torque' or 'least_squares', found {self.start!r}")
        free = free_scales(observations.plan.robot.n_joints, fit_scale, free_gains)
        found = self.posterior_ if again and hasattr(self, "posterior_") else None
        self.posterior_: Posterior | None = None
        self.worth_ = np.ones(observations.plan.robot.n_joints)
        if self.has_prior:
            return self.use_posterior(
                observations, self._posterior(observations, fit_scale, free, found, scale), beside
            )
        plan, n_rows = observations.plan, np.maximum(observations.n_counted, 1)
        n = plan.robot.n_joints
        factors = observations.factors()
        weights: FloatArray = np.sqrt(n_rows) / np.array([max(np.linalg.norm(R[:, -1]), 1e-300) for R in factors])
        if self.weighting is None or self.start == "least_squares":
            weights = np.ones(n)
        scale = np.ones(n)
        extra = [_Weighted(plan, group, self.weighting is not None) for group in beside]
        self.ridge_ = float(self.ridge)
        self.converged_ = False
        for self.n_iter_ in range(1, self.max_iter + 1):
            x = solve(plan, _joined(stack(plan, factors, weights, scale), extra, scale), (self.ridge_,))[0]
            if free.any():
                scale = improve_scale(plan, factors, weights, scale, x, free)
                x = solve(plan, _joined(stack(plan, factors, weights, scale), extra, scale), (self.ridge_,))[0]
            for group in extra:
                group.weigh(x, scale)
            std = np.sqrt(residual_power(plan, factors, x, scale) / n_rows)
            update = weights if self.weighting is None else 1 / np.maximum(std, 1e-300)
            change = float(np.max(np.abs(update / weights - 1)))
            weights = update
            # Without noise the weights chase rounding; what is left no longer matters.
            exact = np.all(std * np.sqrt(n_rows) <= 1e-10 * np.array([np.linalg.norm(R[:, -1]) for R in factors]))
            if (change < self.tol or exact) and not (free.any() and self.n_iter_ < 5):
                self.converged_ = True
                break
        self.weights_ = weights
        self.torque_scale_ = scale
        self.covariance_ = residual_covariance(observations, x, scale)
        if self.weighting == "full_covariance":
            system = _joined(whitened(observations, self.covariance_, scale), extra, scale)
            x = solve(plan, system, (self.ridge_,))[0]
            self.covariance_ = residual_covariance(observations, x, scale)
        return self._keep(plan, x, extra)

    @property
    def has_prior(self) -> bool:
        """Whether a prior is weighed against the data."""
        return self.prior == "robot" or (self.prior == "auto" and self.weighting is not None and self.ridge == 0)

    def _posterior(
        self,
        observations: Observations,
        fit_scale: bool,
        free: NDArray[np.bool_],
        held: Posterior | None,
        scale: FloatArray | None,
    ) -> Posterior:
        if self.weighting is None or self.ridge > 0:
            raise ValueError(
                "a prior is weighed against the noise and replaces the ridge: with prior='robot' weighting must not be "
                "None, and ridge must be 0"
            )
        # Data in ampere has drive gains to estimate, and what is declared is in N m.
        trusted = self.prior == "robot"
        return fit_with_prior(
            observations,
            free=free,
            unknown_gain=fit_scale,
            trusted=trusted,
            held=held,
            scale=scale,
            least_noise=self.least_noise,
            elsewhere=self.elsewhere,
            believed=self.believed,
            known=self.known,
            gains_of=self.gains_of,
        )

    def use_posterior(
        self, observations: Observations, posterior: Posterior, beside: Sequence[RowGroup] = ()
    ) -> LinkDynamicsIdentifier:
        """Take the fit over from `posterior`, which comes from the same observations; `beside` as in `fit`."""
        self.posterior_ = posterior
        self.ridge_, self.n_iter_, self.converged_ = 0.0, posterior.n_rounds, posterior.converged
        self.weights_, self.torque_scale_ = posterior.weights, posterior.scale
        self.worth_ = posterior.n_effective / np.maximum(observations.n_counted, 1)
        plan, scale, x = observations.plan, posterior.scale, posterior.x
        extra = [_Weighted(plan, group, True, self.worth_) for group in beside]
        if extra:
            system = np.concatenate([stack(plan, observations.factors(), self.weights_, scale), posterior.pull])
            for _ in range(RE_WEIGHTINGS):
                for group in extra:
                    group.weigh(x, scale)
                x = solve(plan, _joined(system, extra, scale), (0.0,))[0]
        self.covariance_ = residual_covariance(observations, x, scale)
        if self.weighting == "full_covariance":
            # Rows of a joint count as many as the independent samples they are worth.
            root = np.sqrt(self.worth_)
            rows = whitened(observations, self.covariance_ / np.outer(root, root), scale)
            x = solve(plan, _joined(np.concatenate([rows, posterior.pull]), extra, scale), (0.0,))[0]
            self.covariance_ = residual_covariance(observations, x, scale)
        return self._keep(plan, x, extra)

    def _keep(self, plan: Plan, x: FloatArray, extra: Sequence[_Weighted]) -> LinkDynamicsIdentifier:
        self.x_ = x
        self.beside_ = [group.fitted(x, self.torque_scale_) for group in extra]
        self.phi_base_ = x[: plan.n_base]
        self.own_ = x[plan.n_base :].reshape(plan.robot.n_joints, plan.n_own)
        self.noise_std_ = np.sqrt(np.diag(self.covariance_))
        return self


class _Weighted:
    """A group of rows and its weights, one over the standard deviation of its own residual."""

    def __init__(self, plan: Plan, group: RowGroup, weighted: bool, worth: float | FloatArray = 1.0) -> None:
        """`worth`: independent samples that a row counts as, the same as for the rows of the training runs."""
        self._plan, self._group, self._weighted, self._root = plan, group, weighted, np.sqrt(worth)
        self.weights = np.where(group.n_rows > 0, 1.0, 0.0)
        if weighted:
            norms = np.array([np.linalg.norm(R[:, -1]) for R in group.factors])
            self.weights = self.weights * np.sqrt(group.n_rows) / np.maximum(norms, 1e-300)

    def weigh(self, x: FloatArray, scale: FloatArray) -> None:
        if self._weighted:
            power = residual_power(self._plan, self._group.factors, x, scale)
            std = np.sqrt(power / np.maximum(self._group.n_rows, 1))
            self.weights = np.where(self._group.n_rows > 0, self._root / np.maximum(std, 1e-300), 0.0)

    def system(self, scale: FloatArray) -> FloatArray:
        return stack(self._plan, self._group.factors, self.weights, scale)

    def fitted(self, x: FloatArray, scale: FloatArray) -> Beside:
        left = residual_power(self._plan, self._group.factors, x, scale) / np.maximum(self._group.n_rows, 1)
        rows = [weight * R for weight, R in zip(self.weights, self._group.factors, strict=True)]
        return Beside(rows, self.weights**2 * left)


def _joined(system: FloatArray, extra: Sequence[_Weighted], scale: FloatArray) -> FloatArray:
    """`system` with the rows of other groups under it."""
    return np.concatenate([system, *(group.system(scale) for group in extra)]) if extra else system


def own_beside(observations: Observations, phi_base: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Own coefficients (n_joints, n_own) by least squares while the links are held, and the residual's RMS (n_joints,).

    What the first loop gives by itself: friction beside known link dynamics (Eq. 12).
    """
    plan = observations.plan
    own, left = np.zeros(plan.own.shape), np.zeros(len(plan.own))
    for j, R in enumerate(observations.factors()):
        base = phi_base[plan.pivots >= 10 * j]
        target = R[:, -1] - scale[j] * (R[:, plan.n_own : -1] @ base)
        columns = R[:, : plan.n_own][:, plan.own[j]]
        norms = np.linalg.norm(columns, axis=0)
        norms[norms == 0] = 1.0
        own[j, plan.own[j]] = np.linalg.lstsq(columns / norms, target, rcond=ALIKE)[0] / norms
        left[j] = np.linalg.norm(target - columns @ own[j, plan.own[j]])
    return own, left / np.sqrt(np.maximum(observations.n_counted, 1))


def baseline(observations: Observations) -> tuple[Observations, FloatArray]:
    """Observations of the paper's baseline (rigid body, Coulomb, viscous) and the (n_own, 3) regrouping.

    Rotor inertia, ``coulomb_pos + coulomb_neg``, ``viscous1_pos + viscous1_neg``: columns of the full model, added up.
    """
    plan = observations.plan
    names = [name for effect in plan.effects for name in effect.coefficient_names]
    regroup = np.zeros((len(names), 3))
    for row, column in (
        ("rotor_inertia", 0),
        ("coulomb_pos", 1),
        ("coulomb_neg", 1),
        ("viscous1_pos", 2),
        ("viscous1_neg", 2),
    ):
        regroup[names.index(row), column] = 1.0
    own = np.ones((plan.robot.n_joints, 3), dtype=bool)
    own[:, 0] = plan.own[:, names.index("rotor_inertia")]
    reduced = replace(plan, own=own)

    def narrow(x: FloatArray) -> FloatArray:
        return np.ascontiguousarray(np.concatenate([x[:, : plan.n_own] @ regroup, x[:, plan.n_own :]], axis=1))

    blocks = [
        replace(
            block,
            rows=[narrow(x) for x in block.rows],
            factors=[_core.triangular_factor(narrow(R)) for R in block.factors],
        )
        for block in observations.blocks
    ]
    return Observations(reduced, blocks, observations.runs), regroup
