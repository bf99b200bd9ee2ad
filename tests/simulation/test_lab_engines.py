"""The laboratory against an independent engine, and against its own energy."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from helpers.data import data_file
from helpers.engines import MuJoCo, Pinocchio
from helpers.robots import with_inertials, with_moved_joint
from helpers.tolerances import MUJOCO
from numpy.testing import assert_allclose
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.interpolate import CubicSpline

from dynid_rs import _core
from dynid_rs.simulation import (
    SimulatedArm,
    Tracking,
    build_effects,
    bundled_robot,
    equip,
    kind_names,
    motion_limits,
    parse_wish,
    random_trajectory,
    track,
    typical_arm,
)
from dynid_rs.simulation.motion import friction_torque

GRAVITY = (0.0, 0.0, -9.81)
ENERGY = 1e-6
"""Of the work that passes a joint's motor: splines and Simpson's rule at 0.25 ms."""
TWO_MASS = 1e-3
"""Of the largest torque: a second derivative of encoder positions 0.5 ms apart."""

ROBOTS = ("bundled", "ur10e_innopolis", "panda_gaz")


def urdf_of(name):
    text = bundled_robot().read_text() if name == "bundled" else data_file(name).read_text()
    return with_inertials(text, 1)


def laboratory(name):
    """URDF, its robot and an arm that follows a plan under a controller; rigid ideal gears, no friction."""
    urdf = urdf_of(name)
    robot = _core.RobotModel.from_urdf_string(urdf, gravity=GRAVITY)
    return urdf, robot, SimulatedArm(robot)


def tracked(arm, duration=8.0, seed=0):
    """A motion that a controller makes of a plan, disturbed as a typical arm is."""
    plan = random_trajectory(motion_limits(arm.robot), duration, np.random.default_rng(seed))
    disturbed = typical_arm(arm.robot, encoder_noise=1e-6)
    return track(disturbed, plan, Tracking(disturbance=0.01), np.random.default_rng(seed))


@pytest.mark.parametrize("name", ROBOTS)
def test_rigid_torque_is_mujocos_inverse_dynamics(name):
    urdf, _, arm = laboratory(name)
    motion = arm.motion(tracked(arm), np.arange(0.0, 8.0, 0.01))
    reference = MuJoCo(urdf, GRAVITY).inverse_dynamics(motion.q, motion.dq, motion.ddq)
    scale = np.abs(reference).max(axis=0)
    # A joint on which nothing pulls (axis along gravity, light wrist) is measured against its neighbours.
    scale = np.maximum(scale, 1e-3 * scale.max())
    assert_allclose(motion.tau / scale, reference / scale, rtol=0, atol=MUJOCO)
    assert np.abs(motion.q - tracked(arm).plan.evaluate(motion.t)[0]).max() > 1e-5


@pytest.mark.parametrize("name", ROBOTS)
def test_mujoco_driven_by_the_torque_stays_on_the_motion(name):
    urdf, _, arm = laboratory(name)
    path, start, length = tracked(arm), 3.0, 0.2
    engine = MuJoCo(urdf, GRAVITY)
    model, data = engine.model, engine.data
    model.opt.timestep, model.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    q, dq, _ = path.evaluate(np.array([start]))
    data.qpos[:], data.qvel[:] = q[0], dq[0]
    steps = round(length / 1e-4)
    times = start + 1e-4 * (np.arange(steps) + 0.5)
    torques = arm.motion(path, times).tau
    for tau in torques:
        data.qfrc_applied[:] = tau  # constant over a step: an error of second order
        mujoco.mj_step(model, data)
    q_end, dq_end, _ = path.evaluate(np.array([start + length]))
    travelled = np.abs(q_end - q).max()
    assert travelled > 0.01
    assert_allclose(data.qpos, q_end[0], rtol=0, atol=1e-5 * travelled)
    assert_allclose(data.qvel, dq_end[0], rtol=0, atol=1e-4 * np.abs(dq_end).max())


def test_forward_simulation_of_an_elastic_joint_stays_on_the_motion():
    """Two masses and a spring per joint, integrated from the laboratory's motor torque by another solver."""
    urdf, robot, _ = laboratory("bundled")
    rigid = SimulatedArm(robot, rotor_inertia=typical_arm(robot).rotor_inertia)
    # Soft and damped, so that a solver need not follow a whistle of 100 Hz.
    arm = replace(rigid, stiffness=np.asarray(robot.effort_limits) / 2e-2, damping=100.0)
    plan = random_trajectory(motion_limits(robot), 8.0, np.random.default_rng(0))
    t = np.arange(3.0, 3.3, 5e-4)
    motion = arm.motion(plan, t)
    engine = MuJoCo(urdf, GRAVITY)
    torque = CubicSpline(t, motion.tau)

    def slope(time, state):
        q, x, dq, dx = state.reshape(4, 6)
        spring = arm.stiffness * (x - q) + arm.damping * (dx - dq)
        engine.data.qpos[:], engine.data.qvel[:], engine.data.qfrc_applied[:] = q, dq, spring
        mujoco.mj_forward(engine.model, engine.data)
        return np.concatenate([dq, dx, engine.data.qacc, (torque(time) - spring) / arm.rotor_inertia])

    start = np.concatenate([motion.q[0], motion.q_motor[0], motion.dq[0], motion.dq_motor[0]])
    answer = solve_ivp(slope, (t[0], t[-1]), start, rtol=1e-9, atol=1e-11, method="LSODA")
    q, q_motor = answer.y[:6, -1], answer.y[6:12, -1]
    travelled = np.abs(motion.q[-1] - motion.q[0]).max()
    assert travelled > 0.05
    assert_allclose(q, motion.q[-1], rtol=0, atol=1e-4 * travelled)
    assert_allclose(q_motor, motion.q_motor[-1], rtol=0, atol=1e-4 * travelled)


