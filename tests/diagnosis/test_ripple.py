"""Ripple in the angle at full rate: families of one gear with their orders and sizes, and nothing where nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, found_in, measured, rigid
from helpers.small_arm import JOINTS
from scipy.signal import butter, filtfilt

from dynid_rs.diagnosis.ripple import (
    PARTS,
    Line,
    _family,
    _in_parts,
    _strongest,
    find_ripple,
    measured_beside,
    ripple_entries,
)
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.model.assembly import evaluate
from dynid_rs.model.placed import HeldEffect, PlacedEffect

ARM = rigid()


@pytest.fixture(scope="module")
def clean():
    """Three runs of an arm that lacks nothing, one encoder."""
    return measured(duration=15.0, rate=250.0)


def with_line(runs, joint, order, size, phase=0.7):
    """The same runs with `size * cos(order q - phase)` on a joint."""
    changed = []
    for run in runs:
        tau = run.tau.copy()
        tau[:, joint] += size * np.cos(order * run.q[:, joint] - phase)
        changed.append(replace(run, tau=tau))
    return changed


def families(runs):
    setup = Setup(ROBOT)
    fit = setup.identifier(residual=None).fit(runs)
    return fit, find_ripple(setup, fit, runs)


def test_clean_runs_have_no_line(clean):
    assert families(clean)[1] == []


@pytest.mark.parametrize(("joint", "order"), [(1, 1872 / 7), (0, 100.5), (2, 41.0)])
def test_a_line_of_any_order_is_found_with_its_size_and_phase(clean, joint, order):
    size = 0.3 * ARM.noise_std[joint]
    _, (family,) = families(with_line(clean, joint, order, size))
    assert family.joint == joint
    cosine, sine = family.coefficients[0]
    turns = np.ptp(np.concatenate([run.q[:, joint] for run in clean])) / (2 * np.pi)
    assert abs(family.orders[0] - order) < 0.2 / turns
    # Between two orders of the spectrum a line loses up to a fiftieth.
    assert abs(np.hypot(cosine, sine) - size) < 3 * family.std[0] + 0.05 * size
    assert family.log_odds > np.log(19)


def test_an_order_and_its_harmonics_are_one_family_and_another_order_is_another(clean):
    size = 0.4 * ARM.noise_std[1]
    runs = with_line(with_line(with_line(clean, 1, 100.0, size), 1, 200.0, size), 1, 73.0, 0.8 * size)
    fit, found = families(runs)
    assert sorted([round(order) for order in family.orders] for family in found) == [[73], [100, 200]]
    entries = ripple_entries(found, fit)
    assert [(entry["kind"], entry["joints"]) for entry in entries] == [("torque_ripple", ["elbow"])] * 2
    (both,) = (entry for entry in entries if len(entry["parameters"]) == 4)
    assert [p["name"] for p in both["parameters"]] == ["cycles", "amplitude", "cycles_2", "amplitude_2"]
    for parameter in both["parameters"][1::2]:
        low, high = parameter["interval"]
        assert low < size < high
        assert parameter["unit"] == "N*m"


def test_a_diagnosis_takes_the_line_off_a_run_that_it_has_not_seen(clean):
    size = 2 * ARM.noise_std[0]
    runs = with_line(clean, 0, 120.0, size)
    found = found_in(runs)
    assert [(entry["kind"], entry["joints"]) for entry in found.entries] == [("torque_ripple", [JOINTS[0]])]
    unseen = runs[2]
    before, after = ((unseen.tau - fit.predict(unseen))[:, 0].std() for fit in (found.before, found.after))
    assert before > 1.5 * ARM.noise_std[0]
    assert after < 1.1 * ARM.noise_std[0]
    model = found.after.model_
    terms = evaluate(model, found.after.states(unseen))[1][:, model.term_names.index("torque_ripple")]
    assert np.ptp(terms[:, 0]) == pytest.approx(2 * size, rel=0.1)
    assert not terms[:, 1:].any()


def test_what_a_ripple_covers_is_found_beside_it(clean):
    """A force between two joints, a seventh of the noise, under a ripple of twenty times: seen once that is known."""
    runs, low = [], butter(3, 10.0, fs=250.0)
    for run in with_line(clean, 2, 41.0, 20 * ARM.noise_std[2]):
        ddq = filtfilt(*low, np.gradient(np.gradient(run.q, run.t, axis=0), run.t, axis=0), axis=0)
        tau = run.tau.copy()
        tau[:, [0, 2]] += 0.15 * ARM.noise_std[2] / ddq[:, 0].std() * ddq[:, [2, 0]]
        runs.append(replace(run, tau=tau))
    named = {(entry["kind"], tuple(entry["joints"])) for entry in found_in(runs).entries}
    assert named == {("torque_ripple", (JOINTS[2],)), ("inertial_coupling", (JOINTS[0], JOINTS[2]))}


def test_a_joint_that_rests_in_a_run_serves_with_the_others(clean):
    size = 0.5 * ARM.noise_std[1]
    runs = with_line(clean, 1, 60.0, size)
    resting = runs[0].q.copy()
    resting[:, 0] = resting[0, 0]
    setup = Setup(ROBOT)
    fit = setup.identifier(residual=None).fit(runs)
    (family,) = find_ripple(setup, fit, [replace(runs[0], q=resting), *runs[1:]])
    assert family.joint == 1


def test_a_line_of_a_joint_that_is_late_by_itself_has_its_size(clean):
    """At the wrong angle a fast line is a smaller one."""
    late, size = 0.008, 0.5 * ARM.noise_std[1]
    shown = []
    for run in with_line(clean, 1, 100.0, size):
        tau = run.tau.copy()
        tau[:, 1] = np.interp(run.t - late, run.t, tau[:, 1])
        shown.append(replace(run, tau=tau))
    sizes = []
    for setup, runs in (
        (Setup(ROBOT), with_line(clean, 1, 100.0, size)),
        (Setup(ROBOT, own_delay=np.array([0.0, late, 0.0])), shown),
    ):
        (line,) = find_ripple(setup, setup.identifier(residual=None).fit(runs), runs)
        sizes.append(float(np.linalg.norm(line.coefficients)))
    assert sizes[1] == pytest.approx(sizes[0], rel=0.03)


def test_what_acts_from_outside_hides_no_line(clean):
    """Four seconds of one run in which anything may act, and which are excluded."""
    runs = with_line(clean, 1, 100.0, 0.5 * ARM.noise_std[1])
    t = runs[0].t - runs[0].t[0]
    disturbed, tau = (t > 4) & (t < 8), runs[0].tau.copy()
    tau[disturbed, 1] += 60 * ARM.noise_std[1] * np.random.default_rng(0).normal(size=disturbed.sum())
    window = (float(runs[0].t[0]) + 3.9, float(runs[0].t[0]) + 8.1)
    setup = Setup(ROBOT, excluded={runs[0].name: (window,)})
    runs = [replace(runs[0], tau=tau), *runs[1:]]
    (line,) = find_ripple(setup, setup.identifier(residual=None).fit(runs), runs)
    assert (line.joint, round(float(line.orders[0]))) == (1, 100)


def test_a_line_that_is_held_is_not_found_again(clean):
    size, phase = 0.5 * ARM.noise_std[1], 0.7
    runs = with_line(clean, 1, 100.0, size, phase)
    line = PlacedEffect.at("torque_ripple", 1, cycles=100.0)
    held = HeldEffect(line, (size * np.cos(phase), size * np.sin(phase), 0.0, 0.0))
    assert len(families(runs)[1]) == 1
    setup = Setup(ROBOT, held=(held,))
    assert find_ripple(setup, setup.identifier(residual=None).fit(runs), runs) == []


def test_a_vibration_in_time_is_no_line_in_angle(clean):
    shaken = [
        replace(run, tau=run.tau + 0.5 * ARM.noise_std[1] * np.cos(2 * np.pi * 9.0 * run.t)[:, None] * [0, 1, 0])
        for run in clean
    ]
    assert families(shaken)[1] == []


@pytest.mark.parametrize("size", [0.0, 0.05, 0.1, 0.3])
def test_a_line_s_odds_by_its_parts_are_those_of_its_chance(size):
    """Of complex amplitudes that agree by chance alone the mean's power over its scatter is F distributed."""
    from scipy.stats import f

    rng = np.random.default_rng(1)
    n = 200 * PARTS
    q = np.sort(rng.uniform(0.0, 6.0, n))
    e = size * np.cos(40 * q + 0.3) + 0.3 * rng.standard_normal(n)
    parts = np.mean((np.exp(40j * q) * e).reshape(PARTS, -1), axis=1)
    power = np.abs(parts.mean()) ** 2 / (np.var(parts, ddof=1) / PARTS)
    log_chance = f.logsf(power, 2, 2 * (PARTS - 1))
    assert _in_parts(q, e, 40.0) == pytest.approx(-log_chance - 1 - np.log(max(power, 1.0)), rel=1e-9)


