"""Eqs. 3-12 of the double-encoder paper, each by its number against an independent route."""

import numpy as np
import pinocchio as pin
import pytest
from engines import Pinocchio
from numpy.testing import assert_allclose
from robots import random_chain, random_states, with_inertials
from tolerances import ALGEBRAIC, PINOCCHIO, relative_error

from dynid_rs import FrictionIdentifier, RobotModel, _core
from dynid_rs.columns import make_plan, observe
from dynid_rs.friction import friction_effect
from dynid_rs.friction_laws import with_laws
from dynid_rs.preprocessing import Band, prepare
from dynid_rs.recording import Recording

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


def printed(dq, threshold, eps, k):
    """Eqs. 9-11, literally."""
    torques = []
    for v in dq:
        s = np.tanh(v / eps)
        if v >= 0:
            coulomb = k[0] * s * (s + 1) / 2
            viscous = k[2] * (s + 1) / 2 * v + k[4] * v**2 + k[6] * v**3
        else:
            coulomb = k[1] * s * (1 - s) / 2
            viscous = k[3] * (1 - s) / 2 * v + k[5] * v**2 + k[7] * v**3
        torques.append(coulomb if abs(v) < threshold else coulomb + viscous)
    return np.array(torques)


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
    friction = printed(dq.ravel(), 0.0, 0.02, np.repeat(K[::2], 2) * np.tile([1, 1, 1, 1, 1, -1, 1, 1], 1))
    friction = friction.reshape(dq.shape)
    tau_1 = robot.inverse_dynamics(q, dq, ddq) + friction
    tau_2 = robot.inverse_dynamics(q, -dq, -ddq) - friction  # Eq. 5: -dq and -ddq
    inertia = []
    for pose, acceleration in zip(engine.configurations(q), ddq, strict=True):
        upper = np.triu(pin.crba(engine.model, engine.data, pose))
        inertia.append((upper + upper.T - np.diag(np.diag(upper))) @ acceleration)
    assert relative_error(tau_1 - tau_2, 2 * np.array(inertia) + 2 * friction) < 1e-11


def test_eq_8_is_exact_for_motion_played_backwards_in_time(arm):
    robot, _, (q, dq, ddq) = arm
    basis = _core.friction_basis(dq.ravel(), 0.03, 0.02)
    back = _core.friction_basis(-dq.ravel(), 0.03, 0.02)
    tau_1 = robot.inverse_dynamics(q, dq, ddq) + (basis @ K).reshape(q.shape)
    tau_2 = robot.inverse_dynamics(q, -dq, ddq) + (back @ K).reshape(q.shape)
    odd = (printed(dq.ravel(), 0.03, 0.02, K) - printed(-dq.ravel(), 0.03, 0.02, K)).reshape(q.shape) / 2
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
    assert_allclose(_core.friction_basis(dq, threshold, eps) @ K, printed(dq, threshold, eps, K), **ALGEBRAIC)


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
    tau = robot.inverse_dynamics(q, dq, ddq) + printed(dq[:, 0], threshold, eps, K)[:, None]
    tau += noise * np.random.default_rng(0).standard_normal(tau.shape)
    return robot, Recording(t, q, dq, ddq, tau, name="one")


@pytest.mark.parametrize("law", ["paper", "coulomb_viscous"])
def test_eq_12_the_search_matches_least_squares_over_all_lambda(law):
    robot, recording = one_joint_run(0.11, 0.02, noise=0.02)
    states = prepare(recording, Band(8.0), 100.0)
    shape = friction_effect(np.array([0.0]), np.array([1e-4]))
    plan = make_plan(robot, [_core.Effect.rotor_inertia(), _core.Effect.torque_offset(), shape])
    plan = with_laws(plan, (law,))
    observations = observe(plan, [states])
    rows = observations.rows_with([states.in_band(states.tau)])
    fitted = FrictionIdentifier(as_printed=True).fit(plan, [states], rows)
    assert fitted.transition_width_[0] == 1e-4  # as printed

    def left(threshold):
        columns = np.stack([printed(states.dq[:, 0], threshold, 1e-4, unit) for unit in np.eye(8)], axis=1)
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