def test_two_mass_equations_hold_between_the_encoders():
    """Spring torque from the two positions is Pinocchio's link torque; what is left of the motor's moves its rotor."""
    urdf, robot, _ = laboratory("bundled")
    arm = replace(typical_arm(robot, noise=0.0, delay=0.0), kinematic_error=np.zeros(6))
    path = tracked(SimulatedArm(robot))
    run = arm.motion(path, np.arange(0.0, 8.0, 5e-4))
    inside = slice(1000, -1000)
    link = Pinocchio(urdf, GRAVITY).inverse_dynamics(run.q, run.dq, run.ddq)
    for joint in range(6):
        deflection = CubicSpline(run.t, run.q_motor[:, joint] - run.q[:, joint])
        spring = arm.stiffness[joint] * deflection(run.t) + arm.damping[joint] * deflection(run.t, 1)
        scale = np.abs(link[:, joint]).max()
        z = run.hysteresis[:, joint]
        assert_allclose((spring + z)[inside], link[inside, joint], rtol=0, atol=TWO_MASS * scale)
        rotor = arm.rotor_inertia[joint] * CubicSpline(run.t, run.q_motor[:, joint])(run.t, 2)
        friction = friction_torque(arm, run.dq_motor)[:, joint]
        motor = spring + (1 + arm.hysteresis_loss[joint]) * z + rotor + friction + arm.torque_offset[joint]
        assert_allclose(motor[inside], run.tau[inside, joint], rtol=0, atol=TWO_MASS * np.abs(run.tau[:, joint]).max())


def energy(urdf, robot, phi, q, dq):
    """Kinetic and potential energy of the links (n,) [J], by Pinocchio."""
    import pinocchio as pin

    peer = Pinocchio(urdf, robot.gravity)
    for j, body in enumerate(np.reshape(phi, (-1, 10))):
        peer.model.inertias[j + 1] = pin.Inertia.FromDynamicParameters(body)
    return np.array(
        [
            pin.computeKineticEnergy(peer.model, peer.data, a, b) + pin.computePotentialEnergy(peer.model, peer.data, a)
            for a, b in zip(q, dq, strict=True)
        ]
    )


