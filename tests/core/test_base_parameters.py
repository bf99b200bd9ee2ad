"""Base parameters against the rank of Pinocchio's regressor, and the identities that make them useful."""

import numpy as np
import pytest
import scipy.linalg
from helpers.data import URDF_ROBOTS, data_file
from helpers.engines import Pinocchio
from helpers.robots import random_chain, random_states, with_inertials
from helpers.tolerances import ALGEBRAIC
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import RobotModel

GRAVITY = (0.0, 0.0, -9.81)
TILTED = (3.1, -5.2, -7.4)
RTOL = 1e-9
"""Rank of files that write pi with ten digits: their square angles are off by 2e-10."""
CLEAR = 1e6
"""A gap below this would make the rank a matter of taste."""
CHAINS = range(0, 200, 4)
PARAMETERS = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
KNOWN = {
    "dualarm7_hujinfei": (45, 45),  # its first axis lies
    "kuka_kr300_weigand": (36, 38),
    "kuka_lwr4p_flobaroid": (43, 45),
    "panda_gaz": (43, 45),
    "rokae_xmate3pro": (43, 45),
    "ur10e_innopolis": (36, 38),
}
"""Numbers under vertical and under tilted gravity, which shows two parameters more of the first link.
36 is the text-book number of a six-axis arm."""


def observation_matrix(engine, n_joints, seed, n_samples=120):
    """Stacked regressor at random states: (n_samples n_joints, 10 n_links)."""
    regressor = engine.joint_torque_regressor(*random_states(n_samples, n_joints, seed))
    return regressor.reshape(-1, regressor.shape[2])


def urdf_of(name):
    return with_inertials(data_file(name).read_text(encoding="utf-8"), seed=1)


def assert_identities(robot, base, seed):
    """Projected, reduced and lifted torques are the torque, relative to what adds up to it."""
    rng = np.random.default_rng(seed)
    states = random_states(30, robot.n_joints, seed)
    regressor = robot.joint_torque_regressor(*states)
    reduced = base.reduce(regressor)
    phi, phi_base = rng.normal(size=base.n_standard), rng.normal(size=base.n_base)
    assert reduced.shape == (30, robot.n_joints, base.n_base)
    assert_array_equal(reduced, regressor[..., base.pivots])
    scale = np.max(np.abs(regressor) @ np.abs(phi)) * max(1.0, np.max(np.abs(base.beta), initial=0.0))
    assert_allclose(reduced @ base.project(phi) / scale, regressor @ phi / scale, **ALGEBRAIC)
    lifted = base.lift(base.project(phi))
    assert lifted.shape == (base.n_standard,)
    of_lifted, of_all = (robot.inverse_dynamics(*states, x) for x in (lifted, phi))
    assert_allclose(of_lifted / scale, of_all / scale, **ALGEBRAIC)
    assert_array_equal(base.project(base.lift(phi_base)), phi_base)
    assert_allclose(regressor @ base.lift(phi_base), reduced @ phi_base, **ALGEBRAIC)
    by_hand = phi[base.pivots] + base.beta @ phi[base.dependent]
    assert_allclose(base.project(phi), by_hand, **ALGEBRAIC)


@pytest.mark.parametrize("gravity", [GRAVITY, TILTED], ids=["upright", "tilted"])
@pytest.mark.parametrize("name", URDF_ROBOTS)
def test_real_robots(name, gravity):
    robot = RobotModel.from_urdf_string(urdf_of(name), gravity=gravity)
    base = robot.base_parameters()
    matrix = observation_matrix(Pinocchio(urdf_of(name), gravity), robot.n_joints, seed=1)
    assert base.n_base == np.linalg.matrix_rank(matrix, rtol=RTOL)
    assert base.n_base == KNOWN[name][gravity == TILTED]
    assert base.gap > CLEAR
    assert_identities(robot, base, seed=2)


@pytest.mark.parametrize("first", CHAINS[::10])
def test_random_chains(first):
    for seed in range(first, first + 40, 4):
        chain = random_chain(seed)
        robot = RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)
        base = robot.base_parameters()
        matrix = observation_matrix(Pinocchio(chain.urdf, chain.gravity), robot.n_joints, seed)
        assert base.n_base == np.linalg.matrix_rank(matrix)
        assert base.gap > CLEAR
        assert_identities(robot, base, seed)


