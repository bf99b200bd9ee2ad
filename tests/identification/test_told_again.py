"""What a result claims, `dynid estimate` with the saved model says of the same file, to the last digit."""

import json

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, SIX_AXES, columns_of, measured
from helpers.run_files import write
from helpers.small_arm import URDF, dynid, refusal, run, study

from dynid_rs import RobotModel, TorqueModel
from dynid_rs.base.numbers import significant
from dynid_rs.simulation import bundled_robot

LATE = "torque_delay::2"


def early(columns, seconds):
    """The same run with its torque channel early by so many seconds."""
    t = columns["t"]
    return {n: np.interp(t + seconds, t, x) if n.startswith("tau_") else x for n, x in columns.items()}


def diagnosed(folder, runs, *options, urdf=URDF):
    """Diagnose runs through the command line, the last of them for testing; result.json."""
    robot = folder / "robot.urdf"
    robot.write_text(urdf)
    paths = [write(folder / f"run_{k}.parquet", columns) for k, columns in enumerate(runs)]
    done = dynid("diagnose", robot, *paths[:-1], "--test", paths[-1], "-o", folder / "found", *options)
    assert done.exit_code in (0, 1), done.output
    return json.loads((folder / "found" / "result.json").read_text()), paths


def told(model, path, *options):
    """What `dynid estimate` says of a file."""
    return json.loads(dynid("estimate", model, path, "--json", *options).stdout)


def excluded(result, name):
    """The times that a result leaves out of a run, as options."""
    windows = result["data"].get("excluded", {}).get(name, [])
    return [option for start, end in windows for option in ("--exclude", f"{start!r}:{end!r}")]


def assert_told_again(result, folder, paths):
    """The after-error of every test run by both commands; with one test run, the headline."""
    (entry,) = result["rmse"]["by_run"]
    again = told(folder / "found" / "model.json", paths[-1], *excluded(result, entry["run"]))
    assert again["rmse_in_band"] == entry["after"] == result["rmse"]["test"]["after"]
    assert entry["before"] == result["rmse"]["test"]["before"]


def kinds(result):
    return {entry["kind"] for entry in result["effects"]}


def test_a_late_torque_channel(tmp_path):
    runs = [columns_of(recording) for recording in measured(LATE, seed=3)]
    result, paths = diagnosed(tmp_path, runs)
    assert kinds(result) == {"torque_delay"}
    model = TorqueModel.load(tmp_path / "found" / "model.json")
    assert model.torque_delay == pytest.approx(0.01, abs=2e-3)
    test = result["rmse"]["test"]
    assert np.any(np.array(test["after"]) < 0.7 * np.array(test["before"])), (
        "the delay should have been worth something"
    )
    assert_told_again(result, tmp_path, paths)
    said = dynid("estimate", tmp_path / "found" / "model.json", paths[-1]).stdout
    for error in test["after"]:
        assert f"{significant(error)} N*m (in motion, below 5 Hz, as in result.json)" in said


def test_one_torque_channel_that_is_late_by_itself(tmp_path):
    runs, delay = [columns_of(recording) for recording in measured(seed=3)], 0.01
    for columns in runs:
        columns["tau_1"] = early(columns, -delay)["tau_1"]
    result, paths = diagnosed(tmp_path, runs)
    assert [(entry["kind"], entry["joints"]) for entry in result["effects"]] == [("torque_delay", ["elbow"])]
    model = TorqueModel.load(tmp_path / "found" / "model.json")
    np.testing.assert_allclose(model.torque_delay, [0.0, delay, 0.0], atol=2e-3)
    test = result["rmse"]["test"]
    assert test["after"][1] < 0.7 * test["before"][1]
    assert_told_again(result, tmp_path, paths)


def test_an_early_torque_channel(tmp_path):
    """Offline the states that the channel shows the torque of stand in the record."""
    runs = [early(columns_of(recording), 0.01) for recording in measured(seed=3)]
    result, paths = diagnosed(tmp_path, runs)
    assert kinds(result) == {"torque_delay"}
    assert TorqueModel.load(tmp_path / "found" / "model.json").torque_delay == pytest.approx(-0.01, abs=2e-3)
    test = result["rmse"]["test"]
    assert np.any(np.array(test["after"]) < 0.7 * np.array(test["before"]))
    assert_told_again(result, tmp_path, paths)