def test_work_of_the_motors_is_energy_and_losses():
    """All effects that act on the torque, at once: not a joule is lost or made."""
    urdf = urdf_of("bundled")
    robot = _core.RobotModel.from_urdf_string(urdf, gravity=GRAVITY)
    typical = typical_arm(robot, noise=0.0, delay=0.0)
    effects = build_effects([parse_wish(kind) for kind in kind_names()], typical)
    arm = equip(replace(typical.rigid(), delay=0.0), effects)
    (moved,) = (effect for effect in effects if effect.kind == "kinematic_error")
    true_urdf = with_moved_joint(urdf, robot.joint_names[moved.joints[0]], moved.offset, moved.turn)
    plan = random_trajectory(motion_limits(robot), 10.0, np.random.default_rng(1))
    arm = arm.of_run(0, plan.duration, np.random.default_rng(1))
    path = track(arm, plan, Tracking(), np.random.default_rng(0))
    t = np.arange(0.0, plan.duration, 2.5e-4)
    motion = arm.motion(path, t)

    def work(torque, rate):
        return cumulative_simpson(np.sum(torque * rate, axis=1), x=t, initial=0.0)

    stored = energy(true_urdf, arm.robot, arm.phi, motion.q, motion.dq)
    stored = stored + 0.5 * np.sum(arm.rotor_inertia * motion.dq_motor**2, axis=1)
    x_rate = motion.dq_motor / (1 + slope_of_gear_error(arm, motion))
    in_gears = energy_in_gears(arm, motion, x_rate - motion.dq, t)
    links, motors = np.zeros_like(t), np.zeros_like(t)
    for effect, torque in zip(arm.effects, motion.effects, strict=True):
        if effect.link_torque(arm, t, motion.q) is None:
            motors += work(torque, motion.dq_motor)
        else:
            links += work(torque, motion.dq)
    lost = work(friction_torque(arm, motion.dq_motor) + arm.torque_offset, motion.dq_motor)
    lost = lost + work(arm.hysteresis_loss * motion.hysteresis, x_rate)
    given = work(motion.tau, motion.dq_motor)
    passed = np.trapezoid(np.abs(motion.tau * motion.dq_motor), t, axis=0).sum()
    parts = (stored - stored[0], in_gears - in_gears[0], links, motors, lost)
    assert np.abs(given - sum(parts)).max() < ENERGY * passed
    # The check would see it if one of them were missing.
    assert min(np.abs(part).max() for part in parts) > 20 * ENERGY * passed


def energy_in_gears(arm, motion, ddeflection, t):
    """What springs, stiffening and play hold, in closed form, and what dampers and hysteresis took (n,) [J]."""
    nonlinear, play = (next(e for e in arm.effects if e.kind == kind) for kind in ("nonlinear_elasticity", "backlash"))
    tau = motion.tau_gear
    x = np.clip(tau / play.width, -1, 1)
    spring = motion.deflection - nonlinear.cubic * tau**3 - play.gap / 2 * (15 * x - 10 * x**3 + 3 * x**5) / 8
    held = 0.5 * arm.stiffness * spring**2 + 0.75 * nonlinear.cubic * tau**4
    held = held + play.gap / 2 * play.width * (15 / 2 * x**2 - 15 / 2 * x**4 + 5 / 2 * x**6) / 8
    tau_rate = CubicSpline(t, tau)(t, 1)
    step_slope = np.where(np.abs(tau) < play.width, 15 / 8 * (1 - x**2) ** 2 / play.width, 0.0)
    rate = ddeflection - (3 * nonlinear.cubic * tau**2 + play.gap / 2 * step_slope) * tau_rate
    taken = np.sum((arm.damping * rate + motion.hysteresis) * rate, axis=1)
    return np.sum(held, axis=1) + cumulative_simpson(taken, x=t, initial=0.0)


def slope_of_gear_error(arm, motion):
    angle = arm.kinematic_cycles * (motion.q + motion.deflection) + arm.kinematic_phase
    return arm.kinematic_error * arm.kinematic_cycles * np.cos(angle)
