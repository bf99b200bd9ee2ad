"""What the search for effects rests on: gains beside the model, chance, choice, and an arm whose truth is known."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from binaries import find_estimator
from run_files import write
from scipy.optimize import lsq_linear
from scipy.signal import lfilter
from scipy.stats import kstest
from small_arm import URDF, dynid
from test_estimate import assert_same_answers
from tolerances import EXACT

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.diagnosis import choice
from dynid_rs.diagnosis.beside import Beside, bounded_gain
from dynid_rs.diagnosis.candidate import joined, stacked
from dynid_rs.diagnosis.dropping import drop_needless
from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.loop import diagnose
from dynid_rs.diagnosis.null import effective_tests, noise_copies, p_value
from dynid_rs.diagnosis.search import good_candidates, refined_candidate, search
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import Search, columns_in, fitted, rms
from dynid_rs.simulation import build_effects, equip, parse_wish, simulate, typical_arm
from dynid_rs.simulation.folder import run_columns

REFIT = {"rtol": 1e-5, "atol": 1e-9}
"""Triangular factors with their tiny ridge against one dense factorisation of everything."""
IN_BAND = 0.25
"""Part of white torque noise that the band lets through; 0.2 to 0.22 at 5 Hz."""
N_DRAWS = 200
"""Residuals of made-up noise."""
N_COPIES = 120
MEMORY = 0.5
"""Correlation of neighbouring rows of the made-up noise."""

ROBOT = dyn.RobotModel.from_urdf_string(URDF)
TYPICAL = typical_arm(ROBOT)
ARM = replace(TYPICAL.rigid(), delay=0.0)
STRIBECK = Hypothesis("stribeck", (2,), (("stribeck_velocity", 0.1), ("exponent", 2.0), ("transition_width", 0.02)))
HYSTERESIS = Hypothesis("friction_hysteresis", (1,), (("presliding_distance", 0.01),))
LOAD = Hypothesis("load_dependent_friction", (2,), (("transition_width", 0.02),))
TRUTH = ("friction_hysteresis:elbow:2", "load_dependent_friction:wrist:2")


def measured(*wishes: str, n_runs: int = 4) -> list[dyn.Recording]:
    """One encoder, rigid gears, and what is wished for in 1 of the usual size."""
    arm = equip(ARM, build_effects([parse_wish(wish) for wish in wishes], TYPICAL)) if wishes else ARM
    recordings = simulate(arm, n_runs=n_runs, duration=12.0, rate=200.0, seed=0).recordings
    return [dyn.Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints) for r in recordings]


def start(setup: Setup, runs: list[dyn.Recording]) -> Search:
    fit = fitted(setup, runs)
    return Search(setup, fit, Kinds(fit))


@pytest.fixture(scope="module")
def clean():
    return start(Setup(ROBOT), measured(n_runs=3))


@pytest.fixture(scope="module")
def beside(clean):
    return Beside(clean.fit)


@pytest.mark.parametrize("law", ["paper", "stribeck"])
def test_an_effects_own_columns_are_found_beside_every_law_of_friction(law):
    setup = Setup(ROBOT, effects=(STRIBECK.placed(), HYSTERESIS.placed()), options={"friction_law": law})
    state = start(setup, measured(n_runs=2))
    names = [name for effect in state.fit.observations_.plan.effects for name in effect.coefficient_names]
    named = [[(j, names[column]) for j, column in places] for places in columns_in(state)]
    assert named == [[(2, "stribeck_pos"), (2, "stribeck_neg")], [(1, "hysteresis")]]
    assert columns_in(state)[0][0][1] == len(names) - 8 - 3  # right before friction, behind the law's own


@pytest.fixture(scope="module")
def mixed():
    return measured(*TRUTH)


@pytest.fixture(scope="module")
def outcome(mixed):
    return diagnose(Setup(ROBOT), mixed[:3], mixed[3:])


def coupled(kinds: Kinds) -> Hypothesis:
    """Two joints, one coefficient each."""
    return next(h for h in kinds.grid(["coupled_friction"]) if h.joints == (1, 2))


class Dense:
    """The whole model as one matrix, written down from the rows: [A | tau] / noise; the prior on friction below."""

    def __init__(self, fit, left_out: int | None = None):
        observations = fit.observations_
        plan = observations.plan
        blocks = [block for k, block in enumerate(observations.blocks) if k != left_out]
        self.weights = 1 / fit.links_.noise_std_
        parts, pulls = [], []
        names = [name for effect in plan.effects for name in effect.coefficient_names]
        pair = [names.index("coulomb_pos"), names.index("coulomb_neg")]
        for j in range(ROBOT.n_joints):
            rows = np.concatenate([block.rows[j] for block in blocks])
            wide = np.zeros((len(rows), plan.n_columns + 1))
            wide[:, plan.unknowns(j)] = rows[:, :-1]
            wide[:, -1] = rows[:, -1]
            parts.append(self.weights[j] * wide)
            size = np.sqrt(np.mean(np.concatenate([block.rows[j] for block in observations.blocks])[:, -1] ** 2))
            pull = np.zeros(plan.n_columns + 1)
            pull[plan.n_base + j * plan.n_own + np.array(pair)] = np.array([1.0, -1.0]) / (fit.links_.asymmetry * size)
            pulls.append(pull)
        self.n_rows = [len(part) for part in parts]
        system = np.concatenate([*parts, pulls])
        self.A, self.y = system[:, :-1][:, plan.estimable()], system[:, -1]

    def column(self, columns, keep=slice(None)):
        """A candidate's columns as columns of this matrix."""
        width = next(iter(columns.values())).shape[1]
        parts = [
            self.weights[j] * columns[j][keep] if j in columns else np.zeros((n, width))
            for j, n in enumerate(self.n_rows)
        ]
        return np.concatenate([*parts, np.zeros((len(self.y) - sum(self.n_rows), width))])

    def solve(self, C=None):
        """Unknowns and the sum of squares that is left."""
        A = self.A if C is None else np.column_stack([self.A, C])
        norms = np.linalg.norm(A, axis=0)
        norms[norms == 0] = 1.0
        x = np.linalg.lstsq(A / norms, self.y, rcond=1e-12)[0] / norms
        return x, float(np.sum((self.y - A @ x) ** 2))


