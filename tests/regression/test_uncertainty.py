"""Intervals: they hold the truth as often as they say, with white and with coloured noise."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from helpers.small_arm import URDF
from numpy.testing import assert_allclose
from threadpoolctl import threadpool_limits

from dynid_rs import Recording, RobotModel, _core
from dynid_rs.identification.friction import friction_effect
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.loops import declared_plan
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.columns import Block, Observations, observe
from dynid_rs.regression.uncertainty import NORMAL_95, _inverse, parameter_covariance
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.simulation import bundled_robot, simulate, typical_arm

N_RUNS = 200
N_WHOLE = int(os.environ.get("DYNID_COVERAGE_RUNS", "25"))
"""Whole identifications, more than a second each: 200 of them are an experiment, not a test."""


@pytest.fixture(scope="module")
def experiment():
    """Rigid six-axis arm, three runs of 20 s without noise: plan, observations, true unknowns, noise level."""
    robot = RobotModel.from_urdf(bundled_robot())
    arm = replace(typical_arm(robot, noise=1.0).rigid(), delay=0.0)
    quiet = replace(arm, noise_std=np.zeros(6), link_resolution=np.zeros(6), motor_resolution=np.zeros(6))
    recordings = simulate(quiet, n_runs=3, duration=20.0, rate=250.0, seed=1, derivatives=True).recordings
    runs = [prepare(recording, Band(5.0), 250.0) for recording in recordings]
    shape = friction_effect(np.array(arm.velocity_threshold), np.array(arm.transition_width))
    plan = declared_plan(robot, shape)
    return plan, runs, observe(plan, runs), true_unknowns(plan, arm), np.asarray(arm.noise_std)


def true_unknowns(plan, arm):
    """Base parameters with the rotors that are in them, then the joints' own coefficients."""
    base = plan.robot.base_parameters().project(arm.phi)
    for (j, column), share in plan.absorbed.items():
        base = base + share * (arm.rotor_inertia[j] if column == 0 else arm.torque_offset[j])
    own = np.column_stack([arm.rotor_inertia, arm.torque_offset, arm.friction])
    return np.concatenate([base, own.ravel()])


def with_noise(plan, runs, observations, noise):
    rows = observations.rows_with([states.in_band(states.tau + e) for states, e in zip(runs, noise, strict=True)])
    factored = [Block(k, joints, [_core.triangular_factor(x) for x in joints]) for k, joints in enumerate(rows)]
    return Observations(plan, factored)


def coverage(experiment, draw, prior=None, n_runs=N_RUNS):
    """Share of 95 % intervals that hold the truth: base parameters, own coefficients."""
    plan, runs, observations, truth, _ = experiment
    used = plan.estimable()
    inside = []
    with threadpool_limits(1):
        for _ in range(n_runs):
            noisy = with_noise(plan, runs, observations, [draw(states) for states in runs])
            links = LinkDynamicsIdentifier(prior=prior).fit(noisy)
            std = np.sqrt(np.diag(parameter_covariance(noisy, links, runs, fitted_widths=False)))
            inside.append((np.abs(links.x_ - truth) <= NORMAL_95 * std)[used])
    hits = np.mean(inside, axis=0)
    return hits[: plan.n_base].mean(), hits[plan.n_base :].mean()


def test_intervals_cover_under_white_noise(experiment):
    rng, std = np.random.default_rng(0), experiment[-1]
    for share in coverage(experiment, lambda states: rng.normal(size=states.tau.shape) * std):
        assert 0.93 <= share <= 0.97, share


def with_a_memory(experiment):
    """First-order noise with a memory of 0.2 s."""
    from scipy.signal import lfilter

    rng, std = np.random.default_rng(1), experiment[-1]

    def draw(states):
        pole = np.exp(-1 / (0.2 * states.rate))
        return lfilter([1 - pole], [1, -pole], rng.normal(size=(len(states.t) + 500, 6)), axis=0)[500:] * 20 * std

    return draw