@pytest.mark.parametrize("wish", ["torque_gain:elbow:3", "gravity_tilt::2"])
def test_a_gain_and_a_tilt(tmp_path, wish):
    runs = [columns_of(recording) for recording in measured(wish)]
    result, paths = diagnosed(tmp_path, runs)
    assert kinds(result) == {wish.split(":")[0]}
    assert_told_again(result, tmp_path, paths)


def test_an_encoder_that_is_not_centred(tmp_path):
    """What needs six axes to be seen."""
    wish = "encoder_eccentricity:1:4"
    runs = [columns_of(recording) for recording in measured(wish, robot=SIX_AXES, duration=25.0, rate=100.0)]
    result, paths = diagnosed(tmp_path, runs, urdf=bundled_robot().read_text())
    assert kinds(result) == {wish.split(":")[0]}
    assert_told_again(result, tmp_path, paths)


def test_another_mounting(tmp_path):
    """The arm hangs from the ceiling, the robot file says that it stands."""
    hanging = RobotModel.from_urdf_string(URDF, gravity=(0.0, 0.0, 9.81))
    runs = [columns_of(recording) for recording in measured(robot=hanging, seed=3)]
    result, paths = diagnosed(tmp_path, runs)
    assert TorqueModel.load(tmp_path / "found" / "model.json").robot.gravity[2] > 0 > ROBOT.gravity[2]
    assert_told_again(result, tmp_path, paths)


def test_a_pushed_run_is_told_without_what_it_leaves_out(tmp_path):
    runs = [columns_of(recording) for recording in measured(seed=3)]
    t = runs[-1]["t"]
    push = 15.0 * np.exp(-(((t - 6.0) / 0.15) ** 2))
    runs[-1] = runs[-1] | {"tau_1": runs[-1]["tau_1"] + push}
    result, paths = diagnosed(tmp_path, runs)
    (name,) = result["data"]["excluded"]
    assert name == "run_2.parquet"
    assert_told_again(result, tmp_path, paths)
    whole = told(tmp_path / "found" / "model.json", paths[-1])
    assert whole["rmse_in_band"][1] > result["rmse"]["test"]["after"][1]


@pytest.mark.parametrize("encoders", [1, 2])
def test_identify(encoders):
    done = study(encoders)
    again = told(done.model, done.runs[2])
    (entry,) = done.result["rmse"]["by_run"]
    assert again["rmse_in_band"] == entry["after"] == done.result["rmse"]["test"]["after"]
    assert again["cutoff_hz"] == done.result["data"]["cutoff_hz"]


def test_the_last_third_of_a_lone_run(tmp_path):
    robot = tmp_path / "robot.urdf"
    robot.write_text(URDF)
    path = write(tmp_path / "run.parquet", run(0, duration=12.0))
    dynid("identify", robot, path, "-o", tmp_path / "out")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    (start,) = (f["value"] for f in result["data"]["findings"] if f["code"] == "test_part_chosen")
    again = told(tmp_path / "out" / "model.json", path, "--test-from", repr(start))
    assert again["rmse_in_band"] == result["rmse"]["test"]["after"]


@pytest.mark.parametrize("words", ["3", "3:2", "a:b", "1:inf", "1:2:3", " "])
def test_times_that_are_none(words):
    sentence = refusal(dynid("estimate", study().model, study().runs[2], "--exclude", words))
    assert sentence == f"--exclude must be START:END in seconds, START before END, found {words!r}"


@pytest.mark.parametrize("words", ["-2:-1", "100:200"])
def test_times_outside_of_the_run_are_refused(words):
    sentence = refusal(dynid("estimate", study().model, study().runs[2], "--exclude", words))
    assert sentence == f"--exclude {words} lies outside of run_2.parquet (0 to 8 s)"


def test_a_model_that_says_no_band_and_a_run_too_short_for_it(tmp_path):
    old = json.loads(study().model.read_text())
    model = TorqueModel.load(study().model)
    bare = TorqueModel(
        model.robot, model.phi, model.effects, encoder_delay=[0.0] * 3, noise_std=[1.0] * 3, domain=model.domain
    )
    bare.save(tmp_path / "bare.json")
    assert (old["version"], json.loads((tmp_path / "bare.json").read_text())["version"]) == (2, 1)
    said = dynid("estimate", tmp_path / "bare.json", study().runs[2]).stdout
    assert "no error in the band of result.json: the model does not say in which band" in said
    short = write(tmp_path / "short.parquet", {name: x[:100] for name, x in run(0).items()})
    done = dynid("estimate", study().model, short, "--cutoff", 20)
    assert done.exit_code == 0
    assert "no error in the band of result.json: short.parquet: 0.5 s are too short" in done.stdout