@pytest.mark.parametrize("which", ["one joint", "two joints"])
def test_a_gain_is_that_of_a_dense_refit(clean, beside, which):
    hypothesis = STRIBECK if which == "one joint" else coupled(clean.kinds)
    columns = stacked(clean.kinds.columns([hypothesis])[0])
    free = np.full((2, 2), [-np.inf, np.inf])
    gain = beside.gains(columns, [slice(None)], [free])[0]
    dense = Dense(clean.fit)
    x, with_it = dense.solve(dense.column(columns))
    _, without = dense.solve()
    np.testing.assert_allclose(gain.coefficients, x[-2:], **REFIT)
    np.testing.assert_allclose(gain.power, without - with_it, rtol=1e-4)
    assert gain.power > 1e-4 * without  # a difference of two sums is worth comparing
    assert 0 < gain.own < 1


@pytest.mark.parametrize("which", ["model alone", "with a candidate"])
def test_left_out_is_a_refit_without_the_block(clean, beside, which):
    columns = stacked(clean.kinds.columns([STRIBECK])[0]) if which == "with a candidate" else None
    left = beside.left_out(columns, None if columns is None else np.full((2, 2), [-np.inf, np.inf]))
    whole = Dense(clean.fit)
    starts = np.cumsum([0, *whole.n_rows])
    for k, block in enumerate(beside.blocks):
        keep = np.ones(beside.n_rows, dtype=bool)
        keep[block] = False
        part = Dense(clean.fit, left_out=k)
        x, _ = part.solve(None if columns is None else part.column(columns, keep))
        A = whole.A if columns is None else np.column_stack([whole.A, whole.column(columns)])
        error = whole.y - A @ x
        for j in range(ROBOT.n_joints):
            seen = error[starts[j] : starts[j + 1]][block] / whole.weights[j]
            np.testing.assert_allclose(left[block, j], seen, rtol=0, atol=1e-4 * seen.std())


@pytest.mark.parametrize("signed", [1, 2])
@pytest.mark.parametrize("n_free", [0, 3])
def test_bounds_are_those_of_bounded_least_squares(signed, n_free):
    rng = np.random.default_rng(signed + 10 * n_free)
    touched = 0
    for _ in range(200):
        k = signed + n_free
        A = rng.normal(size=(30, k)) @ (np.eye(k) + 0.15 * rng.normal(size=(k, k)))
        y = rng.normal(size=30)
        bounds = np.array([(0.0, np.inf)] * signed + [(-np.inf, np.inf)] * n_free)
        gain = bounded_gain(A.T @ A, np.sum(A**2, axis=0), A.T @ y, bounds)
        best = lsq_linear(A, y, (bounds[:, 0], bounds[:, 1]), tol=1e-14)
        np.testing.assert_allclose(gain.power, np.sum(y**2) - 2 * best.cost, rtol=1e-6, atol=1e-6)
        assert np.all(gain.coefficients[:signed] >= 0)
        touched += bool(gain.bound.any())
    assert touched > 50


