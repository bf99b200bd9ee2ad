"""Friction that follows a measured temperature: in a session that warms up, online as offline, and without one."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers import online_answers
from helpers.diagnosed import ROBOT, recorded, rigid
from helpers.online_answers import assert_same_bits, csv_text, from_csv, from_json, json_text
from helpers.online_answers import run as answer_of
from helpers.run_files import write
from helpers.small_arm import dynid, refusal
from numpy.testing import assert_allclose, assert_array_equal

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.diagnosis.hypotheses import Catalogue
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.model.assembly import evaluate
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.runs.splitting import split_runs
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm

estimator = online_answers.estimator
"""The fixture that finds the binary."""

N = 6
LINK_SIDE = ("q", "dq", "ddq")
MISSING = 8


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(str(bundled_robot()))


@pytest.fixture(scope="module")
def session(robot):
    """Four runs of an arm whose friction falls by 30 % as it warms up from run to run, and what was put in."""
    typical = typical_arm(robot)
    (drift,) = build_effects([parse_wish("thermal_drift")], typical)
    arm = equip(replace(typical.rigid(), delay=0.0), [drift])
    runs = simulate(arm, n_runs=4, duration=20, rate=100, seed=0).recordings
    runs = [dyn.Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints, temperature=r.temperature) for r in runs]
    return arm, drift, runs


@pytest.fixture(scope="module")
def fitted(robot, session):
    arm, _, runs = session
    names = [coefficient["name"] for coefficient in CATALOGUE["friction"]["coefficients"]]
    shapes = [dict(zip(names, arm.friction[j], strict=True)) | {"transition_width": 0.01} for j in range(N)]
    effects = [
        PlacedEffect.at("temperature_friction", j, reference_temperature=25.0, **shape)
        for j, shape in enumerate(shapes)
    ]
    return dyn.ThreeLoopIdentifier(robot, residual=None, effects=effects).fit(runs[:3])


def test_a_session_that_warms_up_is_told_by_its_thermometers(robot, session, fitted):
    """On the run that nothing has seen; warmth takes change / 20 K of friction per kelvin."""
    _, drift, runs = session
    without = dyn.ThreeLoopIdentifier(robot, residual=None).fit(runs[:3])

    def error(fit):
        states = fit.states(runs[3])
        left = states.in_band(states.tau - evaluate(fit.model_, states)[0])
        return np.sqrt(np.mean(left**2, axis=0))

    assert np.all(error(fitted)[:3] < 0.5 * error(without)[:3])
    assert np.all(error(fitted) < 1.02 * error(without))
    effect, coefficients = next((e, c) for e, c in fitted.model_.effects if e.kind == "temperature_friction")
    assert effect.coefficient_names == ["friction_per_kelvin"]
    assert_allclose(coefficients[:, 0], drift.change / 20.0, rtol=0.1)


def test_it_is_looked_for_where_thermometers_move(fitted):
    """On every joint; not where one is stuck, and not at all where there is none."""
    whole = Catalogue(fitted).runs

    def joints(runs):
        catalogue = Catalogue(fitted)
        catalogue.runs = runs
        return sorted({h.joints for h in catalogue.grid if h.kind == "temperature_friction"})

    assert joints(whole) == [(j,) for j in range(N)]
    stuck = [states.temperature.copy() for states in whole]
    for temperature in stuck:
        temperature[:, 2] = 31.5
    assert joints([replace(s, temperature=t) for s, t in zip(whole, stuck, strict=True)]) == [
        (j,) for j in range(N) if j != 2
    ]
    assert joints([*whole[1:], replace(whole[0], temperature=None)]) == []


def test_states_carry_the_temperature_on_their_grid(session):
    _, _, runs = session
    states = prepare(runs[0], Band(5.0), 100.0)
    expected = np.stack([np.interp(states.t, runs[0].t, column) for column in runs[0].temperature.T], axis=1)
    assert_allclose(states.temperature, expected, rtol=1e-12)
    assert prepare(replace(runs[0], temperature=None), Band(5.0), 100.0).temperature is None


def test_a_run_without_temperature_is_refused_offline(robot, session, fitted, tmp_path):
    _, _, runs = session
    cold = [replace(run, temperature=None) for run in runs]
    with pytest.raises(ValueError, match="follows a measured temperature, which was not given"):
        fitted.predict(cold[0])
    with pytest.raises(ValueError, match="temperature_friction needs temperature, which was not given"):
        dyn.ThreeLoopIdentifier(robot, residual=None, effects=fitted.effects).fit(cold[:3])
    fitted.model_.save(tmp_path / "model.json")
    columns = {"t": cold[0].t} | {f"q_{j}": cold[0].q[:, j] for j in range(N)}
    path = write(tmp_path / "cold.parquet", columns)
    words = refusal(dynid("estimate", tmp_path / "model.json", path))
    assert "cold.parquet: the model's friction follows the joints' temperature, which the run does not hold" in words


def test_the_binary_gives_the_bits_of_python(estimator, session, fitted, tmp_path):
    """By hand, and through the states that `dynid estimate` writes."""
    _, _, runs = session
    model, path = fitted.model_, tmp_path / "model.json"
    model.save(path)
    states = prepare(runs[1], Band(5.0), 100.0)
    shown = dict(zip(LINK_SIDE, states.signals(), strict=False)) | {"temperature": states.temperature}
    total = model.evaluate(**shown)[0]
    names = model.term_names
    assert_same_bits(from_csv(answer_of(estimator, path, csv_text(shown)), names, N).total, total)
    assert_same_bits(from_json(answer_of(estimator, path, json_text(shown)), names, N).total, total)
    columns = {"t": runs[1].t}
    for signal in ("q", "temperature"):
        columns |= {f"{signal}_{j}": getattr(runs[1], signal)[:, j] for j in range(N)}
    run, out = write(tmp_path / "run.parquet", columns), tmp_path / "out.parquet"
    assert dynid("estimate", path, run, "-o", out, "--states", tmp_path / "states.csv").exit_code == 0
    answers = from_csv(answer_of(estimator, path, (tmp_path / "states.csv").read_text()), names, N)
    import pyarrow.parquet as pq

    table = pq.read_table(out)
    assert_array_equal(answers.total, np.stack([table[f"tau_{j}"].to_numpy() for j in range(N)], axis=1))


def test_online_a_missing_temperature_stops_nothing(estimator, session, fitted, tmp_path):
    _, _, runs = session
    model, path = fitted.model_, tmp_path / "model.json"
    model.save(path)
    states = prepare(runs[1], Band(5.0), 100.0)
    shown = dict(zip(LINK_SIDE, (x[:50] for x in states.signals()), strict=False))
    warm = {**shown, "temperature": states.temperature[:50]}
    _, terms, status = model.evaluate(**warm)
    at = model.term_names.index("temperature_friction")
    assert np.all(np.any(terms[:, at] != 0, axis=1))

    answers = from_csv(answer_of(estimator, path, csv_text(shown)), model.term_names, N)
    assert_array_equal(answers.terms[:, at], 0.0)
    assert_same_bits(np.delete(answers.terms, at, axis=1), np.delete(terms, at, axis=1))
    assert_array_equal(answers.status, status | MISSING)

    gone = warm["temperature"].copy()
    gone[10:20, 1] = np.nan
    answers = from_csv(answer_of(estimator, path, csv_text({**shown, "temperature": gone})), model.term_names, N)
    expected = terms.copy()
    expected[10:20, at, 1] = 0.0
    assert_array_equal(answers.terms, expected)
    assert_array_equal(answers.status & MISSING, MISSING * np.isin(np.arange(50), np.arange(10, 20)))

    lines = json_text(warm).splitlines()
    for k in range(10, 20):
        lines[k] = json.dumps({key: value for key, value in json.loads(lines[k]).items() if key != "temperature"})
    answers = from_json(answer_of(estimator, path, "\n".join(lines) + "\n"), model.term_names, N)
    expected[10:20, at] = 0.0
    assert_array_equal(answers.terms, expected)


def test_the_part_that_is_kept_aside_is_as_warm_as_the_run_made_it():
    """A lone run is cut in two: what the model remembers at the cut is the run's, not that of a cold start."""
    arm = equip(rigid(ROBOT), build_effects([parse_wish("thermal_friction:wrist:3")], typical_arm(ROBOT)))
    (run,) = recorded(arm, n_runs=1, duration=30.0, rate=100.0)
    split = split_runs([run], [])
    warm = PlacedEffect(
        "thermal_friction",
        (2,),
        (("time_constant", (20.0,)), ("reference_speed", (0.0,)), ("transition_width", (0.02,))),
    )
    fit = Setup(ROBOT, effects=(warm,)).identifier(residual=None).fit(split.train)
    (kept_aside,) = split.test
    whole, part, cold = (fit.states(r) for r in (run, kept_aside, replace(kept_aside, before=None)))
    torque = evaluate(fit.model_, whole)[0][-len(part.t) :, 2]
    inside = slice(len(part.t) // 4, 3 * len(part.t) // 4)  # where no filter's end is near
    size = np.abs(torque).max()
    assert np.abs(evaluate(fit.model_, part)[0][inside, 2] - torque[inside]).max() < 1e-3 * size
    assert np.abs(evaluate(fit.model_, cold)[0][inside, 2] - torque[inside]).max() > 0.02 * size