def test_numbers_of_one_joint_are_countable_by_hand():
    inertial = "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>"
    urdf = (
        f"<robot name='one'><link name='base'/><link name='arm'>{inertial}</link>"
        "<joint name='joint' type='%s'><parent link='base'/><child link='arm'/><axis xyz='0 0 1'/>"
        "<limit lower='-1' upper='1' velocity='1' effort='1'/></joint></robot>"
    )
    turning = RobotModel.from_urdf_string(urdf % "revolute")
    assert turning.base_parameters().names == ["Izz[arm]"]
    leaning = turning.with_gravity([9.81, 0.0, 0.0])
    assert leaning.base_parameters().names == ["hx[arm]", "hy[arm]", "Izz[arm]"]
    sliding = RobotModel.from_urdf_string(urdf % "prismatic")
    assert sliding.base_parameters().names == ["m[arm]"]


@pytest.mark.parametrize("seed", range(12))
def test_every_base_parameter_has_a_name_of_its_own(seed):
    chain = random_chain(seed)
    robot = RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)
    base = robot.base_parameters()
    assert len(base.names) == base.n_base == len(set(base.names))
    assert all(type(name) is str and name for name in base.names)
    labels = [f"{parameter}[{link}]" for link in robot.link_names for parameter in PARAMETERS]
    for name, pivot in zip(base.names, base.pivots, strict=True):
        assert name.split(" ")[0] == labels[pivot]


def test_indices_are_disjoint_and_what_is_left_moves_nothing():
    chain = random_chain(7)
    robot = RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)
    base = robot.base_parameters()
    pivots, dependent = base.pivots.tolist(), base.dependent.tolist()
    assert pivots == sorted(set(pivots))
    assert dependent == sorted(set(dependent))
    assert not set(pivots) & set(dependent)
    assert base.beta.shape == (len(pivots), len(dependent))
    left = sorted(set(range(base.n_standard)) - set(pivots) - set(dependent))
    matrix = observation_matrix(robot, robot.n_joints, seed=1)
    assert np.max(np.abs(matrix[:, left]), initial=0.0) <= 1e-10 * np.max(np.abs(matrix))


@pytest.mark.parametrize("seed", range(5))
def test_random_state_reproduces_and_does_not_decide_the_number(seed):
    chain = random_chain(seed)
    robot = RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)
    first, again = (robot.base_parameters(random_state=11) for _ in range(2))
    assert_array_equal(first.pivots, again.pivots)
    assert_array_equal(first.beta, again.beta)
    assert (first.gap, first.spread, first.names) == (again.gap, again.spread, again.names)
    for other in range(20):
        assert robot.base_parameters(random_state=other).n_base == first.n_base


SEEDS = range(8)


def test_the_gap_is_that_of_a_pivoted_qr():
    # First axis turned by 3.141592654: two parameters move the torque by 1e-10 of the others.
    robot = RobotModel.from_urdf_string(urdf_of("kuka_kr300_weigand"))
    r, _ = scipy.linalg.qr(observation_matrix(robot, 6, seed=1), mode="r", pivoting=True)
    diagonal = np.abs(np.diag(r))
    gaps = np.array([robot.base_parameters(random_state=seed).gap for seed in SEEDS])
    assert np.all(np.abs(np.log10(gaps * diagonal[36] / diagonal[35])) < 1)


def test_a_finer_tolerance_sees_finer_parameters():
    robot = RobotModel.from_urdf_string(urdf_of("kuka_kr300_weigand"))
    assert {robot.base_parameters(random_state=seed, rtol=1e-12).n_base for seed in SEEDS} == {38}


@pytest.mark.parametrize(
    ("method", "argument", "sentence"),
    [
        ("project", np.zeros(3), r"^phi has shape \(3,\), expected \(50,\)$"),
        ("project", np.zeros((5, 10)), r"^phi has shape \(5, 10\), expected \(50,\)$"),
        ("project", np.full(50, np.nan), r"^phi holds NaN at row 0, column 0; every value must be finite$"),
        ("lift", np.zeros(50), r"^phi_base has shape \(50,\), expected \(\d+,\)$"),
    ],
)
def test_wrong_arguments_are_named(method, argument, sentence):
    base = RobotModel.from_urdf_string(random_chain(3).urdf).base_parameters()
    with pytest.raises(ValueError, match=sentence):
        getattr(base, method)(argument)