@pytest.mark.parametrize("cycles", [3.2, 3.4])
def test_a_curve_of_few_cycles_is_no_line(cycles):
    """The band shows it; it leaks into the first orders that are sought here."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        t = np.arange(20000) / 400
        q = 0.6 * np.sin(0.9 * t) + 0.15 * np.sin(2.1 * t + 1)
        turns = float(np.ptp(q)) / (2 * np.pi)
        assert _strongest(q, rng.normal(size=len(t)) + 3 * np.cos(cycles / turns * q), turns, 6) is None


@pytest.mark.parametrize(("size", "least"), [(0.0, None), (0.1, 3.0), (0.2, 15.0), (1.0, 30.0)])
def test_the_larger_a_line_the_surer_it_is_on_a_part_of_a_turn_too(size, least):
    """Measured against the line itself, which spreads over its neighbours there, it would stay at 10 to 20 nats."""
    rng = np.random.default_rng(0)
    t = np.arange(20000) / 400
    q = 1.2 * np.sin(0.9 * t) + 0.3 * np.sin(2.1 * t + 1)
    line = _strongest(q, rng.normal(size=len(t)) + size * np.cos(122.7 * q), float(np.ptp(q)) / (2 * np.pi), 6)
    assert (line is None) is (least is None)
    if line is not None:
        assert line.log_odds > least
        assert line.order == pytest.approx(122.7, abs=0.3)


@pytest.mark.parametrize("way", [0.9, 9.0])
def test_a_line_s_error_is_that_of_the_background_a_short_way_from_it(way):
    """White noise of 0.1 gives a coefficient's, 0.1 sqrt(2 / n); a third of a turn tells orders three apart at best."""
    rng = np.random.default_rng(1)
    q = way * np.sin(np.linspace(0.0, 60.0, 20_000))
    e = 0.5 * np.cos(20.0 * q) + 0.1 * rng.standard_normal(len(q))
    family = _family(0, q, e, [Line(20.0, 50.0)])
    np.testing.assert_allclose(family.coefficients, [[0.5, 0.0]], atol=0.01)
    np.testing.assert_allclose(family.std, 0.1 * np.sqrt(2 / len(q)), rtol=0.6)


