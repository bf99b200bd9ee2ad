"""Plans that a controller plays: read, checked, made smooth, played, and written beside what happened."""

import json

import numpy as np
import pytest
import typer
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import BPoly
from typer.testing import CliRunner

from dynid_rs import _core
from dynid_rs.commands.simulate import simulate as command
from dynid_rs.runs.readers import read_recording
from dynid_rs.simulation import bundled_robot, motion_limits, random_trajectory, read_plan


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def planned(robot):
    """t, q, dq, ddq of a motion with zero start and end."""
    trajectory = random_trajectory(motion_limits(robot), 6.0, np.random.default_rng(2))
    t = np.arange(0.0, 5.0 + 1e-9, 0.01)
    return t, *trajectory.evaluate(np.clip(t + trajectory.rest, trajectory.rest, trajectory.duration - trajectory.rest))


def columns_of(planned, joints=None):
    t, *signals = planned
    joints = joints or range(signals[0].shape[1])
    columns = {"t": t}
    for name, values in zip(("q", "dq", "ddq"), signals, strict=True):
        columns |= {f"{name}_{joint}": values[:, k] for k, joint in enumerate(joints)}
    return columns


def write_plan(path, columns):
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.fixture
def plan_file(tmp_path, planned):
    return write_plan(tmp_path / "plan.csv", columns_of(planned))


@pytest.fixture(scope="module")
def run_command():
    app = typer.Typer()
    app.command()(command)
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_samples_come_back_and_rests_lie_around_them(robot, planned, plan_file):
    plan = read_plan(plan_file, robot)
    t, q, dq, ddq = planned
    assert plan.duration == 6.0
    for value, expected in zip(plan.evaluate(t[1:-1] + 0.5), (q, dq, ddq), strict=True):
        assert_allclose(value, expected[1:-1], rtol=0, atol=1e-9 * np.abs(expected).max())
    for rest, row in (([-1.0, 0.0, 0.5], 0), ([5.5, 6.0, 9.0], -1)):
        at, still, calm = plan.evaluate(np.array(rest))
        assert_array_equal(at, np.tile(q[row], (3, 1)))
        assert_array_equal(still, 0.0)
        assert_array_equal(calm, 0.0)


def test_between_samples_it_is_hermites_polynomial(robot, planned, plan_file):
    plan = read_plan(plan_file, robot)
    t, q, dq, ddq = planned
    between = np.linspace(0.001, 4.999, 777)
    for joint in (0, 5):
        peer = BPoly.from_derivatives(t, np.stack([q[:, joint], dq[:, joint], ddq[:, joint]], axis=1))
        for order, value in enumerate(plan.evaluate(between + 0.5)):
            expected = peer(between, order)
            assert_allclose(value[:, joint], expected, rtol=0, atol=1e-7 * 10**order * np.abs(expected).max())


def test_command_plays_plans_and_adds_the_reference(run_command, robot, planned, plan_file, tmp_path):
    other = write_plan(tmp_path / "other.csv", columns_of(planned, robot.joint_names))  # joints by name
    folder = tmp_path / "out"
    result = run_command("-o", folder, "--trajectory", plan_file, "--trajectory", other, "--reference", "--json")
    assert result.exit_code == 0, result.stderr
    assert [run["duration_s"] for run in json.loads(result.stdout)["runs"]] == [6.0, 6.0]
    import pyarrow.parquet as pq

    first, second = (pq.read_table(folder / f"run_{run}.parquet") for run in range(2))
    t = first["t"].to_numpy()
    for joint in range(6):
        reference = first[f"q_ref_{joint}"].to_numpy()
        assert_array_equal(reference, read_plan(plan_file, robot).evaluate(t)[0][:, joint])
        assert_array_equal(reference, second[f"q_ref_{joint}"].to_numpy())
        off = np.abs(first[f"q_{joint}"].to_numpy() - reference).max()
        assert 1e-5 < off < 0.02
    # Same plan, other noise.
    assert not np.array_equal(first["tau_0"], second["tau_0"])
    truth = json.loads((folder / "truth.json").read_text())
    assert [run["trajectory"]["plan"] for run in truth["runs"]] == ["plan.csv", "other.csv"]
    # Readers do not take the reference for a joint.
    for known in (robot, None):
        assert read_recording(folder / "run_0.parquet", known, None).n_joints == 6


