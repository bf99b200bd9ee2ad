"""What `identify` must not swallow: dead channels, joints that only shake, lost inputs, useless models."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.run_files import write
from helpers.small_arm import dynid, refusal, run, snapshot, write_robot, write_runs

from dynid_rs import Config, DataError, RobotModel
from dynid_rs.archive.runs import RunFile


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


def same_names(folder):
    """The robot, and three runs of one name in three folders."""
    for k in range(3):
        (folder / f"day_{k}").mkdir()
    return write_robot(folder), [write(folder / f"day_{k}" / "run.csv", run(k)) for k in range(3)]


BROKEN = {
    "no run": (".csv", lambda content: b"not a run\n", None),
    "no number": (".csv", lambda content: content.replace(b"\n0.005,", b"\nx,", 1), 1),
    "no JSON": (".jsonl", lambda content: b"{\n", None),
    "cut": (".parquet", lambda content: content[: len(content) // 2], None),
    "no archive": (".npz", lambda content: b"nothing", None),
}


@pytest.mark.parametrize(("suffix", "damage", "row"), BROKEN.values(), ids=BROKEN)
def test_of_files_of_one_name_the_broken_one_is_told(tmp_path, suffix, damage, row):
    """Whichever of them it was, the sentence said `run.csv`."""
    robot, paths = same_names(tmp_path)
    content = write(paths[1].with_suffix(suffix if suffix != ".jsonl" else ".csv"), run(1)).read_bytes()
    paths[1] = paths[1].with_suffix(suffix)
    paths[1].write_bytes(damage(content))
    name, output = f"day_1/run{suffix}", tmp_path / "out"
    assert refusal(dynid("init", robot, *paths, "-o", tmp_path / "dynid.toml")).startswith(name)
    inspected = dynid("inspect", "--robot", robot, *paths)
    assert inspected.stderr.startswith(f"error: {name}")
    assert "day_0/run.csv\n" in inspected.stdout
    refused = dynid("identify", robot, *paths[:2], "--test", paths[2], "-o", output, "--json")
    error = json.loads(refused.stdout)["error"]
    assert refused.stderr == f"error: {error['message']}\n"
    assert error["message"].startswith(name)
    assert (error["file"], error.get("row")) == (name, row)


def test_a_lone_file_is_called_by_its_own_name(tmp_path):
    robot, paths = same_names(tmp_path)
    paths[1].write_text("not a run\n")
    assert dynid("inspect", paths[1]).stderr.startswith("error: run.csv: column q_0 is missing")
    other = paths[0].rename(paths[0].with_name("other.csv"))
    said = refusal(dynid("identify", robot, other, paths[1], "-o", tmp_path / "out"))
    assert said.startswith("run.csv: column q_0 or q_shoulder is missing")


def test_a_part_is_read_from_the_file_that_its_name_says(tmp_path):
    robot, paths = same_names(tmp_path)
    paths[1].write_text("not a run\n")
    model = RobotModel.from_urdf(robot)
    part = RunFile(paths[1], "day_1/run.csv (part 2 of 2)", model, Config(), part=1, n_parts=2)
    with pytest.raises(DataError, match=r"^day_1/run\.csv: column q_0 or q_shoulder is missing") as caught:
        part.read()
    assert caught.value.file == "day_1/run.csv"


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
    from dynid_rs import ThreeLoopIdentifier, read_recording

    robot = RobotModel.from_urdf(write_robot(tmp_path))
    identifier = ThreeLoopIdentifier(robot, residual=None).fit(
        [read_recording(path, robot) for path in write_runs(tmp_path)]
    )
    noise = [max(states.velocity_noise(j) for states in identifier.runs_) for j in range(3)]
    assert np.all(identifier.friction_.transition_width_ >= np.maximum(noise, 1e-3))
