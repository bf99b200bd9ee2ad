"""Effects that are torque columns: each adds what its definition says, written out here once more."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

from dynid_rs import _core
from dynid_rs.simulation import (
    SimulatedArm,
    build_effect,
    bundled_robot,
    equip,
    kind_names,
    motion_limits,
    parse_wish,
    random_trajectory,
    simulate,
    typical_arm,
)

ROUNDING = 1e-10
"""Same mathematics; the sum is taken with the rigid torque and away again."""
DAHL = 1e-4
"""Of the level: an adaptive solver with a switch, and straight lines between 0.5 ms."""


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def typical(robot):
    return typical_arm(robot, noise=0.0)


@pytest.fixture(scope="module")
def trajectory(robot):
    return random_trajectory(motion_limits(robot), 12.0, np.random.default_rng(7))


def number(effect, name):
    return np.array(next(value.value for value in effect.values if value.name == name))


def added(robot, trajectory, effect, step=0.01):
    """Motion of an ideal arm with the effect, and what the effect adds to its torque."""
    arm = equip(SimulatedArm(robot), [effect])
    motion = arm.motion(trajectory, np.arange(0.0, trajectory.duration, step))
    extra = motion.tau - robot.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    assert_allclose(extra, motion.effects[0], rtol=0, atol=ROUNDING * np.abs(motion.tau).max())
    return motion, extra


def stribeck(p, m, j):
    v = m.dq[:, j]
    level = np.where(v >= 0, p("stribeck_pos"), p("stribeck_neg"))
    return level * np.tanh(v / p("transition_width")) * np.exp(-((np.abs(v) / p("stribeck_velocity")) ** p("exponent")))


def load_dependent_friction(p, m, j):
    v, load = m.dq[:, j], np.abs(m.tau_link[:, j])
    return (p("load_friction") + p("load_friction_speed") * np.abs(v)) * load * np.tanh(v / p("transition_width"))


def bearing_friction(p, m, j):
    beside = j + 1 if j + 1 < m.q.shape[1] else j - 1
    assert beside == j + p("side")
    return p("bearing_friction") * np.abs(m.tau_link[:, beside]) * np.tanh(m.dq[:, j] / p("transition_width"))


def position_dependent_friction(p, m, j):
    angle = p("cycles") * m.q[:, j]
    around = p("position_friction_cos") * np.cos(angle) + p("position_friction_sin") * np.sin(angle)
    return around * np.tanh(m.dq[:, j] / p("transition_width"))


def torque_ripple(p, m, j):
    angle = p("cycles") * m.q[:, j]
    first = p("ripple_cos1") * np.cos(angle) + p("ripple_sin1") * np.sin(angle)
    return first + p("ripple_cos2") * np.cos(2 * angle) + p("ripple_sin2") * np.sin(2 * angle)


def torque_saturation(p, m, j):
    return p("saturation") * m.tau_link[:, j] ** 3


def joint_spring(p, m, j):
    return p("spring_stiffness") * (m.q[:, j] - p("rest_position"))


def counterbalance(p, m, j):
    """Derivative of the gas' energy by a complex step."""
    q = m.q[:, j] + 1e-30j
    length = np.sqrt(p("a") ** 2 + p("b") ** 2 + 2 * p("a") * p("b") * np.cos(q + p("phase")))
    energy = -p("counterbalance") * np.log(p("gas_length") - length + abs(p("a") - p("b")))
    return energy.imag / 1e-30


def thermal_friction(p, m, j):
    v = m.dq[:, j]
    warmth = 1 - np.exp(-m.t / p("time_constant"))
    return warmth * (p("warm_coulomb") * np.tanh(v / p("transition_width")) + p("warm_viscous") * v)


DEFINITIONS = (
    stribeck,
    load_dependent_friction,
    bearing_friction,
    position_dependent_friction,
    torque_ripple,
    torque_saturation,
    joint_spring,
    counterbalance,
    thermal_friction,
)