def test_a_plan_has_its_own_length(run_command, plan_file, tmp_path):
    result = run_command("-o", tmp_path / "out", "--trajectory", plan_file, "--duration", 600)
    assert result.exit_code == 2
    assert "--trajectory and --duration contradict each other" in result.stderr
    assert not (tmp_path / "out").exists()


def test_runs_may_outnumber_plans(run_command, plan_file, tmp_path):
    assert run_command("-o", tmp_path / "out", "--trajectory", plan_file, "--runs", 3, "--ideal").exit_code == 0
    truth = json.loads((tmp_path / "out" / "truth.json").read_text())
    assert [run["trajectory"]["plan"] for run in truth["runs"]] == ["plan.csv"] * 3
    assert truth["tracking"] is None


def spoil(columns, name, change):
    columns[name] = change(columns[name])


SPOILED = {
    "no time": (lambda c: c.pop("t"), "column t is missing"),
    "no velocity": (
        lambda c: c.pop("dq_3"),
        "column dq_3 is missing; a plan for this robot has t and q_i, dq_i, ddq_i",
    ),
    "more joints": (lambda c: c.update(q_6=c["q_0"]), "column q_6 is there, but the robot has 6 joints"),
    "degrees": (lambda c: spoil(c, "q_1", np.degrees), "dq_1 is not the derivative of q_1"),
    "swapped": (lambda c: c.update(ddq_0=c["ddq_1"]), "ddq_0 is not the derivative of dq_0"),
    "not a number": (lambda c: spoil(c, "q_2", lambda x: np.where(x == x[7], np.nan, x)), "column q_2: nan is not"),
    "time back": (lambda c: spoil(c, "t", lambda t: -t), "time goes backwards"),
    "coarse": (lambda c: spoil(c, "t", lambda t: 20 * t), "a step of 0.2 s is too long for a plan"),
    "moving start": (
        lambda c: [c.update({name: c[name][200:]}) for name in list(c)],
        "the plan starts with joint",
    ),
    "beyond": (lambda c: spoil(c, "q_0", lambda q: q + 10.0), "leaves the limits of joint 'joint_1'"),
}


@pytest.mark.parametrize("fault", SPOILED)
def test_a_wrong_plan_is_one_sentence_and_writes_nothing(run_command, planned, tmp_path, fault):
    columns = columns_of(planned)
    change, words = SPOILED[fault]
    change(columns)
    path = write_plan(tmp_path / "plan.csv", columns)
    result = run_command("-o", tmp_path / "out", "--trajectory", path)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "plan.csv" in result.stderr
    assert result.stderr.strip().count("\n") == 0
    assert not (tmp_path / "out").exists()


def test_a_plan_that_is_too_fast_is_refused(run_command, robot, planned, tmp_path):
    t, q, dq, ddq = planned
    fast = 0.4
    path = write_plan(tmp_path / "plan.csv", columns_of((fast * t, q, dq / fast, ddq / fast**2)))
    result = run_command("-o", tmp_path / "out", "--trajectory", path)
    assert result.exit_code == 2
    assert "leaves the limits of joint" in result.stderr
    assert "at most" in result.stderr


def test_missing_plan_is_said(run_command, tmp_path):
    result = run_command("-o", tmp_path / "out", "--trajectory", tmp_path / "none.csv")
    assert (result.exit_code, result.stderr.strip().count("\n")) == (2, 0)
    assert "none.csv" in result.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--tracking", "0"], "the bandwidth of tracking must lie between"),
        (["--tracking", "nan"], "the bandwidth of tracking must lie between"),
        (["--ideal", "--tracking", "5"], "--ideal and --tracking contradict"),
        (["--ideal", "--disturbance", "0.1"], "--ideal and --disturbance contradict"),
        (["--disturbance", "2"], "the disturbance must lie between"),
        (["--encoder-noise", "-1"], "link_noise must not be negative"),
        (["--encoder-noise", "nan"], "link_noise must be finite"),
    ],
)
def test_wrong_options_of_the_controller(run_command, tmp_path, options, words):
    result = run_command("-o", tmp_path / "out", *options)
    assert result.exit_code == 2
    assert words in result.stderr
    assert result.stderr.strip().count("\n") == 0
    assert not (tmp_path / "out").exists()
