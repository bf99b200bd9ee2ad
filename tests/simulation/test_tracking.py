"""A controller that tracks a plan: exact response, exact derivatives, noise that belongs to the motion."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import chain
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

from dynid_rs import _core
from dynid_rs.simulation import (
    SimulatedArm,
    Tracking,
    bundled_robot,
    motion_limits,
    random_trajectory,
    simulate,
    track,
    typical_arm,
)
from dynid_rs.simulation.limits import typical_inertia
from dynid_rs.simulation.tracking import CYCLE, TrackedMotion

RESPONSE = 1e-9
"""Another realisation of the same linear system, solved by scipy at half cycles; of the largest error."""
EIGHTH_ORDER = 1e-6
"""Central differences of eighth order, step 0.1 ms, across cycles whose fifth derivative jumps."""


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def arm(robot):
    return typical_arm(robot, encoder_noise=1e-6)


@pytest.fixture(scope="module")
def plan(robot):
    return random_trajectory(motion_limits(robot), 8.0, np.random.default_rng(7))


@pytest.fixture(scope="module")
def motion(arm, plan):
    return track(arm, plan, Tracking(), np.random.default_rng(3))


class Still:
    """A plan that stays where it is."""

    duration = 2.0

    def evaluate(self, t):
        zero = np.zeros((len(t), 2))
        return zero, zero, zero


@pytest.mark.parametrize(("bandwidth", "damping"), [(1.0, 0.7), (10.0, 0.7), (30.0, 1.2), (7.0, 0.2)])
def test_error_is_the_response_of_the_linear_system(bandwidth, damping):
    rng = np.random.default_rng(0)
    shape = (round(2.2 / CYCLE) + 1, 2)
    push, deflection, drive, noise = (rng.standard_normal(shape) for _ in range(4))
    push[0] = deflection[0] = drive[0] = noise[0] = 0.0
    inertia = np.array([2.0, 0.1])
    tracking = Tracking(bandwidth, damping)
    tracked = TrackedMotion(
        Still(), tracking, push=push, deflection=deflection, drive=drive, inertia=inertia, noise=noise
    )
    w, corner = 2 * np.pi * bandwidth, 2 * np.pi * 2.5 * bandwidth
    low_pass = np.polymul([1 / corner**2, 2 / corner, 1], [1 / corner**2, 2 / corner, 1])
    loop = np.polymul([1, 2 * damping * w, w**2], low_pass)
    cycles = CYCLE * np.arange(len(push))
    t = CYCLE / 2 * np.arange(2 * round(2.0 / CYCLE))
    for joint in range(2):
        acceleration = np.interp(t, cycles, push[:, joint] + drive[:, joint] / inertia[joint])
        seen = np.interp(t, cycles, deflection[:, joint] + noise[:, joint])
        _, by_push, _ = signal.lsim(signal.TransferFunction([1.0], loop), acceleration, t)
        _, by_noise, _ = signal.lsim(signal.TransferFunction([-2 * damping * w, -(w**2)], loop), seen, t)
        expected = by_push + by_noise
        error = tracked.error(t)[0][:, joint]
        assert_allclose(error, expected, rtol=0, atol=RESPONSE * np.abs(expected).max())


def test_velocity_and_acceleration_are_derivatives_of_position(motion):
    t = np.linspace(0.01, motion.duration, 400)
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    step = 1e-4

    def slope(order):
        def at(k):
            return motion.error(t + k * step)[order]

        return sum(w * (at(k) - at(-k)) for k, w in weights.items()) / step

    _, de, dde = motion.error(t)
    assert_allclose(slope(0), de, rtol=0, atol=EIGHTH_ORDER * np.abs(de).max())
    assert_allclose(slope(1), dde, rtol=0, atol=EIGHTH_ORDER * np.abs(dde).max())


def test_acceleration_and_its_slope_are_continuous_from_cycle_to_cycle(motion):
    cycles = CYCLE * np.arange(1, round(motion.duration / CYCLE))
    before, after = motion.error(cycles - 1e-9), motion.error(cycles)
    for left, right in zip(before, after, strict=True):
        assert np.abs(left - right).max() < 1e-6 * np.abs(right).max()


def test_equations_of_motion_hold_along_the_actual_motion(robot, arm, plan):
    quiet = replace(arm.rigid(), delay=0.0, noise_std=np.zeros(6), link_resolution=np.zeros(6))
    quiet = replace(quiet, link_noise=np.zeros(6))
    tracked = track(quiet, plan, Tracking(), np.random.default_rng(0))
    run = quiet.record(tracked, 250.0, np.random.default_rng(1), derivatives=True)
    assert np.abs(run.q - plan.evaluate(run.t)[0]).max() > 1e-4
    tau = robot.inverse_dynamics(run.q, run.dq, run.ddq) + quiet.rotor_inertia * run.ddq + quiet.torque_offset
    for joint in range(6):
        basis = _core.friction_basis(run.dq[:, joint], quiet.velocity_threshold[joint], quiet.transition_width[joint])
        tau[:, joint] += basis @ quiet.friction[joint]
    assert_allclose(run.tau, tau, rtol=0, atol=1e-11 * np.abs(tau).max())


def test_arm_starts_at_rest_where_the_controller_holds_it(arm, plan, robot):
    silent = replace(arm, noise_std=np.zeros(6), motor_noise=np.zeros(6))
    tracked = track(silent, plan, Tracking(), np.random.default_rng(0))
    t = np.array([-0.01, 0.0, 0.1, 0.3])
    e, de, dde = tracked.error(t)
    # Held by the spring of the controller against offset and wind-up: motor side and plan differ by offset / stiffness.
    inertia = typical_inertia(robot) + silent.rotor_inertia
    held = silent.motion(plan, np.array([0.0, 0.1])).tau_link[0] / silent.stiffness
    expected = -held - silent.torque_offset / (inertia * (2 * np.pi * 10.0) ** 2)
    assert_allclose(e, np.tile(expected, (4, 1)), rtol=1e-9)
    assert_allclose(de, 0.0, atol=1e-12)
    assert_allclose(dde, 0.0, atol=1e-10)


def test_more_bandwidth_tracks_better(arm, plan):
    t = np.arange(0.0, plan.duration, 2e-3)
    rigid = replace(arm.rigid(), noise_std=np.zeros(6), motor_noise=np.zeros(6))
    errors = [
        np.abs(track(rigid, plan, Tracking(hz), np.random.default_rng(0)).error(t)[0]).max() for hz in (3, 10, 30)
    ]
    assert errors[0] > 5 * errors[1] > 25 * errors[2] > 0
    # An arm that is what its controller thinks follows exactly.
    ideal = SimulatedArm(rigid.robot, rotor_inertia=rigid.rotor_inertia)
    assert np.abs(track(ideal, plan, Tracking(), np.random.default_rng(0)).error(t)[0]).max() < 1e-14


def test_torque_noise_keeps_its_size_and_belongs_to_the_motion(robot, plan):
    arm = SimulatedArm(robot, noise_std=5.0)
    tracked = track(arm, plan, Tracking(), np.random.default_rng(0))
    run = arm.record(tracked, 250.0, np.random.default_rng(1), derivatives=True)
    noise = run.tau - robot.inverse_dynamics(run.q, run.dq, run.ddq)
    assert_allclose(noise.std(axis=0), 5.0, rtol=5 / np.sqrt(2 * run.n_samples))
    # The drive pushes the link one way and the channel errs the other way; the link answers some samples later.
    assert np.min(lagged_correlation(noise, tracked.error(run.t)[2])) < -0.1
    # Where nothing closes the loop, noise and motion have nothing to do with each other.
    open_loop = arm.record(plan, 250.0, np.random.default_rng(1), derivatives=True)
    noise = open_loop.tau - robot.inverse_dynamics(open_loop.q, open_loop.dq, open_loop.ddq)
    assert np.abs(lagged_correlation(noise, tracked.error(run.t)[2])).max() < 5 / np.sqrt(run.n_samples)


def lagged_correlation(noise, dde, n_lags=25):
    """Correlation of torque noise with the acceleration 0 to `n_lags` samples later, joint by joint."""
    n = len(noise) - n_lags
    return [[np.corrcoef(noise[:n, j], dde[lag : lag + n, j])[0, 1] for lag in range(n_lags)] for j in range(6)]


def test_slow_disturbance_has_its_size_and_is_missing_in_the_torque(robot):
    arm = SimulatedArm(robot)
    plan = random_trajectory(motion_limits(robot), 60.0, np.random.default_rng(0))
    tracked = track(arm, plan, Tracking(disturbance=0.02), np.random.default_rng(0))
    t = np.arange(0.0, 60.0, CYCLE)
    drive = tracked.drive(t)
    # 3 Hz for 60 s: about 2 pi 3 60 / 2 independent values per joint.
    assert_allclose(drive.std(axis=0), 0.02 * np.asarray(robot.effort_limits), rtol=5 / np.sqrt(2 * 565))
    frequency, power = signal.welch(drive[:, 0], 1 / CYCLE, nperseg=2**13)
    assert power[frequency > 30.0].max() < 0.05 * power[frequency < 1.0].mean()
    run = arm.record(tracked, 250.0, np.random.default_rng(1), derivatives=True)
    exact = robot.inverse_dynamics(run.q, run.dq, run.ddq)
    assert_allclose(run.tau - exact, -tracked.drive(run.t), rtol=0, atol=1e-9)


def test_recorded_encoder_noise_is_what_the_controller_saw(arm, plan):
    loud = replace(arm.rigid(), motor_noise=np.full(6, 1e-4), motor_resolution=np.zeros(6), noise_std=np.zeros(6))
    tracked = track(loud, plan, Tracking(), np.random.default_rng(0))
    run = loud.record(tracked, 500.0, np.random.default_rng(1))
    noise = run.q_motor - loud.motion(tracked, run.t).q_motor
    assert_allclose(noise.std(axis=0), 1e-4, rtol=5 / np.sqrt(2 * run.n_samples))
    assert_allclose(noise, tracked.encoder_noise(run.t), rtol=0, atol=1e-12)
    silent = track(replace(loud, motor_noise=np.zeros(6)), plan, Tracking(), np.random.default_rng(0))
    moved = tracked.error(run.t)[0] - silent.error(run.t)[0]
    assert 1e-6 < moved.std() < 1e-4


def test_a_seed_repeats_all_and_runs_do_not_depend_on_their_number(arm):
    first, again = (simulate(arm, n_runs=2, duration=5.0, seed=4, tracking=Tracking()) for _ in range(2))
    more = simulate(arm, n_runs=3, duration=5.0, seed=4, tracking=Tracking())
    ideal = simulate(arm, n_runs=2, duration=5.0, seed=4)
    for run in range(2):
        for name in ("t", "q", "q_motor", "tau"):
            value = getattr(first.recordings[run], name)
            assert_array_equal(value, getattr(again.recordings[run], name))
            assert_array_equal(value, getattr(more.recordings[run], name))
        # The plan is the same with and without a controller.
        assert_array_equal(first.reference(run), ideal.reference(run))
        off = np.abs(first.recordings[run].q - ideal.recordings[run].q).max()
        assert 1e-5 < off < 0.02
    truth = first.truth()
    assert truth["tracking"]["bandwidth_hz"] == 10.0
    assert ideal.truth()["tracking"] is None


@pytest.mark.parametrize("kinds", [["prismatic"], ["revolute", "prismatic", "revolute"]], ids=len)
def test_any_serial_robot_is_tracked(kinds):
    robot = _core.RobotModel.from_urdf_string(chain(kinds))
    simulation = simulate(typical_arm(robot), n_runs=1, duration=5.0, tracking=Tracking())
    off = np.abs(simulation.recordings[0].q - simulation.reference(0))
    assert (off.max(axis=0) > 1e-6).all()
    assert (off.max(axis=0) < 0.05).all()


def test_a_robot_without_masses_is_held_all_the_same():
    text = re.sub(r"<inertial>.*?</inertial>", "", chain(["revolute"] * 3))
    robot = _core.RobotModel.from_urdf_string(text)
    assert not robot.phi.any()
    simulation = simulate(typical_arm(robot), n_runs=1, duration=5.0, tracking=Tracking())
    assert np.abs(simulation.recordings[0].q - simulation.reference(0)).max() < 0.1


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"bandwidth": 0.0}, "the bandwidth of tracking must lie between 1 and 30 Hz, got 0 Hz"),
        ({"bandwidth": np.nan}, "the bandwidth of tracking"),
        ({"damping": 0.0}, "the damping of tracking must lie between 0.1 and 2, got 0"),
        ({"disturbance": -1.0}, "the disturbance must lie between 0 and 1"),
        ({"disturbance": np.nan}, "the disturbance must lie between 0 and 1"),
    ],
)
def test_a_wrong_controller_is_refused(numbers, words):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as caught:
        Tracking(**numbers)
    assert words in str(caught.value)


def test_least_squares_is_biased_and_the_plan_is_an_instrument():
    """Why instrumental variables exist: a pendulum of 0.1 kg m^2, 0.8 N m of slow drive disturbance."""
    robot = _core.RobotModel.from_urdf_string(chain(["revolute"]))
    arm, base = SimulatedArm(robot), robot.base_parameters()
    true = base.project(robot.phi)
    direct, instrumental = [], []
    for seed in range(6):
        plan = random_trajectory(motion_limits(robot), 40.0, np.random.default_rng(seed))
        path = track(arm, plan, Tracking(3.0, disturbance=0.002), np.random.default_rng(seed + 100))
        run = arm.record(path, 50.0, np.random.default_rng(0), derivatives=True)
        A = base.reduce(robot.joint_torque_regressor(run.q, run.dq, run.ddq))[:, 0]
        Z = base.reduce(robot.joint_torque_regressor(*plan.evaluate(run.t)))[:, 0]
        direct.append(np.linalg.lstsq(A, run.tau[:, 0])[0] - true)
        instrumental.append(np.linalg.solve(Z.T @ A, Z.T @ run.tau[:, 0]) - true)

    def sigmas(errors):
        return np.mean(errors, axis=0) / (np.std(errors, axis=0, ddof=1) / np.sqrt(len(errors)))

    inertia = base.names.index("Iyy[l1]")
    assert sigmas(direct)[inertia] < -10
    assert np.mean(direct, axis=0)[inertia] < -0.5 * true[inertia]
    assert np.abs(sigmas(instrumental)).max() < 4
    assert abs(np.mean(instrumental, axis=0)[inertia]) < 0.1 * true[inertia]
