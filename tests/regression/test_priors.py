"""The weak prior: the algebra, the width that the evidence gives it, what it is good for; the robot file trusted."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import data
from helpers.small_arm import URDF, dynid, refusal, write_robot, write_runs
from robot_files import robot_files
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

from dynid_rs import RobotModel, UrdfError, _core, read_recording
from dynid_rs.base.memory import column_memory, inflation, residual_memory, returning
from dynid_rs.identification.friction import friction_effect
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.loops import declared_plan
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression import evidence
from dynid_rs.regression.columns import Block, Observations, make_plan, observe
from dynid_rs.regression.evidence import TRUSTED, WIDTHS, fit_with_prior, linear_model
from dynid_rs.regression.linear_model import Choice
from dynid_rs.regression.priors import CARRIES, LEAST_MASS, LENGTH, declares_inertia, link_spread, weak_prior
from dynid_rs.regression.uncertainty import NORMAL_95, parameter_covariance
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.simulation import bundled_robot, simulate, typical_arm


def spread_of(phi):
    """Standard deviation of the links' parameters at width one, written out once more."""
    spread = []
    for link in np.reshape(phi, (-1, 10)):
        m, length = max(link[0], 0.3), 0.15
        spread += [m / 2] + 3 * [m * length] + 6 * [m * length**2]
    return np.array(spread)


def arm_and_plan(robot):
    arm = replace(typical_arm(robot, noise=1.0).rigid(), delay=0.0)
    shape = friction_effect(np.array(arm.velocity_threshold), np.array(arm.transition_width))
    return arm, declared_plan(robot, shape)


def regrouping(robot):
    base = robot.base_parameters()
    return np.array([base.project(unit) for unit in np.eye(len(robot.phi))]).T


@pytest.fixture(scope="module")
def six_axes():
    """Rigid six-axis arm, short runs without noise: robot, arm, plan, states of four runs of 6 s."""
    robot = RobotModel.from_urdf(bundled_robot())
    arm, plan = arm_and_plan(robot)
    quiet = replace(arm, noise_std=np.zeros(6), link_resolution=np.zeros(6), motor_resolution=np.zeros(6))
    recordings = simulate(quiet, n_runs=4, duration=6.0, rate=250.0, seed=5, derivatives=True).recordings
    return robot, arm, plan, [prepare(recording, Band(5.0), 250.0) for recording in recordings]


def observed(plan, runs, dphi, noise, rng):
    """Observations of an arm whose links differ by `dphi` from the file, with white noise; one block per run."""
    torque = [
        states.tau
        + plan.robot.inverse_dynamics(states.q, states.dq, states.ddq, dphi)
        + rng.normal(size=states.tau.shape) * noise
        for states in runs
    ]
    return observe(plan, runs, torque)


def true_unknowns(plan, arm, phi):
    base = plan.robot.base_parameters().project(phi)
    for (j, column), share in plan.absorbed.items():
        base = base + share * (arm.rotor_inertia[j] if column == 0 else arm.torque_offset[j])
    return np.concatenate([base, np.column_stack([arm.rotor_inertia, arm.torque_offset, arm.friction]).ravel()])


def torque_error(observations, x):
    """RMS per joint of what x leaves on runs without noise."""
    plan = observations.plan
    left = [
        np.concatenate([b.rows[j][:, -1] - b.rows[j][:, :-1] @ x[plan.unknowns(j)] for b in observations.blocks])
        for j in range(plan.robot.n_joints)
    ]
    return np.sqrt(np.mean(np.square(left), axis=1))


# --- algebra ---------------------------------------------------------------------------------------------------------


def sizes_of(observations):
    """RMS of every joint's torque, and of its own columns (n_joints, n_own)."""
    plan, rows = observations.plan, range(observations.plan.robot.n_joints)
    joints = [np.concatenate([block.rows[j] for block in observations.blocks]) for j in rows]
    own = np.array([np.sqrt(np.mean(joint[:, : plan.n_own] ** 2, axis=0)) for joint in joints])
    return np.array([np.sqrt(np.mean(joint[:, -1] ** 2)) for joint in joints]), own


def names_of(plan):
    return [name for effect in plan.effects for name in effect.coefficient_names]


