"""The simulated experiment: exact motion, physics by other roads, sensors that lie as declared."""

import json
from dataclasses import replace

import numpy as np
import pytest
import typer
from helpers.robots import chain
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from typer.testing import CliRunner

from dynid_rs import _core
from dynid_rs.commands.simulate import ALWAYS
from dynid_rs.commands.simulate import simulate as command
from dynid_rs.runs.readers import read_recording
from dynid_rs.simulation import (
    MotionLimits,
    SimulatedArm,
    bundled_robot,
    motion_limits,
    random_trajectory,
    simulate,
    typical_arm,
    write_simulation,
)
from dynid_rs.simulation.gear import wind_up
from dynid_rs.simulation.limits import plausible_effort

ROUNDING = 1e-12  # same mathematics, other order of operations
EIGHTH_ORDER = 1e-9  # central differences of eighth order, step 1 ms, motion below 1 Hz
STEP_ERROR = 1e-4  # second-order scheme at 0.5 ms against an adaptive solver


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def trajectory(robot):
    return random_trajectory(motion_limits(robot), 20.0, np.random.default_rng(7))


@pytest.fixture(scope="module")
def exact(robot):
    """Noiseless, elastic."""
    return typical_arm(robot, noise=0.0)


# Motion


def eighth_order(function, t, step=1e-3):
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (function(t + k * step) - function(t - k * step)) for k, w in weights.items()) / step


def test_velocity_and_acceleration_are_derivatives_of_position(trajectory):
    t = np.linspace(0.6, trajectory.duration - 0.6, 500)
    _, dq, ddq = trajectory.evaluate(t)
    assert_allclose(eighth_order(lambda s: trajectory.evaluate(s)[0], t), dq, rtol=0, atol=EIGHTH_ORDER)
    assert_allclose(eighth_order(lambda s: trajectory.evaluate(s)[1], t), ddq, rtol=0, atol=EIGHTH_ORDER)


def test_rest_at_both_ends_is_exact_and_reached_smoothly(trajectory):
    t = np.array([-1.0, 0.0, 0.49, trajectory.duration - 0.49, trajectory.duration, 99.0])
    q, dq, ddq = trajectory.evaluate(t)
    assert_array_equal(q, np.tile(q[0], (len(t), 1)))
    assert_array_equal(dq, np.zeros_like(dq))
    assert_array_equal(ddq, np.zeros_like(ddq))
    # Acceleration starts with zero slope: it grows with the square of the time since the start.
    for since in (1e-3, -1e-3):
        start = 0.5 if since > 0 else trajectory.duration - 0.5
        _, dq, ddq = trajectory.evaluate(np.array([start + since]))
        assert np.abs(ddq).max() < 1e3 * since**2
        assert np.abs(dq).max() < 1e3 * abs(since) ** 3


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    duration=st.floats(4.0, 70.0),
    span=st.just(0.0) | st.floats(1e-3, 6.0),
    velocity=st.floats(0.05, 10.0),
    acceleration=st.floats(0.05, 30.0),
)
def test_limits_are_kept_and_used(seed, duration, span, velocity, acceleration):
    limits = MotionLimits(
        lower=np.array([-0.3 * span, -1.0]),
        upper=np.array([0.7 * span, 2.0]),
        velocity=np.array([velocity, 2.0]),
        acceleration=np.array([acceleration, 5.0]),
    )
    trajectory = random_trajectory(limits, duration, np.random.default_rng(seed))
    assert trajectory.duration == pytest.approx(duration, rel=1e-12)
    q, dq, ddq = trajectory.evaluate(np.arange(0.0, duration, 1e-3))
    assert (q >= limits.lower - 1e-12).all()
    assert (q <= limits.upper + 1e-12).all()
    assert (np.abs(dq) <= limits.velocity).all()
    assert (np.abs(ddq) <= limits.acceleration).all()
    used = np.max(
        [
            np.ptp(q, axis=0) / np.maximum(limits.upper - limits.lower, 1e-9),
            np.abs(dq).max(axis=0) / limits.velocity,
            np.abs(ddq).max(axis=0) / limits.acceleration,
        ],
        axis=0,
    )
    assert used[1] > 0.7
    assert span == 0 or used[0] > 0.7