@pytest.fixture(scope="module")
def drawn(beside):
    """What the declared model leaves of noise with memory, (n_rows, n_joints, N_DRAWS)."""
    rng = np.random.default_rng(7)
    noise = lfilter([1.0], [1.0, -MEMORY], rng.standard_normal((beside.n_rows + 100, 3, N_DRAWS)), axis=0)[100:]
    noise /= beside.weights[:, None]
    left = beside.own_part({j: noise[:, j] for j in range(3)})
    return np.stack([left[j] for j in range(3)], axis=1)


def with_residual(beside, residual):
    """The same model after a fit to something else."""
    assert beside.leverage
    made = copy(beside)
    made.residual = residual
    return made


def test_copies_have_the_spectrum_of_the_noise_not_of_what_the_fit_left():
    """A fit takes every second line of a band; the copies hold what was there before, of noise that is known."""
    n, n_copies = 1024, 400
    rng = np.random.default_rng(3)
    t = np.arange(n)[:, None]
    fitted_columns = np.column_stack(
        [f(2 * np.pi * k * t / n) for k in range(100, 260, 2) for f in (np.cos, np.sin)],
    )
    Q, _ = np.linalg.qr(fitted_columns)
    taken = [np.sum(np.abs(np.fft.rfft(Q, axis=0)) ** 2, axis=1) / n]
    known = 1 / np.abs(1 - MEMORY * np.exp(-2j * np.pi * np.fft.rfftfreq(n))) ** 2
    bands = [(10, 100), (100, 260), (260, 500)]
    copied, left_over = [], []
    for _ in range(8):
        noise = lfilter([1.0], [1.0, -MEMORY], rng.standard_normal(n + 200))[200:]
        left = noise - Q @ (Q.T @ noise)
        made = SimpleNamespace(blocks=[slice(0, n)], leverage=[taken])
        copies = noise_copies(made, left[:, None], n_copies)[0]
        shown = np.mean(np.abs(np.fft.rfft(copies, axis=0)) ** 2, axis=1) / n
        kept = np.abs(np.fft.rfft(left)) ** 2 / n
        copied.append([shown[a:b].mean() / known[a:b].mean() for a, b in bands])
        left_over.append([kept[a:b].mean() / known[a:b].mean() for a, b in bands])
    # Eight residuals of 80 lines or more: 4 %, and as much for stretches that reach beyond a band's edge.
    np.testing.assert_allclose(np.mean(copied, axis=0), 1.0, atol=0.15)
    np.testing.assert_allclose(np.mean(left_over, axis=0), [1.0, 0.5, 1.0], atol=0.1)


def test_p_values_of_noise_are_uniform(clean, beside, drawn):
    candidate = clean.kinds.candidate(LOAD)
    columns = stacked(candidate.columns)
    free = np.full((2, 2), [-np.inf, np.inf])
    p = []
    for draw in range(N_DRAWS):
        made = with_residual(beside, drawn[:, :, draw])
        gain = made.gains(columns, [slice(None)], [free])[0]
        after = made.with_columns(columns, gain.coefficients)
        p.append(p_value(made, columns, after, np.array([True, True]), n_copies=N_COPIES))
    assert kstest(p, "uniform").pvalue > 1e-3
    assert np.mean(np.array(p) < 0.05) < 0.11  # four standard errors