def test_the_order_of_a_line_over_a_part_of_a_turn_is_not_where_the_spectrum_peaks():
    """Four cycles: lines of the true order leave nothing, and the spectrum peaks a hundredth of it beside."""
    q = 0.83 * np.sin(np.linspace(0.0, 40.0, 8_000)) - 0.3 * np.sin(np.linspace(0.0, 11.0, 8_000))
    e = np.cos(10.3 * q + 1.1) + 0.4 * np.cos(20.6 * q)
    grid = 10.3 + np.linspace(-1.0, 1.0, 401)
    peak = grid[np.argmax(np.abs(np.exp(1j * np.outer(grid, q)) @ e))]
    assert abs(peak - 10.3) > 0.1
    family = _family(0, q, e, [Line(10.1, 50.0), Line(20.2, 50.0)])
    np.testing.assert_allclose(family.orders, [10.3, 20.6], rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(family.coefficients, axis=1), [1.0, 0.4], rtol=1e-3)


def test_what_the_fit_imitates_of_slow_cycles_is_the_line_s():
    """Beside the family's own torque the fit gives back what it took of it; intervals of errors know nothing of it."""
    runs = measured(duration=15.0, rate=250.0)
    sizes, first, again = 2 * ARM.noise_std, [], []
    for joint, order in ((0, 11.0), (1, 12.0), (2, 14.0)):
        changed = with_line(runs, joint, order, sizes[joint])
        setup = Setup(ROBOT)
        alone = [family for family in families(changed)[1] if family.joint == joint]
        assert len(alone) == 1
        first.append(np.linalg.norm(alone[0].coefficients[0]) / sizes[joint])
        held = replace(setup, held=tuple(alone[0].held()))
        (beside,) = measured_beside(alone, held, held.identifier(residual=None).fit(changed), changed)
        again.append(np.linalg.norm(beside.coefficients[0]) / sizes[joint])
    before, after = (np.abs(np.array(ratios) - 1) for ratios in (first, again))
    assert before.max() > 0.03
    assert np.all(after < before)  # the rest is noise, which has its colour
    assert after.mean() < 0.6 * before.mean()


def test_a_line_that_no_prediction_holds_as_it_is_shown_is_measured_once():
    """Ten cycles in four samples: on the grid of a prediction hardly anything of it is left to be taken off."""
    runs = measured(duration=15.0, rate=250.0)
    size = 2 * ARM.noise_std[0]
    changed, setup = with_line(runs, 0, 700.3, size), Setup(ROBOT)
    (alone,) = families(changed)[1]
    held = replace(setup, held=tuple(alone.held()))
    (beside,) = measured_beside([alone], held, held.identifier(residual=None).fit(changed), changed)
    assert np.linalg.norm(beside.coefficients[0]) == pytest.approx(size, rel=0.05)