def brute_force(observations, choice, unit=1.0):
    """Covariance and mean of all unknowns, K D K' written out: links, rotors and offsets regrouped, friction beside."""
    plan = observations.plan
    robot, n, n_base, n_own = plan.robot, plan.robot.n_joints, plan.n_base, plan.n_own
    torque, own = sizes_of(observations)
    K = np.zeros((plan.n_columns, 10 * n))
    K[:n_base] = regrouping(robot)
    covariance = K @ np.diag((choice.width * unit * spread_of(robot.phi)) ** 2) @ K.T
    mean = K @ robot.phi * choice.centre * unit
    for j in range(n):
        for column, (name, usual) in enumerate((("rotor_inertia", 1.0), ("torque_offset", 0.3))):
            assert names_of(plan)[column] == name
            direction = np.zeros(plan.n_columns)
            direction[:n_base] = plan.absorbed.get((j, column), np.zeros(n_base))
            direction[n_base + j * n_own + column] = plan.own[j, column]
            std = usual * torque[j] / own[j, column]
            if name == "rotor_inertia":
                std = max(std, robot.rotor_inertia[j] / 2)
                mean += direction * robot.rotor_inertia[j] * choice.centre * unit
            covariance += np.outer(direction, direction) * std**2
        for column in range(2, n_own, 2):  # friction: two directions of each order
            name = names_of(plan)[column]
            both = torque[j] / np.hypot(*own[j, [column, column + 1]])
            usual = 1.0 if name in ("coulomb_pos", "viscous1_pos") else choice.bends
            pair = n_base + j * n_own + np.array([column, column + 1])
            shared, apart = np.ones((2, 2)), np.array([[1.0, -1.0], [-1.0, 1.0]])
            covariance[np.ix_(pair, pair)] += (usual * both) ** 2 * shared + (choice.bends * both) ** 2 * apart
    return covariance, mean


@pytest.fixture(scope="module")
def small():
    """Observations of the small arm, its robot file with rotors."""
    robot = RobotModel.from_urdf_string(URDF, rotor_inertia=[2.0, 0.3, 0.1])
    arm, plan = arm_and_plan(robot)
    recording = simulate(arm, n_runs=1, duration=4.0, rate=100.0, seed=2, derivatives=True).recordings[0]
    return observe(plan, [prepare(recording, Band(5.0), 100.0)])


CHOICES = [Choice(0.3, 1.0, 0.2), Choice(10.0, 0.0, 0.01)]


@pytest.mark.parametrize("unit", [1.0, 0.05])
@pytest.mark.parametrize("choice", CHOICES)
def test_the_prior_is_the_regrouped_covariance_of_what_it_says(small, choice, unit):
    prior = weak_prior(small.plan, small.factors(), small.n_rows).in_unit(unit)
    rows, log_det = prior.rows(choice)
    covariance, mean = brute_force(small, choice, unit)
    used = small.plan.estimable()
    assert np.array_equal(prior.used, used)
    assert np.all(rows[:, :-1][:, ~used] == 0)
    covariance, precision = covariance[np.ix_(used, used)], rows[:, :-1].T @ rows[:, :-1]
    scale = np.sqrt(np.diag(covariance))
    product = (precision[np.ix_(used, used)] * np.outer(scale, scale)) @ (covariance / np.outer(scale, scale))
    np.testing.assert_allclose(product, np.eye(used.sum()), atol=1e-6)
    np.testing.assert_allclose(rows[:, -1], rows[:, :-1] @ mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(prior.std(choice)[used], scale, rtol=1e-8)
    assert log_det == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-8)
    assert prior.size == len(used)


def test_every_unknown_that_is_told_apart_has_a_prior(six_axes):
    _, _, plan, runs = six_axes
    observations = observe(plan, runs[:1])
    prior = weak_prior(plan, observations.factors(), observations.n_rows)
    rows, _ = prior.rows(Choice())
    assert len(rows) == plan.estimable().sum()
    assert np.all(prior.std(Choice())[plan.estimable()] > 0)


def test_friction_s_directions_are_alike_beforehand_as_far_as_it_bends(small):
    """Correlation (1 - b^2) / (1 + b^2) between the two, for Coulomb's and viscous torque."""
    plan, names = small.plan, names_of(small.plan)
    prior = weak_prior(plan, small.factors(), small.n_rows)
    for bends in (0.01, 0.05, 0.2):
        rows, _ = prior.rows(Choice(bends=bends))
        for name in ("coulomb", "viscous1"):
            pair = plan.n_base + np.array([names.index(f"{name}_pos"), names.index(f"{name}_neg")])
            precision = rows[:, pair].T @ rows[:, pair]
            covariance = np.linalg.inv(precision)
            correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
            assert correlation == pytest.approx((1 - bends**2) / (1 + bends**2), rel=1e-9)
    # Higher orders are as small as the bends themselves, in the torque that they make.
    torque, own = sizes_of(small)
    third = names.index("viscous3_pos")
    usual = prior.std(Choice(bends=0.05))[plan.n_base + third] * np.hypot(*own[0, [third, third + 1]]) / torque[0]
    assert usual == pytest.approx(0.05 * np.sqrt(2))


def test_a_link_that_the_file_says_nothing_of_has_the_least_mass(small):
    start = URDF.index('<link name="fore"><inertial>')
    end = URDF.index("</inertial>", start) + len("</inertial>")
    robot = RobotModel.from_urdf_string(URDF[:start] + '<link name="fore">' + URDF[end:])
    assert np.all(np.asarray(robot.phi)[10:20] == 0)
    spread = link_spread(np.asarray(robot.phi))[10:20]
    np.testing.assert_allclose(spread, LEAST_MASS * np.array([0.5, *[LENGTH] * 3, *[LENGTH**2] * 6]))
    fitted = LinkDynamicsIdentifier().fit(replace(small, plan=replace(small.plan, robot=robot)))
    assert fitted.posterior_ is not None


