"""What the three loops share while they run: data, model so far, and one step per loop (the paper's Figure 2)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.friction import FrictionIdentifier, friction_effect
from dynid_rs.identification.friction_experiment.pairs import check_reversals, find_mirrors
from dynid_rs.identification.friction_experiment.rows import (
    PairWindow,
    odd_torques,
    pair_rows,
    pair_windows,
    row_groups,
)
from dynid_rs.identification.friction_laws import fit_stribeck, power_left, with_laws
from dynid_rs.identification.links import LinkDynamicsIdentifier, RowGroup, baseline, own_beside
from dynid_rs.identification.loads import Settling, has_settled, link_torque, with_load
from dynid_rs.identification.residual import ResidualCompensator
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier, sign_by_way
from dynid_rs.identification.training import TrainingData
from dynid_rs.model.assembly import Regressions, assemble, evaluate
from dynid_rs.model.known import KnownTerm, less_known
from dynid_rs.model.placed import PlacedEffect, effects_of
from dynid_rs.regression.columns import Observations, Plan, make_plan, observe
from dynid_rs.regression.evaluation import rmse as rms
from dynid_rs.regression.kept_columns import kept_answer
from dynid_rs.regression.scales import Gains, free_scales
from dynid_rs.regression.systems import block_residuals
from dynid_rs.runs.encoders import EncoderDelay, estimate_encoder_delay
from dynid_rs.runs.preprocessing import States, is_of_load, top_speed

FloatArray = NDArray[np.float64]

FIRST_WIDTH = 4e-3
"""Transition width [rad/s] of the first pass and of the baseline, before any search."""
SHAPE_ROUNDS, SAME_SHAPE = 6, 0.1
"""Rounds in which a smooth law's shapes and the links settle, and the change of a width's logarithm at which they
have."""
LOAD_ROUNDS, MOTOR_ROUNDS = 2, 5
"""Fits after each other, at most, in which the load and what depends on it settle, where the change falls tenfold with
each, and the motors' torque and what depends on it: there an error comes back up to 1.5 times as large, and is taken
out."""


class Loops:
    """State of the three loops; `start` once, then `fit_friction`, `fit_links` and `fit_residual` in turn.

    Attributes
    ----------
    runs : list of States
        Training runs, link channel on the motor channel's clock, known terms taken off.
    plan, observations : Plan, Observations
        Columns with friction's shape so far, and their rows without the third loop's torque.
    two_loops : (Observations, LinkDynamicsIdentifier)
        Rows of the columns with friction's shape before there was a third loop, and the links fitted to them.
    left : dict
        RMS per joint (n_joints,) that each loop of this round leaves: `friction`, `links`, `residual`.
    stages : list of TorqueModel
        The baseline, it with the first loop's friction, both loops without a third.
    encoder_delay : EncoderDelay or None
        Between the two channels; None with one encoder.
    """

    def __init__(
        self,
        robot: _core.RobotModel,
        data: TrainingData,
        friction: FrictionIdentifier | SmoothFrictionIdentifier,
        links: LinkDynamicsIdentifier,
        residual: ResidualCompensator | None,
        laws: Sequence[str],
        effects: Sequence[PlacedEffect] = (),
        free_gains: Sequence[int] = (),
        encoder_error: FloatArray | None = None,
    ) -> None:
        self.robot, self.data, self.laws, self.effects = robot, data, laws, effects
        # In ampere all gains but one are free already.
        self.free_gains = () if data.in_ampere else tuple(free_gains)
        self.encoder_error = encoder_error
        self.friction, self.links, self.residual = friction, links, residual
        self.encoder_delay: EncoderDelay | None = None
        self.stages: list[_core.TorqueModel] = []
        self.left: dict[str, FloatArray] = {}
        self._delay = np.zeros(robot.n_joints)
        self._stribeck: _core.Effect | None = None
        self._made_of: tuple[object, ...] = (None, None, None)  # plan, runs and third loop of the last rows
        # Rows that the links have been fitted to, their prior chosen for them or as in an earlier fit.
        self._fresh: Observations | None = None
        self._changed: list[int] | None = None  # joints whose torque the third loop has changed; at first all are new
        self._near = False  # whether the prior and what samples are worth come from an earlier fit

    @property
    def gains(self) -> Gains | None:
        """Gains that are fitted beside all else; None where the torque channels' are given."""
        in_ampere = self.data.in_ampere
        free = free_scales(self.robot.n_joints, in_ampere, self.free_gains)
        return Gains(free, in_ampere) if in_ampere or free.any() else None

    @property
    def third_loop_kept(self) -> bool:
        """Whether some joint has a third loop, so that another round can change something."""
        return self.residual is not None and bool(self.residual.kept.any())

    def start(self, near: Loops | None = None) -> None:
        """Weighted least squares as the paper compares with, the two encoders on one clock, pairs of the slow runs.

        Loads, the prior and what samples are worth begin as `near` ended; those of the slow runs stay so.
        """
        data = self.data
        n = self.robot.n_joints
        first_friction = friction_effect(np.zeros(n), np.full(n, FIRST_WIDTH))
        self.runs = less_known(data.known, [self._as_seen(states) for states in data.runs])
        # The baseline knows no effects; what it says of the load is what they begin with. While a diagnosis comes and
        # goes with effects it stays what it is.
        runs = [(states.motion, states.digest("tau"), states.counted.tobytes()) for states in self.runs]
        made_of = self.robot, data.in_ampere, *runs
        self.plan, self._first, regroup = kept_answer("baseline", made_of, lambda: self._baseline(first_friction))
        self._held = self._first.phi_base_, self._first.torque_scale_
        self.stages = [self.model(self.plan, self._first, self._first.own_ @ regroup.T)]
        if all(states.two_encoders for states in data.runs):
            self.encoder_delay = self._measure_encoder_delay()
            self._delay = self.encoder_delay.value
            self.runs = less_known(data.known, [self._as_seen(states) for states in data.runs])
        slow_runs = less_known(data.known, [self._as_seen(states) for states in data.slow_runs])
        if self.effects:
            loaded = with_load(self.plan, self._first, self._first.own_ @ regroup.T)
            if near is not None:
                loaded = with_load(near.plan, near.links, near.links.own_)
            slow_runs, self.runs = [loaded(states) for states in slow_runs], [loaded(states) for states in self.runs]
        if isinstance(self.friction, SmoothFrictionIdentifier):
            first_friction = self.friction.begin(n).effect_
        self.plan = self._plan(first_friction)
        self.observations = observe(self.plan, self.runs)
        mirrors = [find_mirrors(states) for states in slow_runs]
        check_reversals(slow_runs, mirrors, self.robot.joint_names)
        self._pairs: list[PairWindow] = pair_windows(slow_runs, mirrors)
        self._third_loop = [np.zeros_like(states.tau) for states in self.runs]
        if near is not None and near.links.posterior_ is not None:
            worth = near.links.worth_ * np.maximum(self.observations.n_counted, 1)
            self.links.posterior_, self._near = replace(near.links.posterior_, n_effective=worth), True

    def _baseline(self, friction: _core.Effect) -> tuple[Plan, LinkDynamicsIdentifier, FloatArray]:
        """Plan of the declared model, the baseline fitted to the runs, and its own columns among the plan's."""
        plan = declared_plan(self.robot, friction)
        simple, regroup = baseline(observe(plan, self.runs))
        return plan, LinkDynamicsIdentifier(prior=None).fit(simple, fit_scale=self.data.in_ampere), regroup

    def fit_friction(self) -> None:
        """First loop: friction's shape, on what the links leave; the pairs decide where a joint has some."""
        pairs = zip(self.runs, self._third_loop, strict=True)
        self._search_shape(self.observations.rows_with([s.in_band(s.tau - u) for s, u in pairs]), self._changed)
        self.observations = self._without_third_loop()
        own, self.left = own_beside(self.observations, *self._held), {}
        self.left["friction"] = own[1]
        if len(self.stages) == 1:
            self.stages.append(self.model(self.plan, self._first, own[0]))

    def fit_links(self) -> None:
        """Second loop: all linear coefficients, beside the rows of the pairs."""
        again = len(self.stages) > 2
        self._fit_links(self.observations, again)
        if self.depends_on_load:
            # Columns of the load follow from links and friction, which follow from them.
            settling = Settling()
            of_motor = any("tau_motor" in effect.signals for effect in self.plan.effects)
            for _ in range(MOTOR_ROUNDS if of_motor else LOAD_ROUNDS):
                loaded = with_load(self.plan, self.links, self.links.own_)
                given = [loaded(states) for states in self.runs]
                if has_settled(self.runs, given):
                    break
                self.runs = settling.next(self.runs, given)
                self.observations = self._without_third_loop()
                self._fit_links(self.observations, True)
        self._held = self.links.phi_base_, self.links.torque_scale_
        self._links_leave = block_residuals(self.observations, self.links.x_, self.links.torque_scale_)
        self.left["links"] = self.left["residual"] = rms(self._links_leave)
        if not again:
            self.two_loops = self.observations, copy(self.links)
            self.stages.append(self.model(self.plan, self.links, self.links.own_))

    @property
    def depends_on_load(self) -> bool:
        """Whether some effect's columns are made of a predicted torque."""
        return any(is_of_load(effect.signals) for effect in self.plan.effects)

    def _fit_links(self, observations: Observations, again: bool) -> None:
        """Second loop on these rows; what has been fitted to them is not fitted to them again, unless it is to be."""
        if again or self._fresh is not observations:
            self.links.fit(observations, beside=self.beside(), again=again or self._near, **self._gains())
        self._fresh = None if again else observations

    def _gains(self) -> dict[str, Any]:
        """Which gains are fitted, and where their search begins: where the baseline's ended."""
        scale = self._first.torque_scale_ if self.data.in_ampere else None
        return {"fit_scale": self.data.in_ampere, "free_gains": self.free_gains, "scale": scale}

    def fit_residual(self) -> None:
        """Third loop: what is left, from the deflection; the choice where it is kept is made in the first round."""
        if self.residual is None:
            return
        left = self.observations.by_run(self._links_leave)
        left = [e + s.in_band(u) for e, s, u in zip(left, self.runs, self._third_loop, strict=True)]
        tau_link = [link_torque(self.plan, self.links, states) for states in self.runs]
        if self._changed is None:
            columns = _linear_columns(self.observations)
            self.residual.fit(self.runs, left, tau_link=tau_link, columns=columns)
        else:
            self.residual.refit(self.runs, left, tau_link=tau_link)
        self._third_loop = [self.residual.torque(s, load) for s, load in zip(self.runs, tau_link, strict=True)]
        self._changed = np.flatnonzero(self.residual.kept).tolist()
        self.left["residual"] = rms(
            [e - s.in_band(u) for e, s, u in zip(left, self.runs, self._third_loop, strict=True)]
        )

    def beside(self) -> list[RowGroup]:
        """Rows of the friction experiment that stand beside the training runs'."""
        return row_groups(pair_rows(self.plan, self._pairs)) if self._pairs else []

    def whole_model(self) -> _core.TorqueModel:
        """Model of all three loops."""
        third = self.residual
        kept = None if third is None else (third.inputs_, third.mixtures_, third.compliance_)
        return self.model(self.plan, self.links, self.links.own_, kept)

    def model(
        self,
        plan: Plan,
        links: LinkDynamicsIdentifier,
        own: FloatArray,
        third_loop: tuple[str, Regressions, FloatArray] | None = None,
        known: Sequence[KnownTerm] | None = None,
    ) -> _core.TorqueModel:
        """Model of fitted numbers on this data's clock, in its unit, with its known terms or others."""
        return assemble(
            plan,
            links,
            own,
            self.data.runs,
            encoder_delay=self._delay,
            encoder_error=self.encoder_error,
            torque_delay=self.data.torque_delay,
            torque_unit=self.data.torque_unit,
            band=(self.data.band.cutoff, self.data.rate, self.data.standstill),
            third_loop=third_loop,
            known=self.data.known if known is None else known,
        )

    def _without_third_loop(self) -> Observations:
        made_of = self.plan, self.runs, self._third_loop
        if any(one is not other for one, other in zip(made_of, self._made_of, strict=True)):
            torque = [s.tau - u for s, u in zip(self.runs, self._third_loop, strict=True)]
            self._last, self._made_of = observe(self.plan, self.runs, torque), made_of
        return self._last

    def _measure_encoder_delay(self) -> EncoderDelay:
        tau_link = [evaluate(self.stages[0], states)[1][:, 0] for states in self.data.runs]
        return estimate_encoder_delay(self.runs, tau_link)

    def _as_seen(self, states: States) -> States:
        """Return a run less what is known of its encoders' error and delay so far."""
        return states.aligned(self._delay, self.encoder_error)

    def _plan(self, friction: _core.Effect) -> Plan:
        law = [] if self._stribeck is None else [self._stribeck]
        if isinstance(self.friction, SmoothFrictionIdentifier):
            law = [sign_by_way(self.robot.n_joints)]
        placed = effects_of(self.effects, self.robot.n_joints)
        first = 2 + len(law)
        acts_on = {first + k: joints for k, (_, joints) in enumerate(placed)}
        between = [*law, *(effect for effect, _ in placed)]
        apart = None if self.links.prior is None else moved_apart(self.data.runs)
        plan = declared_plan(self.robot, friction, between, acts_on, apart=apart)
        return with_laws(plan, self.laws, 2 if law else None)

    def _search_shape(self, rows: list[list[FloatArray]], joints: Sequence[int] | None) -> None:
        if isinstance(self.friction, SmoothFrictionIdentifier):
            return self._search_smooth_shape()
        pairs = None
        if self._pairs:
            pairs = odd_torques(self.plan, self._pairs, pair_rows(self.plan, self._pairs)[0], *self._held)
        self.friction.fit(self.plan, self.runs, rows, joints, pairs=pairs)
        self.plan = self._plan(self.friction.effect_)
        if "stribeck" in self.laws:
            first = self._stribeck is None
            self._search_stribeck()
            if first:  # the width was searched without the part that falls with speed: once more, with it
                torque = [np.column_stack([joint[:, -1] for joint in run]) for run in rows]
                self._search_shape(observe(self.plan, self.runs).rows_with(torque), None)

    def _search_smooth_shape(self) -> None:
        """Width and sharpness of a smooth law, beside links that were fitted with the shapes so far.

        Found once, in the first round; beside a third loop they only move.
        """
        assert isinstance(self.friction, SmoothFrictionIdentifier)
        for step in range(SHAPE_ROUNDS):
            observations = self._without_third_loop()
            self._fit_links(observations, step > 0)
            if np.all(self.friction.held):
                return
            if step == 0 and self.friction.start is None and len(self.stages) == 1:
                self.friction.fit(observations, self.links, self.runs)
                change = np.inf
            else:
                change = self.friction.improve(observations, self.links, self.runs)
            self.plan = self._plan(self.friction.effect_)
            if change < SAME_SHAPE:
                break

    def _search_stribeck(self) -> None:
        """Choose the shape of the part that falls with speed; the pairs decide where a joint has some."""

        def left(stribeck: _core.Effect) -> FloatArray:
            self._stribeck = stribeck
            plan = self._plan(self.friction.effect_)
            odd = [_core.triangular_factor(rows) for rows in pair_rows(plan, self._pairs)[0]] if self._pairs else None
            return power_left(observe(plan, self.runs), odd)

        self._stribeck = fit_stribeck(self.friction.effect_, top_speed(self.runs), left)
        self.plan = self._plan(self.friction.effect_)


def declared_plan(
    robot: _core.RobotModel,
    friction: _core.Effect,
    between: Sequence[_core.Effect] = (),
    acts_on: Mapping[int, Collection[int]] | None = None,
    *,
    apart: NDArray[np.bool_] | None = None,
) -> Plan:
    """Columns of the declared model: rotor inertia, offset, effects `between`, friction; then the rigid body's."""
    effects = [_core.Effect.rotor_inertia(), _core.Effect.torque_offset(), *between, friction]
    return make_plan(robot, effects, acts_on=acts_on, apart=apart)


def moved_apart(runs: Sequence[States]) -> NDArray[np.bool_]:
    """Joints whose motor and link positions differ by more than where they were set to zero, (n_joints,)."""
    apart: NDArray[np.bool_] = np.any([np.ptp(states.q_motor - states.q, axis=0) > 0 for states in runs], axis=0)
    return apart


def _linear_columns(observations: Observations) -> list[list[FloatArray]]:
    """Columns of every joint's terms, per joint and run."""
    blocks = observations.blocks
    return [observations.by_run([block.rows[j][:, :-1] for block in blocks]) for j in range(len(blocks[0].rows))]
