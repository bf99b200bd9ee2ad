"""What `identify` must not swallow: dead channels, joints that only shake, lost inputs, useless models."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.run_files import write
from helpers.small_arm import dynid, refusal, run, snapshot, write_robot, write_runs


def spoiled(folder, change):
    """Two training runs and a test run, each changed in place."""
    robot = write_robot(folder)
    paths = []
    for k in range(3):
        columns = run(k)
        change(columns, k)
        paths.append(write(folder / f"run_{k}.parquet", columns))
    return ("identify", robot, *paths[:2], "--test", paths[2], "-o", folder / "out")


@pytest.mark.parametrize(
    ("arguments", "before"),
    [
        (("identify", "robot.urdf", "run.csv", "-o", ""), "-o"),
        (("identify", "robot.urdf", "run.csv", "--output="), "--output"),
        (("inspect", ""), "inspect"),
        (("estimate", "model.json", ""), "model.json"),
    ],
)
def test_an_empty_argument_is_no_folder(tmp_path, monkeypatch, arguments, before):
    """A variable of the shell that is not set wrote its result into the folder that the shell stood in."""
    monkeypatch.chdir(tmp_path)
    assert refusal(dynid(*arguments)).startswith(f"an empty argument stands after {before}; give it a value")
    answer = json.loads(dynid(*arguments, "--json").stdout)
    assert answer["error"]["class"] == "ValueError"
    assert list(tmp_path.iterdir()) == []


def test_a_torque_channel_that_is_dead(tmp_path):
    def change(columns, k):
        columns["tau_1"][:] = -0.0

    sentence = refusal(dynid(*spoiled(tmp_path, change)))
    assert "torque of joint elbow is 0 in every row" in sentence
    assert not (tmp_path / "out").exists()


def test_a_test_run_whose_torque_is_dead(tmp_path):
    def change(columns, k):
        if k == 2:
            columns["tau_0"][:] = 7.5

    assert "run_2.parquet: the torque of joint shoulder is 7.5" in refusal(dynid(*spoiled(tmp_path, change)))


def test_a_locked_joint_that_shakes_with_encoder_noise(tmp_path):
    rng = np.random.default_rng(0)

    def change(columns, k):
        columns["q_2"][:] = 0.3 + 2e-4 * rng.normal(size=len(columns["t"]))

    sentence = refusal(dynid(*spoiled(tmp_path, change)))
    assert "joint wrist never moves" in sentence
    assert not (tmp_path / "out").exists()


def test_a_run_that_a_result_would_replace(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    precious = runs[0].rename(tmp_path / "residuals.parquet")
    before = snapshot(tmp_path)
    sentence = refusal(dynid("identify", robot, precious, runs[1], "--test", runs[2], "-o", tmp_path))
    assert "is read here and would be replaced" in sentence
    assert snapshot(tmp_path) == before


def test_exchanged_torque_columns_end_in_no(tmp_path):
    def change(columns, k):
        if k == 2:
            columns["tau_1"], columns["tau_2"] = columns["tau_2"], columns["tau_1"]

    result = dynid(*spoiled(tmp_path, change))
    assert result.exit_code == 1
    verdict = json.loads((tmp_path / "out" / "result.json").read_text())["verdict"]
    assert "the error is as large as the torque itself" in verdict


def test_at_rest_the_model_does_not_chatter(tmp_path):
    """Transition widths stay above the velocity's noise, so noise at rest is not friction of full size."""
    from dynid_rs import RobotModel, ThreeLoopIdentifier, read_recording

    robot = RobotModel.from_urdf(write_robot(tmp_path))
    identifier = ThreeLoopIdentifier(robot, residual=None).fit(
        [read_recording(path, robot) for path in write_runs(tmp_path)]
    )
    noise = [max(states.velocity_noise(j) for states in identifier.runs_) for j in range(3)]
    assert np.all(identifier.friction_.transition_width_ >= np.maximum(noise, 1e-3))
