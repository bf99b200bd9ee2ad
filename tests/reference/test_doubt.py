"""How well a reference is known: its covariance on the way to a file and back, and in what is told against it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from helpers.run_files import write
from helpers.small_arm import URDF, dynid, study
from load_coverage import drawn_arm, drawn_tool, held, weighed
from numpy.testing import assert_allclose
from threadpoolctl import threadpool_limits

from dynid_rs import (
    DataError,
    Doubt,
    RobotModel,
    ThreeLoopIdentifier,
    TorqueModel,
    _core,
    parameter_directions,
    read_recording,
)
from dynid_rs.identification.directions import directions_of
from dynid_rs.identification.doubt import _root
from dynid_rs.model.assembly import evaluate, with_changes
from dynid_rs.reference import compare, weigh_load
from dynid_rs.simulation import Tracking, simulate, typical_arm
from dynid_rs.simulation.folder import run_columns

LITTLE, MUCH = 7.0, 40.0
"""Seconds of each of two runs: learned from, and weighed on."""
SHIFTED = 8
"""Seed."""
DRAWS = (501, 505)
"""As if the reference had been learned from as much as is weighed, 7 of their 20 intervals missed, and nothing on the
flange had a chance of 1e-7 and 6e-10."""


def test_little_learned_and_much_weighed_is_told_as_it_is():
    hits, chances = [], []
    for seed in DRAWS:
        hits.append(held(*weighed(seed, elastic=False, duration=LITTLE, loaded_for=MUCH)))
        nothing, _ = weighed(seed, elastic=False, carried=False, duration=LITTLE, loaded_for=MUCH)
        chances.append(nothing.p_value)
    print(np.mean(hits), chances)
    assert np.mean(hits) >= 0.9
    assert min(chances) > 0.01


@pytest.fixture(scope="module")
def fitted():
    robot = RobotModel.from_urdf_string(URDF)
    runs = simulate(typical_arm(robot).rigid(), n_runs=2, duration=10.0, rate=200.0, seed=4).recordings
    return ThreeLoopIdentifier(robot, residual=None).fit(list(runs))


def test_a_load_is_named_that_the_model_could_take_if_its_doubts_were_greater():
    """2 kg, which shifts of parameters far beyond their errors explain almost as well."""
    rng = np.random.default_rng([SHIFTED, True])
    arm, tool = drawn_arm(rng, elastic=True), drawn_tool(rng)
    loaded = replace(arm, phi=arm.phi + np.pad(tool, (len(arm.phi) - len(tool), 0)))
    with threadpool_limits(1):
        learned, runs = (
            simulate(one, n_runs=2, duration=seconds, seed=2 * SHIFTED + later, tracking=Tracking()).recordings
            for later, (one, seconds) in enumerate([(arm, 12.0), (loaded, 13.0)])
        )
        fit = ThreeLoopIdentifier(arm.robot, residual=None).fit(learned)
        named = compare(fit.model_, arm.robot, runs, doubt=Doubt.of(fit)).effects
    assert [effect["kind"] for effect in named] == ["payload"]
    mass = named[0]["parameters"][0]["interval"]
    assert mass[0] < tool[0] < mass[1]


def test_a_doubt_survives_its_file(fitted):
    doubt = Doubt.of(fitted)
    again = Doubt.from_json(json.loads(json.dumps(doubt.to_json())), fitted.model_)
    scale = np.sqrt(np.diag(doubt.covariance))
    assert_allclose(again.covariance, doubt.covariance, atol=1e-8 * np.outer(scale, scale).max())
    assert_allclose(again.covariance / np.outer(scale, scale), doubt.covariance / np.outer(scale, scale), atol=2e-8)
    assert again.widths == doubt.widths
    assert again.pivots.tolist() == doubt.pivots.tolist()
    assert again.is_of(fitted.model_, fitted.links_.phi_base_)


def test_contacts_get_the_same_directions_from_it(fitted):
    model, doubt = fitted.model_, Doubt.from_json(Doubt.of(fitted).to_json(), fitted.model_)
    ours = directions_of(doubt.covariance, doubt.plan(model), model, np.asarray(model.noise_std))
    theirs = parameter_directions(fitted)
    assert_allclose(ours.kept, theirs.kept, rtol=1e-6)
    # Directions of one size may change places and signs: what they tell together is the same.
    scale = np.abs(theirs.phi).max(axis=0)
    assert_allclose(ours.phi.T @ ours.phi, theirs.phi.T @ theirs.phi, atol=1e-6 * np.outer(scale, scale).max())


def test_columns_are_what_the_model_makes_of_the_parameters(fitted):
    """The torque of a model with one direction of the root added, less that of the model."""
    doubt, model = Doubt.of(fitted), fitted.model_
    states = fitted.runs_[0]
    columns, root = doubt.columns(model, states), _root(doubt.covariance)
    n, n_base = model.robot.n_joints, len(doubt.pivots)
    for k in (0, root.shape[1] // 2, root.shape[1] - 1):
        step = root[:, k]
        phi = np.array(model.phi)
        phi[doubt.pivots] += step[:n_base]
        own = step[n_base:].reshape(n, -1)
        effects, first = [], 0
        for effect, values in model.effects[: len(doubt.widths)]:
            effects.append((effect, values + own[:, first : first + effect.n_columns]))
            first += effect.n_columns
        moved = with_changes(model, phi=phi, effects=[*effects, *model.effects[len(doubt.widths) :]])
        change = states.in_band(evaluate(moved, states)[0] - evaluate(model, states)[0])
        assert_allclose(columns[:, :, k], change, atol=1e-6 * np.abs(change).max())


def test_what_saturates_has_the_column_of_all_that_the_motor_gives(fitted):
    """Its torque is the cube of all others' together."""
    model, states = fitted.model_, fitted.runs_[0]
    n = model.robot.n_joints
    saturation = _core.Effect.of("torque_saturation")
    own, pivots = np.full((n, 1), -1e-6), Doubt.of(fitted).pivots
    saturated = with_changes(model, effects=[*model.effects, (saturation, own)])
    widths = tuple(effect.n_columns for effect, _ in saturated.effects)
    std = np.zeros(len(pivots) + n * sum(widths))
    std[len(pivots) + sum(widths) - 1] = 1e-7  # the first joint's own, alone
    (column,) = Doubt(pivots, widths, np.diag(std**2)).columns(saturated, states).transpose(2, 0, 1)
    more = with_changes(model, effects=[*model.effects, (saturation, own + 1e-7 * np.eye(n)[:, :1])])
    change = states.in_band(evaluate(more, states)[0] - evaluate(saturated, states)[0])
    assert np.abs(change).max() > 0
    assert_allclose(column, change, atol=1e-6 * np.abs(change).max())


