"""The three loops of the paper's Figure 2: friction, link dynamics, residual, until nothing changes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import clone
from dynid_rs.base.numbers import percent
from dynid_rs.identification.friction import FrictionIdentifier
from dynid_rs.identification.friction_laws import laws_per_joint, usual_law
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.loads import link_torque
from dynid_rs.identification.loops import Loops
from dynid_rs.identification.regressor import RunRegressor
from dynid_rs.identification.residual import ResidualCompensator
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.training import Excluded, TrainingData, prepare_training_data
from dynid_rs.model.assembly import Regressions
from dynid_rs.model.known import KnownTerm, check_known
from dynid_rs.model.placed import HeldEffect, PlacedEffect, held_terms
from dynid_rs.regression.columns import Observations, observe
from dynid_rs.regression.is_fitted import check_is_fitted
from dynid_rs.regression.kept_columns import keeping_columns
from dynid_rs.regression.scales import free_scales
from dynid_rs.regression.uncertainty import parameter_covariance
from dynid_rs.runs.checks.damage import warn_of_damage
from dynid_rs.runs.facts import check_training_runs
from dynid_rs.runs.given import Runs, as_recordings
from dynid_rs.runs.preprocessing import States, prepare, without
from dynid_rs.runs.readers.config_file import Rules
from dynid_rs.runs.recording import Delay, Recording
from dynid_rs.runs.splitting import refuse_repeats

FloatArray = NDArray[np.float64]

NOT_SETTLED = "the three loops still changed"
"""How the warning begins that a fit has not converged."""


@dataclass(frozen=True, eq=False)
class FitInMemory:
    """Rows in time of the runs that are held in memory, and the links fitted to them alone."""

    observations: Observations
    links: LinkDynamicsIdentifier


class ThreeLoopIdentifier(RunRegressor):
    """Torque model of an arm from measured runs (Eq. 26: ``tau = tau_friction + tau_link + tau_residual``).

    Parameters
    ----------
    robot : RobotModel
        Kinematics and gravity.
    friction : FrictionIdentifier or SmoothFrictionIdentifier, optional
        First loop.
    links : LinkDynamicsIdentifier, optional
        Second loop.
    residual : ResidualCompensator, None or "default"
        Third loop; None switches it off.
    known : sequence of (Effect, ndarray (n_joints, n_columns))
        Effects whose coefficients [N*m] are known, not fitted: taken off the torque, and part of the model.
    effects : sequence of PlacedEffect
        What the arm has beside rigid body and friction, with its shapes; coefficients are fitted in the second loop.
    held : sequence of HeldEffect
        Effects on single joints whose coefficients were fitted elsewhere (ripple, at full rate): taken off the torque
        and part of the model, as known terms are, but in the unit of the torque channel.
    free_gains : sequence of int
        Joints whose torque channel has a gain of its own against the others', which is fitted; one has to hold the
        unit. In ampere all gains but the first are fitted anyway.
    torque_delay : float or ndarray (n_joints,)
        How late the torque channels are behind the encoders [s], all or each: training runs are fitted without it, and
        the model predicts what the channels show.
    encoder_error : ndarray (n_joints, 2), optional
        Cosine and sine part [rad] of what each link encoder shows too much; taken off before anything else.
    excluded : mapping of str to windows, optional
        Name of a run to the times (start, end) [s] in which something from outside acts: neither fitted nor scored.
    friction_law : str or sequence of str, optional
        "paper" (Eqs. 9-11), "coulomb_viscous" or "stribeck", for all joints or one per joint, or "smooth" for all,
        which needs the weak prior. Left out: what `friction` searches; without one "smooth", and "paper" with a
        friction experiment and where `links` has no prior.
    cutoff : float, optional
        Band [Hz] in which torques are fitted and compared; chosen from the motion if None.
    standstill : bool
        Whether pauses are fitted and scored too, which only a model with memory can do well.
    max_iter : int
        Most rounds of the three loops.
    tol : float
        Relative change of every joint's residual at which they stop.
    config : Config, path or mapping, optional
        What the columns of data frames are, as for `read_recording`: ``{"q": "actual_q_{i}"}``. Recordings know that.

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
        Training runs as recorded, and with the encoders' error taken off, the link channel on the motor channel's clock
        and the known terms' torque taken off.
    in_memory_ : FitInMemory
        Observations and links of `runs_`, row by row in time: `observations_` and `links_` themselves, unless
        `archive.Archive.settle` has fitted those to more runs than memory holds.
    known_ : list of (Effect, ndarray)
        Known terms as they were used.
    loops_ : Loops
        The loops as they ended, with the data that they ran over.
    history_ : list of dict
        RMS per joint (n_joints,) that is left on the training runs after every loop of every round: `friction` with
        the links held, `links`, `residual`.
    n_iter_, converged_ : int, bool
        Of the three loops.
    """

    _covariance: tuple[FloatArray, FloatArray] | None

    def __init__(
        self,
        robot: _core.RobotModel,
        *,
        friction: FrictionIdentifier | SmoothFrictionIdentifier | None = None,
        links: LinkDynamicsIdentifier | None = None,
        residual: ResidualCompensator | str | None = "default",
        known: Sequence[KnownTerm] = (),
        effects: Sequence[PlacedEffect] = (),
        held: Sequence[HeldEffect] = (),
        free_gains: Sequence[int] = (),
        encoder_error: FloatArray | None = None,
        torque_delay: Delay = 0.0,
        excluded: Excluded | None = None,
        friction_law: str | Sequence[str] | None = None,
        cutoff: float | None = None,
        standstill: bool = False,
        max_iter: int = 10,
        tol: float = 2e-2,
        config: Rules = None,
    ) -> None:
        self.robot = robot
        self.friction = friction
        self.links = links
        self.residual = residual
        self.known = known
        self.effects = effects
        self.held = held
        self.free_gains = free_gains
        self.encoder_error = encoder_error
        self.torque_delay = torque_delay
        self.excluded = excluded
        self.friction_law = friction_law
        self.cutoff = cutoff
        self.standstill = standstill
        self.max_iter = max_iter
        self.tol = tol
        self.config = config

    def fit(
        self,
        X: Runs,
        friction_recording: Runs | None = None,
        *,
        near: ThreeLoopIdentifier | None = None,
        on_progress: Callable[[str], None] = lambda step: None,
    ) -> ThreeLoopIdentifier:
        """Fit to training runs.

        Parameters
        ----------
        X : Recording, data frame, or list of them
            Exciting motion. Data frames (pandas, polars, Arrow) have one row per sample and are read by `config`; one
            that gaps split is several runs.
        friction_recording : Recording, data frame, or list of them, optional
            Friction experiment: the same positions passed in both directions at the same speeds (Eqs. 5-8). Its pairs
            decide friction's shape and its odd part; their sums stand beside the training runs in the joint fit.
        near : ThreeLoopIdentifier, optional
            Fit to the same runs of a model that is nearly this one, shapes apart: the weak prior, what samples are
            worth and the loads begin as they ended there, and are not searched from nothing again.
        on_progress : callable
            Called with a few words before every step.

        Raises
        ------
        ValueError
            A parameter that is none, something else than runs, or `near` of other joints, runs, gains or links.
        DataError
            Runs of another robot, mixed units, a joint that never moves, too little motion, a run that is there
            twice, a friction run without reversal.

        Warns
        -----
        DamageWarning
            A run is not what it seems, q in degrees for one; `dynid_rs.inspect` says more, and asks all runs together.
        """
        from threadpoolctl import threadpool_limits

        if not isinstance(self.robot, _core.RobotModel):
            raise ValueError(
                f"robot must be a RobotModel, found {type(self.robot).__name__}; read one with RobotModel.from_urdf"
            )
        if self.max_iter < 1:
            raise ValueError(f"max_iter must be at least 1, found {self.max_iter}")
        if self.cutoff is not None and not 0 < self.cutoff < np.inf:
            raise ValueError(f"cutoff must be a positive frequency in Hz, found {self.cutoff}")
        if not (self.residual is None or self.residual == "default" or isinstance(self.residual, ResidualCompensator)):
            raise ValueError(f"residual must be a ResidualCompensator, None or 'default', found {self.residual!r}")
        free_scales(self.robot.n_joints, False, self.free_gains)
        n = self.robot.n_joints
        if self.encoder_error is not None and np.shape(self.encoder_error) != (n, 2):
            raise ValueError(f"encoder_error has shape {np.shape(self.encoder_error)}, expected ({n}, 2)")
        recordings = as_recordings(X, self.robot, self.config)
        slow = [] if friction_recording is None else as_recordings(friction_recording, self.robot, self.config)
        laws = self._laws(with_pairs=bool(slow))
        check_training_runs(self.robot, recordings + slow)
        warn_of_damage(recordings + slow, self.robot)
        refuse_repeats(recordings, [])
        self.known_ = check_known(self.known, self.robot, recordings[0].torque_unit)
        # Small matrices by the thousand: BLAS threads spin on each other and cost more than they give.
        with threadpool_limits(limits=1, user_api="blas"), keeping_columns():
            on_progress("filtering the runs")
            loops = self._loops(self._training_data(recordings, slow), laws)
            self._iterate(loops, None if near is None else _alike(near, loops), on_progress)
        self._keep(loops)
        return self

    def _iterate(self, loops: Loops, near: Loops | None, on_progress: Callable[[str], None]) -> None:
        on_progress("weighted least squares")
        loops.start(near)
        self.history_: list[dict[str, FloatArray]] = []
        self.converged_ = False
        for self.n_iter_ in range(1, self.max_iter + 1):
            # Loop 1: friction's shape, on what the links leave (Eqs. 9-12).
            on_progress(f"round {self.n_iter_}: friction")
            loops.fit_friction()
            # Loop 2: links and all linear coefficients, without the third loop's torque (Eqs. 19-25).
            on_progress(f"round {self.n_iter_}: link dynamics")
            loops.fit_links()
            # Loop 3: what is left, from the deflection (Eqs. 26-39); where it does not pay, it stays out.
            on_progress(f"round {self.n_iter_}: residual")
            loops.fit_residual()
            self.history_.append(loops.left)
            if not loops.third_loop_kept or self._settled():
                self.converged_ = True
                return
        from sklearn.exceptions import ConvergenceWarning

        warnings.warn(
            f"{NOT_SETTLED} the residual of a joint by {percent(self._change())} in round {self.n_iter_} "
            f"({percent(self.tol)} is settled); errors on test runs hold all the same, and in Python "
            "ThreeLoopIdentifier takes a larger max_iter or tol",
            ConvergenceWarning,
            stacklevel=3,
        )

    def states(self, recording: Recording) -> States:
        """States of a run in the band and at the rate of the training runs, channels as recorded; less `excluded`."""
        check_is_fitted(self, "band_")
        (recording,) = as_recordings(recording)
        states = prepare(recording, self.band_, self.rate_, standstill=self.standstill)
        return without(states, (self.excluded or {}).get(recording.name, ()))

    def without_third_loop(self) -> ThreeLoopIdentifier:
        """Return the fit to runs in memory as it was before there was a third loop; itself where none is kept."""
        check_is_fitted(self, "model_")
        if self.residual_ is None or not self.residual_.kept.any():
            return self
        two = copy(self)
        (two.observations_, two.links_), two.model_ = self.loops_.two_loops, self.two_loop_model_
        two.residual_, two._covariance = None, None
        return two

    def without_held(self) -> ThreeLoopIdentifier:
        """Return the fit of two loops whose model lacks what is `held`, which was taken off the torque all the same."""
        check_is_fitted(self, "model_")
        bare = copy(self)
        bare.model_ = self.loops_.model(self.observations_.plan, self.links_, self.links_.own_, known=self.known_)
        return bare

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
        kept = (third.inputs_, list(regressions), third.compliance_)
        loads = [link_torque(plan, self.links_, states) for states in self.runs_]
        torque = [third.torque(states, load, regressions) for states, load in zip(self.runs_, loads, strict=True)]
        observations = observe(plan, self.runs_, [s.tau - u for s, u in zip(self.runs_, torque, strict=True)])
        links = copy(self.links_)
        links.fit(
            observations,
            fit_scale=self.torque_unit_ == "A",
            free_gains=self.loops_.free_gains,
            beside=self.loops_.beside(),
            again=True,
        )
        return self.loops_.model(plan, links, links.own_, kept)

    def parameter_covariance(self, *, gains_known: bool = False) -> FloatArray:
        """Covariance of all unknowns of the second loop, (n_columns, n_columns), as in `regression/uncertainty.py`.

        Gains of torque channels that were fitted beside them (of currents all but the first) are unknowns too. With
        `gains_known` they are those of the model: its torque is off by no more than that, for a gain that is too large
        goes with links that are too light.
        """
        check_is_fitted(self, "links_")
        n = len(self.links_.x_)
        return self._whole_covariance(gains_known)[:n, :n]

    def covariance_with_gains(self) -> FloatArray:
        """`parameter_covariance`; where gains were fitted, their logarithms (n_joints,) come last."""
        check_is_fitted(self, "links_")
        return self._whole_covariance(False)

    def _whole_covariance(self, gains_known: bool) -> FloatArray:
        if self._covariance is not None:
            return self._covariance[gains_known]
        gains = None if gains_known else self.loops_.gains
        return parameter_covariance(self.observations_, self.links_, self.runs_, gains=gains)

    def take_covariance(self, covariance: FloatArray, gains_known: FloatArray) -> None:
        """Use a `covariance_with_gains` that was found from more than `runs_`, and the one at known gains."""
        self._covariance = covariance, gains_known

    def _training_data(self, recordings: list[Recording], slow: list[Recording]) -> TrainingData:
        taken_off = self.known_ + held_terms(self.held, self.robot.n_joints)
        return prepare_training_data(
            recordings,
            slow,
            taken_off,
            self.cutoff,
            self.excluded,
            torque_delay=self.torque_delay,
            standstill=self.standstill,
        )

    def _laws(self, *, with_pairs: bool) -> tuple[str, ...]:
        """Law of every joint, (n_joints,)."""
        law = self.friction_law
        given = "smooth" if isinstance(self.friction, SmoothFrictionIdentifier) else "paper"
        if law is None and self.friction is not None:
            law = given
        if law is None:
            links = LinkDynamicsIdentifier() if self.links is None else self.links
            law = usual_law(with_prior=links.has_prior, with_pairs=with_pairs)
        laws = laws_per_joint(law, self.robot.n_joints)
        if self.friction is not None and ("smooth" in laws) != (given == "smooth"):
            raise ValueError(
                f"friction is a {type(self.friction).__name__}, which does not search shapes of friction_law {law!r}; "
                "leave one of the two out"
            )
        return laws

    def _loops(self, data: TrainingData, laws: tuple[str, ...]) -> Loops:
        """Fresh copies of the three loops around the data, so that the user's own are never changed."""
        friction: FrictionIdentifier | SmoothFrictionIdentifier
        if self.friction is not None:
            friction = clone(self.friction)
        elif "smooth" in laws:
            friction = SmoothFrictionIdentifier()
        else:
            friction = FrictionIdentifier()
        links = clone(self.links) if self.links is not None else LinkDynamicsIdentifier()
        residual = self.residual if isinstance(self.residual, ResidualCompensator) else None
        if self.residual == "default":
            residual = ResidualCompensator()
        third = clone(residual) if residual is not None else None
        return Loops(self.robot, data, friction, links, third, laws, self.effects, self.free_gains, self.encoder_error)

    def _keep(self, loops: Loops) -> None:
        data = loops.data
        self.torque_unit_, self.rate_, self.band_ = data.torque_unit, data.rate, data.band
        self.friction_: Any = loops.friction  # whichever law was asked for
        self.links_, self.residual_ = loops.links, loops.residual
        self.encoder_delay_ = loops.encoder_delay
        self.observations_, self.raw_runs_, self.runs_ = loops.observations, data.runs, loops.runs
        self.in_memory_ = FitInMemory(loops.observations, loops.links)
        self._covariance = None
        self.baseline_, self.friction_model_, self.two_loop_model_ = loops.stages
        self.model_ = loops.whole_model()
        self.loops_ = loops

    def _settled(self) -> bool:
        return self._change() <= self.tol

    def _change(self) -> float:
        """Largest relative change of a joint's residual in the last round; all of it in the first."""
        if len(self.history_) < 2:
            return 1.0
        last, now = self.history_[-2]["links"], self.history_[-1]["links"]
        return float(np.max(np.abs(now - last) / np.maximum(last, 1e-300)))


def _alike(near: ThreeLoopIdentifier, loops: Loops) -> Loops:
    """The loops of an earlier fit, where it is of the same joints and runs under the same prior."""
    check_is_fitted(near, "loops_")
    one, other = (
        (
            of.robot.joint_names,
            of.data.torque_unit,
            of.free_gains,
            [states.name for states in of.data.runs],
            (of.links.prior, of.links.weighting, of.links.believed),
        )
        for of in (near.loops_, loops)
    )
    if one != other:
        raise ValueError(
            "near is a fit of other joints, runs, free gains, links' options or another torque unit; give one that "
            "differs in shapes or effects alone, or none"
        )
    return near.loops_