def test_intervals_cover_under_noise_with_a_memory(experiment):
    for share in coverage(experiment, with_a_memory(experiment)):
        assert 0.92 <= share <= 0.98, share


def test_intervals_cover_under_the_weak_prior(experiment):
    """More often than they say: its centre may be the file, which is the truth here, and the noise is large."""
    for share in coverage(experiment, with_a_memory(experiment), prior="auto", n_runs=40):
        assert 0.92 <= share <= 0.998, share


def test_intervals_cover_the_whole_way(experiment):
    """Everything is fitted, friction's shape too; what is left is the choice of a threshold, which is not in them."""
    plan, runs, _, truth, std = experiment
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(N_WHOLE):
        recordings = [
            Recording(s.t, s.q, s.dq, s.ddq, s.tau + rng.normal(size=s.tau.shape) * std, name=s.name) for s in runs
        ]
        identifier = ThreeLoopIdentifier(plan.robot, friction_law="paper", residual=None).fit(recordings)
        covariance = parameter_covariance(identifier.observations_, identifier.links_, identifier.runs_)
        error = np.abs(identifier.links_.x_ - truth)
        inside.append((error <= NORMAL_95 * np.sqrt(np.diag(covariance)))[plan.estimable()])
    hits = np.mean(inside, axis=0)
    base, own = hits[: plan.n_base].mean(), hits[plan.n_base :].mean()
    print(f"{N_WHOLE} runs, everything fitted: {100 * base:.1f} % of base and {100 * own:.1f} % of own parameters")
    least_base, least_own = (0.93, 0.93) if N_WHOLE >= 200 else (0.92, 0.90)
    assert least_base <= base <= 0.99, hits
    assert least_own <= own <= 0.99, hits


def test_a_model_without_noise_is_exact(experiment):
    plan, _, observations, truth, _ = experiment
    links = LinkDynamicsIdentifier().fit(observations)
    assert np.max(np.abs(links.phi_base_ - truth[: plan.n_base])) <= 1e-8 * np.max(np.abs(truth[: plan.n_base]))


def test_the_whole_way_without_noise_recovers_base_parameters(tmp_path):
    robot = RobotModel.from_urdf(bundled_robot())
    arm = replace(typical_arm(robot, noise=0.0).rigid(), delay=0.0)
    recordings = simulate(arm, n_runs=3, duration=20.0, rate=250.0, seed=3, derivatives=True).recordings
    identifier = ThreeLoopIdentifier(robot, friction_law="paper").fit(recordings)
    plan = identifier.observations_.plan
    truth = true_unknowns(plan, arm)[: plan.n_base]
    assert np.max(np.abs(identifier.links_.phi_base_ - truth)) <= 1e-8 * np.max(np.abs(truth))


def test_a_column_that_no_row_holds_stays_zero_in_the_covariance():
    rows = np.random.default_rng(0).normal(size=(20, 3))
    rows[:, 1] = 0.0
    wanted = np.zeros((3, 3))
    wanted[np.ix_([0, 2], [0, 2])] = np.linalg.inv(rows[:, [0, 2]].T @ rows[:, [0, 2]])
    assert_allclose(_inverse(rows), wanted, rtol=0, atol=1e-12)


COULOMB = np.array([4.0, 3.0, 1.0])


def sines():
    """Two runs of three slow sines per joint: t (n,), then q, dq, ddq (n, 3)."""
    t = np.arange(0.0, 12.0, 0.005)
    for phases in np.random.default_rng(1).uniform(0, 2 * np.pi, (2, 3, 3)):
        w = 2 * np.pi * np.array([0.13, 0.31, 0.47])
        angle = t[:, None, None] * w + phases
        yield t, *(0.4 * np.sum(x, axis=2) for x in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))


