"""Leftovers that nothing in the catalogue explains: which signals they depend on, and what a data-driven term takes."""

from copy import copy

import numpy as np
import pytest
from nameless import in_band_noise, measured, plain_arm, with_nameless
from tolerances import ALGEBRAIC

from dynid_rs._core import GaussianMixtureRegression
from dynid_rs.assembly import evaluate, with_residual
from dynid_rs.columns import observe, run_rows
from dynid_rs.diagnosis import rows_beside
from dynid_rs.diagnosis.floor import floor
from dynid_rs.diagnosis.leftovers import run_residuals, search_leftovers
from dynid_rs.diagnosis.signals import candidate_signals, direction, way_since_reversal
from dynid_rs.diagnosis.surrogates import phase_randomised, upper_tail
from dynid_rs.diagnosis.unknown import find_unknown, names
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.loops import link_torque
from dynid_rs.simulation import simulate
from dynid_rs.systems import stack_one

WIDTH = 0.01
EFFECTS = {
    "direction and another position": (
        3,
        lambda s: np.tanh(s.dq[:, 3] / WIDTH) * np.sin(s.q[:, 2]),
        {("dq", 3), ("q", 2)},
    ),
    "load of another joint": (
        1,
        lambda s: np.tanh(s.dq[:, 1] / WIDTH) * np.abs(s.tau_link[:, 3]),
        {("dq", 1), ("tau_link", 3)},
    ),
    "two positions": (4, lambda s: np.sin(3 * s.q[:, 4]) * np.sin(s.q[:, 1]), {("q", 4), ("q", 1)}),
}
REMOVED = 0.7
"""Part of what could be explained that a term on the right signals has to take off a test run."""


@pytest.fixture(scope="module")
def arm():
    return plain_arm()


@pytest.fixture(scope="module")
def plans(arm):
    return simulate(arm, n_runs=4, duration=20, rate=50, seed=7).trajectories


def fitted(arm, plans, seed):
    *training, test = measured(arm, n_runs=4, trajectories=plans, seed=seed)
    return ThreeLoopIdentifier(arm.robot, residual=None).fit(training), test


@pytest.fixture(scope="module")
def clean(arm, plans):
    return fitted(arm, plans, 3)[0]


def error_on(fit, test, joint, term):
    """Mean square on a run outside the fit, the declared model fitted again beside the term."""
    plan = fit.observations_.plan

    def less(states):
        tau = states.tau.copy()
        if term is not None:
            tau[:, joint] -= term.torque(states, link_torque(plan, fit.links_, states))
        return tau

    links = copy(fit.links_).fit(observe(plan, fit.runs_, [less(states) for states in fit.runs_]), again=True)
    states = fit.states(test)
    rows = stack_one(plan, joint, run_rows(plan, states, less(states))[joint], links.torque_scale_)
    return np.mean((rows[:, -1] - rows[:, :-1] @ links.x_) ** 2)


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("ratio", [0.3, 1.5])
def test_signals_are_named_and_a_term_on_them_pays(arm, plans, name, ratio):
    joint, torque, signals = EFFECTS[name]
    fit, test = fitted(with_nameless(arm, joint, torque, ratio, plans[:3]), plans, 3)
    leftovers = search_leftovers(fit)
    found = floor(fit, fit.runs_, run_residuals(fit), leftovers)
    (unknown,) = find_unknown(fit, found, leftovers)
    assert unknown.joint == joint
    named = {signal for signal, _ in unknown.depends_on}
    if ratio > 1:
        assert named == signals
    else:  # the load of a shoulder is nearly a function of its position: then both must be said
        assert signals in [named, *map(set, unknown.ties)]
    assert all(strength > 0.1 for _, strength in unknown.depends_on)
    assert unknown.p_value < 1e-3
    assert unknown.share > 0.3
    before, after = (error_on(fit, test, joint, term) for term in (None, unknown.term))
    noise = in_band_noise(arm, fit.band_, 250.0)[joint] ** 2
    assert unknown.term.pays
    assert (before - after) / (before - noise) > REMOVED
    # The picture shows the same dependence that the term has.
    picture = unknown.picture
    seen = picture.count > 3
    assert np.corrcoef(picture.partial[seen], picture.fitted[seen])[0, 1] > 0.8
    assert picture.count.sum() == sum(len(states.rows) for states in fit.runs_)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_model_adds_the_term_s_own_torque_at_every_speed(arm, plans, name):
    """A whole model predicts with the term what was fitted: no speed is so far from all components as to fade."""
    joint, torque, _ = EFFECTS[name]
    fit, test = fitted(with_nameless(arm, joint, torque, 1.5, plans[:3]), plans, 3)
    leftovers = search_leftovers(fit)
    (unknown,) = find_unknown(fit, floor(fit, fit.runs_, run_residuals(fit), leftovers), leftovers)
    n = len(arm.noise_std)
    signals = [list(unknown.term.signals) if j == joint else [] for j in range(n)]
    regressions = [unknown.term.mixture if j == joint else None for j in range(n)]
    model = with_residual(fit.model_, signals, regressions)
    states = fit.states(test)
    _, terms, _ = evaluate(model, states)
    expected = unknown.term.torque(states, link_torque(fit.observations_.plan, fit.links_, states))
    faded = np.abs(terms[:, -1, joint] - expected) > 1e-6 * np.abs(expected).max()
    assert faded.mean() < 0.01


