"""Eqs. 3-12 of the double-encoder paper, each by its number against an independent route."""

import numpy as np
import pinocchio as pin
import pytest
from helpers import printed
from helpers.engines import Pinocchio
from helpers.robots import random_chain, random_states, with_inertials
from helpers.small_arm import URDF
from helpers.tolerances import ALGEBRAIC, PINOCCHIO, relative_error
from numpy.testing import assert_allclose

from dynid_rs import FrictionIdentifier, RobotModel, _core
from dynid_rs.excitation.friction_experiment import plan_friction_experiment
from dynid_rs.identification.friction import friction_effect
from dynid_rs.identification.friction_experiment import odd_friction
from dynid_rs.identification.friction_experiment.pairs import SAME_PLACE, SAME_SPEED, find_mirrors
from dynid_rs.identification.friction_experiment.rows import PairWindow, pair_rows
from dynid_rs.identification.friction_laws import with_laws
from dynid_rs.regression.columns import make_plan, observe
from dynid_rs.runs.preprocessing import Band, States, prepare
from dynid_rs.runs.recording import Recording

SEEDS = (3, 8)
K = np.array([3.0, 2.6, 1.1, 0.9, -0.4, 0.3, 0.05, 0.07])
"""Coefficients in the order of `FRICTION_NAMES`: both directions of Coulomb, then of each viscous order."""


@pytest.fixture(params=SEEDS)
def arm(request):
    """A random chain by this package and by Pinocchio, with its states."""
    chain = random_chain(request.param)
    urdf = with_inertials(chain.urdf, request.param)
    robot = RobotModel.from_urdf_string(urdf, gravity=chain.gravity)
    return robot, Pinocchio(urdf, chain.gravity), random_states(40, chain.n_joints, request.param)


def test_eq_3_coriolis_torque_is_even_in_velocity(arm):
    robot, engine, (q, dq, _) = arm
    rest = np.zeros_like(q)
    ours = robot.inverse_dynamics(q, -dq, rest) - robot.inverse_dynamics(q, rest, rest)
    theirs = engine.inverse_dynamics(q, dq, rest) - engine.inverse_dynamics(q, rest, rest)
    assert relative_error(ours, theirs) < 10 * PINOCCHIO


def test_eq_3_by_pinocchios_coriolis_matrix(arm):
    robot, engine, (q, dq, _) = arm
    rest = np.zeros_like(q)
    ours = robot.inverse_dynamics(q, -dq, rest) - robot.inverse_dynamics(q, rest, rest)
    matrix = [
        pin.computeCoriolisMatrix(engine.model, engine.data, pose, speed) @ speed
        for pose, speed in zip(engine.configurations(q), dq, strict=True)
    ]
    assert relative_error(ours, np.array(matrix)) < 1e-9


def test_eq_4_friction_is_odd_only_with_mirrored_sides():
    dq = np.linspace(0.01, 2.0, 200)
    dq = np.concatenate([-dq[::-1], dq])
    mirrored = K.copy()
    mirrored[1::2] = mirrored[::2] * np.array([1, 1, -1, 1])  # the quadratic term keeps its sign as printed
    basis = _core.friction_basis(dq, 0.05, 0.02)
    assert_allclose(basis @ mirrored, -(basis @ mirrored)[::-1], **ALGEBRAIC)
    for broken in (K, np.repeat(mirrored[::2], 2)):
        assert np.abs(basis @ broken + (basis @ broken)[::-1]).max() > 0.1


def test_eqs_5_to_7_half_the_difference_is_inertia_and_friction(arm):
    robot, engine, (q, dq, ddq) = arm
    friction = printed.friction(dq.ravel(), 0.0, 0.02, np.repeat(K[::2], 2) * np.tile([1, 1, 1, 1, 1, -1, 1, 1], 1))
    friction = friction.reshape(dq.shape)
    tau_1 = robot.inverse_dynamics(q, dq, ddq) + friction
    tau_2 = robot.inverse_dynamics(q, -dq, -ddq) - friction  # Eq. 5: -dq and -ddq
    inertia = []
    for pose, acceleration in zip(engine.configurations(q), ddq, strict=True):
        upper = np.triu(pin.crba(engine.model, engine.data, pose))
        inertia.append((upper + upper.T - np.diag(np.diag(upper))) @ acceleration)
    assert relative_error(tau_1 - tau_2, 2 * np.array(inertia) + 2 * friction) < 1e-11