def test_links_weigh_more_towards_the_base_as_arms_do():
    """Where nothing is declared of any; the ratio is that of the arms which others have declared."""
    ratios, seen = [], set()
    for path in robot_files().values():
        try:
            mass = np.asarray(RobotModel.from_urdf(str(path)).phi)[::10]
        except UrdfError:
            continue
        is_arm = 5 <= len(mass) <= 7 and np.all(mass > 0) and len(np.unique(mass)) > len(mass) / 2
        if is_arm and tuple(mass.round(3)) not in seen:
            seen.add(tuple(mass.round(3)))
            ratios.append(-np.polyfit(np.arange(len(mass)), np.log(mass), 1)[0])
    assert len(ratios) >= 10
    assert np.exp(np.mean(ratios)) == pytest.approx(CARRIES, abs=0.1)
    mass = 2 * link_spread(np.zeros(60))[::10]
    np.testing.assert_allclose(mass, LEAST_MASS * CARRIES ** np.arange(5.0, -1.0, -1.0))


def test_the_evidence_is_the_normal_density_of_the_data(small):
    """Of every row as it is, at fixed memory and noise; up to one constant for all widths, centres and bends."""
    plan, n_rows, factors = small.plan, small.n_rows, small.factors()
    prior = weak_prior(plan, factors, n_rows)
    torque, _ = sizes_of(small)
    noise = 3.0 * torque  # no noise is smaller than the least, so it stays
    model = linear_model(plan, factors, n_rows, np.ones(3), prior, np.full(3, float(n_rows)), noise)
    rows = [np.concatenate([b.rows[j] for b in small.blocks]) for j in range(3)]
    C = np.zeros((3 * n_rows, plan.n_columns))
    for j in range(3):
        C[j * n_rows : (j + 1) * n_rows, plan.unknowns(j)] = rows[j][:, :-1]
    C[:, ~plan.estimable()] = 0.0
    tau = np.concatenate([r[:, -1] for r in rows])
    difference = []
    for choice in (*CHOICES, Choice(1.0, 1.0, 0.05), Choice(100.0, 0.0, 0.05)):
        fit = model.fit(choice, noise)
        np.testing.assert_array_equal(fit.noise, noise)
        covariance, mean = brute_force(small, choice)
        total = C @ covariance @ C.T + np.diag(np.repeat(noise**2, n_rows))
        root = np.linalg.cholesky(total)
        distance = np.sum(np.linalg.solve(root, tau - C @ mean) ** 2)
        difference.append(fit.evidence + distance / 2 + np.sum(np.log(np.diag(root))))
    assert np.ptp(difference) <= 1e-5, difference


def test_width_and_centre_are_those_of_the_greatest_evidence(small):
    """With everything else as the fit has it."""
    found = fit_with_prior(small)
    plan, factors = small.plan, small.factors()
    least = 1e-6 * sizes_of(small)[0]
    model = linear_model(plan, factors, small.n_rows, np.ones(3), found.prior, found.n_effective, least)
    evidence = {
        (w, c): model.fit(found.choice._replace(width=w, centre=c), found.noise_std).evidence
        for w in WIDTHS
        for c in (0.0, 1.0)
    }
    assert max(evidence, key=evidence.get) == (found.choice.width, found.choice.centre)
    assert found.evidence == pytest.approx(evidence[found.choice.width, found.choice.centre], abs=0.1)
    assert found.converged


def test_rows_count_as_the_independent_samples_they_are_worth():
    rng = np.random.default_rng(0)
    n, pole = 20000, 0.8
    white = rng.normal(size=n)
    red = np.zeros(n)
    for k in range(1, n):
        red[k] = pole * red[k - 1] + white[k]
    columns = np.column_stack([np.ones(n), np.sin(np.arange(n) * 0.05), np.cos(np.arange(n) * 0.3)])
    memory = column_memory([columns])
    assert inflation([white], memory) == pytest.approx(1.0, abs=0.1)
    # the spectrum of first-order noise over its variance, at the columns' three frequencies
    spectrum = [(1 - pole**2) / (1 + pole**2 - 2 * pole * np.cos(w)) for w in (0.0, 0.05, 0.3)]
    assert inflation([red], memory) == pytest.approx(np.mean(spectrum), rel=0.15)


def test_a_residual_counts_as_the_independent_samples_it_is_worth():
    """First-order noise: 1 + 2 sum rho = (1 + a) / (1 - a), less what lies below the weakest correlation."""
    rng = np.random.default_rng(0)
    pole = 0.8
    runs = [lfilter([1.0], [1.0, -pole], rng.normal(size=20000)) for _ in range(3)]
    assert residual_memory(runs) == pytest.approx((1 + pole) / (1 - pole), rel=0.1)
    assert residual_memory([rng.normal(size=20000)]) == pytest.approx(1.0, abs=0.05)
    assert residual_memory([np.zeros(10)]) == 1.0