def test_torque_stays_within_the_declared_effort(robot, exact):
    effort = np.asarray(robot.effort_limits)
    assert_array_equal(plausible_effort(robot), effort)
    for recording in simulate(exact, n_runs=6, seed=3).recordings:
        assert (np.abs(recording.tau) <= effort).all()


# Rigid arm


def printed_friction(dq, k, threshold, width):
    """Eqs. 9-11 read from the paper, side by side."""
    forward = (np.tanh(dq / width) + 1) / 2
    backward = (1 - np.tanh(dq / width)) / 2
    fast = np.abs(dq) >= threshold
    coulomb = np.where(dq >= 0, k[0] * forward, k[1] * backward) * np.tanh(dq / width)
    gate = np.where(dq >= 0, forward, backward)
    first, second, third = (np.where(dq >= 0, k[i], k[i + 1]) for i in (2, 4, 6))
    return coulomb + fast * (gate * first * dq + second * dq**2 + third * dq**3)


def test_rigid_and_noiseless_is_the_declared_model(robot, trajectory):
    arm = typical_arm(robot, noise=0.0, delay=0.0).rigid()
    run = arm.record(trajectory, 250.0, np.random.default_rng(0), derivatives=True)
    assert_array_equal(run.q_motor, run.q)
    assert_array_equal(run.dq_motor, run.dq)
    tau = robot.inverse_dynamics(run.q, run.dq, run.ddq) + arm.rotor_inertia * run.ddq + arm.torque_offset
    for joint in range(robot.n_joints):
        tau[:, joint] += printed_friction(
            run.dq[:, joint],
            arm.friction[joint],
            arm.velocity_threshold[joint],
            arm.transition_width[joint],
        )
    assert_allclose(run.tau, tau, rtol=ROUNDING, atol=ROUNDING * np.abs(tau).max())