THRESHOLD, WIDTH = 0.05, 0.02
"""Lambda and eps of the exact data [rad/s]."""


@pytest.fixture(scope="module")
def played():
    """The planned friction experiment of a small arm without any measurement: (plan, States), torque by Pinocchio."""
    robot = RobotModel.from_urdf_string(URDF)
    planned = plan_friction_experiment(robot, n_speeds=4, leg_time=1.0, pair_time=8.0, levels=(1.0, 0.1))
    t = np.arange(0, planned.duration, 1 / 250.0)
    q, dq, ddq = planned.evaluate(t)
    friction = np.stack([printed.friction(speed, THRESHOLD, WIDTH, K) for speed in dq.T], axis=1)
    tau = Pinocchio(URDF, (0.0, 0.0, -9.81)).inverse_dynamics(q, dq, ddq) + friction
    everywhere = np.ones(len(t), dtype=bool)
    return planned, States("exact", t, q, dq, ddq, q, dq, ddq, tau, 250.0, Band(1e3), everywhere, False)


def test_eq_5_pairs_are_found_at_the_same_place_with_opposite_speed(played):
    """By the plan's closed form: legs with ddq = 0 as printed, reversed motion with +ddq, which Eq. 5 has as -ddq."""
    planned, states = played
    n_legs = n_reversed = 0
    for mirror in find_mirrors(states):
        after, before = mirror.samples()
        first, second = (planned.evaluate(np.interp(k, np.arange(len(states.t)), states.t)) for k in (after, before))
        reach, top = np.ptp(states.q, axis=0), np.abs(states.dq).max(axis=0)
        assert (np.abs(first[0] - second[0]) <= SAME_PLACE * reach).all()
        assert (np.abs(first[1] + second[1]) <= SAME_SPEED * top).all()
        if np.count_nonzero(mirror.moves) == 1:
            n_legs += 1
            j = int(np.flatnonzero(mirror.moves)[0])
            steady = (first[1][:, j] != 0) & (first[2][:, j] == 0) & (second[2][:, j] == 0)
            assert steady.sum() > 100
            assert_allclose(first[1][steady, j], -second[1][steady, j], rtol=1e-9)
        else:
            n_reversed += 1
            same = np.abs(first[2] - second[2]).max(axis=1) < 0.01 * np.abs(first[2]).max()
            assert same.mean() > 0.98  # a mirror may run into the next motion until speeds tell
    assert n_legs >= 3 * 4
    assert n_reversed == 2


def mirrored_states(sign):
    """(engine, States): 30 random samples, then each with q, -dq and sign * ddq; torque by Pinocchio as in Eq. 6."""
    engine = Pinocchio(URDF, (0.0, 0.0, -9.81))
    q, dq, ddq = random_states(30, 3, 5)
    q, dq, ddq = np.tile(q, (2, 1)), np.concatenate([dq, -dq]), np.concatenate([ddq, sign * ddq])
    friction = np.stack([printed.friction(speed, THRESHOLD, WIDTH, K) for speed in dq.T], axis=1)
    tau = engine.inverse_dynamics(q, dq, ddq) + friction
    t = np.arange(60) / 250.0
    return engine, States("pairs", t, q, dq, ddq, q, dq, ddq, tau, 250.0, Band(1e3), np.ones(60, dtype=bool), False)


