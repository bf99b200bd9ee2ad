"""Ripple in the angle domain: orders, sizes and chances against torques that were put there, and against nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

import dynid_rs as dyn
from dynid_rs.assembly import evaluate
from dynid_rs.diagnosis.angle_data import AngleRun, angle_runs, full_rate_runs
from dynid_rs.diagnosis.order_spectrum import OrderGrid, amplitudes, order_grid
from dynid_rs.diagnosis.ripple import add_ripple, ripple_candidates, ripple_orders
from dynid_rs.diagnosis.ripple_fit import fit_lines
from dynid_rs.diagnosis.ripple_search import log_highest, peaks_of, search_lines
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.whitening import fit_whitener
from dynid_rs.simulation import bundled_robot, simulate, typical_arm

SEEN = dict(rtol=0.03)  # linear interpolation between cells of the angle grid: a percent of an amplitude, twice
ROUNDING = dict(rtol=1e-9, atol=1e-9)


@pytest.fixture(scope="module")
def arm():
    return replace(typical_arm(dyn.RobotModel.from_urdf(bundled_robot())).rigid(), delay=0.0)


@pytest.fixture(scope="module")
def clean(arm):
    """Three runs of an arm that lacks nothing, one encoder."""
    runs = simulate(arm, n_runs=3, duration=15.0, rate=250.0, seed=0).recordings
    return [dyn.Recording(run.t, run.q, tau=run.tau, name=run.name, joints=run.joints) for run in runs]


def with_ripple(runs, joint, order, size, phase=0.7, *, reversing=False):
    """The same runs with `size * cos(order q - phase)` on a joint; times the sign of the motion if it reverses."""
    changed = []
    for run in runs:
        q, tau = run.q[:, joint], run.tau.copy()
        way = np.sign(np.gradient(q)) if reversing else 1.0
        tau[:, joint] += size * way * np.cos(order * q - phase)
        changed.append(replace(run, tau=tau))
    return changed


def fitted(arm, runs, **options):
    setup = Setup(arm.robot, options=options)
    return setup, setup.identifier(residual=None).fit(runs)


def test_clean_runs_have_no_line(arm, clean):
    assert ripple_orders(fitted(arm, clean)[1], clean) == []


@pytest.mark.parametrize(("joint", "order"), [(1, 1872 / 7), (0, 100.5), (3, 41.0)])
def test_a_line_of_any_order_is_found_with_its_size_and_phase(arm, clean, joint, order):
    size = 0.3 * arm.noise_std[joint]
    runs = with_ripple(clean, joint, order, size)
    (line,) = ripple_orders(fitted(arm, runs)[1], runs)
    spread = [np.diff(interval)[0] / 2 for interval in (line.order_interval, line.amplitude_interval)]
    assert line.joint == joint
    assert line.p_value < 1e-6
    assert abs(line.order - order) < 2 * spread[0] < 0.3
    assert abs(line.amplitude - size) < 2 * spread[1] < 0.3 * size
    assert abs(line.phase - 0.7) < 0.3


def test_a_line_that_changes_sign_with_the_direction_is_seen_and_said(arm, clean):
    runs = with_ripple(clean, 2, 80.0, 0.5 * arm.noise_std[2], reversing=True)
    (line,) = ripple_orders(fitted(arm, runs)[1], runs)
    assert line.reversing > 0.8
    assert abs(line.order - 80) < 0.3


def test_an_order_and_twice_it_are_one_candidate_and_a_third_is_another(arm, clean):
    size = 0.4 * arm.noise_std[1]
    runs = with_ripple(with_ripple(with_ripple(clean, 1, 100.0, size), 1, 200.0, size), 1, 73.0, 0.8 * size)
    setup, fit = fitted(arm, runs)
    found = ripple_candidates(fit, runs, setup)
    assert sorted(round(dict(candidate.shape)["cycles"]) for candidate in found) == [73, 100]
    assert sorted(len(candidate.lines) for candidate in found) == [1, 2]
    assert all(candidate.kind == "torque_ripple" and candidate.joints == (1,) for candidate in found)
    assert all(after < before for before, after in (candidate.residual_rms for candidate in found))


def test_held_ripple_is_part_of_the_model_and_takes_the_line_off_runs_it_has_not_seen(arm, clean):
    runs = with_ripple(clean, 0, 120.0, 2 * arm.noise_std[0])
    setup, fit = fitted(arm, runs[:2])
    wider, found = add_ripple(setup, fit, runs[:2])
    assert len(found) == len(wider.held) == 1
    again = wider.identifier(residual=None).fit(runs[:2])
    unseen = runs[2]
    before, after = ((unseen.tau - model.predict(unseen))[:, 0].std() for model in (fit, again))
    assert before > 1.5 * arm.noise_std[0]
    assert after < 1.05 * arm.noise_std[0]
    assert ripple_orders(again, runs[:2]) == []
    terms = evaluate(again.model_, again.states(unseen))[1][:, again.model_.term_names.index("torque_ripple")]
    assert np.ptp(terms[:, 0]) > 3 * arm.noise_std[0]
    assert not terms[:, 1:].any()


def test_ripple_that_the_band_holds_is_left_to_the_fit(arm, clean):
    runs = with_ripple(clean, 1, 8.0, 3 * arm.noise_std[1])
    setup, fit = fitted(arm, runs)
    wider, found = add_ripple(setup, fit, runs)
    assert [effect.kind for effect in wider.effects] == ["torque_ripple"]
    assert wider.held == ()
    assert abs(dict(found[0].shape)["cycles"] - 8) < 0.2


def test_a_run_in_which_only_one_joint_moves_serves_that_joint(arm, clean):
    _, fit = fitted(arm, clean)
    resting = clean[0].q.copy()
    resting[:, [0, 1, 3, 4, 5]] = resting[0, [0, 1, 3, 4, 5]]
    alone = replace(clean[0], q=resting)
    runs = full_rate_runs(fit, [alone])
    assert [len(angle_runs(runs, j)) for j in range(6)] == [0, 0, 1, 0, 0, 0]


def test_a_vibration_in_time_is_no_line_in_angle():
    rng = np.random.default_rng(0)
    run = sweeping(rng, lambda t, q: 0.5 * np.cos(2 * np.pi * 9.0 * t))
    assert search_lines([run])[0].orders == ()


def test_an_alias_at_constant_speed_is_unfolded():
    rng = np.random.default_rng(1)
    rate, speed = 1000.0, 50.0
    t = np.arange(4000) / rate
    q = speed * t + 0.01 * np.cumsum(rng.normal(size=4000)) / np.sqrt(4000) + 2e-4 * np.sin(3 * t)
    torque = 0.3 * np.cos(72.0 * q) + 0.1 * rng.normal(size=4000)
    run = AngleRun("turns", q, np.full(4000, speed), torque, np.ones((4000, 1)), np.ones(4000, bool), rate)
    folded = 2 * np.pi * rate / speed - 72.0
    (order,) = search_lines([run])[0].orders
    assert abs(order.cycles - 72.0) < 0.1 < abs(order.cycles - folded)


def test_chance_is_what_it_says():
    """Highest of many orders of pure noise, through the whole spectrum: its p-values are uniform, or greater."""
    p_values = []
    for seed in range(60):
        run = sweeping(np.random.default_rng(seed), lambda t, q: 0 * t)
        p_values.append(np.exp(peaks_of([run], fit_lines([run], []), order_grid([run]), [])[0].log_p))
    assert kstest(p_values, "uniform", alternative="greater").pvalue > 1e-3
    assert min(p_values) > 1e-4


def test_the_bound_on_the_highest_falls_with_height_and_grows_with_the_orders_tried():
    level = np.array([20.0, 40.0])
    few, many = log_highest(level, 2, 100.0, 0.7), log_highest(level, 2, 1000.0, 0.7)
    assert few[1] < few[0] < 0
    assert np.all(many > few)


def test_one_transform_gives_the_sums_over_all_samples():
    rng = np.random.default_rng(3)
    angle, values = np.cumsum(rng.normal(0, 0.01, 2000)), rng.normal(size=2000)
    grid = OrderGrid(0.25, 20, 800)
    direct = np.array([values @ (np.cos(n * angle) + 1j * np.sin(n * angle)) for n in grid.orders[::60]])
    error = np.abs(amplitudes(angle, values, grid)[::60] - direct)
    assert np.all(error < SEEN["rtol"] * np.sqrt(len(angle)))


def test_the_whiteners_adjoint_is_its_transpose():
    rng = np.random.default_rng(4)
    x, y = np.cumsum(rng.normal(size=(2, 800)), axis=1)
    whitener = fit_whitener([x], [np.ones(800, bool)], 100.0)
    np.testing.assert_allclose(y @ whitener.apply(x, 0), whitener.adjoint(y, 0) @ x, **ROUNDING)


def sweeping(rng, torque):
    """One joint between -0.8 and 0.8 rad, back and forth at changing speeds, white noise of size one."""
    rate, n = 250.0, 6000
    t = np.arange(n) / rate
    q = 0.8 * np.sin(1.1 * t + 0.6 * np.sin(0.3 * t))
    return AngleRun(
        "sweeps", q, np.gradient(q, t), torque(t, q) + rng.normal(size=n), np.ones((n, 1)), np.ones(n, bool), rate
    )