@pytest.mark.parametrize(("share", "rho"), [(1.0, 1.0), (0.5, 0.5), (0.0, 0.0)])
def test_what_returns_with_a_motion_is_said_once(share, rho):
    """Of four times round: all of a misfit is there again, and nothing of noise."""
    rng = np.random.default_rng(1)
    phase = np.tile(np.arange(3000), 4)
    misfit, noise = rng.normal(size=3000)[phase], rng.normal(size=12000)
    residual = np.sqrt(share) * misfit + np.sqrt(1 - share) * noise
    assert returning(residual, phase) == pytest.approx(1 + 3 * rho, abs=0.1)
    assert returning(residual, np.arange(12000)) == 1.0
    assert returning(np.zeros(12000), phase) == 1.0


# --- what it is good for ---------------------------------------------------------------------------------------------


def test_a_short_run_gains_from_the_prior_and_its_intervals_hold(six_axes):
    """Arms that differ from their file by a fifth: left-out error against no prior, and coverage."""
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(1)
    used, inside, ratios, spreads = plan.estimable(), [], [], []
    with threadpool_limits(1):
        for _ in range(25):
            dphi = 0.2 * spread_of(robot.phi) * rng.normal(size=len(robot.phi))
            noise = np.asarray(arm.noise_std)
            lone = observed(plan, runs[:1], dphi, noise, rng)
            left_out = observed(plan, runs[3:], dphi, 0 * noise, rng)
            fitted = LinkDynamicsIdentifier().fit(lone)
            without = LinkDynamicsIdentifier(prior=None).fit(lone)
            ratios.append(torque_error(left_out, fitted.x_) / torque_error(left_out, without.x_))
            spreads.append(fitted.posterior_.choice.width)
            std = np.sqrt(np.diag(parameter_covariance(lone, fitted, runs[:1], fitted_widths=False)))
            truth = true_unknowns(plan, arm, robot.phi + dphi)
            inside.append((np.abs(fitted.x_ - truth) <= NORMAL_95 * std)[used])
    ratios = np.array(ratios)
    hits = np.mean(inside, axis=0)
    mean, better = np.exp(np.mean(np.log(ratios))), np.mean(np.mean(np.log(ratios), axis=1) < 0)
    base, own = hits[: plan.n_base].mean(), hits[plan.n_base :].mean()
    print(f"left-out error with over without: {mean:.3f}, better {better:.2f}, coverage {base:.3f} {own:.3f}")
    print(f"width, truth 0.2: {np.percentile(spreads, [10, 50, 90]).round(3)}")
    assert mean <= 0.85
    assert better >= 0.9
    assert 0.92 <= base <= 0.995  # the least width is wider than these arms' files are wrong
    assert own >= 0.90
    assert 0.3 <= np.median(spreads) <= 1.0


@pytest.fixture(scope="module")
def rich(six_axes):
    """Two minutes of the same arm, links off by a tenth: observations, true torque on another run."""
    robot, arm, plan, _ = six_axes
    quiet = replace(arm, noise_std=np.zeros(6), link_resolution=np.zeros(6), motor_resolution=np.zeros(6))
    recordings = simulate(quiet, n_runs=5, duration=30.0, rate=250.0, seed=9, derivatives=True).recordings
    runs = [prepare(recording, Band(5.0), 250.0) for recording in recordings]
    rng = np.random.default_rng(4)
    dphi = 0.1 * spread_of(robot.phi) * rng.normal(size=len(robot.phi))
    noise = np.asarray(arm.noise_std)
    return observed(plan, runs[:4], dphi, noise, rng), observed(plan, runs[4:], dphi, 0 * noise, rng)


def test_with_rich_data_the_prior_hardly_matters(rich):
    observations, left_out = rich
    with threadpool_limits(1):
        best = fit_with_prior(observations)
        held = [best, *(replace(best, choice=best.choice._replace(width=w)) for w in WIDTHS)]
        errors = [torque_error(left_out, fit_with_prior(observations, held=posterior).x) for posterior in held]
        without = torque_error(left_out, LinkDynamicsIdentifier(prior=None).fit(observations).x_)
    std = np.sqrt(np.mean([np.concatenate([b.rows[j][:, -1] for b in left_out.blocks]) ** 2 for j in range(6)], axis=1))
    for error in (*errors, without):
        assert np.all(error <= 0.01 * std), error / std
        assert np.all(errors[0] <= error + 0.002 * std)


def test_a_wrong_file_is_overruled_by_rich_data(rich):
    observations, left_out = rich
    robot = observations.plan.robot
    text = Path(bundled_robot()).read_text(encoding="utf-8")
    heavy = re.sub(r'<mass value="([^"]+)"', lambda m: f'<mass value="{8 * float(m[1])!r}"', text)
    wrong = RobotModel.from_urdf_string(heavy)
    assert np.allclose(np.asarray(wrong.phi)[::10], 8 * np.asarray(robot.phi)[::10])
    believed = replace(observations, plan=replace(observations.plan, robot=wrong))
    std = np.sqrt(np.mean([np.concatenate([b.rows[j][:, -1] for b in left_out.blocks]) ** 2 for j in range(6)], axis=1))
    with threadpool_limits(1):
        fitted, trusted = fit_with_prior(believed), fit_with_prior(believed, trusted=True)
    assert fitted.choice.centre == 0.0  # the file is no centre
    assert np.all(torque_error(left_out, fitted.x) <= 0.01 * std)
    # Where the user trusts it, it is the centre whatever the data say, and as wide as trust goes.
    assert (trusted.choice.width, trusted.choice.centre) == (max(TRUSTED), 1.0)