@pytest.mark.parametrize("sign", [-1.0, 1.0], ids=["as_printed", "played_backwards"])
def test_eqs_6_and_7_rows_of_a_pair(sign):
    """Odd rows hold M ddq (but where time runs back) and odd friction, even ones everything else."""
    engine, states = mirrored_states(sign)
    robot = RobotModel.from_urdf_string(URDF)
    plan = make_plan(robot, [friction_effect(np.full(3, THRESHOLD), np.full(3, WIDTH))])
    after, before = np.arange(30), np.arange(30, 60)
    used, places = np.ones((3, 30), dtype=bool), np.stack([after, before])
    odd, even = pair_rows(plan, [PairWindow(states, after, before, used, places, used)])
    q, dq, ddq = states.q[:30], states.dq[:30], states.ddq[:30]
    rest = np.zeros_like(q)
    inertia = engine.inverse_dynamics(q, rest, ddq) - engine.inverse_dynamics(q, rest, rest)
    still = engine.inverse_dynamics(q, dq, rest)  # Coriolis torque and gravity
    phi_base = robot.base_parameters().project(engine.phi)
    for j in range(3):
        forwards, backwards = (printed.friction(s * dq[:, j], THRESHOLD, WIDTH, K) for s in (1, -1))
        odd_torque = (forwards - backwards) / 2 + (1 - sign) / 2 * inertia[:, j]
        even_torque = (forwards + backwards) / 2 + still[:, j] + (1 + sign) / 2 * inertia[:, j]
        true = np.concatenate([K, phi_base[plan.unknowns(j)[8:]]])
        for rows, torque in ((odd[j], odd_torque), (even[j], even_torque)):
            assert_allclose(rows[:, -1], torque, **ALGEBRAIC)
            assert_allclose(rows[:, :-1] @ true, torque, **ALGEBRAIC)


def test_eq_8_friction_of_the_experiment_is_the_odd_part_of_what_was_put_in(played):
    """Half the difference of the torques, from exact data; legs are closer than classes of speed."""
    for odd in odd_friction(played[1]):
        truth = (
            printed.friction(odd.speed, THRESHOLD, WIDTH, K) - printed.friction(-odd.speed, THRESHOLD, WIDTH, K)
        ) / 2
        legs = np.array(odd.kind) == "leg"
        assert legs.sum() >= 3
        assert_allclose(odd.tau_odd[legs], truth[legs], rtol=2e-3)
        smooth = ~legs & (odd.speed > 2 * THRESHOLD)  # within a class the law bends, and jumps at lambda
        assert smooth.sum() >= 5
        assert_allclose(odd.tau_odd[smooth], truth[smooth], rtol=1e-2)


def test_eq_8_is_exact_for_motion_played_backwards_in_time(arm):
    robot, _, (q, dq, ddq) = arm
    basis = _core.friction_basis(dq.ravel(), 0.03, 0.02)
    back = _core.friction_basis(-dq.ravel(), 0.03, 0.02)
    tau_1 = robot.inverse_dynamics(q, dq, ddq) + (basis @ K).reshape(q.shape)
    tau_2 = robot.inverse_dynamics(q, -dq, ddq) + (back @ K).reshape(q.shape)
    odd = (printed.friction(dq.ravel(), 0.03, 0.02, K) - printed.friction(-dq.ravel(), 0.03, 0.02, K)).reshape(
        q.shape
    ) / 2
    assert relative_error((tau_1 - tau_2) / 2, odd) < 1e-10


def test_eq_8_as_printed_leaves_inertia_unless_speed_is_constant(arm):
    robot, _, (q, dq, ddq) = arm
    mirrored = (robot.inverse_dynamics(q, dq, ddq) - robot.inverse_dynamics(q, -dq, -ddq)) / 2
    constant = (robot.inverse_dynamics(q, dq, 0 * ddq) - robot.inverse_dynamics(q, -dq, 0 * ddq)) / 2
    size = np.abs(robot.inverse_dynamics(q, dq, ddq)).max()
    assert np.abs(constant).max() < 1e-12 * size
    assert np.abs(mirrored).max() > 1e-2 * size


@pytest.mark.parametrize("eps", [1e-4, 0.02])
@pytest.mark.parametrize("threshold", [0.0, 0.1])
def test_eqs_9_to_11_literally(threshold, eps):
    dq = np.concatenate([np.linspace(-2, 2, 201), [1e-5, -1e-5, 0.0, threshold, -threshold]])
    assert_allclose(_core.friction_basis(dq, threshold, eps) @ K, printed.friction(dq, threshold, eps, K), **ALGEBRAIC)


