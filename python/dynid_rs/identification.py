"""The three loops of the paper's Figure 2: friction, link dynamics, residual, until nothing changes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.validation import check_is_fitted

from dynid_rs import _core
from dynid_rs.assembly import Regressions, assemble, evaluate
from dynid_rs.columns import Observations, Plan, make_plan, observe
from dynid_rs.encoders import EncoderDelay, estimate_encoder_delay
from dynid_rs.evaluation import rmse as rms
from dynid_rs.friction import FrictionIdentifier, friction_effect
from dynid_rs.friction_experiment.pairs import check_reversals, find_mirrors
from dynid_rs.friction_experiment.rows import PairWindow, odd_torques, pair_rows, pair_windows, row_groups
from dynid_rs.friction_laws import DEFAULT_LAW, fit_stribeck, laws_per_joint, power_left, with_laws
from dynid_rs.known import KnownTerm, check_known, less_known
from dynid_rs.links import LinkDynamicsIdentifier, baseline, block_residuals, own_beside
from dynid_rs.preprocessing import Band, States, choose_band, common_rate, prepare
from dynid_rs.recording import Recording
from dynid_rs.residual import ResidualCompensator
from dynid_rs.training import check_training_runs, prepare_training_runs

FloatArray = NDArray[np.float64]

FIRST_WIDTH = 4e-3
"""Transition width [rad/s] of the first pass and of the baseline, before any search."""


@dataclass(frozen=True, eq=False)
class _Data:
    """What the loops start from: runs as recorded and on one clock, pairs of the friction runs, the first plan."""

    raw_runs: list[States]
    runs: list[States]
    pairs: list[PairWindow]
    plan: Plan
    observations: Observations


class ThreeLoopIdentifier(BaseEstimator):  # type: ignore[misc]
    """Torque model of an arm from measured runs (Eq. 26: ``tau = tau_friction + tau_link + tau_residual``).

    Parameters
    ----------
    robot : RobotModel
        Kinematics and gravity.
    friction : FrictionIdentifier, optional
        First loop.
    links : LinkDynamicsIdentifier, optional
        Second loop.
    residual : ResidualCompensator, None or "default"
        Third loop; None switches it off.
    known : sequence of (Effect, ndarray (n_joints, n_columns))
        Effects whose coefficients [N*m] are known, not fitted: taken off the torque, and part of the model.
    friction_law : str or sequence of str
        "paper" (Eqs. 9-11), "coulomb_viscous" or "stribeck", for all joints or one per joint.
    cutoff : float, optional
        Band [Hz] in which torques are fitted and compared; chosen from the motion if None.
    max_iter : int
        Most rounds of the three loops.
    tol : float
        Relative change of every joint's residual at which they stop.

    Attributes
    ----------
    model_ : TorqueModel
        The result, owned by Rust.
    links_, friction_, residual_ : estimators
        The fitted loops.
    baseline_ : TorqueModel
        Rigid body, Coulomb and viscous friction by weighted least squares: what the paper compares with.
    two_loop_model_ : TorqueModel
        Friction and link dynamics without a third loop.
    friction_model_ : TorqueModel
        What the first loop gives by itself: friction with its shape beside the baseline's links.
    encoder_delay_ : EncoderDelay or None
        Delay between the two encoder channels; None with one encoder.
    observations_ : Observations
        Rows and factors of the last round.
    raw_runs_, runs_ : list of States
        Training runs as recorded, and with the link channel on the motor channel's clock and the known terms' torque
        taken off.
    known_ : list of (Effect, ndarray)
        Known terms as they were used.
    history_ : list of dict
        RMS per joint (n_joints,) that is left on the training runs after every loop of every round: `friction` with
        the links held, `links`, `residual`.
    n_iter_, converged_ : int, bool
        Of the three loops.
    """

    _stribeck: _core.Effect | None = None

    def __init__(
        self,
        robot: _core.RobotModel,
        *,
        friction: FrictionIdentifier | None = None,
        links: LinkDynamicsIdentifier | None = None,
        residual: ResidualCompensator | str | None = "default",
        known: Sequence[KnownTerm] = (),
        friction_law: str | Sequence[str] = DEFAULT_LAW,
        cutoff: float | None = None,
        max_iter: int = 10,
        tol: float = 2e-2,
    ) -> None:
        self.robot = robot
        self.friction = friction
        self.links = links
        self.residual = residual
        self.known = known
        self.friction_law = friction_law
        self.cutoff = cutoff
        self.max_iter = max_iter
        self.tol = tol

    def fit(
        self,
        recordings: Recording | Sequence[Recording],
        friction_recording: Recording | Sequence[Recording] | None = None,
        *,
        on_progress: Callable[[str], None] = lambda step: None,
    ) -> ThreeLoopIdentifier:
        """Fit to training runs.

        Parameters
        ----------
        recordings : Recording or sequence of Recording
            Exciting motion.
        friction_recording : Recording or sequence of Recording, optional
            Friction experiment: the same positions passed in both directions at the same speeds (Eqs. 5-8). Its pairs
            decide friction's shape and its odd part; their sums stand beside the training runs in the joint fit.
        on_progress : callable
            Called with a few words before every step.

        Raises
        ------
        DataError
            Runs of another robot, mixed units, a joint that never moves, too little motion, a friction run
            without reversal.
        """
        from threadpoolctl import threadpool_limits

        if self.max_iter < 1:
            raise ValueError(f"max_iter must be at least 1, found {self.max_iter}")
        if self.cutoff is not None and not 0 < self.cutoff < np.inf:
            raise ValueError(f"cutoff must be a positive frequency in Hz, found {self.cutoff}")
        if not (self.residual is None or self.residual == "default" or isinstance(self.residual, ResidualCompensator)):
            raise ValueError(f"residual must be a ResidualCompensator, None or 'default', found {self.residual!r}")
        self._stribeck = None
        laws_per_joint(self.friction_law, self.robot.n_joints)
        recordings = _as_list(recordings)
        slow = _as_list(friction_recording) if friction_recording is not None else []
        check_training_runs(self.robot, recordings + slow)
        # Small matrices by the thousand: BLAS threads spin on each other and cost more than they give.
        with threadpool_limits(limits=1, user_api="blas"):
            return self._fit(recordings, slow, on_progress)

    def _fit(
        self, recordings: list[Recording], slow: list[Recording], on_progress: Callable[[str], None]
    ) -> ThreeLoopIdentifier:
        friction, links, residual = self._estimators()
        data = self._prepare(recordings, slow, on_progress)
        runs, plan, observations = data.runs, data.plan, data.observations
        in_ampere = self.torque_unit_ == "A"

        third_loop = [np.zeros_like(states.tau) for states in runs]
        held = self._baseline_links.phi_base_, self._baseline_links.torque_scale_
        self.history_: list[dict[str, FloatArray]] = []
        self.converged_ = False
        changed = None  # joints whose torque the third loop has changed; at first all are new
        for self.n_iter_ in range(1, self.max_iter + 1):
            # Loop 1: friction's shape, on what the links leave (Eqs. 9-12).
            on_progress(f"round {self.n_iter_}: friction")
            torque = [states.in_band(states.tau - u) for states, u in zip(runs, third_loop, strict=True)]
            plan = self._fit_shape(friction, plan, observations.rows_with(torque), data, held, changed)
            # Loop 2: links and all linear coefficients, without the third loop's torque (Eqs. 19-25).
            on_progress(f"round {self.n_iter_}: link dynamics")
            observations = observe(plan, runs, [s.tau - u for s, u in zip(runs, third_loop, strict=True)])
            own, after_friction = own_beside(observations, *held)
            if self.n_iter_ == 1:
                self.friction_model_ = self._model(plan, self._baseline_links, own, data.raw_runs)
            beside = row_groups(pair_rows(plan, data.pairs)) if data.pairs else []
            links.fit(observations, fit_scale=in_ampere, beside=beside, again=self.n_iter_ > 1)
            held = links.phi_base_, links.torque_scale_
            after = after_links = rms(block_residuals(observations, links.x_, links.torque_scale_))
            if self.n_iter_ == 1:
                self.two_loop_model_ = self._model(plan, links, links.own_, data.raw_runs)
            # Loop 3: what is left, from the deflection (Eqs. 31-39); where it does not pay, it stays out.
            if residual is not None:
                on_progress(f"round {self.n_iter_}: residual")
                left = observations.by_run(block_residuals(observations, links.x_, links.torque_scale_))
                left = [e + states.in_band(u) for e, states, u in zip(left, runs, third_loop, strict=True)]
                tau_link = [_link_torque(plan, links, states) for states in runs]
                if self.n_iter_ == 1:
                    residual.fit(runs, left, tau_link=tau_link, columns=_linear_columns(observations))
                else:
                    residual.refit(runs, left, tau_link=tau_link)
                torque = [residual.torque(states, load) for states, load in zip(runs, tau_link, strict=True)]
                after = rms([e - states.in_band(u) for e, states, u in zip(left, runs, torque, strict=True)])
            self.history_.append({"friction": after_friction, "links": after_links, "residual": after})
            if residual is None or not residual.kept.any() or self._settled():
                self.converged_ = True
                break
            third_loop = torque
            changed = np.flatnonzero(residual.kept).tolist()
        if not self.converged_:
            warnings.warn(
                f"the three loops still changed after {self.max_iter} rounds; raise max_iter or tol",
                ConvergenceWarning,
                stacklevel=2,
            )
        self.friction_, self.links_, self.residual_ = friction, links, residual
        self._pairs = data.pairs
        self.observations_, self.raw_runs_, self.runs_ = observations, data.raw_runs, runs
        kept = None if residual is None else (residual.inputs_, residual.mixtures_, residual.compliance_)
        self.model_ = self._model(plan, links, links.own_, data.raw_runs, kept)
        return self

    def predict(self, recording: Recording) -> FloatArray:
        """Torque of `recording` at its own stamps, (n_samples, n_joints), in the unit of the training runs."""
        check_is_fitted(self, "model_")
        states = self.states(recording)
        total = evaluate(self.model_, states)[0]
        return np.stack([np.interp(recording.t, states.t, column) for column in total.T], axis=1)

    def states(self, recording: Recording) -> States:
        """States of a run in the band and at the rate of the training runs, channels as recorded."""
        check_is_fitted(self, "band_")
        return prepare(recording, self.band_, self.rate_)

    def model_with(self, regressions: Regressions) -> _core.TorqueModel:
        """Return the model with other regressions in its third loop; all None leaves it out.

        The second loop is fitted again beside them: its terms depend on what the third one takes.
        """
        check_is_fitted(self, "model_")
        if all(regression is None for regression in regressions):
            return self.two_loop_model_
        third, plan = self.residual_, self.observations_.plan
        if third is None:
            raise ValueError("the third loop was switched off; fit with a ResidualCompensator first")
        if list(regressions) == third.mixtures_:
            return self.model_
        loads = [_link_torque(plan, self.links_, states) for states in self.runs_]
        torque = [third.torque(states, load, regressions) for states, load in zip(self.runs_, loads, strict=True)]
        observations = observe(plan, self.runs_, [s.tau - u for s, u in zip(self.runs_, torque, strict=True)])
        beside = row_groups(pair_rows(plan, self._pairs)) if self._pairs else []
        links = copy(self.links_).fit(observations, fit_scale=self.torque_unit_ == "A", beside=beside, again=True)
        kept = (third.inputs_, list(regressions), third.compliance_)
        return self._model(plan, links, links.own_, self.raw_runs_, kept)

    def _estimators(self) -> tuple[FrictionIdentifier, LinkDynamicsIdentifier, ResidualCompensator | None]:
        """Fresh copies of the three loops, so that the user's own are never changed."""
        friction = clone(self.friction) if self.friction is not None else FrictionIdentifier()
        links = clone(self.links) if self.links is not None else LinkDynamicsIdentifier()
        residual = ResidualCompensator() if self.residual == "default" else self.residual
        return friction, links, clone(residual) if residual is not None else None

    def _prepare(self, recordings: list[Recording], slow: list[Recording], on_progress: Callable[[str], None]) -> _Data:
        """Filter, fit the baseline, and bring the two encoder channels on one clock."""
        self.torque_unit_ = recordings[0].torque_unit
        self.known_ = check_known(self.known, self.robot, self.torque_unit_)
        self.rate_ = common_rate(recordings)
        self.band_ = Band(self.cutoff) if self.cutoff is not None else choose_band(recordings)
        on_progress("filtering the runs")
        raw_runs = prepare_training_runs(recordings, self.band_, self.rate_)
        slow_runs = [prepare(recording, self.band_, self.rate_) for recording in slow]
        on_progress("weighted least squares")
        plan = self._plan(friction_effect(*self._first_shape()))
        runs = less_known(self.known_, raw_runs)
        observations = observe(plan, runs)
        self._fit_baseline(observations, raw_runs, fit_scale=self.torque_unit_ == "A")
        if self._measure_encoder_delay(raw_runs):
            runs = less_known(self.known_, [states.aligned(self._delay) for states in raw_runs])
            slow_runs = [states.aligned(self._delay) for states in slow_runs]
            observations = observe(plan, runs)
        if slow_runs:
            on_progress("pairs of the friction experiment")
            slow_runs = less_known(self.known_, slow_runs)
        mirrors = [find_mirrors(states) for states in slow_runs]
        check_reversals(slow_runs, mirrors, self.robot.joint_names)
        return _Data(raw_runs, runs, pair_windows(slow_runs, mirrors), plan, observations)

    def _first_shape(self) -> tuple[FloatArray, FloatArray]:
        n = self.robot.n_joints
        return np.zeros(n), np.full(n, FIRST_WIDTH)

    def _plan(self, friction: _core.Effect) -> Plan:
        effects = [_core.Effect.rotor_inertia(), _core.Effect.torque_offset()]
        if self._stribeck is not None:
            effects.append(self._stribeck)
        plan = make_plan(self.robot, [*effects, friction])
        return with_laws(plan, laws_per_joint(self.friction_law, self.robot.n_joints))

    def _fit_shape(
        self,
        friction: FrictionIdentifier,
        plan: Plan,
        rows: list[list[FloatArray]],
        data: _Data,
        held: tuple[FloatArray, FloatArray],
        changed: Sequence[int] | None,
    ) -> Plan:
        """First loop: friction's shape, by the pairs of a friction experiment where a joint has some; the plan then."""
        pairs = odd_torques(plan, data.pairs, pair_rows(plan, data.pairs)[0], *held) if data.pairs else None
        friction.fit(plan, data.runs, rows, changed, pairs=pairs)
        plan = self._plan(friction.effect_)
        if "stribeck" in laws_per_joint(self.friction_law, self.robot.n_joints):
            first = self._stribeck is None
            plan = self._fit_stribeck(friction.effect_, data)
            if first:  # the width was searched without the part that falls with speed: once more, with it
                torque = [np.column_stack([run[j][:, -1] for j in range(len(run))]) for run in rows]
                rows = observe(plan, data.runs).rows_with(torque)
                return self._fit_shape(friction, plan, rows, data, held, None)
        return plan

    def _fit_stribeck(self, friction: _core.Effect, data: _Data) -> Plan:
        """Choose the shape of the part that falls with speed; the pairs decide where a joint has some."""

        def left(stribeck: _core.Effect) -> FloatArray:
            self._stribeck = stribeck
            plan = self._plan(friction)
            odd = [_core.triangular_factor(rows) for rows in pair_rows(plan, data.pairs)[0]] if data.pairs else None
            return power_left(observe(plan, data.runs), odd)

        top_speed = np.max([np.abs(states.dq_motor).max(axis=0) for states in data.runs], axis=0)
        self._stribeck = fit_stribeck(friction, top_speed, left)
        return self._plan(friction)

    def _fit_baseline(self, observations: Observations, runs: list[States], *, fit_scale: bool) -> None:
        simple, regroup = baseline(observations)
        self._baseline_links = links = LinkDynamicsIdentifier(ridge=0.0, prior=None).fit(simple, fit_scale=fit_scale)
        self._delay = np.zeros(self.robot.n_joints)
        self.baseline_ = self._model(observations.plan, links, links.own_ @ regroup.T, runs)

    def _model(
        self,
        plan: Plan,
        links: LinkDynamicsIdentifier,
        own: FloatArray,
        runs: list[States],
        third_loop: tuple[str, Regressions, FloatArray] | None = None,
    ) -> _core.TorqueModel:
        delay, unit = self._delay, self.torque_unit_
        known = self.known_
        return assemble(
            plan, links, own, runs, encoder_delay=delay, torque_unit=unit, third_loop=third_loop, known=known
        )

    def _measure_encoder_delay(self, runs: list[States]) -> bool:
        """Estimate the delay between the channels; true if there are two."""
        self.encoder_delay_: EncoderDelay | None = None
        if not all(states.two_encoders for states in runs):
            return False
        tau_link = [evaluate(self.baseline_, states)[1][:, 0] for states in runs]
        self.encoder_delay_ = estimate_encoder_delay(runs, tau_link)
        self._delay = self.encoder_delay_.value
        return True

    def _settled(self) -> bool:
        if len(self.history_) < 2:
            return False
        last, now = self.history_[-2]["links"], self.history_[-1]["links"]
        return bool(np.all(np.abs(now - last) <= self.tol * np.maximum(last, 1e-300)))


def _as_list(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


def _link_torque(plan: Plan, links: LinkDynamicsIdentifier, states: States) -> FloatArray:
    """Rigid-body torque of the second loop at every sample, (n, n_joints) in the torque unit."""
    phi = np.zeros(10 * plan.robot.n_joints)
    phi[plan.pivots] = links.phi_base_
    tau: FloatArray = plan.robot.inverse_dynamics(states.q, states.dq, states.ddq, phi) * links.torque_scale_
    return tau


def _linear_columns(observations: Observations) -> list[list[FloatArray]]:
    """Columns of every joint's terms, per joint and run."""
    blocks = observations.blocks
    return [observations.by_run([block.rows[j][:, :-1] for block in blocks]) for j in range(len(blocks[0].rows))]