def test_base_parameters_are_recovered_from_noiseless_runs(robot):
    arm = typical_arm(robot, noise=0.0, delay=0.0).rigid()
    blocks, torques = [], []
    for run in simulate(arm, n_runs=2, rate=50.0, derivatives=True).recordings:
        n = run.n_samples
        Y = robot.joint_torque_regressor(run.q, run.dq, run.ddq)
        columns = []
        for joint in range(robot.n_joints):
            own = _core.friction_basis(run.dq[:, joint], arm.velocity_threshold[joint], arm.transition_width[joint])
            own = np.column_stack([own, run.ddq[:, joint], np.ones(n)])
            full = np.zeros((n, robot.n_joints, own.shape[1]))
            full[:, joint] = own
            columns.append(full)
        blocks.append(np.concatenate([Y, *columns], axis=2).reshape(n * robot.n_joints, -1))
        torques.append(run.tau.ravel())
    A, y = np.vstack(blocks), np.concatenate(torques)
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0] = 1.0
    x = np.linalg.lstsq(A / scale, y, rcond=1e-12)[0] / scale
    assert_allclose(A @ x, y, rtol=0, atol=1e-9 * np.abs(y).max())
    # What the data determines of phi, seen through other motion: the torque it predicts without friction.
    rng = np.random.default_rng(1)
    q, dq, ddq = (rng.uniform(-1, 1, (200, robot.n_joints)) for _ in range(3))
    n_phi = 10 * robot.n_joints
    rotor = x[n_phi + 8 :: 10]
    offset = x[n_phi + 9 :: 10]
    predicted = robot.inverse_dynamics(q, dq, ddq, x[:n_phi]) + rotor * ddq + offset
    expected = robot.inverse_dynamics(q, dq, ddq) + arm.rotor_inertia * ddq + arm.torque_offset
    assert_allclose(predicted, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_mujoco_gives_the_same_rigid_torque(robot, trajectory):
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(bundled_robot()))
    # Limits, contacts and armature are no part of the rigid-body torque.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    assert (model.nv, list(model.dof_armature)) == (6, [0.0] * 6)
    arm = SimulatedArm(robot)
    motion = arm.motion(trajectory, np.arange(0.0, trajectory.duration, 0.02))
    reference = np.empty_like(motion.tau)
    for row, (q, dq, ddq) in enumerate(zip(motion.q, motion.dq, motion.ddq, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        reference[row] = data.qfrc_inverse
    scale = np.abs(reference).max(axis=0)
    assert_allclose(motion.tau / scale, reference / scale, rtol=0, atol=1e-9)


# Elastic gears


def test_deflection_is_torque_over_stiffness_without_hysteresis(robot, trajectory):
    arm = SimulatedArm(robot, stiffness=3e5)
    motion = arm.motion(trajectory, np.arange(0.0, trajectory.duration, 0.004))
    scale = np.abs(motion.tau_link).max()
    assert_allclose(3e5 * motion.deflection, motion.tau_link, rtol=0, atol=1e-9 * scale)
    damped = replace(arm, damping=np.full(6, 500.0)).motion(trajectory, motion.t)
    rate = CubicSpline(damped.t, damped.deflection)(damped.t, 1)
    moving = slice(200, -200)
    balance = 3e5 * damped.deflection + 500.0 * rate
    assert_allclose(balance[moving], damped.tau_link[moving], rtol=0, atol=STEP_ERROR * scale)
    assert np.abs(500.0 * rate).max() > 10 * STEP_ERROR * scale


def test_motor_side_signals_are_derivatives_of_each_other(exact, trajectory):
    t = np.arange(0.0, trajectory.duration, 5e-4)
    motion = exact.motion(trajectory, t)
    assert np.abs(motion.q_motor - motion.q).max() > 1e-4
    for rate, value, tolerance in (
        (motion.dq_motor, motion.q_motor, 1e-8),
        (motion.ddq_motor, motion.dq_motor, 1e-5),
    ):
        integral = value[0] + cumulative_simpson(rate, x=t, axis=0, initial=0.0)
        assert_allclose(integral, value, rtol=0, atol=tolerance)


def test_hysteresis_agrees_with_an_adaptive_solver():
    K, z_max, way = 2e5, 10.0, 1e-4

    def torque(t):
        return 150.0 * np.sin(2 * t) + 60.0 * np.sin(5 * t + 0.3)

    def slope(t, state):
        _, z = state
        rate = 300.0 * np.cos(2 * t) + 300.0 * np.cos(5 * t + 0.3)
        dz = z_max / way * (1 - z / z_max * np.sign(rate))
        return rate / (K + dz), dz * rate / (K + dz)

    t = np.arange(0.0, 6.0, 5e-4)
    start = torque(0.0) / K
    answer = solve_ivp(
        slope, (0.0, t[-1]), (start, 0.0), t_eval=t, rtol=1e-10, atol=1e-14, max_step=2e-3, method="LSODA"
    )
    ours = wind_up(torque(t), 5e-4, stiffness=K, damping=0.0, hysteresis=z_max, hysteresis_distance=way)
    assert_allclose(ours, answer.y[0], rtol=0, atol=STEP_ERROR * np.abs(ours).max())


@pytest.mark.parametrize("damping", [0.0, 50.0])
@pytest.mark.parametrize("hysteresis", [0.0, 5.0, 50.0])
def test_energy_is_lost_in_every_cycle_of_the_gear(hysteresis, damping):
    t = np.arange(0.0, 4.0, 5e-4)
    tau = 100.0 * np.sin(2 * np.pi * t)
    delta = wind_up(tau, 5e-4, stiffness=1e5, damping=damping, hysteresis=hysteresis, hysteresis_distance=1e-4)
    lost = [np.trapezoid(tau[k : k + 2001], delta[k : k + 2001]) for k in (2000, 4000)]
    if hysteresis == 0:
        # A damper alone: D times the mean square of the speed, over one second.
        expected = damping * (100.0 / 1e5 * 2 * np.pi) ** 2 / 2
        assert_allclose(lost, expected, rtol=1e-3, atol=1e-9)
    else:
        assert min(lost) > 1e-3
    assert_allclose(lost[0], lost[1], rtol=1e-3, atol=1e-9)  # settled: each cycle costs the same


def test_motor_never_gains_energy_from_what_the_gear_loses(exact, trajectory):
    motion = exact.motion(trajectory, np.arange(0.0, trajectory.duration, 1e-3))
    for joint in range(6):
        friction = printed_friction(
            motion.dq_motor[:, joint],
            exact.friction[joint],
            exact.velocity_threshold[joint],
            exact.transition_width[joint],
        )
        loss = friction + exact.hysteresis_loss[joint] * motion.hysteresis[:, joint]
        moving = np.abs(motion.dq_motor[:, joint]) > 5 * exact.transition_width[joint]
        assert (loss * motion.dq_motor[:, joint])[moving].min() > 0
    assert (np.abs(motion.hysteresis) <= exact.hysteresis * (1 + 1e-3)).all()


# Sensors


def test_delay_is_found_again_in_the_data(robot):
    arm = replace(typical_arm(robot, noise=0.0).rigid(), delay=0.0041)
    run = simulate(arm, n_runs=1).recordings[0]
    for joint in range(run.n_joints):
        late = CubicSpline(run.t, run.q[:, joint])
        inside = slice(50, -50)

        def error(delay, late=late, joint=joint, inside=inside, run=run):
            return np.sum((late(run.t[inside] + delay) - run.q_motor[inside, joint]) ** 2)

        found = minimize_scalar(error, bounds=(0.0, 0.01), method="bounded", options={"xatol": 1e-9})
        assert found.x == pytest.approx(0.0041, abs=1e-6)


def test_delay_is_found_again_through_noise_and_elasticity(robot):
    run = simulate(typical_arm(robot), n_runs=1).recordings[0]
    spline = CubicSpline(run.t, run.q[:, 0])
    # Axis 1 stands upright: its gear winds up with acceleration, which is not in phase with velocity.
    columns = np.stack([spline(run.t, 1), np.ones(run.n_samples)], axis=1)
    delay, _ = np.linalg.lstsq(columns, run.q_motor[:, 0] - run.q[:, 0], rcond=None)[0]
    assert delay == pytest.approx(0.0028, abs=2e-4)


def test_noise_and_steps_are_those_declared(robot, trajectory):
    arm, clean = typical_arm(robot, noise=2.0), typical_arm(robot, noise=0.0)
    run = arm.record(trajectory, 250.0, np.random.default_rng(5))
    true = clean.record(trajectory, 250.0, np.random.default_rng(5))
    ratio = (run.tau - true.tau).std(axis=0) / (0.01 * np.asarray(robot.effort_limits))
    assert_allclose(ratio, 1.0, atol=5 / np.sqrt(2 * run.n_samples))
    for measured, value, step in (
        (run.q, true.q, arm.link_resolution),
        (run.q_motor, true.q_motor, arm.motor_resolution),
    ):
        assert_allclose(measured / step, np.round(measured / step), rtol=0, atol=1e-6)
        assert (np.abs(measured - value) <= 0.5001 * step).all()
    assert true.dq is None
    assert len(np.unique(np.round(true.q[:, 0] / arm.link_resolution[0]) - true.q[:, 0])) > 1000


def test_stamp_jitter_moves_stamps_and_nothing_else(exact, trajectory):
    plain = exact.record(trajectory, 250.0, np.random.default_rng(5))
    shaken = exact.record(trajectory, 250.0, np.random.default_rng(5), stamp_jitter=1e-3)
    assert_array_equal(shaken.tau, plain.tau)
    assert 5e-4 < (shaken.t - plain.t).std() < 1.1e-3


# Experiments


def test_same_seed_same_numbers_and_runs_do_not_depend_on_their_number(robot):
    arm = typical_arm(robot)
    first, again = (simulate(arm, n_runs=2, duration=6.0, seed=4) for _ in range(2))
    more = simulate(arm, n_runs=3, duration=6.0, seed=4)
    other = simulate(arm, n_runs=1, duration=6.0, seed=5)
    for run, same, longer in zip(first.recordings, again.recordings, more.recordings, strict=False):
        for signal in ("t", "q", "q_motor", "tau"):
            assert_array_equal(getattr(run, signal), getattr(same, signal))
            assert_array_equal(getattr(run, signal), getattr(longer, signal))
    assert not np.array_equal(first.recordings[0].q, first.recordings[1].q)
    assert not np.array_equal(first.recordings[0].q, other.recordings[0].q)


@pytest.mark.parametrize("limits", [True, False])
@pytest.mark.parametrize(
    "kinds",
    [
        ["revolute"],
        ["prismatic"],
        ["continuous", "prismatic", "revolute"],
        ["revolute", "prismatic"] * 3,
        ["revolute"] * 12,
    ],
    ids=len,
)
def test_any_serial_robot(kinds, limits):
    robot = _core.RobotModel.from_urdf_string(chain(kinds, limits))
    arm = typical_arm(robot)
    sliding = np.array([kind == "prismatic" for kind in kinds])
    assert_array_equal(arm.flexible, ~sliding)
    run = simulate(replace(arm, delay=0.0), n_runs=1, duration=5.0, rate=100.0).recordings[0]
    apart = np.abs(run.q_motor - run.q).max(axis=0)
    steps = arm.link_resolution + arm.motor_resolution
    assert (apart[sliding] <= steps[sliding]).all()
    assert (apart[~sliding] > 0).all()
    assert (run.tau.std(axis=0) > 0).all()


def test_runs_are_read_back_and_the_truth_lies_beside(robot, tmp_path):
    simulation = simulate(typical_arm(robot), n_runs=2, duration=5.0)
    paths = write_simulation(simulation, tmp_path / "new" / "folder", bundled_robot())
    for path, recording in zip(paths, simulation.recordings, strict=True):
        back = read_recording(path, robot, None)
        for signal in ("t", "q", "q_motor", "tau"):
            assert_array_equal(getattr(back, signal), getattr(recording, signal))
    truth = json.loads((tmp_path / "new" / "folder" / "truth.json").read_text())
    assert_array_equal(truth["arm"]["parameters"]["phi"], robot.phi)
    assert_array_equal(truth["arm"]["parameters"]["stiffness"], simulation.arm.stiffness)
    assert set(truth["arm"]["units"]) | {"phi"} == set(truth["arm"]["parameters"])
    assert [run["file"] for run in truth["runs"]] == ["run_0.parquet", "run_1.parquet"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stiffness": -1.0}, "stiffness must not be negative"),
        ({"stiffness": 0.0}, "stiffness must be positive"),
        ({"damping": np.nan}, "damping must be finite"),
        ({"noise_std": np.inf}, "noise_std must be finite"),
        ({"friction": np.zeros(3)}, "friction must be one number or an array (6, 8)"),
        ({"phi": np.zeros(59)}, "phi must be one number or an array (60,)"),
        ({"delay": 1.0}, "delay must lie within 0.1 s of zero"),
        ({"delay": np.nan}, "delay must lie within 0.1 s of zero"),
        ({"kinematic_error": 0.1, "kinematic_cycles": 20.0}, "below 1"),
        ({"hysteresis": 5.0, "hysteresis_loss": 1.0}, "give energy back"),
    ],
)
def test_a_wrong_arm_is_refused(robot, change, words):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as caught:
        SimulatedArm(robot, **change)
    assert words in str(caught.value)


# Command


@pytest.fixture(scope="module")
def run_command():
    app = typer.Typer()
    app.command()(command)
    runner = CliRunner()

    def invoke(*arguments):
        return runner.invoke(app, [str(argument) for argument in arguments])

    return invoke


def test_command_writes_runs_robot_and_truth(run_command, tmp_path):
    result = run_command("-o", tmp_path, "--runs", 2, "--duration", 5, "--json")
    assert result.exit_code == 0, result.stderr
    answer = json.loads(result.stdout)
    names = ["robot.urdf", "run_0.parquet", "run_1.parquet", "truth.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    robot = _core.RobotModel.from_urdf(answer["robot_file"])
    assert [run["n_samples"] for run in answer["runs"]] == [1251, 1251]
    assert read_recording(answer["runs"][1]["path"], robot, None).dq is None
    before = (tmp_path / "run_1.parquet").read_bytes()
    # Once more, from the robot it wrote itself: nothing changes.
    again = (tmp_path / "robot.urdf", "-o", tmp_path, "--runs", 2, "--duration", 5)
    refused = run_command(*again)
    assert (refused.exit_code, "holds a finished result already (truth.json)" in refused.stderr) == (2, True)
    assert run_command(*again, "--force").exit_code == 0
    assert (tmp_path / "run_1.parquet").read_bytes() == before


def test_an_arm_without_a_turning_joint_has_what_it_can_have(run_command, tmp_path):
    robot = tmp_path / "slides.urdf"
    robot.write_text(chain(["prismatic", "prismatic"]))
    done = run_command(robot, "-o", tmp_path / "lab", "--runs", 1, "--duration", 5)
    assert done.exit_code == 0, done.output
    truth = json.loads((tmp_path / "lab" / "truth.json").read_text())
    assert [effect["kind"] for effect in truth["effects"]] == ["encoder_delay"]


def test_rigid_and_noiseless_command_adds_derivatives(run_command, tmp_path):
    assert run_command("-o", tmp_path, "--runs", 1, "--duration", 5, "--rigid", "--noise", 0).exit_code == 0
    run = read_recording(tmp_path / "run_0.parquet", None, None)
    assert_array_equal(run.q, run.q_motor)
    assert run.ddq is not None


def test_effects_are_switched_on_one_by_one(run_command, tmp_path):
    for kind in ALWAYS:
        folder = tmp_path / kind
        assert run_command("-o", folder, "--runs", 1, "--duration", 5, "--effect", kind).exit_code == 0
        parameters = json.loads((folder / "truth.json").read_text())["arm"]["parameters"]
        assert (parameters["stiffness"][0] is not None) == (kind == "joint_elasticity")
        assert (parameters["delay"] > 0) == (kind == "encoder_delay")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--effect", "gremlins"], "effect 'gremlins' cannot be simulated; there are joint_elasticity, "),
        (["--stiffness", "-3e5"], "--stiffness must be positive"),
        (["--stiffness", "nan"], "--stiffness must be positive"),
        (["--stiffness", "1e5,2e5"], "--stiffness has 2 numbers, expected 1 or 6"),
        (["--stiffness", "stiff"], "--stiffness must be one number"),
        (["--rigid", "--stiffness", "1e5"], "--rigid and --stiffness contradict"),
        (["--rigid", "--effect", "encoder_delay"], "--rigid and --effect contradict"),
        (["--effect", "encoder_delay", "--stiffness", "1e5"], "--stiffness needs --effect joint_elasticity"),
        (["--duration", "2"], "too short"),
        (["--duration", "nan"], "too short"),
        (["--duration", "1e9"], "too long"),
        (["--rate", "1"], "the rate must lie between"),
        (["--rate", "nan"], "the rate must lie between"),
        (["--runs", "0"], "the number of runs"),
        (["--trajectory", "a.csv", "--trajectory", "b.csv", "--runs", "1"], "--runs 1 would leave out 1 of 2 --traj"),
        (["--noise", "-1"], "noise must be at least 0"),
        (["--noise", "nan"], "noise must be at least 0"),
        (["--delay", "2"], "delay must lie within"),
        (["--jitter", "1"], "the jitter must lie between"),
        (["--seed", "-1"], "the seed must not be negative"),
    ],
)
def test_wrong_use_is_one_sentence_and_writes_nothing(run_command, tmp_path, options, words):
    folder = tmp_path / "out"
    result = run_command("-o", folder, *options)
    assert result.exit_code == 2
    assert words in result.stderr
    assert result.stderr.strip().count("\n") == 0
    assert not folder.exists()