@pytest.mark.parametrize("size", [1.0, 2.5])
@pytest.mark.parametrize("definition", DEFINITIONS, ids=lambda definition: definition.__name__)
def test_torque_is_what_the_definition_says(robot, typical, trajectory, definition, size):
    effect = build_effect(parse_wish(f"{definition.__name__}::{size}"), typical)
    motion, extra = added(robot, trajectory, effect, step=0.01 if definition is not thermal_friction else 0.0105)
    expected = np.zeros_like(extra)
    for place, joint in enumerate(effect.joints):
        expected[:, joint] = definition(lambda name, place=place: number(effect, name)[place], motion, joint)
    tolerance = 1e-4 if definition is thermal_friction else ROUNDING  # straight between 0.5 ms
    assert_allclose(extra, expected, rtol=0, atol=tolerance * np.abs(motion.tau).max(axis=0).max())
    share = np.abs(extra).max(axis=0)[list(effect.joints)] / np.asarray(robot.effort_limits)[list(effect.joints)]
    assert (share > 1e-4 * size).all()
    assert (share < 0.4 * size).all()


def test_every_column_that_can_be_found_can_be_put_in():
    found = {entry["kind"] for entry in _core.effect_catalogue() if not entry["declared"]}
    tested = {definition.__name__ for definition in DEFINITIONS}
    others = {"coupled_friction", "inertial_coupling", "friction_hysteresis", "load_hysteresis"}
    # `thermal_drift` is friction that follows its thermometers: see test_temperature.py. What a gear loses comes with
    # `joint_elasticity`.
    by_another_name = {"temperature_friction", "gear_hysteresis"}
    assert found == tested | others | by_another_name
    assert found - by_another_name <= set(kind_names())


def test_default_sizes_follow_the_effort_limit(typical, robot):
    effort, speed = np.asarray(robot.effort_limits), np.asarray(robot.velocity_limits)
    for wish, name, expected in (
        ("stribeck", "stribeck_pos", 0.03 * effort),
        ("stribeck", "stribeck_velocity", 0.05 * speed),
        ("load_dependent_friction", "load_friction", np.full(6, 0.06)),
        ("load_dependent_friction", "load_friction_speed", 0.02 / speed),
        ("bearing_friction", "bearing_friction", np.full(6, 0.04)),
        ("position_dependent_friction", "position_friction_cos", 0.02 * effort),
        ("friction_hysteresis", "hysteresis", 0.03 * effort),
        ("load_hysteresis", "load_hysteresis", np.full(6, 0.06)),
        ("torque_ripple", "ripple_cos1", 0.01 * effort),
        ("torque_saturation", "saturation", 0.05 / effort**2),
        ("coupled_friction", "coupled_friction", 0.03 * min(effort[4:]) * np.ones(2)),
        ("thermal_friction", "warm_coulomb", -0.3 * 0.04 * effort),
    ):
        assert_allclose(number(build_effect(parse_wish(wish), typical), name), expected, rtol=1e-12)


def test_pairs_feel_each_other(robot, typical, trajectory):
    effect = build_effect(parse_wish("coupled_friction"), typical)
    assert effect.joints == (5, 4)
    motion, extra = added(robot, trajectory, effect)
    level, width = number(effect, "coupled_friction")[0], number(effect, "transition_width")[0]
    both = level * np.tanh((motion.dq[:, 4] + motion.dq[:, 5]) / width)
    assert_allclose(extra[:, 4:], np.stack([both, both], axis=1), rtol=0, atol=1e-8)
    assert_allclose(extra[:, :4], 0.0, atol=1e-8)
    # Nothing but loss: the stage turns at the sum of both speeds.
    assert (np.sum(extra * motion.dq, axis=1) > -1e-8).all()

    effect = build_effect(parse_wish("inertial_coupling:joint_1:-2"), typical)
    assert effect.joints == (0, 1)
    motion, extra = added(robot, trajectory, effect)
    level = -0.6 * np.sqrt(typical.rotor_inertia[0] * typical.rotor_inertia[1])
    assert_allclose(extra[:, :2], level * motion.ddq[:, 1::-1], rtol=0, atol=1e-8)
    assert_allclose(extra[:, 2:], 0.0, atol=1e-8)