def out_and_back():
    """All joints out and back in 6, 3 and 1.5 s, with pauses: t (n,), then q, dq, ddq (n, 3)."""
    parts = []
    for duration in (6.0, 3.0, 1.5):
        x = np.arange(0.0, 1.0, 0.005 / duration)
        out = 0.8 * x**3 * (10 - 15 * x + 6 * x**2)
        parts += [np.zeros(100), out, np.full(100, 0.8), 0.8 - out]
    q = np.concatenate([*parts, np.zeros(100)])[:, None] * [1.0, 0.9, 1.1] - 0.4
    dq = np.gradient(q, 0.005, axis=0)
    return np.arange(len(q)) * 0.005, q, dq, np.gradient(dq, 0.005, axis=0)


def measured(robot, motion, noise, name, gain=(1.0, 1.0, 1.0), unit="N*m"):
    """Recording of a motion with `noise` (n, 3) [N m]; rigid links, Coulomb and viscous friction."""
    t, q, dq, ddq = motion
    tau = robot.inverse_dynamics(q, dq, ddq, robot.phi) + COULOMB * np.tanh(dq / 0.02) + dq
    return Recording(t, q, tau=(tau + noise) / gain, name=name, torque_unit=unit)


def currents(robot, seed):
    """Recordings [A] of `sines` with noise of draw `seed`."""
    rng = np.random.default_rng(seed)
    for k, motion in enumerate(sines()):
        noise = rng.normal(size=motion[1].shape) * [1.0, 1.0, 0.5]
        yield measured(robot, motion, noise, f"run_{k}", (20.0, 15.0, 6.0), "A")


@pytest.mark.parametrize("prior", ["auto", "robot", None])
def test_intervals_cover_where_the_gains_of_currents_are_fitted(prior):
    """The links behind a joint whose gain is unknown are no better known than it."""
    robot = RobotModel.from_urdf_string(URDF)
    truth, inside, as_if_known = robot.base_parameters().project(robot.phi) / 20.0, [], []
    for seed in range(25):
        links = LinkDynamicsIdentifier(prior=prior)
        fit = ThreeLoopIdentifier(robot, links=links, friction_law="coulomb_viscous", residual=None)
        fit.fit(list(currents(robot, seed)))
        error = np.abs(fit.links_.phi_base_ - truth)
        for hits, known in ((inside, False), (as_if_known, True)):
            std = np.sqrt(np.diag(fit.parameter_covariance(gains_known=known)))[: len(truth)]
            hits.append((error <= NORMAL_95 * std)[std > 0])
    heaviest = 1  # the elbow's first moment, which its gravity tells but for the gain
    assert np.mean(as_if_known, axis=0)[heaviest] < 0.5
    assert np.mean(inside, axis=0).min() >= 0.8, np.mean(inside, axis=0)
    assert np.mean(inside) >= 0.93


@pytest.mark.parametrize(("prior", "noise"), [("auto", 0.3), (None, 1.0)])
def test_intervals_hold_what_a_friction_experiment_tells(prior, noise):
    """Coulomb's friction is off by as much as its intervals say; those of the runs alone are several times as wide."""
    robot, errors, told = RobotModel.from_urdf_string(URDF), [], []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        runs = [measured(robot, m, rng.normal(size=m[1].shape), f"run_{k}") for k, m in enumerate(sines())]
        slow = out_and_back()
        experiment = measured(robot, slow, noise * rng.normal(size=slow[1].shape), "slow")
        links = LinkDynamicsIdentifier(prior=prior)
        fit = ThreeLoopIdentifier(robot, links=links, friction_law="coulomb_viscous", residual=None)
        fit.fit(runs, experiment)
        plan = fit.observations_.plan
        names = [name for effect in plan.effects for name in effect.coefficient_names]
        at = [names.index("coulomb_pos"), names.index("coulomb_neg")]
        std = np.sqrt(np.diag(fit.parameter_covariance()))[plan.n_base :].reshape(3, -1)
        errors.append(fit.links_.own_[:, at] - COULOMB[:, None])
        told.append(std[:, at])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(told), axis=0))
    assert ratio.min() > 0.5, ratio
    assert ratio.max() < 1.6, ratio