def test_a_trusted_file_is_the_centre_and_narrow(six_axes):
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(2)
    dphi = 0.02 * spread_of(robot.phi) * rng.normal(size=len(robot.phi))
    lone = observed(plan, runs[:1], dphi, np.asarray(arm.noise_std), rng)
    robots = LinkDynamicsIdentifier(prior="robot").fit(lone).posterior_
    assert robots.choice.centre == 1.0
    assert robots.choice.width in TRUSTED
    assert robots.choice.width < min(WIDTHS)
    assert robots.relative_uncertainty == robots.choice.width / 2


def test_in_ampere_the_gain_of_the_prior_is_found(six_axes):
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(6)
    dphi = 0.1 * spread_of(robot.phi) * rng.normal(size=len(robot.phi))
    in_torque = observed(plan, runs[:3], dphi, np.asarray(arm.noise_std), rng)
    gain = 0.08
    blocks = [
        Block(
            b.run,
            rows := [np.column_stack([r[:, :-1], gain * r[:, -1]]) for r in b.rows],
            [_core.triangular_factor(r) for r in rows],
        )
        for b in in_torque.blocks
    ]
    with threadpool_limits(1):
        known = fit_with_prior(in_torque)
        found = fit_with_prior(Observations(plan, blocks), unknown_gain=True)
    assert found.prior.unit == pytest.approx(gain, rel=0.1)
    assert found.choice == known.choice
    np.testing.assert_allclose(found.x / gain, known.x, atol=0.01 * np.abs(known.x).max())
    np.testing.assert_allclose(found.noise_std / gain, known.noise_std, rtol=0.01)


def test_a_column_on_joints_that_it_does_not_act_on_takes_nothing_off_the_unit(six_axes):
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(8)
    spring = _core.Effect.of("joint_spring", rest_position=np.zeros(6))
    with_spring = make_plan(robot, [*plan.effects, spring], acts_on={len(plan.effects): [5]})
    factors = observed(with_spring, runs[:1], 0 * robot.phi, np.asarray(arm.noise_std), rng).factors()
    gravity = [_core.triangular_factor(_in_place_of(R, plan.n_own, R[:, -1])) for R in factors[:5]] + factors[5:]
    unit = evidence._unit(with_spring, factors, np.ones(6))
    assert unit == pytest.approx(1.0, rel=0.05)
    assert evidence._unit(with_spring, gravity, np.ones(6)) == pytest.approx(unit, rel=1e-9)


def _in_place_of(rows, k, column):
    rows = rows.copy()
    rows[:, k] = column
    return rows


def test_drive_gains_far_from_each_other_are_found(six_axes):
    """Joints' torque per ampere differ by a factor of ten: relative gains and the unit come with everything else."""
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(6)
    in_torque = observed(plan, runs[:3], 0 * robot.phi, np.asarray(arm.noise_std), rng)
    per_torque = 0.05 * np.array([1.0, 1.5, 3.0, 10.0, 0.5, 2.0])
    blocks = [
        Block(
            b.run,
            rows := [np.column_stack([r[:, :-1], k * r[:, -1]]) for r, k in zip(b.rows, per_torque, strict=True)],
            [_core.triangular_factor(r) for r in rows],
        )
        for b in in_torque.blocks
    ]
    in_ampere = Observations(plan, blocks)
    with threadpool_limits(1):
        begin = LinkDynamicsIdentifier(prior=None).fit(in_ampere, fit_scale=True).torque_scale_
        links = LinkDynamicsIdentifier().fit(in_ampere, fit_scale=True, scale=begin)
    # The wrist's last joints carry next to nothing: their gain is not told from their inertia.
    np.testing.assert_allclose(links.torque_scale_[:4], per_torque[:4] / per_torque[0], rtol=0.05)
    assert links.posterior_.prior.unit == pytest.approx(per_torque[0], rel=0.2)


def test_gains_that_agree_with_each_other_do_not_hold_the_first_off(six_axes, monkeypatch):
    """Begun twenty times off, joints behind an upright first axis settle among themselves; its noise would hide it."""
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(6)
    in_torque = observed(plan, runs[:3], 0 * robot.phi, np.asarray(arm.noise_std), rng)
    begin = np.array([1.0, 20.0, 20.0, 20.0, 20.0, 20.0])

    def fitted():
        with threadpool_limits(1):
            return fit_with_prior(in_torque, free=np.arange(6) > 0, unknown_gain=True, scale=begin)

    found = fitted()
    np.testing.assert_allclose(found.scale[:4], 1.0, rtol=0.1)
    monkeypatch.setattr(evidence, "COMMON", (1.0,))
    assert fitted().evidence < found.evidence - 100


