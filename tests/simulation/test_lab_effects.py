"""Effects of structure, gears and sensors in the laboratory: each is what its definition says."""

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import typer
from helpers.engines import Pinocchio
from helpers.robots import chain, with_moved_joint
from helpers.tolerances import PINOCCHIO, relative_error
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline
from typer.testing import CliRunner

from dynid_rs import _core
from dynid_rs.commands.simulate import simulate as command
from dynid_rs.simulation import (
    SimulatedArm,
    build_effect,
    build_effects,
    bundled_robot,
    equip,
    kind_names,
    motion_limits,
    parse_wish,
    random_trajectory,
    simulate,
    typical_arm,
)

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def trajectory(robot):
    return random_trajectory(motion_limits(robot), 12.0, np.random.default_rng(7))


@pytest.fixture(scope="module")
def states(trajectory):
    return trajectory.evaluate(np.arange(0.0, trajectory.duration, 0.05))


def made(robot, wish, arm=None):
    """An effect sized for the typical arm."""
    return build_effect(parse_wish(wish), typical_arm(robot, noise=0.0) if arm is None else arm)


def with_effect(robot, wish):
    """An ideal arm with one effect."""
    return equip(SimulatedArm(robot), [made(robot, wish)])


def number(effect, name):
    return next(value.value for value in effect.values if value.name == name)


# Structure


def test_payload_is_a_box_on_the_last_link(robot, states):
    effect = made(robot, "payload::2")
    mass, *_ = number(effect, "parameters")
    peer = Pinocchio(bundled_robot().read_text(), robot.gravity)
    box = pin.Inertia.FromBox(mass, 0.10, 0.16, 0.12)
    peer.model.inertias[6] += pin.Inertia(mass, np.array([0.02, -0.03, 0.08]), box.inertia)
    arm = equip(SimulatedArm(robot), [effect])
    assert relative_error(arm.robot.inverse_dynamics(*states, arm.phi), peer.inverse_dynamics(*states)) < PINOCCHIO
    # Twice the size, twice the mass; the weight takes 15 % of an effort limit at size 1, on no joint more.
    assert mass == pytest.approx(2 * number(made(robot, "payload"), "parameters")[0])
    q = np.random.default_rng(0).uniform(-3, 3, (4000, 6))
    still = np.zeros_like(q)
    weight = robot.inverse_dynamics(q, still, still, np.eye(60)[50] * mass / 2)
    share = np.abs(weight).max(axis=0) / np.asarray(robot.effort_limits)
    assert 0.08 < share.max() < 0.2


def test_gravity_tilt_turns_the_base(robot, states):
    effect = made(robot, "gravity_tilt::-3")
    roll, pitch = number(effect, "roll"), number(effect, "pitch")
    assert_allclose((roll, pitch), np.radians((-6.0, 4.5)))
    base = pin.rpy.rpyToMatrix(roll, pitch, 0.0)
    peer = Pinocchio(bundled_robot().read_text(), base.T @ np.array(robot.gravity))
    arm = equip(SimulatedArm(robot), [effect])
    assert relative_error(arm.robot.inverse_dynamics(*states), peer.inverse_dynamics(*states)) < PINOCCHIO


@pytest.mark.parametrize(("wish", "joint"), [("kinematic_error", 1), ("kinematic_error:joint_4:-2", 3)])
def test_kinematic_error_is_another_urdf(robot, states, wish, joint):
    effect = made(robot, wish)
    urdf = with_moved_joint(
        bundled_robot().read_text(), f"joint_{joint + 1}", number(effect, "offset"), number(effect, "turn")
    )
    peer = Pinocchio(urdf, robot.gravity)
    arm = equip(SimulatedArm(robot), [effect])
    expected = peer.inverse_dynamics(*states)
    assert relative_error(arm.robot.inverse_dynamics(*states), expected) < 10 * PINOCCHIO  # angles there and back
    assert relative_error(robot.inverse_dynamics(*states), expected) > 1e-3