def test_missing_robot_and_unwritable_folder(run_command, tmp_path):
    result = run_command(tmp_path / "none.urdf", "-o", tmp_path / "out")
    assert (result.exit_code, result.stderr.strip().count("\n")) == (2, 0)
    assert "none.urdf" in result.stderr
    (tmp_path / "file").write_text("")
    result = run_command("-o", tmp_path / "file" / "out", "--runs", 1, "--duration", 4)
    assert (result.exit_code, result.stderr.strip().count("\n")) == (2, 0)
    assert "is not a folder" in result.stderr


def test_runs_of_another_simulation_are_not_mixed_in(run_command, tmp_path):
    assert run_command("-o", tmp_path, "--runs", 2, "--duration", 4).exit_code == 0
    result = run_command("-o", tmp_path, "--runs", 1, "--duration", 4, "--force")
    assert result.exit_code == 2
    assert "run_1.parquet of an older simulation" in result.stderr


@pytest.mark.parametrize("name", ["run_0.parquet", "robot.urdf"])
def test_files_that_no_simulation_wrote_are_not_replaced(run_command, tmp_path, name):
    (tmp_path / name).write_text("measured by hand")
    result = run_command("-o", tmp_path, "--runs", 1, "--duration", 4)
    assert result.exit_code == 2
    assert f"{name} that no simulation wrote" in result.stderr
    assert [path.read_text() for path in tmp_path.iterdir()] == ["measured by hand"]


@pytest.mark.parametrize("effort", ["", 'effort="0"', 'effort="10000"'])
def test_placeholders_of_effort_are_not_believed(effort):
    text = chain(["revolute"] * 4).replace('effort="400"', effort)
    believed = plausible_effort(_core.RobotModel.from_urdf_string(text))
    assert (believed >= 1).all()
    assert (believed < 500).all()