def test_no_step_on_the_gains_makes_them_less_likely(six_axes):
    """Forty rows tell hardly more gains than links: towards the most probable pair of both the evidence falls."""
    robot, arm, plan, runs = six_axes
    in_torque = observed(plan, runs[:1], 0 * robot.phi, np.asarray(arm.noise_std), np.random.default_rng(3))
    rows = [part[:40] for part in in_torque.joint_rows()]
    factors = [_core.triangular_factor(part) for part in rows]
    free, scale = np.arange(6) > 0, np.array([1.0, *[0.3] * 5])
    prior, noise = weak_prior(plan, factors, 40, scale), np.asarray(arm.noise_std)
    first = linear_model(plan, factors, 40, scale, prior, np.full(6, 8.0), 1e-9 * noise).fit(Choice(1.0, 1.0), noise)

    def steps(step):
        best, gains, values = first, scale, []
        for _ in range(6):
            values.append(best.evidence + evidence._of_gains(gains))
            best, gains = step(best, gains)
        return np.array(values)

    def whole(best, gains):
        improved = evidence._improved(best, plan.n_base, gains, free)
        return evidence._at_gains(best.model, plan.n_base, improved / gains).fit(best.choice, best.noise), improved

    with threadpool_limits(1):
        chosen, unasked = steps(lambda best, gains: evidence._with_gains(best, plan.n_base, gains, free)), steps(whole)
    assert np.diff(unasked).min() < -1
    assert np.all(np.diff(chosen) >= 0)
    assert chosen[-1] > max(chosen[0], unasked[-1]) + 1


def test_gains_of_an_earlier_fit_stay_and_so_does_its_unit(six_axes):
    robot, arm, plan, runs = six_axes
    in_torque = observed(plan, runs[:2], 0 * robot.phi, np.asarray(arm.noise_std), np.random.default_rng(6))
    links = {"fit_scale": True, "scale": np.array([1.0, 1.2, 0.8, 1.1, 0.9, 1.0])}
    with threadpool_limits(1):
        first = LinkDynamicsIdentifier().fit(in_torque, **links)
        of = replace(first.posterior_, scale=2.0 ** np.arange(6), prior=first.posterior_.prior.in_unit(0.7))
        held = LinkDynamicsIdentifier(gains_of=of).fit(in_torque, **links)
        again = LinkDynamicsIdentifier(gains_of=of).fit(in_torque, **links).fit(in_torque, again=True, **links)
    for found in (held, again):
        np.testing.assert_array_equal(found.torque_scale_, of.scale)
        assert found.posterior_.prior.unit == 0.7
    assert first.posterior_.evidence > held.posterior_.evidence


def test_without_declared_inertials_there_is_no_centre(six_axes):
    robot, _, _, runs = six_axes
    bare = RobotModel.from_urdf_string(
        re.sub(r"<inertial>.*?</inertial>", "", Path(bundled_robot()).read_text(encoding="utf-8"), flags=re.S)
    )
    assert not np.any(bare.phi)
    assert not declares_inertia(bare)
    _, plan = arm_and_plan(robot)
    observations = observe(replace(plan, robot=bare), runs[:1])
    for prior in ("auto", "robot"):
        posterior = LinkDynamicsIdentifier(prior=prior).fit(observations).posterior_
        assert posterior.choice.centre == 0.0
        assert not np.any(posterior.pull[:, -1])


@pytest.mark.parametrize("n_runs", [1, 2])
def test_every_fit_has_the_weak_prior_but_those_that_leave_it_out(six_axes, n_runs):
    _, _, plan, runs = six_axes
    observations = observe(plan, runs[:n_runs])
    assert LinkDynamicsIdentifier().fit(observations).posterior_ is not None
    assert LinkDynamicsIdentifier(prior=None).fit(observations).posterior_ is None
    # Without weights, or with a ridge, there is nothing that a prior could be weighed against.
    assert LinkDynamicsIdentifier(None).fit(observations).posterior_ is None
    assert LinkDynamicsIdentifier(ridge=1e-3).fit(observations).posterior_ is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"prior": "cad"}, "prior must be"),
        ({"prior": "robot", "weighting": None}, "weighed against the noise"),
        ({"prior": "robot", "ridge": 0.1}, "replaces the ridge"),
    ],
)
def test_priors_that_make_no_sense_are_refused(six_axes, arguments, words):
    _, _, plan, runs = six_axes
    with pytest.raises(ValueError, match=words):
        LinkDynamicsIdentifier(**arguments).fit(observe(plan, runs[:1]))


def test_full_covariance_goes_with_a_prior(six_axes):
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(3)
    noise = np.asarray(arm.noise_std)
    lone = observed(plan, runs[:1], 0.1 * spread_of(robot.phi) * rng.normal(size=len(robot.phi)), noise, rng)
    full, simple = (LinkDynamicsIdentifier(w, prior="robot").fit(lone) for w in ("full_covariance", "joint_variance"))
    std = np.sqrt(np.diag(parameter_covariance(lone, full, runs[:1], fitted_widths=False)))
    shift = np.abs(full.x_ - simple.x_)[std > 0] / std[std > 0]
    assert shift.max() < 1


