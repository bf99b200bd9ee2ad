"""The loops: each against an independent route, then all together on a simulated arm with known truth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.tolerances import ALGEBRAIC
from numpy.testing import assert_allclose
from scipy.signal import butter, sosfiltfilt
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from dynid_rs import (
    DataError,
    FrictionIdentifier,
    LinkDynamicsIdentifier,
    Recording,
    ResidualCompensator,
    RobotModel,
    ThreeLoopIdentifier,
    rmse,
)
from dynid_rs.excitation import FourierExcitation
from dynid_rs.identification.friction import friction_effect
from dynid_rs.identification.links import own_beside
from dynid_rs.identification.loops import declared_plan
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.columns import observe
from dynid_rs.regression.error_interval import rmse_interval
from dynid_rs.regression.evaluation import compare, noise_floor
from dynid_rs.regression.systems import stack_one
from dynid_rs.regression.uncertainty import parameter_covariance
from dynid_rs.runs.preprocessing import Band, choose_band, prepare
from dynid_rs.simulation import Tracking, bundled_robot, simulate, typical_arm
from dynid_rs.simulation.tracking import track


@pytest.fixture(scope="module")
def robot():
    return RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def rigid_arm(robot):
    return replace(typical_arm(robot).rigid(), delay=0.0)


@pytest.fixture(scope="module")
def rigid_runs(rigid_arm):
    return simulate(rigid_arm, n_runs=3, duration=12.0, rate=200.0, seed=2, derivatives=True).recordings


@pytest.fixture(scope="module")
def flexible_runs(robot):
    return simulate(typical_arm(robot), n_runs=5, duration=20.0, rate=250.0, seed=0).recordings


@pytest.fixture(scope="module")
def observed(robot, rigid_arm, rigid_runs):
    runs = [prepare(recording, Band(5.0), 200.0) for recording in rigid_runs]
    shape = friction_effect(np.array(rigid_arm.velocity_threshold), np.array(rigid_arm.transition_width))
    return runs, observe(declared_plan(robot, shape), runs)


def stacked(observations, scale=None):
    """All rows of all joints among all estimable unknowns, joint by joint: A (n_joints, m, p) and b (n_joints, m)."""
    plan = observations.plan
    scale = np.ones(plan.robot.n_joints) if scale is None else scale
    wide = np.array(
        [
            np.concatenate([stack_one(plan, j, block.rows[j], scale) for block in observations.blocks])
            for j in range(plan.robot.n_joints)
        ]
    )
    return wide[:, :, :-1][:, :, plan.estimable()], wide[:, :, -1]


def estimated(links, observations):
    return links.x_[observations.plan.estimable()]


def test_rows_are_the_regressor_through_scipys_zero_phase_filter(robot, observed):
    runs, observations = observed
    states, plan = runs[0], observations.plan
    rate, cutoff = states.rate, states.band.cutoff
    sos = butter(4, cutoff / (rate / 2), output="sos")
    regressor = robot.joint_torque_regressor(states.q, states.dq, states.ddq)[:, :, plan.pivots]
    filtered = sosfiltfilt(sos, regressor, axis=0, padlen=int(3 * rate / cutoff))[states.rows]
    torque = sosfiltfilt(sos, states.tau, axis=0, padlen=int(3 * rate / cutoff))[states.rows]
    for j, rows in enumerate(observations.blocks[0].rows):
        seen, moves = plan.pivots >= 10 * j, states.counted[:, j]
        assert_allclose(rows[moves, plan.n_own : -1], filtered[moves, j][:, seen], **ALGEBRAIC)
        assert_allclose(rows[moves, -1], torque[moves, j], **ALGEBRAIC)
        assert np.mean(moves) > 0.9
        assert not rows[~moves].any()  # what a joint at rest shows is not fitted


def test_ordinary_least_squares_is_numpys(observed):
    links = LinkDynamicsIdentifier(None, prior=None).fit(observed[1])
    A, b = stacked(observed[1])
    reference = np.linalg.lstsq(A.reshape(-1, A.shape[2]), b.ravel(), rcond=None)[0]
    assert_allclose(estimated(links, observed[1]), reference, rtol=1e-7, atol=1e-8)


def test_weighted_least_squares_has_converged_weights(observed):
    links = LinkDynamicsIdentifier("joint_variance", prior=None, tol=1e-10, max_iter=100).fit(observed[1])
    A, b = stacked(observed[1])
    residual = b - A @ estimated(links, observed[1])
    weights = 1 / np.sqrt(np.sum(residual**2, axis=1) / observed[1].n_counted)
    weighted = (A * weights[:, None, None]).reshape(-1, A.shape[2])
    reference = np.linalg.lstsq(weighted, (b * weights[:, None]).ravel(), rcond=None)[0]
    assert links.converged_
    assert_allclose(estimated(links, observed[1]), reference, rtol=1e-6, atol=1e-7)


def test_generalised_least_squares_whitens_across_joints(robot, rigid_arm, rigid_runs):
    rng = np.random.default_rng(0)
    mixing = rng.normal(size=(6, 6)) * np.asarray(rigid_arm.noise_std)[:, None]
    noisy = [replace(r, tau=r.tau + rng.normal(size=r.tau.shape) @ mixing.T) for r in rigid_runs]
    runs = [prepare(recording, Band(5.0), 200.0) for recording in noisy]
    shape = friction_effect(np.array(rigid_arm.velocity_threshold), np.array(rigid_arm.transition_width))
    observations = observe(declared_plan(robot, shape), runs)
    weighted = LinkDynamicsIdentifier("joint_variance", prior=None).fit(observations)
    general = LinkDynamicsIdentifier("full_covariance", prior=None).fit(observations)
    A, b = stacked(observations)
    share = observations.plan.estimable().sum() / 6
    residual = b - A @ estimated(weighted, observations)
    freedom = np.sqrt(np.sum([states.counted.sum(axis=0) for states in runs], axis=0) - share)
    precision = np.linalg.inv(residual @ residual.T / np.outer(freedom, freedom))  # Eq. 24
    normal = np.einsum("imp,ij,jmq->pq", A, precision, A, optimize=True)
    right = np.einsum("imp,ij,jm->p", A, precision, b, optimize=True)
    reference = np.linalg.solve(normal, right)  # Eq. 25
    assert_allclose(estimated(general, observations), reference, rtol=1e-4, atol=1e-5)


def test_a_ridge_is_a_number_and_takes_the_prior_s_place(observed):
    """Ridge l on unit-norm columns: min |A x - b|^2 + (l s_max)^2 |D x|^2, D their norms."""
    links = LinkDynamicsIdentifier(None, ridge=1e-2).fit(observed[1])
    assert links.ridge_ == 1e-2
    assert links.posterior_ is None
    A, b = stacked(observed[1])
    A = A.reshape(-1, A.shape[2])
    norms = np.linalg.norm(A, axis=0)
    greatest = np.linalg.svd(A / norms, compute_uv=False)[0]
    below = 1e-2 * greatest * np.diag(norms)
    reference = np.linalg.lstsq(np.concatenate([A, below]), np.append(b.ravel(), np.zeros(len(norms))), rcond=None)[0]
    assert_allclose(estimated(links, observed[1]), reference, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("n_runs", [1, 3])
def test_the_weak_prior_moves_rich_data_by_less_than_their_errors(observed, n_runs):
    """Always there, for a lone run too; the most that it moves of some eighty unknowns is as far as noise moves one."""
    runs, observations = observed
    observations = observe(observations.plan, runs[:n_runs])
    weak, plain = (LinkDynamicsIdentifier(prior=prior).fit(observations) for prior in ("auto", None))
    assert weak.posterior_ is not None
    assert weak.ridge_ == plain.ridge_ == 0
    assert plain.posterior_ is None
    std = np.sqrt(np.diag(parameter_covariance(observations, plain, runs[:n_runs], fitted_widths=False)))
    used = observations.plan.estimable()
    assert np.abs((weak.x_ - plain.x_)[used] / std[used]).max() < 3


def test_currents_give_the_ratio_of_the_drive_gains(robot, rigid_runs):
    gains = np.array([10.0, 8.0, 9.0, 12.0, 11.0, 10.0])
    currents = [replace(recording, tau=recording.tau / gains, torque_unit="A") for recording in rigid_runs]
    identifier = ThreeLoopIdentifier(robot, residual=None).fit(currents)
    assert_allclose(identifier.links_.torque_scale_[:3], gains[0] / gains[:3], rtol=0.02)
    in_torque = ThreeLoopIdentifier(robot, residual=None).fit(list(rigid_runs))
    states = identifier.states(currents[0])
    error = rmse(states.tau, evaluate(identifier.model_, states)[0]) * gains
    reference = rmse(states.tau * gains, evaluate(in_torque.model_, states)[0])
    assert np.all(error <= 1.05 * reference)


def test_the_search_finds_frictions_width(robot, rigid_arm, rigid_runs):
    identifier = ThreeLoopIdentifier(robot, friction_law="paper", residual=None).fit(list(rigid_runs))
    ratio = identifier.friction_.transition_width_ / np.asarray(rigid_arm.transition_width)
    assert np.all((ratio > 0.7) & (ratio < 1.4)), ratio


def test_two_encoders_three_loops(robot, flexible_runs):
    *train, test = flexible_runs
    identifier = ThreeLoopIdentifier(robot).fit(train)
    assert_allclose(identifier.encoder_delay_.value, 2.8e-3, atol=0.1e-3)
    assert identifier.residual_.inputs_ == "load_free_deflection"
    assert identifier.residual_.kept.any()
    states = [identifier.states(test)]
    errors = {
        name: compare(states[0], evaluate(model, states[0])[0])
        for name, model in {
            "baseline": identifier.baseline_,
            "two": identifier.model_with([None] * 6),
            "three": identifier.model_,
        }.items()
    }
    rms = {name: np.sqrt(np.mean(comparison.error**2, axis=0)) for name, comparison in errors.items()}
    assert np.mean(np.log(rms["three"] / rms["baseline"])) < np.log(0.85)
    kept = identifier.residual_.kept
    assert np.mean(np.log(rms["three"][kept] / rms["two"][kept])) < np.log(0.95)
    intervals = rmse_interval([errors["three"]])
    pairs = zip(intervals, rms["three"], strict=True)
    assert all(interval is None or interval[0] < value < interval[1] for interval, value in pairs)
    assert any(intervals)


def test_the_third_loop_is_refused_on_stiff_gears(robot, rigid_runs):
    identifier = ThreeLoopIdentifier(robot).fit([run.without("ddq", "dq") for run in rigid_runs])
    assert not identifier.residual_.kept.any()
    assert "residual" not in identifier.model_.term_names


def test_the_floor_is_the_noise_that_was_put_in(rigid_arm, rigid_runs):
    runs = [prepare(recording, Band(5.0), 200.0) for recording in rigid_runs]
    impulse = np.zeros(2001)
    impulse[1000] = 1.0
    in_band = np.sqrt(np.sum(Band(5.0).apply(impulse, 200.0) ** 2))
    ratio = noise_floor(runs) / (in_band * np.asarray(rigid_arm.noise_std))
    assert np.all((ratio > 0.8) & (ratio < 1.1)), ratio


def test_predictions_come_at_the_runs_own_stamps(robot, rigid_runs):
    identifier = ThreeLoopIdentifier(robot, residual=None).fit(list(rigid_runs))
    predicted = identifier.predict(rigid_runs[0])
    assert predicted.shape == rigid_runs[0].tau.shape
    assert np.all(rmse(rigid_runs[0].tau, predicted) < 0.2 * rigid_runs[0].tau.std(axis=0))


def test_estimators_follow_scikit_learns_conventions(robot):
    identifier = ThreeLoopIdentifier(
        robot, friction=FrictionIdentifier(refine=False), residual=ResidualCompensator(n_components=3)
    )
    copy = clone(identifier)
    assert copy.get_params()["friction__refine"] is False
    assert copy.residual.n_components == 3
    assert copy.robot is robot
    with pytest.raises(NotFittedError):
        copy.predict(Recording(np.arange(30.0), np.zeros((30, 6)), tau=np.zeros((30, 6))))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda r: replace(r, q=r.q * [0, 1, 1, 1, 1, 1], dq=None, ddq=None), "joint_1 never moves"),
        (lambda r: replace(r, torque_unit="A"), "different signals"),
        (lambda r: r.slice(400, 480), "too short|standstill"),
    ],
)
def test_unusable_training_runs_are_refused(robot, rigid_runs, spoil, words):
    runs = [spoil(rigid_runs[0]), rigid_runs[1]] if "different" in words else [spoil(rigid_runs[0])]
    with pytest.raises((DataError, ValueError), match=words):
        ThreeLoopIdentifier(robot).fit(runs)


def test_a_recorded_velocity_that_lags_is_differentiated_instead(rigid_runs):
    run = rigid_runs[0].without("ddq")
    late = replace(run, dq=np.roll(run.dq, 8, axis=0))  # 40 ms
    states = prepare(late, Band(5.0), 200.0)
    assert any("lags by 40 ms" in note for note in states.notes)
    moving = states.moving
    assert rmse(states.dq[moving], prepare(run, Band(5.0), 200.0).dq[moving]).max() < 0.01


def test_standstill_is_left_out(rigid_runs):
    states = prepare(rigid_runs[0], Band(5.0), 200.0)
    assert not states.moving[: int(0.5 * 200)].any()
    assert states.moving.mean() > 0.8


def test_a_vibrating_joint_does_not_open_the_band(rigid_runs):
    run = rigid_runs[0].without("dq", "ddq")
    shaking = run.q.copy()
    shaking[:, 3] += 0.01 * np.sin(2 * np.pi * 40 * run.t)
    assert choose_band([run]).cutoff == choose_band([replace(run, q=shaking)]).cutoff == 5.0


def test_results_do_not_depend_on_the_number_of_threads(observed):
    first = LinkDynamicsIdentifier().fit(observed[1])
    again = LinkDynamicsIdentifier().fit(observed[1])
    np.testing.assert_array_equal(first.x_, again.x_)


def test_offset_and_friction_of_both_directions_do_not_cancel_each_other():
    """In motion they are one column; on gears that yield what is left at rest would blow them up without the prior."""
    robot = RobotModel.from_urdf(bundled_robot())
    arm = typical_arm(robot)
    runs = []
    for seed in (1, 6):
        plan = FourierExcitation(n_restarts=1, max_iter=20, random_state=seed).fit(robot).trajectory_
        rng = np.random.default_rng(seed)
        runs.append(arm.record(track(arm, plan, Tracking(), rng), 250.0, rng, f"run_{seed}"))
    coulomb = arm.friction[:, :2].mean(axis=1)
    worst = {}
    for prior in ("auto", None):
        links = LinkDynamicsIdentifier(prior=prior)
        identifier = ThreeLoopIdentifier(robot, links=links, friction_law="paper", residual=None).fit(runs)
        _, _, forwards, backwards = identifier.links_.own_.T[:4]
        worst[prior] = np.max(np.abs(forwards - backwards) / coulomb)
    assert worst["auto"] < 0.5, worst
    assert worst[None] > 5, worst


def test_columns_that_a_short_run_cannot_tell_apart_share_what_they_explain():
    """A run of seconds left friction's columns so alike that coefficients were beyond any arm's."""
    rng = np.random.default_rng(0)
    one, rest = rng.standard_normal((2, 50))
    columns = np.stack([one, one * (1 + 1e-9 * rest)], axis=1)
    target = 2 * one + 1e-3 * rng.standard_normal(50)
    R = np.linalg.qr(np.column_stack([columns, target]), mode="r")
    plan = SimpleNamespace(own=np.ones((1, 2), dtype=bool), n_own=2, pivots=np.empty(0, dtype=int))
    observations = SimpleNamespace(plan=plan, factors=lambda: [R], n_counted=np.array([50]))
    own, left = own_beside(observations, np.empty(0), np.ones(1))
    assert_allclose(own[0], [1, 1], atol=1e-3)
    assert left[0] < 2e-3