def test_a_joint_that_is_not_there_cannot_be_moved(robot):
    with pytest.raises(ValueError, match="there is no joint 6, the robot has 6, counted from 0"):
        robot.with_joint_moved(6, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for bad in ((np.nan, 0.0, 0.0), (0.0, 0.0, np.inf)):
        with pytest.raises(ValueError, match="finite"):
            robot.with_joint_moved(0, bad, (0.0, 0.0, 0.0))
        with pytest.raises(ValueError, match="finite"):
            robot.with_joint_moved(0, (0.0, 0.0, 0.0), bad)


# Gears


def test_elasticity_of_one_joint_leaves_the_others_rigid(robot, trajectory):
    typical = typical_arm(robot, noise=0.0)
    arm = with_effect(robot, "joint_elasticity:joint_3:2")
    assert_array_equal(np.isfinite(arm.stiffness), np.arange(6) == 2)
    assert arm.stiffness[2] == typical.stiffness[2] / 2
    motion = arm.motion(trajectory, np.arange(0.0, trajectory.duration, 0.01))
    assert np.abs(motion.q_motor - motion.q)[:, 2].max() > 1e-4
    assert_array_equal(np.delete(motion.q_motor, 2, axis=1), np.delete(motion.q, 2, axis=1))


def test_nonlinear_elasticity_is_linear_plus_cubic(robot, trajectory):
    springs = SimulatedArm(robot, stiffness=np.asarray(robot.effort_limits) / 2e-3)
    effect = made(robot, "nonlinear_elasticity", springs)
    arm = equip(SimulatedArm(robot), [effect])
    motion = arm.motion(trajectory, np.arange(0.0, trajectory.duration, 5e-4))
    peer = Pinocchio(bundled_robot().read_text(), robot.gravity)
    tau = peer.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    expected = tau / springs.stiffness + number(effect, "cubic") * tau**3
    deflection = motion.q_motor - motion.q
    assert_allclose(deflection, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    # 20 % stiffer at the effort limit, whatever the joint.
    effort = np.asarray(robot.effort_limits)
    assert_allclose(number(effect, "cubic") * effort**3, -0.2 * effort / springs.stiffness)


def test_backlash_jumps_by_the_gap_where_the_torque_changes_sign(robot, trajectory):
    effect = made(robot, "backlash:0:3")
    (gap,), (width,) = number(effect, "gap"), number(effect, "transition_torque")
    assert gap == pytest.approx(9e-4)
    arm = equip(SimulatedArm(robot), [effect])
    motion = arm.motion(trajectory, np.arange(0.0, trajectory.duration, 5e-4))
    deflection, tau = (motion.q_motor - motion.q)[:, 0], motion.tau_link[:, 0]
    loaded = np.abs(tau) > width * 1.01
    assert (np.diff(np.sign(tau[loaded])) != 0).sum() > 3
    assert_allclose(deflection[loaded], gap / 2 * np.sign(tau[loaded]), rtol=0, atol=1e-6 * gap)
    assert np.abs(deflection).max() < gap / 2 * (1 + 1e-6)
    crossing = ~loaded & (np.abs(tau) > 1e-6)
    x = tau[crossing] / width
    inside = np.abs(x) < 1
    step = gap / 2 * np.where(inside, (15 * x - 10 * x**3 + 3 * x**5) / 8, np.sign(x))
    assert_allclose(deflection[crossing], step, rtol=0, atol=1e-6 * gap)
    assert_array_equal(motion.q_motor[:, 1:], motion.q[:, 1:])


def test_motor_side_stays_consistent_where_gears_have_play(robot, trajectory):
    arm = equip(
        SimulatedArm(robot),
        build_effects([parse_wish("backlash"), parse_wish("nonlinear_elasticity")], typical_arm(robot)),
    )
    t = np.arange(0.0, trajectory.duration, 1e-4)
    motion = arm.motion(trajectory, t)
    for value, rate in ((motion.q_motor, motion.dq_motor), (motion.dq_motor, motion.ddq_motor)):
        integral = value[0] + cumulative_simpson(rate, x=t, axis=0, initial=0.0)
        assert_allclose(integral, value, rtol=0, atol=1e-4 * np.abs(value - value[0]).max())


# Sensors


def test_torque_gain_scales_the_channel(robot, trajectory):
    plain = SimulatedArm(robot).record(trajectory, 100.0, np.random.default_rng(0))
    run = with_effect(robot, "torque_gain:2:-2").record(trajectory, 100.0, np.random.default_rng(0))
    gain = np.where(np.arange(6) == 2, 0.9, 1.0)
    assert_allclose(run.tau, gain * plain.tau, rtol=ROUNDING)


def test_torque_delay_is_a_shift(robot, trajectory):
    typical = typical_arm(robot, noise=0.0)
    plain = typical.record(trajectory, 200.0, np.random.default_rng(0))
    late = equip(typical, [made(robot, "torque_delay:1")])
    run = late.record(trajectory, 200.0, np.random.default_rng(0))
    # 5 ms are one sample.
    scale = np.abs(plain.tau[:, 1]).max()
    assert_allclose(run.tau[1:, 1], plain.tau[:-1, 1], rtol=0, atol=1e-9 * scale)
    assert_array_equal(np.delete(run.tau, 1, axis=1), np.delete(plain.tau, 1, axis=1))
    assert_array_equal(run.q, plain.q)


def test_encoder_delay_is_a_shift_of_the_link_channel(robot, trajectory):
    plain = SimulatedArm(robot).record(trajectory, 1000 / 2.8, np.random.default_rng(0))
    run = with_effect(robot, "encoder_delay").record(trajectory, 1000 / 2.8, np.random.default_rng(0))
    assert_allclose(run.q[1:], plain.q[:-1], rtol=0, atol=1e-12)
    assert_array_equal(run.q_motor, plain.q_motor)


def test_eccentric_encoder_errs_once_per_turn(robot, trajectory):
    effect = made(robot, "encoder_eccentricity::5")
    arm = equip(SimulatedArm(robot), [effect])
    run = arm.record(trajectory, 1000.0, np.random.default_rng(0), derivatives=True)
    q, dq, _ = trajectory.evaluate(run.t)
    error = np.array(number(effect, "amplitude")) * np.sin(q + number(effect, "phase"))
    assert_allclose(run.q, q + error, rtol=0, atol=1e-14)
    assert np.abs(error).max() > 4e-3
    # The torque is that of the true position, and so is the motor's.
    assert_array_equal(run.q_motor, q)
    assert_array_equal(run.tau, SimulatedArm(robot).record(trajectory, 1000.0, np.random.default_rng(0)).tau)
    for joint in range(6):
        shown = CubicSpline(run.t, run.q[:, joint])
        assert_allclose(run.dq[:, joint], shown(run.t, 1), rtol=0, atol=1e-6 * np.abs(dq).max())
        assert_allclose(run.ddq[20:-20, joint], shown(run.t, 2)[20:-20], rtol=0, atol=1e-3)


# Contact


def test_contact_is_a_force_on_the_last_link_within_its_windows(robot, trajectory):
    arm = with_effect(robot, "contact").of_run(0, trajectory.duration, np.random.default_rng(5))
    t = np.arange(0.0, trajectory.duration, 0.01)
    motion = arm.motion(trajectory, t)
    extra = motion.tau - robot.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    windows = number(arm.effects[0], "windows")
    assert len(windows) >= 1
    peer = Pinocchio(bundled_robot().read_text(), robot.gravity)
    expected = np.zeros_like(extra)
    for window in windows:
        middle, half = (window["start_s"] + window["end_s"]) / 2, (window["end_s"] - window["start_s"]) / 2
        for row in np.flatnonzero(np.abs(t - middle) < half):
            pin.computeJointJacobians(peer.model, peer.data, motion.q[row])
            jacobian = pin.getJointJacobian(peer.model, peer.data, 6, pin.LOCAL_WORLD_ALIGNED)[:3]
            course = (1 - ((t[row] - middle) / half) ** 2) ** 4
            expected[row] -= course * jacobian.T @ window["force"]
    assert_allclose(extra, expected, rtol=0, atol=1e-10 * np.abs(motion.tau).max())
    touched = np.abs(expected).max(axis=1) > 0
    assert 0.02 < touched.mean() < 0.2
    share = np.abs(expected).max(axis=0) / np.asarray(robot.effort_limits)
    assert 0.05 < share.max() <= 0.3 * 1.1


def test_contact_differs_from_run_to_run_and_stands_in_the_truth(robot):
    simulation = simulate(with_effect(robot, "contact"), n_runs=2, duration=15.0, seed=3)
    runs = json.loads(json.dumps(simulation.truth()))["runs"]
    windows = [run["effects"][0]["parameters"][-1] for run in runs]
    assert [window["name"] for window in windows] == ["windows"] * 2
    assert windows[0] != windows[1]
    longer = simulate(with_effect(robot, "contact"), n_runs=3, duration=15.0, seed=3)
    for run, same in zip(simulation.recordings, longer.recordings, strict=False):
        assert_array_equal(run.tau, same.tau)
    for window in (w for entry in windows for w in entry["value"]):
        assert 1.0 <= window["start_s"] < window["end_s"] <= 14.0


# Asking for them


@pytest.mark.parametrize("kind", kind_names())
def test_every_kind_acts_alone_on_any_robot(kind, robot):
    for model in (robot, _core.RobotModel.from_urdf_string(chain(["revolute", "prismatic", "revolute"]))):
        typical = typical_arm(model, noise=0.0)
        ideal = replace(typical.rigid(), delay=0.0)
        arm = equip(ideal, [made(model, kind)])
        plain, run = (simulate(each, n_runs=1, duration=8.0, rate=100.0).recordings[0] for each in (ideal, arm))
        effort = np.asarray(typical.noise_std) if typical.noise_std.any() else np.asarray(model.effort_limits)
        moved = max(
            np.abs((run.tau - plain.tau) / effort).max(),
            np.abs(run.q - plain.q).max(),
            np.abs(run.q_motor - plain.q_motor).max(),
        )
        assert 1e-5 < moved < 1.0
        entry = json.loads(json.dumps(arm.effects[-1].to_json(model.joint_names), allow_nan=False))
        assert entry["kind"] == kind
        assert entry["parameters"]
        assert all(parameter["unit"] for parameter in entry["parameters"])


@pytest.fixture(scope="module")
def run_command():
    app = typer.Typer()
    app.command()(command)
    return lambda *arguments, **more: CliRunner().invoke(app, [str(argument) for argument in arguments], **more)


def test_command_puts_effects_in_and_the_robot_file_stays_as_it_was(run_command, tmp_path):
    options = ["--effect", "gravity_tilt", "--effect", "torque_gain:joint_2:2", "--effect", "joint_elasticity"]
    result = run_command("-o", tmp_path, "--runs", 1, "--duration", 5, *options, "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["effects"] == ["gravity_tilt", "torque_gain", "joint_elasticity"]
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert [effect["joints"] for effect in truth["effects"]][1] == ["joint_2"]
    gain = truth["effects"][1]["parameters"][0]
    assert (gain["name"], gain["value"], gain["unit"]) == ("gain", [0.1], "1")
    assert truth["gravity"][0] != 0.0
    assert (tmp_path / "robot.urdf").read_bytes() == bundled_robot().read_bytes()
    assert truth["arm"]["parameters"]["delay"] == 0.0


def test_kinds_are_listed(run_command):
    result = run_command("--list-effects")
    assert result.exit_code == 0
    assert [line.split(":")[0] for line in result.stdout.splitlines()] == list(kind_names())
    assert "--list-effects" in run_command("--help", env={"COLUMNS": "160"}).stdout


@pytest.mark.parametrize("words", [("--list-effects", "--json"), ("--json", "--list-effects")])
def test_kinds_are_listed_as_json(run_command, words):
    answer = json.loads(run_command(*words).stdout)
    assert [entry["kind"] for entry in answer["effects"]] == list(kind_names())
    assert all(set(entry) == {"kind", "default", "where"} for entry in answer["effects"])


def test_without_a_folder_nothing_is_simulated(run_command):
    result = run_command("--runs", "1")
    assert result.exit_code == 2
    assert "--output (-o) is missing" in result.stderr


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ("gremlins", "effect 'gremlins' cannot be simulated; there are joint_elasticity, "),
        ("", "effect '' cannot be simulated"),
        ("payload::heavy", "the size must be a number other than 0, got 'heavy'"),
        ("payload::nan", "the size must be a number other than 0"),
        ("payload::0", "the size must be a number other than 0"),
        ("payload::-1", "the size of payload must be positive, got -1"),
        (
            "backlash:7",
            "there is no joint '7'; joints are joint_1, joint_2, joint_3, joint_4, joint_5, joint_6, or 0 to 5",
        ),
        ("backlash:-1", "there is no joint '-1'"),
        ("backlash:elbow:2", "there is no joint 'elbow'"),
        ("payload:joint_2", "payload acts on the whole robot; leave the joint 'joint_2' out"),
        ("torque_delay::50", "torque_delay of size 50 is 0.25 s; take at most 0.1 s"),
        ("torque_gain::-30", "torque_gain of size -30 would turn the torque's sign"),
        ("nonlinear_elasticity::2", "take at most 1.3"),
        ("encoder_eccentricity::2000", "would turn the encoder back"),
    ],
)
def test_a_wrong_wish_is_one_sentence_and_writes_nothing(run_command, tmp_path, wish, words):
    result = run_command("-o", tmp_path / "out", "--effect", wish)
    assert result.exit_code == 2
    assert words in result.stderr
    assert result.stderr.strip().count("\n") == 0
    assert not (tmp_path / "out").exists()


def test_what_a_robot_cannot_have_is_said(robot):
    sliding = _core.RobotModel.from_urdf_string(chain(["prismatic", "prismatic"]))
    with pytest.raises(ValueError, match="needs a joint that feels a force on the last link's frame, and all"):
        made(_core.RobotModel.from_urdf_string(chain(["revolute"])), "payload")
    with pytest.raises(ValueError, match="joint_elasticity needs a joint that turns, and this robot has none"):
        made(sliding, "joint_elasticity")
    mixed = _core.RobotModel.from_urdf_string(chain(["revolute", "prismatic"]))
    with pytest.raises(ValueError, match="encoder_eccentricity needs a joint that turns, and joint 'j2' slides"):
        made(mixed, "encoder_eccentricity:j2")
    with pytest.raises(ValueError, match="gravity_tilt needs gravity, and this robot has none"):
        made(robot.with_gravity((0.0, 0.0, 0.0)), "gravity_tilt")
    with pytest.raises(ValueError, match="'backlash' is there twice for the same joint"):
        build_effects([parse_wish("backlash"), parse_wish("backlash:2")], typical_arm(robot))
