"""The next experiment: what is known of what is open, what a motion would say of it, and what comes out."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, columns_of, found_in, measured, names, recorded, rigid, with_effects
from helpers.run_files import write_csv
from helpers.small_arm import URDF, dynid, refusal
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

import dynid_rs as dyn
from dynid_rs import Recording
from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.along import NEEDS_MORE, Along, Told, is_designable
from dynid_rs.diagnosis.any_function import _as_rough, _window, own_angle
from dynid_rs.diagnosis.candidates import SPREAD, STEP, cell, free_shape, with_slopes
from dynid_rs.diagnosis.hypotheses import Catalogue
from dynid_rs.diagnosis.open_file import checksum_of, read_open, to_json
from dynid_rs.diagnosis.open_questions import Answer, Question
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.waves import smoother, waves
from dynid_rs.excitation import ExcitationLimits
from dynid_rs.excitation.series import FourierSeries
from dynid_rs.experiment import designing
from dynid_rs.experiment.answer import sentences, words
from dynid_rs.experiment.answer import to_json as next_json
from dynid_rs.experiment.designing import led_by
from dynid_rs.experiment.worth import Worth
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.simulation import simulate

TIE = "joint_spring:elbow:0.3"
PLACE = ("joint_spring", (1,))
LAW = "position_dependent_friction:wrist:0.3"
QUICK = {"duration": 10.0, "n_restarts": 2, "max_iter": 10, "random_state": 0}
SAME_COLUMNS = {"rtol": 0.25}
"""Another grid of instants, and beside the runs stands a yielding of every gear, which takes a part away."""
DRAWN = 0.06
"""Error of a chance from 128 draws, half of them mirrored: two standard deviations at a half."""


@pytest.fixture
def few_draws(monkeypatch):
    """Walks begin at the best of a few random motions: for what does not depend on how good the best is."""
    monkeypatch.setattr(designing, "N_DRAWS", 12)


@pytest.fixture(scope="module")
def runs():
    return measured(TIE, duration=10.0)


@pytest.fixture(scope="module")
def found(runs):
    return found_in(runs)


@pytest.fixture(scope="module")
def asked(found):
    return found.asked


@pytest.fixture(scope="module")
def designed(found):
    return designed_after(found)


def designed_after(found, **options):
    return dyn.next_experiment(found, **QUICK | options)


def nowhere(asked):
    """No row is wanted anywhere."""
    n = len(asked.known)
    return np.zeros((ROBOT.n_joints, n, n))


def tie_of(asked):
    return next(q for q in asked.questions if q.second.candidates)


def test_a_tie_is_a_question_with_the_odds_that_the_result_says(found, asked):
    question = tie_of(asked)
    assert asked.candidates[question.first.candidates[0]].place == PLACE
    (entry,) = (entry for entry in found.entries if entry.get("told_as") == "joint_spring")
    (tie,) = entry["ties"]
    assert tie["kind"] == asked.candidates[question.second.candidates[0]].kind
    assert question.log_odds == pytest.approx(entry["evidence"] - tie["evidence"])
    assert abs(question.log_odds) < SURE


def test_along_the_runs_themselves_rows_say_what_they_said(found, asked):
    """Of declared unknowns and of what is asked, by another way than the fit."""
    question = tie_of(asked)
    along = Along(asked, question.candidates)
    told = np.zeros_like(asked.precision)
    declared = np.zeros_like(asked.known)
    for states in found.after.runs_:
        t = np.arange(0.0, states.t[-1] - states.t[0], 1 / along.rate)
        more = along.information([CubicSpline(states.t - states.t[0], x)(t) for x in states.signals()[:3]])
        told += more.unknowns
        declared += more.declared
    at = np.concatenate([asked.at(k)[: len(asked.candidates[k].unit)] for k in question.candidates])
    assert_allclose(np.diag(told)[at], np.diag(asked.precision)[at], **SAME_COLUMNS)
    base = np.arange(asked.plan.n_base)
    strong = np.diag(told)[base] > 1e3  # the prior is not in what rows say
    assert strong.sum() > 5
    assert_allclose(np.diag(told)[base][strong], np.diag(asked.precision)[base][strong], **SAME_COLUMNS)
    assert_allclose(np.diag(declared)[base][strong], np.diag(asked.known)[base][strong], **SAME_COLUMNS)


def test_after_a_friction_that_follows_the_temperature_a_motion_is_as_warm_as_friction_is_declared_at():
    """No motion of seconds tells what follows a temperature, and all else is asked beside it."""
    asked = found_in(measured("thermal_drift", duration=40.0, rate=50.0)).asked
    assert "temperature_friction" in {kind for (kind, _), _ in asked.named}
    t = np.arange(0.0, 5.0, 1.0 / Along(asked, ()).rate)[:, None] * np.array([1.0, 1.1, 1.2])
    told = Along(asked, ()).information((np.sin(t), np.cos(t), -np.sin(t))).declared
    warm = [
        at for e, at in zip(asked.plan.effects, _places(asked.plan), strict=True) if e.kind == "temperature_friction"
    ]
    assert np.diag(told).max() > 0.0
    assert np.all(told[np.concatenate(warm)] == 0.0)


def _places(plan):
    """Where the coefficients of every effect stand among the declared unknowns, all joints one after the other."""
    width, first = plan.n_own, 0
    for effect in plan.effects:
        own = np.arange(first, first + effect.n_columns)
        yield np.concatenate([plan.n_base + j * width + own for j in range(plan.robot.n_joints)])
        first += effect.n_columns


def test_chances_are_those_of_two_gaussians(asked):
    """One coefficient that rows tell directly: the log odds are normal with mean and variance in closed form."""
    k = next(k for k in range(len(asked.candidates)) if len(asked.at(k)) == 1)
    n = asked.plan.n_columns
    at = asked.at(k)[0]
    precision = np.zeros_like(asked.precision)
    precision[np.diag_indices(n)] = 1.0
    nothing = np.zeros((n, n))
    sure, d = 1e8, 4.0  # its size is known, whether it is there is not
    precision[at, at] = sure
    candidates = list(asked.candidates)
    candidates[k] = replace(candidates[k], mean=np.array([1.0]))
    known = replace(
        asked,
        precision=precision,
        candidates=tuple(candidates),
        questions=(Question(Answer((k,), (1.0,)), Answer(), 0.5),),
    )
    told = np.zeros_like(precision)
    told[at, at] = d
    (chance,) = Worth(known, known.questions, nowhere(known)).chances(Told(nothing, told))
    # Under the first answer y ~ N(sqrt(d), 1), under the other N(0, 1): L ~ N(0.5 + d / 2, d), and N(0.5 - d / 2, d).
    assert chance.first == pytest.approx(ndtr((0.5 + d / 2 - SURE) / np.sqrt(d)), abs=DRAWN)
    assert chance.second == pytest.approx(ndtr((-SURE - 0.5 + d / 2) / np.sqrt(d)), abs=DRAWN)
    assert chance.told > 0


def test_no_rows_tell_nothing_and_more_rows_tell_more(asked, designed):
    worth = Worth(asked, asked.questions, nowhere(asked))
    nothing = Told(np.zeros_like(asked.known), np.zeros_like(asked.precision))
    assert all(abs(chance.told) < 1e-6 for chance in worth.chances(nothing))
    assert all(chance.right == 0 for chance in worth.chances(nothing) if abs(chance.log_odds) < SURE)
    along = Along(asked, list(range(len(asked.candidates))))
    t = np.arange(0.0, 10.0, 1 / along.rate)
    told = along.information(designed.trajectory.evaluate(t))
    nats = [worth.nats(told * share) for share in (0.01, 0.1, 1.0)]
    assert nats == sorted(nats)


def test_the_error_beyond_the_noise_is_that_of_what_the_runs_leave_unknown(asked, designed):
    """Parameters are drawn as the runs leave them; what that makes of torques along a motion is counted."""
    at, along = asked.declared(), Along(asked, [])
    t = np.arange(0.0, 10.0, 1 / along.rate)
    motion = designed.trajectory.evaluate(t)
    worth = Worth(asked, (), along.squares(motion))
    precision = asked.known[np.ix_(at, at)]
    unit = 1 / np.sqrt(np.diag(precision))
    root = np.linalg.cholesky(precision * np.outer(unit, unit))
    drawn = np.zeros((4000, asked.plan.n_columns))
    normal = np.random.default_rng(0).standard_normal((len(at), 4000))
    drawn[:, at] = unit * np.linalg.solve(root.T, normal).T
    for j, rows in enumerate(along._fit(motion).observations_.joint_rows()):
        wrong = along._scaled(rows[:, :-1], j) @ drawn[:, asked.plan.unknowns(j)].T / asked.noise[j]
        often = np.quantile(np.sqrt(1 + np.mean(wrong**2, axis=0)) - 1, 0.95)
        assert worth.excess()[j] == pytest.approx(often, rel=0.08)
    more = [worth.excess(along.information(motion) * share) for share in (0.0, 1.0, 100.0)]
    assert_allclose(more[0], worth.excess())
    assert (more[0] > more[1]).all()
    assert (more[1] > more[2]).all()
    assert (more[2] < 0.01).all()


def test_a_motion_is_wanted_until_nothing_is_open_and_only_noise_is_left(designed):
    quiet = replace(designed.excess, now=np.full(3, 0.01))
    closed = [replace(question, log_odds=-2 * SURE) for question in designed.questions]
    assert not replace(designed, questions=tuple(closed), excess=quiet).is_wanted
    loud = replace(designed.excess, now=np.array([0.01, 0.2, 0.01]))
    assert replace(designed, questions=tuple(closed), excess=loud).is_wanted
    likely = replace(designed.expected, chances=tuple(replace(c, right=0.9) for c in designed.expected.chances))
    assert replace(designed, expected=likely, excess=quiet).is_wanted
    unlikely = replace(designed.expected, chances=tuple(replace(c, right=0.1) for c in designed.expected.chances))
    assert not replace(designed, expected=unlikely, excess=quiet).is_wanted


def test_a_known_load_shows_what_depends_on_it(asked):
    q = np.random.default_rng(0).uniform(-1, 1, (1, ROBOT.n_joints))
    still = np.zeros_like(q)
    plain, loaded = (Along(asked, [], load) for load in (0.0, 2.0))
    plan, links = asked.plan, asked.links
    phi = np.zeros((2, 10 * ROBOT.n_joints))
    phi[0, plan.pivots], phi[1, plan.pivots] = plain._links.phi_base_, loaded._links.phi_base_
    whole = np.array(ROBOT.phi)
    whole[-10] += 2.0
    more = ROBOT.inverse_dynamics(q, still, still, whole) - ROBOT.inverse_dynamics(q, still, still)
    seen = ROBOT.inverse_dynamics(q, still, still, phi[1]) - ROBOT.inverse_dynamics(q, still, still, phi[0])
    assert_allclose(seen, more, rtol=1e-9, atol=1e-9)
    assert np.array_equal(plain._links.phi_base_, links.phi_base_)


def test_the_designed_motion_keeps_its_limits_and_is_worth_more_than_others(designed):
    limits = designed.design.limits_
    assert designed.design.merit_.violations(limits) == 0
    assert designed.expected.nats >= designed.random.nats
    assert designed.expected.nats >= designed.exciting.nats
    assert designed.random_times is None or designed.random_times >= 1.0


@pytest.mark.usefixtures("few_draws")
def test_the_same_seed_designs_the_same_motion(found):
    one, again = (designed_after(found, max_iter=5, random_state=1) for _ in range(2))
    assert one.expected.nats > one.exciting.nats  # it was drawn, not the motion from which draws begin
    assert np.array_equal(again.design.x_, one.design.x_)


@pytest.mark.usefixtures("few_draws")
def test_what_it_says_it_settles_it_settles(runs, found, designed):
    """The arm plays the motion; the tie is gone on all runs, and the name is right.

    Two laws of an angle are told the surer the further that goes: near by, the shape of either follows the other.
    """
    wide = designed_within(found, 3.0)
    chance, near = (each.expected.chances[each.questions.index(tie_of(found.asked))] for each in (wide, designed))
    assert chance.right > 0.9
    assert near.right < chance.right
    played = recorded_along(with_effects(rigid(), TIE), wide.trajectory)
    after = dyn.diagnose(ROBOT, [*runs[:-1], played], runs[-1:], after=found.asked)
    assert names(after) == {("joint_spring", ("elbow",))}
    assert names(dyn.diagnose(ROBOT, [*runs[:-1], played], runs[-1:])) == names(after)


def designed_within(found, reach):
    """A motion of 20 s whose elbow and wrist may go further."""
    own = ExcitationLimits.of_robot(ROBOT)
    limits = replace(own, position=np.array([[-1.0], [1.0]]) * [3.0, reach, reach])
    return dyn.next_experiment(found, limits, **QUICK | {"duration": 20.0})


@pytest.fixture(scope="module")
def unnamed():
    """A law that any function of its angle does as well as: its runs and their diagnosis."""
    measurement = measured(LAW, duration=10.0)
    return measurement, found_in(measurement)


@pytest.mark.usefixtures("few_draws")
def test_a_law_without_a_name_is_asked_for_against_any_function(unnamed):
    _, found = unnamed
    (entry,) = (entry for entry in found.entries if entry["kind"] == "unknown")
    assert entry["told_as"] == "position_dependent_friction"
    question = next(q for q in found.asked.questions if q.second.candidates)
    first, second = (
        {found.asked.candidates[k].place for k in answer.candidates} for answer in (question.first, question.second)
    )
    assert first == {("position_dependent_friction", (2,))}
    assert second == {("unknown", (2,))}
    assert question.is_open
    assert sum(question.second.weights) == pytest.approx(1.0)
    section = next_json(designed_after(found, duration=4.0, max_iter=1))
    (said,) = (words(q, 3) for q in section["questions"] if q["or"])
    assert said == "position-dependent friction on wrist or another function of the position of wrist"


@pytest.mark.usefixtures("few_draws")
def test_beyond_the_angles_that_were_seen_a_law_is_told_from_any_function(unnamed):
    runs, found = unnamed
    question = next(q for q in found.asked.questions if q.second.candidates)
    wide = designed_within(found, 3.1)
    assert wide.expected.chances[wide.questions.index(question)].right > 0.9
    played = recorded_along(with_effects(rigid(), LAW), wide.trajectory)
    after = dyn.diagnose(ROBOT, [*runs[:-1], played], runs[-1:], after=found.asked)
    assert names(after) == {("position_dependent_friction", ("wrist",))}


@pytest.mark.parametrize("falls", [2, 3, 4])
def test_a_function_on_a_whole_turn_is_as_rough_within_the_seen_angles_as_one_that_is_made_for_them(unnamed, falls):
    """How much its torque varies along the runs beforehand, and how much that changes with the angle."""
    _, found = unnamed
    catalogue = Catalogue(found.after)
    window, seen = _window(catalogue, 2)
    assert window.n == np.ceil(10 / seen)
    made = waves(catalogue, 2, [own_angle(2)])
    made = smoother(made, falls - 2).columns[2]
    anywhere = _as_rough(waves(catalogue, 2, [own_angle(2)], within=window), seen, falls).columns[2]
    one, other = (part - part.mean(axis=0) for part in (made, anywhere))
    assert np.sum(other**2) == pytest.approx(np.sum(one**2), rel=0.8)
    changes = [np.sum(np.diff(part, axis=0) ** 2) / np.sum(part**2) for part in (one, other)]
    assert changes[1] == pytest.approx(changes[0], rel=0.8)


def test_a_function_may_be_anything_where_the_joint_may_go(unnamed):
    _, found = unnamed
    window, _ = _window(Catalogue(found.after), 2)
    assert window.low <= ROBOT.lower[2]
    assert window.low + window.span >= ROBOT.upper[2]
    assert window.span >= 2 * np.pi


def test_gears_that_two_encoders_see_take_nothing_away_along_a_motion(asked, designed):
    motion = designed.trajectory.evaluate(np.arange(0.0, 10.0, 0.005))
    question = tie_of(asked)
    at = np.concatenate([asked.at(k) for k in question.candidates])
    seen = replace(asked, two_encoders=True)
    more, less = (np.diag(Along(one, question.candidates).information(motion).unknowns)[at] for one in (seen, asked))
    assert np.all(more >= less * (1 - 1e-9))
    assert np.any(more > 1.01 * less)


def test_harmonics_that_fall_keep_the_ends_at_rest():
    series = FourierSeries(5, 10.0)
    x = np.random.default_rng(0).normal(size=(series.n_free, 2))
    assert_allclose(series.falling(x, np.zeros(2)), x, atol=1e-12)
    wide = series.trajectory(series.falling(x, np.full(2, 2.0)), np.zeros(2))
    q, dq, ddq = wide.evaluate(np.array([0.0, 10.0]))
    assert_allclose([q, dq, ddq], 0.0, atol=1e-12)
    plain = series.trajectory(x, np.zeros(2))
    t = np.linspace(0.0, 10.0, 500)
    ways = [np.ptp(one.evaluate(t)[0], axis=0) / np.abs(one.evaluate(t)[1]).max(axis=0) for one in (plain, wide)]
    assert np.all(ways[1] > ways[0])  # further at the same speed


def test_rows_that_would_show_shapes_tell_whether_they_are_there(asked):
    """What a kind could be and does not show speaks against it (`rivals.valued`)."""
    question = tie_of(asked)
    worth = Worth(asked, (question,), nowhere(asked))
    of_shapes = np.concatenate([asked.at(k)[len(asked.candidates[k].unit) :] for k in question.candidates])
    more = np.zeros_like(asked.precision)
    more[of_shapes, of_shapes] = 100.0 * np.diag(asked.precision)[of_shapes]
    (chance,) = worth.chances(Told(np.zeros_like(asked.known), more))
    assert chance.right > 0.9
    assert chance.wrong < 0.1


def test_behind_a_candidate_stands_what_its_torque_changes_by_with_its_shape(found, asked):
    candidate = asked.candidates[tie_of(asked).second.candidates[0]]
    catalogue, own = Catalogue(found.after), Shaped(*candidate.place, candidate.shape)
    (h,) = catalogue.of([own])
    (j,) = candidate.joints
    columns = with_slopes(catalogue, candidate, candidate.mean, {j: h.columns[j] * (candidate.unit / h.unit)})[j]
    slopes = columns[:, len(candidate.unit) :]
    free = free_shape(candidate)
    assert [parameter["name"] for parameter in free] == ["b", "phase", "gas_length"]
    for slope, parameter in zip(slopes.T, free, strict=True):
        name = parameter["name"]
        value = dict(candidate.shape)[name]
        moved = [value + d if name == "phase" else value * (1 + d) for d in (-STEP, STEP)]
        low, high = (catalogue.torque(own.with_shape(name, x), candidate.unit * candidate.mean)[j] for x in moved)
        assert_allclose(slope, SPREAD * (high - low) / (2 * STEP), atol=1e-9 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("kind", "name", "value", "at"), [("counterbalance", "phase", 0.0, 0.1), ("torque_ripple", "cycles", 8.5, 2.3)]
)
def test_cells_about_all_values_of_a_grid_are_even(kind, name, value, at):
    """Together they are as high as one over the step: a shape between two values is as likely as one of them."""
    (parameter,) = (p for p in CATALOGUE[kind]["shape"] if p["name"] == name)
    grid = np.array(parameter["grid"]) if parameter["scale"] == "linear" else np.log(parameter["grid"])
    z = (at - grid) / cell(parameter, value)
    density = np.sum(np.exp(-(z**2) / 2)) / np.sqrt(2 * np.pi) / cell(parameter, value)
    assert density == pytest.approx((len(grid) - 1) / np.ptp(grid), rel=0.15)


def test_a_value_that_stands_alone_in_its_grid_has_the_spread_of_candidates():
    (parameter,) = (p for p in CATALOGUE["counterbalance"]["shape"] if p["name"] == "gas_length")
    assert cell(parameter, -1.5) == SPREAD < cell(parameter, 10.0)


def test_the_search_looks_at_the_least_certain_questions(asked):
    leading = led_by(asked.questions)
    assert tie_of(asked) in leading
    assert len(leading) < len(asked.questions)
    left = [q for q in asked.questions if q not in leading]
    assert max(-abs(q.log_odds) for q in left) <= min(-abs(q.log_odds) for q in leading)


def recorded_along(arm, trajectory):
    """What the arm's recording of a motion holds, with the laboratory's noise."""
    played = simulate(arm, trajectories=[trajectory], n_runs=1, rate=200.0, seed=5).recordings[0]
    return Recording(played.t, played.q, tau=played.tau, name="played", joints=played.joints)


def test_only_what_was_left_open_is_asked_again(runs, found):
    """A place that was refuted is not sought, whatever the new runs say."""
    closed = replace(found.asked, may_pass=frozenset())
    after = dyn.diagnose(ROBOT, runs[:-1], runs[-1:], after=closed)
    assert {entry["kind"] for entry in after.entries} <= {entry["kind"] for entry in found.entries}
    assert not [step for step in after.steps if step["action"] == "added"]


def test_what_was_settled_is_checked(runs, found):
    """A name that the runs do not bear out is dropped."""
    clean = recorded(rigid(), duration=10.0)
    after = dyn.diagnose(ROBOT, clean[:-1], clean[-1:], after=found.asked)
    assert names(after) == set()


@pytest.mark.parametrize("which", ["tie", "law"])
def test_open_questions_survive_the_disk(request, designed, tmp_path, which):
    asked = request.getfixturevalue("asked") if which == "tie" else request.getfixturevalue("unnamed")[1].asked
    path = tmp_path / "open.json"
    path.write_text(json.dumps(to_json(asked)))
    again = read_open(path, RobotFile(tmp_path).robot)
    assert again.questions == asked.questions
    assert again.may_pass == asked.may_pass
    assert_allclose(again.known, asked.known, rtol=1e-7, atol=1e-7 * np.abs(asked.known).max())
    assert_allclose(again.precision, asked.precision, rtol=1e-7, atol=1e-7 * np.abs(asked.precision).max())
    t = np.arange(0.0, 10.0, 0.005)
    motion = designed.trajectory.evaluate(t)
    every = list(range(len(asked.candidates)))
    theirs, ours = (Along(one, every).information(motion).unknowns for one in (again, asked))
    assert_allclose(theirs, ours, rtol=1e-6, atol=1e-6 * np.abs(ours).max())


class RobotFile:
    def __init__(self, folder):
        self.path = folder / "robot.urdf"
        self.path.write_text(URDF)
        self.robot = dyn.RobotModel.from_urdf(self.path)


def function(joint, span, n=1):
    """A candidate without a name, as `open.json` has it."""
    shape = {"low": 0.0, "span": span, "turning": 1.0}
    return {
        "kind": "unknown",
        "joints": [joint],
        "shape": shape,
        "unit": n * [1.0],
        "mean": n * [0.0],
        "instead_of": [],
    }


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda c: c | {"format": "else"}, '"format" must be'),
        (lambda c: c | {"version": 9}, '"version" must be 5, found 9'),
        (lambda c: c | {"joints": ["a"]}, "give the robot file that was diagnosed"),
        (lambda c: c | {"weights": [1.0]}, '"weights" must be 3 finite numbers'),
        (lambda c: c | {"noise": [1.0, 0.0, 1.0]}, '"noise" must be above zero'),
        (lambda c: c | {"weights": [1.0, 2.0, 1e999]}, "not a JSON number"),
        (lambda c: c | {"pivots": [0, 99]}, '"pivots" must be places'),
        (lambda c: c | {"precision": {"scale": [1.0], "upper": [1.0]}}, '"precision.scale" must be'),
        (lambda c: c | {"questions": [{"first": {"candidates": [999], "weights": [1]}}]}, '"candidates" must be'),
        (lambda c: c | {"two_encoders": "no"}, '"two_encoders" must be true or false'),
        (lambda c: c | {"cutoff_hz": 0.0}, '"cutoff_hz" must be'),
        (lambda c: c | {"candidates": [{"kind": "magic"}]}, "its content is not what it should be"),
        (lambda c: c | {"candidates": [function("wrist", 0.0)]}, "a function has a window and units of usual sizes"),
        (lambda c: c | {"candidates": [function("wrist", 5e-324)]}, "a function has a window and units of usual sizes"),
        (lambda c: c | {"weights": [1.0, 2.0, 10**400]}, '"weights" must hold numbers'),
        (lambda c: c | {"candidates": [function("wrist", 1.0, 61)]}, "has 1 to 60 waves"),
        (lambda c: c | {"candidates": [function("nobody", 1.0)]}, "its content is not what it should be"),
        (lambda c: c | {"structure": [{"kind": "gravity_tilt", "joints": [], "value": [1.0]}]}, "has 2 numbers"),
        (lambda c: {k: v for k, v in c.items() if k != "own"}, "own"),
        (lambda c: [], '"format" must be'),
    ],
)
def test_a_damaged_file_is_refused_in_a_sentence(asked, tmp_path, spoil, said):
    path, spoiled = tmp_path / "open.json", spoil(to_json(asked))
    if isinstance(spoiled, dict):
        spoiled |= {"checksum": checksum_of(spoiled)}  # by somebody who knows how it is made
    path.write_text(json.dumps(spoiled))
    with pytest.raises(dyn.DataError) as refused:
        read_open(path, ROBOT)
    assert said in str(refused.value)
    assert str(path) in str(refused.value)
    assert len(str(refused.value)) < 1000


def test_a_file_that_was_changed_is_refused(asked, tmp_path):
    """A scale of zero, a rate of 1e30: what no look at one value finds."""
    path, content = tmp_path / "open.json", to_json(asked)
    for changed in (content | {"cutoff_hz": 1e30}, {k: v for k, v in content.items() if k != "checksum"}):
        path.write_text(json.dumps(changed))
        with pytest.raises(dyn.DataError, match="is not as it was written"):
            read_open(path, ROBOT)


def test_the_gravity_that_is_asked_for_is_taken(asked, tmp_path):
    """Of an arm that leans six digits were told, and refused once more: the same numbers on both sides."""
    path, robot = tmp_path / "open.json", RobotFile(tmp_path)
    leaning = {"gravity": [6.936717523, 0.0, -6.936717523]}
    content = to_json(asked) | leaning
    path.write_text(json.dumps(content | {"checksum": checksum_of(content)}))
    with pytest.raises(dyn.DataError, match=r"and here it is 0,0,-9\.81; give --gravity") as refused:
        read_open(path, robot.robot)
    told = re.search(r"give --gravity (\S+), or", str(refused.value))[1]
    typed = dyn.read_robot(robot.path, gravity=[float(part) for part in told.split(",")])
    assert read_open(path, typed).setup.declared.gravity.tolist() == typed.gravity.tolist()


def test_a_folder_without_open_questions_says_why(tmp_path):
    """A diagnosis with --reference leaves none: it was told to be done again, and left none again."""
    with pytest.raises(FileNotFoundError, match=r"without --reference, which leaves nothing open to ask$"):
        read_open(tmp_path, ROBOT)


def test_kinds_that_no_motion_tells_are_left_to_others(asked):
    for kind in NEEDS_MORE:
        other = replace(asked.candidates[0], kind=kind)
        assert not is_designable(other)


def test_a_diagnosis_that_searched_nothing_is_refused(found):
    with pytest.raises(ValueError, match="has not searched for effects"):
        dyn.next_experiment(replace(found, asked=None))


def test_where_nothing_is_open_it_says_so():
    section = {
        "questions": [],
        "random_times_as_long": None,
        "duration_s": 20.0,
        "error_beyond_noise": {"now": [0.03, 0.01], "this_motion": [0.02, 0.001]},
        "is_wanted": False,
    }
    first, second, third, last = sentences(section, ["a", "b"])
    assert "nothing is open" in first
    assert "sixty-four" in second
    assert "on a, the least known joint, exceeds the noise by at most 3.0\N{NO-BREAK SPACE}% now" in third
    assert "only noise is left" in last
    assert len(sentences(section | {"is_wanted": True}, ["a", "b"])) == 3


@pytest.mark.usefixtures("few_draws")
def test_from_the_command_line(runs, tmp_path):
    """Diagnose, design, and go on, each by the command that the one before names."""
    urdf = RobotFile(tmp_path).path
    files = []
    for run, letter in zip(runs, "abc", strict=True):
        files.append(write_csv(tmp_path / f"{letter}.csv", columns_of(run)))
    result, plan = tmp_path / "result", tmp_path / "next.csv"
    dynid("diagnose", urdf, *files[:2], "--test", files[2], "-o", result)
    said = json.loads((result / "result.json").read_text())["next_experiment"]
    assert any("dynid excite" in sentence and "--after" in sentence for sentence in said)
    quick = ("--duration", 10, "--restarts", 2, "--iterations", 10)
    out = " ".join(dynid("excite", urdf, "-o", plan, "--after", result, *quick).output.split())
    assert "open questions" in out
    section = json.loads(plan.with_suffix(".json").read_text())["next"]
    assert section["nats"]["this_motion"] >= section["nats"]["random_motion"]
    assert "What it will decide" in plan.with_suffix(".html").read_text()
    refused = refusal(dynid("excite", urdf, "-o", tmp_path / "x.csv", "--after", result, "--separate", "a", "b"))
    assert "two aims" in refused
    for option in ("--load", "--budget"):
        assert "--after" in refusal(dynid("excite", urdf, "-o", tmp_path / "x.csv", option, 1))
    # What is refused is refused before anything is searched.
    asks = ("excite", urdf, "-o", tmp_path / "x.csv", "--after", result)
    for option in ("--duration", "--budget"):
        assert f"{option} must be at least" in refusal(dynid(*asks, option, 1.5, "--restarts", 1000))
    assert "leave one out" in refusal(dynid(*asks, "--budget", 10, "--duration", 10))
    assert "--budget must be a time" in refusal(dynid(*asks, "--budget", 0))
    # Nor is a motion designed for an arm that hangs otherwise than the one that was diagnosed.
    assert "give --gravity 0,0,-9.81" in refusal(dynid(*asks, "--gravity", "9.81,0,0", "--restarts", 1000))
    # Another length of the budget is another problem, whose searches are kept beside.
    assert dynid(*asks, "--budget", 8, "--restarts", 1, "--iterations", 2, "--resume").exit_code == 0
    assert not list(tmp_path.glob("x.restarts*"))
    again = tmp_path / "again"
    dynid("diagnose", urdf, *files[:2], "--test", files[2], "-o", again, "--after", result)
    assert json.loads((again / "open.json").read_text())["format"] == "dynid-open"
    refused = refusal(dynid("diagnose", urdf, *files[:2], "-o", tmp_path / "y", "--after", tmp_path))
    assert "open.json" in refused


@pytest.mark.usefixtures("few_draws")
def test_a_budget_takes_the_shortest_motion_that_is_enough(found):
    """Of a quarter, half and all of it."""
    short = dyn.next_experiment(found, budget=48.0, max_iter=1, n_restarts=1, random_state=0)
    assert short.design.duration in (12.0, 24.0, 48.0)
    enough = all(chance.right >= 0.95 for chance in short.expected.chances)
    assert enough or short.design.duration == 48.0


@pytest.mark.usefixtures("few_draws")
def test_searches_of_every_length_of_a_budget_are_kept(found, tmp_path):
    kept = {"state_file": tmp_path / "kept.json", "max_iter": 1, "n_restarts": 1, "random_state": 0}
    first, again = (dyn.next_experiment(found, budget=8.0, **kept) for _ in range(2))
    assert {path.name for path in tmp_path.iterdir()} == {"kept_4s.json", "kept_8s.json"}
    assert again.design.history_ == first.design.history_
    with pytest.raises(ValueError, match=r"^budget must be at least"):
        dyn.next_experiment(found, budget=1.0, **kept)