def test_the_number_of_tests_keeps_the_family_wise_error(clean, beside, drawn):
    hypotheses = [*clean.kinds.grid(["friction_hysteresis", "load_hysteresis", "load_dependent_friction"])]
    hypotheses = [h for h in hypotheses if h.joints == (1,)][::2]
    parts = [stacked(columns) for columns in clean.kinds.columns(hypotheses)]
    edges = np.cumsum([0, *(part[1].shape[1] for part in parts)])
    groups = [slice(a, b) for a, b in pairwise(edges)]
    n_tests = effective_tests(with_residual(beside, drawn[:, :, 0]), [(joined(parts), groups)])
    assert 1 < n_tests <= len(hypotheses) + 2
    false = 0
    for draw in range(N_DRAWS * 3 // 10):
        made = with_residual(beside, drawn[:, :, draw])
        p = [
            p_value(made, part, made.residual, np.ones(part[1].shape[1], dtype=bool), n_copies=N_COPIES)
            for part in parts
        ]
        false += min(p) * n_tests < 0.1
    # A tenth of 60 with a standard error of 2.3.
    assert false < 14


def test_a_clean_arm_gives_nothing(clean):
    assert good_candidates(copy(clean), []) == []
    found = search(clean.setup, measured(n_runs=3))
    assert found.setup.effects == ()
    assert found.steps == []


def test_two_effects_are_found_by_name_and_the_error_is_the_noise(outcome):
    assert {(e["kind"], tuple(e["joints"])) for e in outcome.effects} == {
        ("friction_hysteresis", ("elbow",)),
        ("load_dependent_friction", ("wrist",)),
    }
    before = rms(start(Setup(ROBOT), measured(*TRUTH)[:3]).fit)
    assert np.all(before[1:] > 0.4 * ARM.noise_std[1:])
    assert np.all(rms(outcome.search.fit) < IN_BAND * ARM.noise_std)
    for entry in outcome.effects:
        at = ["shoulder", "elbow", "wrist"].index(entry["joints"][0])
        assert entry["rmse_test_after"][at] < IN_BAND * ARM.noise_std[at] < entry["rmse_test_before"][at]
        for parameter in entry["parameters"]:
            low, high = parameter["interval"]
            assert low < parameter["value"] < high


def test_test_runs_choose_nothing(mixed, outcome):
    test = replace(mixed[3], tau=mixed[3].tau[::-1])
    again = diagnose(Setup(ROBOT), mixed[:3], [test])
    assert again.steps == outcome.steps
    assert again.setup.effects == outcome.setup.effects
    for first, second in ((outcome.before, again.before), (outcome.after, again.after)):
        np.testing.assert_array_equal(first.links_.x_, second.links_.x_)
        state = first.states(mixed[0])
        one, other = (fit.model_.evaluate(*state.signals(), step=1 / state.rate)[1] for fit in (first, second))
        np.testing.assert_allclose(one, other, **EXACT)
    assert again.effects[0]["rmse_test_after"] != outcome.effects[0]["rmse_test_after"]


def test_found_effects_run_online(tmp_path, mixed, outcome):
    model, out, states = tmp_path / "model.json", tmp_path / "out.parquet", tmp_path / "states.csv"
    outcome.after.model_.save(model)
    assert {"friction_hysteresis", "load_dependent_friction"} <= set(_core.TorqueModel.load(model).term_names)
    run = write(tmp_path / "run.parquet", run_columns(mixed[3]))
    assert dynid("estimate", model, run, "-o", out, "--states", states).exit_code == 0
    assert_same_answers(find_estimator(), model, states.read_text(), out)


def test_friction_that_drives_is_refuted(clean, beside):
    candidate = clean.kinds.candidate(HYSTERESIS)
    columns = stacked(candidate.columns)
    size = 3 * clean.fit.links_.noise_std_[1] / columns[1].std()
    torque = beside.own_part({1: -size * columns[1]})
    made = with_residual(beside, beside.residual + np.column_stack([torque[j] for j in range(3)]))
    unbounded = made.gains(columns, [slice(None)], [np.array([[-np.inf, np.inf]])])[0]
    assert unbounded.power > 100
    assert unbounded.coefficients[0] == pytest.approx(-size, rel=0.1)
    weighed = choice.weigh(made, candidate)
    assert weighed.gain.power == 0
    assert weighed.gain.bound.all()
    assert choice.tested(made, weighed, made.left_out(None)).p_value == 1.0


def test_two_names_of_one_thing_are_a_tie(mixed):
    state = start(Setup(ROBOT), mixed[:3])
    true = refined_candidate(Beside(state.fit), state.kinds, HYSTERESIS)
    rng = np.random.default_rng(0)
    shaken = [{1: run[1] + 1e-4 * run[1].std() * rng.standard_normal(run[1].shape)} for run in true.columns]
    twin = replace(true, kind="twin", columns=shaken)
    found = good_candidates(state, [twin])
    names = [choice.weighed.candidate.kind for choice in found if choice.weighed.candidate.joints == (1,)]
    assert len(names) == 1
    tied = [tie.weighed.candidate.kind for choice in found for tie in choice.ties]
    assert {names[0], *tied} >= {"twin", "friction_hysteresis"}


def test_what_is_needless_is_dropped(mixed):
    needless = STRIBECK.placed()
    needed = [h.placed() for h in (HYSTERESIS, LOAD)]
    state = start(replace(Setup(ROBOT), effects=(needless, *needed)), mixed[:3])
    drop_needless(state, mixed[:3])
    assert [effect.kind for effect in state.setup.effects] == [effect.kind for effect in needed]
    assert [(step.action, step.choice.weighed.candidate.kind) for step in state.steps] == [("dropped", "stribeck")]