@pytest.mark.parametrize(
    "spoilt",
    [
        {"pivots": [0.5]},
        {"pivots": [10**6]},
        {"columns": [1]},
        {"columns": 3},
        {"std_error": [-1.0]},
        {"std_error": [float("nan")]},
        {"correlation": [2.0]},
        {"correlation": None},
    ],
)
def test_what_is_no_covariance_of_the_model_is_refused(fitted, spoilt):
    with pytest.raises(DataError, match=r"`covariance` is damaged, or of another model"):
        Doubt.from_json(Doubt.of(fitted).to_json() | spoilt, fitted.model_)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """A run of the small arm with 1.5 kg at its hand."""
    path = tmp_path_factory.mktemp("doubt") / "loaded.parquet"
    arm = typical_arm(RobotModel.from_urdf_string(URDF)).rigid()
    phi = np.array(arm.phi)
    phi[-10:] += [1.5, 0.03, 0.0, 0.06, 0.01, 0.0, 0.0, 0.01, 0.0, 0.01]
    run = simulate(replace(arm, phi=phi), n_runs=1, duration=10, seed=9).recordings[0]
    write(path, run_columns(run))
    return path


def test_errors_without_a_load_are_not_those_of_a_model_that_doubts_itself(fitted, loaded):
    """Beside the friction and the offsets of that day only: what the model leaves open may look like half of a load."""
    run = read_recording(loaded)
    alone, doubted = (weigh_load(fitted.model_, [run], doubt=doubt) for doubt in (None, Doubt.of(fitted)))
    assert_allclose(doubted.rmse_before, alone.rmse_before, rtol=1e-9)
    assert_allclose(doubted.rmse_after, alone.rmse_after, rtol=0.2)


def told(model, run):
    return json.loads(dynid("payload", model, run, "--json").stdout)


def test_the_command_reads_what_lies_beside_the_model(tmp_path, loaded):
    folder = study().output
    alone = tmp_path / "model.json"
    shutil.copy(folder / "model.json", alone)
    known, lone = told(folder, loaded), told(alone, loaded)
    assert known == told(folder / "model.json", loaded)
    widths = [np.diff(answer["load"][0]["interval"]) for answer in (known, lone)]
    assert widths[0] != widths[1]
    assert "reference_alone" not in [one["code"] for one in known["findings"]]
    (finding,) = (one for one in lone["findings"] if one["code"] == "reference_alone")
    assert "identify again where its result.json has none, and leave both in one folder" in finding["message"]


def test_a_folder_of_an_earlier_version_is_told_to_be_made_again(tmp_path, loaded):
    """Its model is in the folder that `dynid identify` wrote, and leaving it there is no mend."""
    shutil.copytree(study().output, tmp_path / "earlier")
    result = study().result
    del result["covariance"]
    (tmp_path / "earlier" / "result.json").write_text(json.dumps(result))
    (finding,) = (one for one in told(tmp_path / "earlier", loaded)["findings"] if one["code"] == "reference_alone")
    assert "no `covariance` beside the model" in finding["message"]
    assert "identify again where its result.json has none" in finding["message"]


def test_the_result_of_another_model_says_nothing(tmp_path, loaded):
    folder = study().output
    shutil.copytree(folder, tmp_path / "copy")
    model = TorqueModel.load(folder / "model.json")
    with_changes(model, phi=1.01 * np.asarray(model.phi)).save(tmp_path / "copy" / "model.json")
    assert "reference_alone" in [one["code"] for one in told(tmp_path / "copy", loaded)["findings"]]
