"""The exciting trajectory: a Fourier series that lets the torque tell the parameters apart (Eqs. 13-18)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import RankDeficientError
from dynid_rs.base.estimator import Estimator
from dynid_rs.excitation.constraints import Constraint, PhysicalLimits, torque_bound, unlimited_joints
from dynid_rs.excitation.limits import ExcitationLimits
from dynid_rs.excitation.merit import merit_of
from dynid_rs.excitation.problem import CRITERIA, Problem
from dynid_rs.excitation.search import Plan, Restart, search
from dynid_rs.excitation.series import FourierSeries

if TYPE_CHECKING:
    from dynid_rs._core import BaseParameters, RobotModel

FloatArray = NDArray[np.float64]

MAX_SAMPLES = 100_000
MOST = 1_000_000
"""Searches, steps of one, harmonics: nobody waits for more."""
BLIND = 1e6
"""A condition number above this says that some parameters are not excited at all."""


class FourierExcitation(Estimator):
    """Exciting trajectory by random restarts of an SQP search with exact gradients.

    Parameters
    ----------
    n_harmonics : int
        Terms of the series per joint, at least 2.
    duration : float
        One period, which is the length of the trajectory [s].
    rate : float
        Samples per second that the criterion is computed from [Hz].
    criterion : {"block", "condition", "D", "A"}
        The weighted condition numbers of Eq. 14; the condition number of the base regressor alone; the determinant
        (D) or the trace of the inverse (A) of the information matrix.
    start : array_like (n_joints,), optional
        Where it starts and ends [rad, m]. Zero by default, or the middle of the limits where zero is not inside.
    noise_std : array_like (n_joints,), optional
        Standard deviation of the torque noise, for the whitening of Eq. 13.
    noise_covariance : array_like (n_joints, n_joints), optional
        Its covariance, instead.
    constraints : sequence of WorkspaceBox, SelfCollision, ...
        What else must be kept.
    n_restarts : int
        Searches, each from a random motion of its own.
    max_iter : int
        Most steps of one search.
    time_limit : float, optional
        No search begins after it, and running ones stop [s]; the answer then depends on the machine's speed.
    n_jobs : int, optional
        Threads, one per core by default or with -1; the answer does not depend on it.
    state_file : path-like, optional
        Finished searches are kept here.
    resume : bool
        Take finished searches of the same problem from there.
    callback : callable, optional
        Called with all finished `Restart` after each one.
    random_state : int or None
        Seed; None draws one.

    Attributes
    ----------
    trajectory_ : FourierTrajectory
        The best one found.
    condition_number_ : float
        Of the base regressor at the samples, unweighted.
    objective_ : float
        The criterion's value: Eq. 14, the (whitened) condition number, -log det or trace of the inverse.
    block_weights_ : tuple of float or None
        w_a, w_b, w_g of Eq. 14, together one.
    merit_ : Merit
        All figures of merit, and the exact extremes on a 1 ms grid.
    constraint_report_ : dict
        Extremes of torque, workspace and self-collision beside their bounds.
    history_ : tuple of Restart
        What every search began with, reached and cost.
    x_ : ndarray (n_free, n_joints)
        Its free coefficients (`series.py`).
    robot_, limits_, start_, base_ : RobotModel, ExcitationLimits, ndarray (n_joints,), BaseParameters
        What was used.
    notes_ : tuple of str
        What the user should know about the limits.
    seed_ : int
        Repeats the search.
    """

    def __init__(
        self,
        n_harmonics: int = 5,
        duration: float = 20.0,
        rate: float = 10.0,
        *,
        criterion: str = "block",
        start: Any = None,
        noise_std: Any = None,
        noise_covariance: Any = None,
        constraints: Sequence[PhysicalLimits] = (),
        n_restarts: int = 4,
        max_iter: int = 30,
        time_limit: float | None = None,
        n_jobs: int | None = None,
        state_file: str | Path | None = None,
        resume: bool = True,
        callback: Callable[[Sequence[Restart]], object] | None = None,
        random_state: int | None = None,
    ) -> None:
        self.n_harmonics = n_harmonics
        self.duration = duration
        self.rate = rate
        self.criterion = criterion
        self.start = start
        self.noise_std = noise_std
        self.noise_covariance = noise_covariance
        self.constraints = constraints
        self.n_restarts = n_restarts
        self.max_iter = max_iter
        self.time_limit = time_limit
        self.n_jobs = n_jobs
        self.state_file = state_file
        self.resume = resume
        self.callback = callback
        self.random_state = random_state

    def fit(
        self, robot: RobotModel, limits: ExcitationLimits | None = None, *, base: BaseParameters | None = None
    ) -> FourierExcitation:
        """Design the trajectory of `robot` within `limits`; the robot's own limits and base parameters by default.

        Raises
        ------
        ValueError
            A setting makes no sense, the limits cannot be met, the start is outside them, or the robot has no base
            parameter; one sentence with the mend.
        RankDeficientError
            The best motion within the limits does not tell the parameters apart.
        """
        self._check(robot)
        limits = ExcitationLimits.of_robot(robot) if limits is None else limits
        if limits.n_joints != robot.n_joints:
            raise ValueError(f"the limits are for {limits.n_joints} joints, and the robot has {robot.n_joints}")
        base = robot.base_parameters() if base is None else base
        if base.n_base == 0:
            raise ValueError(
                f"robot {robot.name} has no base parameter: its torque does not depend on any inertial parameter, so "
                "there is nothing to excite; check joints, axes and gravity of the robot file"
            )
        self.robot_, self.base_, self.limits_ = robot, base, limits
        self.start_ = limits.start(self.start, robot.joint_names)
        problem = self.problem()
        self.seed_ = int(np.random.SeedSequence(self.random_state).entropy)  # type: ignore[arg-type]
        restarts = search(problem, self._plan(), self.callback)
        best = min(
            (r for r in restarts if r.objective is not None),
            key=lambda restart: (restart.objective, restart.index),
            default=None,
        )
        if best is None:
            kept = " and ".join(constraint.name for constraint in problem.constraints)
            raise ValueError(
                f"none of {len(restarts)} searches found a motion that keeps {kept}; choose another start, "
                "widen these limits, or allow more restarts"
            )
        self.block_weights_ = problem.weights
        self.history_ = tuple(restarts)
        self._keep(problem, np.array(best.x), float(best.objective))  # type: ignore[arg-type]
        if not self.condition_number_ < BLIND:
            raise RankDeficientError(
                f"the best trajectory within these limits has a condition number of {self.condition_number_:.1e}: some "
                "parameters are hardly excited; widen the limits, or use a longer duration or more harmonics"
            )
        return self

    def problem(self) -> Problem:
        """What `fit` searched, made again: series, limits, constraints and criterion."""
        constraints, self.notes_ = self._constraints(self.robot_, self.limits_, self.start_)
        return Problem(
            self.robot_,
            self.base_,
            FourierSeries(self.n_harmonics, self.duration),
            np.arange(round(self.duration * self.rate)) / self.rate,
            self.limits_,
            self.start_,
            criterion=self.criterion,
            whitening=_whitening(self.noise_std, self.noise_covariance, self.robot_.n_joints),
            constraints=constraints,
        )

    def with_motion(self, x: FloatArray) -> FourierExcitation:
        """Return the same design with another motion, free coefficients (n_free, n_joints) of `problem()`."""
        other = copy(self)
        problem = self.problem()
        other._keep(problem, x, problem.value(x))
        return other

    def _keep(self, problem: Problem, x: FloatArray, objective: float) -> None:
        """Keep a motion and everything that is known of it."""
        t = np.arange(round(self.duration * self.rate)) / self.rate
        whitened = self.noise_std is not None or self.noise_covariance is not None
        self.x_ = x
        self.trajectory_ = problem.series.trajectory(x, self.start_)
        self.merit_ = merit_of(self.trajectory_, self.robot_, self.base_, problem.excitation, t, whitened=whitened)
        self.condition_number_ = self.merit_.condition_number
        self.objective_ = objective
        self.constraint_report_ = {
            constraint.name: constraint.report(self.trajectory_.evaluate(problem.series.grid(constraint.fine_step)))
            for constraint in problem.constraints
        }

    def _constraints(
        self, robot: RobotModel, limits: ExcitationLimits, start: FloatArray
    ) -> tuple[list[Constraint], tuple[str, ...]]:
        """Torque and what the user asked for, bound to the robot; and notes."""
        torque = torque_bound(robot, limits, start)
        bound: list[Constraint] = [] if isinstance(torque, str) else [torque]
        bound += [constraint.bind(robot, start) for constraint in self.constraints]
        return bound, (torque,) if isinstance(torque, str) else unlimited_joints(torque, start)

    def _plan(self) -> Plan:
        return Plan(
            n_restarts=self.n_restarts,
            max_iter=self.max_iter,
            seed=self.seed_,
            n_jobs=self.n_jobs,
            time_limit=self.time_limit,
            state_file=None if self.state_file is None else Path(self.state_file),
            resume=self.resume,
        )

    def _check(self, robot: RobotModel) -> None:
        if self.criterion not in CRITERIA:
            raise ValueError(f"criterion {self.criterion!r} is not known; choose one of {', '.join(CRITERIA)}")
        counts = {
            "n_harmonics": (self.n_harmonics, 2),
            "n_restarts": (self.n_restarts, 1),
            "max_iter": (self.max_iter, 1),
        }
        if self.n_jobs not in (None, -1):
            counts["n_jobs"] = (self.n_jobs, 1)
        for name, (value, least) in counts.items():
            if isinstance(value, bool) or int(value) != value or value < least:
                other = ", or -1 for one per core" if name == "n_jobs" else ""
                raise ValueError(f"{name} must be a whole number of at least {least}{other}, got {value}")
            if value > MOST:
                raise ValueError(f"{name} must be at most {MOST}, got {value}")
        sizes = {"duration": self.duration, "rate": self.rate}
        if self.time_limit is not None:
            sizes["time_limit"] = self.time_limit
        for name, size in sizes.items():
            if not (np.isfinite(size) and size > 0):
                raise ValueError(f"{name} must be a positive number, got {size}")
        if self.random_state is not None and (int(self.random_state) != self.random_state or self.random_state < 0):
            raise ValueError(f"random_state must be a whole number of at least 0, or None, got {self.random_state}")
        least = 4 * self.n_harmonics
        n_samples = round(self.duration * self.rate)
        if not least <= n_samples <= MAX_SAMPLES:
            raise ValueError(
                f"{self.duration:g} s at {self.rate:g} Hz are {n_samples} samples, expected {least} (four per period "
                f"of the highest harmonic) to {MAX_SAMPLES}; change duration, rate or n_harmonics"
            )


def _whitening(std: Any, covariance: Any, n_joints: int) -> FloatArray | None:
    """Omega^(-1/2) of Eq. 13; None for equal and independent noise."""
    if std is not None and covariance is not None:
        raise ValueError("noise_std and noise_covariance say the same; leave one out")
    if std is not None:
        std = np.asarray(std, dtype=np.float64)
        if std.shape != (n_joints,) or not (np.isfinite(std) & (std > 0)).all():
            raise ValueError(f"noise_std must be {n_joints} positive numbers, one per joint")
        return np.diag(1 / std)
    if covariance is None:
        return None
    omega = np.asarray(covariance, dtype=np.float64)
    if omega.shape != (n_joints, n_joints) or not np.isfinite(omega).all() or not np.allclose(omega, omega.T):
        raise ValueError(f"noise_covariance must be a symmetric matrix ({n_joints}, {n_joints}) of finite numbers")
    values, vectors = np.linalg.eigh(omega)
    if not values.min() > 1e-12 * values.max():
        raise ValueError("noise_covariance must be positive definite; a joint without noise needs a small one")
    return np.asarray((vectors / np.sqrt(values)) @ vectors.T)