def test_many_rows_are_thinned_to_the_same_answer(arm, plans, monkeypatch):
    joint, torque, signals = EFFECTS["load of another joint"]
    fit, _ = fitted(with_nameless(arm, joint, torque, 1.5, plans[:3]), plans, 3)
    monkeypatch.setattr(rows_beside, "MOST_ROWS", 600)
    rows = rows_beside.Beside(fit).of_joint(joint)
    assert len(rows.rows) <= 600
    for split in (*rows.splits, rows.whole):
        assert np.linalg.norm(split.taken, 2) <= 1 + 1e-12
    best = search_leftovers(fit).joints[joint].found.scores[0]
    assert signals <= set(best.signals)


def test_names_are_those_of_columns(arm, plans):
    joint, torque, _ = EFFECTS["direction and another position"]
    fit, _ = fitted(with_nameless(arm, joint, torque, 1.0, plans[:3]), plans, 4)
    (unknown,) = find_unknown(fit, floor(fit, fit.runs_, run_residuals(fit)))
    joints = arm.robot.joint_names
    assert {name for name, _ in names(unknown, joints)} == {f"dq_{joints[3]}", f"q_{joints[2]}"}


def test_clean_data_has_nothing_unknown(clean):
    assert find_unknown(clean, floor(clean, clean.runs_, run_residuals(clean))) == []


def test_what_the_declared_model_has_is_taken_whole(clean):
    rows = rows_beside.Beside(clean).of_joint(2)
    declared = np.concatenate([block.rows[2][:, 3:10] for block in clean.observations_.blocks])[rows.rows]
    declared = declared / np.linalg.norm(declared, axis=0)
    for split in rows.splits:
        shown = declared[split.fitted]
        left = shown - split.taken @ (split.taken.T @ shown)
        # Friction of one joint is in no other joint's rows: nothing but the weak prior between directions resists.
        assert np.linalg.norm(left, axis=0).max() < 1e-3
        elsewhere = split.weighed(declared[split.left]) - split.elsewhere @ (split.taken.T @ shown)
        assert np.linalg.norm(elsewhere, axis=0).max() < 1e-2


def test_two_components_share_a_velocity_as_friction_turns_round():
    m, w = 0.4, 0.01
    covariances = np.tile(np.diag([m * w, 1.0]), (2, 1, 1))
    mixture = GaussianMixtureRegression([0.5, 0.5], np.array([[-m, -1.0], [m, 1.0]]), covariances)
    dq = np.linspace(-2.0, 2.0, 801)
    np.testing.assert_allclose(mixture.predict(dq[:, None])[0], direction(dq, w), **ALGEBRAIC)


def test_surrogates_keep_the_spectrum_and_lose_the_rest():
    rng = np.random.default_rng(0)
    residual = np.cumsum(rng.standard_normal(600))
    block = np.repeat([0, 1], [250, 350])
    copies = phase_randomised(residual, block, 3, 1)
    for k in (0, 1):
        part = residual[block == k] - residual[block == k].mean()
        power = np.abs(np.fft.rfft(part)) ** 2
        # The two real lines of an even length lose their imaginary part.
        inner = slice(1, (len(part) - 1) // 2)
        for column in copies[block == k].T:
            np.testing.assert_allclose(np.abs(np.fft.rfft(column))[inner] ** 2, power[inner], **ALGEBRAIC)
            assert abs(np.corrcoef(column, part)[0, 1]) < 0.9


def test_the_tail_of_a_maximum_is_the_share_that_reaches_it():
    rng = np.random.default_rng(0)
    maxima = rng.standard_normal((4000, 50)).max(axis=1)
    reached = np.array([upper_tail(3.2, maxima[k : k + 24]) for k in range(0, 2400, 24)])
    assert np.median(reached) == pytest.approx(np.mean(maxima > 3.2), rel=0.5)


def test_the_way_since_a_reversal_starts_again():
    t = np.linspace(0.0, 4 * np.pi, 2001)
    way = way_since_reversal(np.cos(t), -np.sin(t))
    assert way.min() >= 0
    assert way.max() == pytest.approx(2.0, abs=1e-3)
    after = np.searchsorted(t, np.pi + 0.2)
    assert way[after] == pytest.approx(1 + np.cos(t[after]), abs=1e-3)


def test_candidates_are_signals_of_all_joints(clean):
    candidates = candidate_signals(clean)
    n = clean.robot.n_joints
    assert len(candidates.of_joint(0)) == 4 * n + 2
    assert ("reversal", 1) not in candidates.of_joint(0)