# --- the command -----------------------------------------------------------------------------------------------------


def test_the_command_says_which_prior_and_weight_it_used(tmp_path):
    import jsonschema

    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    printed = dynid("identify", robot, runs[0], "--test", runs[2], "--prior", "robot", "-o", tmp_path / "out")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    jsonschema.validate(result, json.loads((data.ROOT / "docs" / "reference" / "result.schema.json").read_text()))
    prior = result["prior"]
    assert prior["kind"] == "robot"
    assert 0 < prior["relative_uncertainty"]["links"] < 1  # the file is the truth here
    assert prior["relative_uncertainty"]["rotors"] is None
    # Of links, not of friction, whose coefficients no robot file knows.
    assert 0 < prior["n_determined"] <= prior["n_directions"] == result["base_parameters"]["n_base"]
    assert all(n <= prior["n_rows"] for n in prior["n_effective"])
    for entry in prior["moved"]:
        assert entry["shift"] == pytest.approx((entry["value"] - entry["declared"]) / entry["std"])
    words = " ".join(printed.stdout.split())
    assert re.search(r"by the evidence they are wrong by about [\d.]+ %\. Of \d+ combinations of them", words)
    assert "masses and inertias of the robot file decide" in (tmp_path / "out" / "report.html").read_text()
    assert dynid("report", tmp_path / "out").exit_code == 0
    dynid("identify", robot, runs[0], "--test", runs[2], "--prior", "none", "-o", tmp_path / "none")
    assert json.loads((tmp_path / "none" / "result.json").read_text())["prior"] is None


def test_rotors_of_the_config_are_declared(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    config = tmp_path / "dynid.toml"
    config.write_text("[motor]\nrotor_inertia = [0.4, 0.3, 0.1]\n")
    dynid("identify", robot, runs[0], "--test", runs[2], "--prior", "robot", "--config", config, "-o", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "result.json").read_text())["prior"]["kind"] == "robot"
    model = json.loads((tmp_path / "out" / "model.json").read_text())
    assert "0.4" in json.dumps(model)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("rotor_inertia = [1.0, 2.0]", "must be one number or 3"),
        ("rotor_inertia = -1.0", "at least 0"),
        ("inertia = 1.0", "not known"),
        ("rotor_inertia = 'big'", "must be a number"),
    ],
)
def test_rotors_that_make_no_sense_are_refused(tmp_path, line, words):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=1)
    config = tmp_path / "dynid.toml"
    config.write_text(f"[motor]\n{line}\n")
    sentence = refusal(dynid("identify", robot, *runs, "--config", config, "-o", tmp_path / "out"))
    assert words in sentence
    assert "[motor]" in sentence
    assert not (tmp_path / "out").exists()


def test_an_unknown_prior_is_refused(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=1)
    assert "--prior must be auto, robot or none" in refusal(
        dynid("identify", robot, *runs, "--prior", "cad", "-o", tmp_path / "out")
    )


# --- the KUKA with its hydraulic counterbalance ----------------------------------------------------------------------

KUKA_GEAR = np.array([1798 / 7, 1872 / 7, 757 / 3, 221, 5032 / 21, 206793 / 1340])
KUKA_ROTOR = np.array([0.00923, 0.0118, 0.0118, 0.00173, 0.00173, 0.00173])
"""Rotors [kg m^2] of the authors' model, before the gears."""
AXIS_2 = 1


def authors_counterbalance(q):
    """Torque [N m] of the authors' hydraulic counterbalance, as their README writes it."""
    D, k, Z, R, T = 0.8, 0.2, 1.01, 296.8, 328.0
    area = np.pi / 4 * (0.055**2 - 0.030**2)
    m, V = 2 * 0.0795, 2 * 0.48e-3
    delta = q + np.deg2rad(95)
    dl = np.sqrt(D**2 + k**2 - 2 * D * k * np.cos(delta)) - (D - k)
    h = D * k * np.sin(delta) / (dl + D - k)
    return h * area * Z * R * T * m / (V - dl * area)


def kuka_terms():
    """The same as a term of the catalogue: cos(q + phase) = -cos(q + 95 deg), gas length V / A, coefficient Z R T m."""
    area = np.pi / 4 * (0.055**2 - 0.030**2)
    shape = {"a": 0.8, "b": 0.2, "phase": np.deg2rad(95) - np.pi, "gas_length": 2 * 0.48e-3 / area}
    return shape, 1.01 * 296.8 * 328.0 * 2 * 0.0795