def one_joint_run(threshold, eps, noise=0.0):
    """A pendulum whose torque is friction and gravity, with exact derivatives."""
    urdf = """<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="0.2 0 0.1"/>
      <mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
      <joint name="joint" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
      <limit lower="-3" upper="3" velocity="3" effort="50"/></joint></robot>"""
    robot = RobotModel.from_urdf_string(urdf)
    t = np.arange(0, 30, 0.01)
    q, dq, ddq = (
        sum(a * w**d * np.sin(w * t + p + d * np.pi / 2) for a, w, p in ((0.8, 0.9, 0.0), (0.3, 2.3, 1.0)))[:, None]
        for d in range(3)
    )
    tau = robot.inverse_dynamics(q, dq, ddq) + printed.friction(dq[:, 0], threshold, eps, K)[:, None]
    tau += noise * np.random.default_rng(0).standard_normal(tau.shape)
    return robot, Recording(t, q, dq, ddq, tau, name="one")


@pytest.mark.parametrize("width", [1e-4, 0.02])
@pytest.mark.parametrize("law", ["paper", "coulomb_viscous"])
def test_eq_12_the_search_matches_least_squares_over_all_lambda(law, width):
    """With eps as printed; where the joint's own is another, lambda makes up for it and is not the joint's own."""
    robot, recording = one_joint_run(0.11, width, noise=0.02)
    states = prepare(recording, Band(8.0), 100.0)
    shape = friction_effect(np.array([0.0]), np.array([1e-4]))
    plan = make_plan(robot, [_core.Effect.rotor_inertia(), _core.Effect.torque_offset(), shape])
    plan = with_laws(plan, (law,))
    observations = observe(plan, [states])
    rows = observations.rows_with([states.in_band(states.tau)])
    fitted = FrictionIdentifier(as_printed=True).fit(plan, [states], rows)
    assert fitted.transition_width_[0] == 1e-4  # as printed

    everywhere = printed.friction_columns(states.dq[:, 0], 0.0, 1e-4)

    def left(threshold):
        columns = everywhere.copy()
        columns[np.abs(states.dq[:, 0]) < threshold, 2:] = 0.0  # Eq. 9
        columns = states.in_band(columns)[:, : 8 if law == "paper" else 4]
        links = rows[0][0][:, plan.n_own : -1]
        others = rows[0][0][:, : plan.n_own - 8][:, plan.own[0, :-8]]
        system = np.column_stack([columns, links, others])
        norms = np.linalg.norm(system, axis=0)
        system = system[:, norms > 0] / norms[norms > 0]
        tau = rows[0][0][:, -1]
        return np.sum((tau - system @ np.linalg.lstsq(system, tau, rcond=None)[0]) ** 2)

    thresholds = np.concatenate([[0.0], np.geomspace(5e-3, 0.25, 200)]) if law == "paper" else [0.0]
    best = min(left(threshold) for threshold in thresholds)
    assert left(fitted.velocity_threshold_[0]) <= 1.01 * best
    if law == "coulomb_viscous":
        assert fitted.velocity_threshold_[0] == 0
    elif width == 1e-4:
        assert_allclose(fitted.velocity_threshold_[0], 0.11, rtol=0.01)


@pytest.mark.parametrize("n_orders", [1, 3])
def test_eq_12_the_searched_power_is_what_least_squares_leaves_of_eq_8(n_orders):
    """Sum of squares of tau_estf - tau_f over the best k, for pairs of opposite speed and any lambda and eps."""
    rng = np.random.default_rng(7)
    dq = np.concatenate([rng.uniform(0.01, 1.5, 80), -rng.uniform(0.01, 1.5, 80)])
    tau = printed.friction(dq, 0.1, 0.02, K) + 0.05 * rng.normal(size=160)
    first, second = np.arange(80), np.arange(80, 160)
    tau_estf = (tau[first] - tau[second]) / 2
    run = (dq, None, first.tolist(), second.tolist())
    search = _core.FrictionSearch([run], np.zeros((80, 0)), tau_estf, weak=1e-2, n_orders=n_orders)
    for threshold in (0.0, 0.05, 0.1, 0.3):
        for eps in (1e-4, 0.02, 0.1):
            columns = printed.friction_columns(dq, threshold, eps)[:, : 2 + 2 * n_orders]
            odd = (columns[first] - columns[second]) / 2
            left = tau_estf - odd @ np.linalg.lstsq(odd, tau_estf, rcond=1e-12)[0]
            assert_allclose(search.power([threshold], [eps]), np.sum(left**2), rtol=1e-8)