def test_hysteresis_is_dahls_whatever_the_rate(robot, typical, trajectory):
    effect = build_effect(parse_wish("friction_hysteresis:0"), typical)
    (level,), (way,) = number(effect, "hysteresis"), number(effect, "presliding_distance")
    motion, extra = added(robot, trajectory, effect, step=0.02)

    def slope(t, z):
        rate = trajectory.evaluate(np.array([t]))[1][0, 0]
        return rate / way * (1 - z * np.sign(rate))

    answer = solve_ivp(
        slope, (0.0, motion.t[-1]), [0.0], t_eval=motion.t, rtol=1e-8, atol=1e-9, max_step=2e-3, method="LSODA"
    )
    assert_allclose(extra[:, 0], level * answer.y[0], rtol=0, atol=DAHL * level)
    # A run of other rate remembers the same.
    often, at_those = added(robot, trajectory, effect, step=0.005)
    assert_allclose(at_those[::4, 0], extra[:, 0], rtol=0, atol=1e-8)
    assert_array_equal(often.t[::4], motion.t)


def test_springs_and_cylinders_wind_the_gear_up(robot, trajectory):
    springs = SimulatedArm(robot, stiffness=3e5)
    for kind in ("joint_spring", "counterbalance"):
        effect = build_effect(parse_wish(kind), springs)
        arm = equip(springs, [effect])
        motion = arm.motion(trajectory, np.arange(0.0, trajectory.duration, 0.01))
        (joint,) = effect.joints
        assert np.abs(motion.effects[0][:, joint]).max() > 10.0
        transmitted = robot.inverse_dynamics(motion.q, motion.dq, motion.ddq) + motion.effects[0]
        assert_allclose(3e5 * (motion.q_motor - motion.q), transmitted, rtol=0, atol=1e-6 * np.abs(transmitted).max())
        assert_allclose(motion.tau, transmitted, rtol=0, atol=1e-9 * np.abs(transmitted).max())


def test_counterbalance_carries_gravity(robot, typical):
    effect = build_effect(parse_wish("counterbalance"), typical)
    (joint,) = effect.joints
    assert joint == 1
    limits = motion_limits(robot)
    q = np.random.default_rng(1).uniform(limits.lower, limits.upper, (3000, 6))
    still = np.zeros_like(q)
    load = robot.inverse_dynamics(q, still, still)[:, joint]
    carried = effect.link_torque(typical, np.zeros(len(q)), q)[:, joint]
    assert np.mean(load * carried) < 0
    assert (load + carried).std() < 0.8 * load.std()


def test_session_warms_the_arm_up_and_thermometers_show_it(robot, typical):
    cold = replace(typical.rigid(), delay=0.0)
    warm = equip(cold, [build_effect(parse_wish("thermal_drift"), typical)])
    plain, session = (simulate(arm, n_runs=3, duration=15.0, derivatives=True) for arm in (cold, warm))
    for run, (before, after) in enumerate(zip(plain.recordings, session.recordings, strict=True)):
        f = 1 - np.exp(-(run * 25.0 + after.t) / 120.0)
        friction = before.tau - robot.inverse_dynamics(before.q, before.dq, before.ddq)
        friction -= cold.rotor_inertia * before.ddq + cold.torque_offset
        expected = -0.3 * f[:, None] * friction
        assert_allclose(after.tau - before.tau, expected, rtol=0, atol=1e-9 * np.abs(before.tau).max())
        assert_allclose(after.temperature, np.tile(25.0 + 20.0 * f[:, None], 6), rtol=0, atol=0.051)
    starts = [run["effects"][0]["parameters"][-1]["value"] for run in session.truth()["runs"]]
    assert starts == [0.0, 25.0, 50.0]


def test_a_rotor_pair_keeps_positive_energy(typical):
    with pytest.raises(ValueError, match=r"negative energy; take less than 3\.33"):
        build_effect(parse_wish("inertial_coupling::4"), typical)
    with pytest.raises(ValueError, match=r"would leave no friction; take less than 3\.33"):
        build_effect(parse_wish("thermal_drift::4"), typical)