@pytest.fixture(scope="module")
def kuka(tmp_path_factory):
    """result.json of `dynid identify` with a prior or none, the counterbalance known, and what was printed."""
    folder = tmp_path_factory.mktemp("kuka")
    shape, coefficient = kuka_terms()
    lines = [f"{name} = {float(value)!r}" for name, value in {**shape, "counterbalance": coefficient}.items()]
    (folder / "terms.toml").write_text(
        "\n".join(["[[term]]", 'kind = "counterbalance"', f"joint = {AXIS_2}", *lines, ""])
    )
    (folder / "dynid.toml").write_text(f"[motor]\nrotor_inertia = {(KUKA_ROTOR * KUKA_GEAR**2).tolist()}\n")
    files = [data.data_file("kuka_kr300_weigand", name) for name in ("robot.urdf", "traj_A.parquet", "traj_B.parquet")]
    results = {}
    for prior in ("robot", "none"):
        printed = dynid(
            "identify", files[0], files[1], "--test", files[2], "--prior", prior, "--known", folder / "terms.toml",
            "--config", folder / "dynid.toml", "-o", folder / prior,
        )  # fmt: skip
        results[prior] = json.loads((folder / prior / "result.json").read_text()), printed.stdout, folder / prior
    return results


def test_the_term_is_the_authors_formula():
    shape, coefficient = kuka_terms()
    q = np.linspace(-2.3, 0.3, 200)[:, None]
    effect = _core.Effect.of("counterbalance", **{name: [value] for name, value in shape.items()})
    tau = _core.effect_torque(effect, [[coefficient]], q, 0 * q, 0 * q)
    np.testing.assert_allclose(tau[:, 0], authors_counterbalance(q[:, 0]), rtol=1e-10, atol=1e-8)
    assert np.ptp(tau) > 4000


def test_with_the_prior_the_counterbalance_takes_axis_2_from_above_80_to_below_35_percent(kuka):
    result = kuka["robot"][0]
    (entry,) = result["known"]
    std = result["rmse"]["test"]["torque_std"][AXIS_2]
    errors = {key: value / std for key, value in entry["rmse_test_with_prior"].items()}
    print(errors, result["prior"]["relative_uncertainty"])
    assert errors["without_same_weight"] > 0.8
    assert errors["with"] < 0.35
    assert result["rmse"]["test"]["after"][AXIS_2] / std < 0.35
    # The evidence alone, without the term, loosens the prior until base parameters imitate it.
    assert errors["with"] < errors["without"] < errors["without_same_weight"]
    off = entry["relative_uncertainty"]
    assert off["with"] == off["without_same_weight"] < 0.3
    assert off["without"] > 2 * off["with"]
    assert entry["with_prior"]["separable"]
    # the other axes do not pay for it
    assert np.all(np.array(result["rmse"]["test"]["after"]) <= 0.5 * np.array(result["rmse"]["test"]["torque_std"]))


def test_without_the_prior_the_tool_says_that_the_data_cannot_separate_it(kuka):
    result, printed, _ = kuka["none"]
    (entry,) = result["known"]
    assert not entry["data_alone"]["separable"]
    assert entry["data_alone"]["share"] < 1e-5
    assert entry["data_alone"]["std_error"] > 1
    (finding,) = [f for f in result["data"]["findings"] if f["code"] == "not_separable"]
    assert finding["severity"] == "warning"
    words = "his data cannot separate the counterbalance of joint_2 from the base parameters"
    assert words in finding["message"]
    assert words in result["verdict"]
    assert words in " ".join(printed.split())
    # and so it is: without a prior the term changes nothing
    bare = entry["rmse_test_alone"]
    assert abs(bare["with"] / bare["without"] - 1) < 0.1


def test_with_the_prior_it_says_what_the_prior_is_for(kuka):
    result, printed, folder = kuka["robot"]
    words = "ithout the prior, this data cannot separate the counterbalance of joint_2"
    assert words in result["verdict"]
    assert "without it under the same weight of the prior" in " ".join(printed.split())
    assert "Known terms" in (folder / "report.html").read_text()


def test_the_saved_model_has_the_counterbalance(kuka, tmp_path):
    folder = kuka["robot"][2]
    model = _core.TorqueModel.load(folder / "model.json")
    assert "counterbalance" in model.term_names
    run_b = data.data_file("kuka_kr300_weigand", "traj_B.parquet")
    printed = dynid("estimate", folder / "model.json", run_b, "-o", tmp_path / "torques.parquet")
    assert printed.exit_code == 0, printed.output


def test_the_default_prefers_the_prior_on_the_kuka_by_its_training_run_alone():
    robot = RobotModel.from_urdf(data.data_file("kuka_kr300_weigand"))
    runs = (read_recording(data.data_file("kuka_kr300_weigand", f"traj_{name}.parquet"), robot) for name in "AB")
    train, test = (run.without("dq") for run in runs)  # 23 ms late, and not used anyway
    errors = []
    for prior in ("auto", None):
        identifier = ThreeLoopIdentifier(robot, links=LinkDynamicsIdentifier(prior=prior), residual=None).fit(train)
        assert (identifier.links_.posterior_ is not None) == (prior == "auto")
        states = identifier.states(test)
        left = states.in_band(states.tau - identifier.model_.evaluate(*states.signals())[0])
        errors.append(np.sqrt(np.mean(left**2, axis=0)))
    print("error with over without the prior", (errors[0] / errors[1]).round(2))
    assert np.exp(np.mean(np.log(errors[0] / errors[1]))) < 0.75
