"""Inverse dynamics and regressor against two engines built by others, and the edge of the Python face."""

import threading
import time

import numpy as np
import pytest
from helpers.data import URDF_ROBOTS, data_file
from helpers.engines import MuJoCo, Pinocchio
from helpers.robots import random_chain, random_states, with_inertials
from helpers.tolerances import ALGEBRAIC, EXACT, MUJOCO, PINOCCHIO, relative_error
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import RobotModel

N_CHAINS = 200
STATES_PER_CHAIN = 300
STATES_PER_ROBOT = 10_000
CHUNK = 2_500
"""States whose regressors are held at a time: 12 joints take 12 kB each."""
GRAVITY = (0.0, 0.0, -9.81)
TILTED = (3.1, -5.2, -7.4)
POINT_MASSES = ("kuka_kr300_weigand",)
"""Robots with a load without extent, which MuJoCo refuses: it gets other inertials."""


def assert_agrees(urdf, gravity, n_states, seed, engines=(Pinocchio, MuJoCo)):
    """One robot, one set of states, every engine."""
    robot = RobotModel.from_urdf_string(urdf, gravity=gravity)
    references = [engine(urdf, gravity) for engine in engines]
    for start in range(0, n_states, CHUNK):
        states = random_states(min(CHUNK, n_states - start), robot.n_joints, seed + start)
        tau = robot.inverse_dynamics(*states)
        for reference in references:
            error = relative_error(tau, reference.inverse_dynamics(*states))
            if isinstance(reference, MuJoCo):
                assert error <= MUJOCO
            else:
                assert error <= PINOCCHIO
                regressor = robot.joint_torque_regressor(*states)
                assert relative_error(regressor, reference.joint_torque_regressor(*states)) <= PINOCCHIO
                assert relative_error(robot.phi[None], reference.phi[None]) <= PINOCCHIO


def test_enough_states():
    assert N_CHAINS * STATES_PER_CHAIN + len(URDF_ROBOTS) * STATES_PER_ROBOT >= 100_000


@pytest.mark.parametrize("name", URDF_ROBOTS)
def test_real_robots_agree_with_pinocchio_and_mujoco(name):
    urdf = with_inertials(data_file(name).read_text(encoding="utf-8"), seed=1)
    if name in POINT_MASSES:
        assert_agrees(urdf, GRAVITY, STATES_PER_ROBOT // 2, seed=10, engines=(Pinocchio,))
        urdf = with_inertials(urdf, seed=2, replace=True)
    assert_agrees(urdf, GRAVITY, STATES_PER_ROBOT // 2, seed=20)
    assert_agrees(urdf, TILTED, STATES_PER_ROBOT // 2, seed=30)


@pytest.mark.parametrize("first", range(0, N_CHAINS, 25))
def test_random_chains_agree_with_pinocchio_and_mujoco(first):
    for seed in range(first, first + 25):
        chain = random_chain(seed)
        assert_agrees(chain.urdf, chain.gravity, STATES_PER_CHAIN, seed)


def test_random_chains_are_what_they_claim():
    chains = [random_chain(seed) for seed in range(N_CHAINS)]
    assert {chain.n_joints for chain in chains} == set(range(2, 13))
    assert {kind for chain in chains for kind in chain.kinds} == {"revolute", "continuous", "prismatic"}
    for chain in chains[:20]:
        robot = RobotModel.from_urdf_string(chain.urdf)
        as_moving = ["prismatic" if kind == "prismatic" else "revolute" for kind in chain.kinds]
        assert robot.joint_kinds == as_moving
        assert robot.joint_names == [f"joint_{j}" for j in range(chain.n_joints)]
        assert chain.urdf == random_chain(chains.index(chain)).urdf


@pytest.fixture(scope="module")
def robot():
    return RobotModel.from_urdf_string(random_chain(3).urdf)  # five joints


@pytest.fixture
def states(robot):
    return random_states(40, robot.n_joints, seed=0)


def test_regressor_times_parameters_is_inverse_dynamics(robot, states):
    phi = np.random.default_rng(1).normal(size=10 * robot.n_links)
    tau = robot.inverse_dynamics(*states, phi)
    regressor = robot.joint_torque_regressor(*states)
    assert regressor.shape == (40, robot.n_joints, 10 * robot.n_links)
    assert tau.shape == (40, robot.n_joints)
    assert_allclose(regressor @ phi, tau, **ALGEBRAIC)


def test_own_parameters_are_the_default_and_rnea_is_another_name(robot, states):
    tau = robot.inverse_dynamics(*states)
    assert_array_equal(tau, robot.inverse_dynamics(*states, robot.phi))
    assert_array_equal(tau, robot.inverse_dynamics(*states, phi=robot.phi.tolist()))
    assert_array_equal(tau, robot.rnea(*states))


def test_gravity_of_the_file_and_of_a_copy_are_the_same(robot, states):
    turned = RobotModel.from_urdf_string(random_chain(3).urdf, gravity=TILTED)
    assert_array_equal(turned.gravity, TILTED)
    assert_array_equal(robot.gravity, GRAVITY)
    assert_array_equal(robot.with_gravity(list(TILTED)).inverse_dynamics(*states), turned.inverse_dynamics(*states))
    # Torque is affine in gravity: without it, plus gravity's own part at rest.
    q, rest = states[0], np.zeros_like(states[0])
    floating = robot.with_gravity([0, 0, 0])
    part = turned.inverse_dynamics(q, rest, rest)
    assert_allclose(floating.inverse_dynamics(*states) + part, turned.inverse_dynamics(*states), **ALGEBRAIC)


def test_samples_do_not_touch_each_other(robot, states):
    tau = robot.inverse_dynamics(*states)
    for k in (0, 17, 39):
        alone = robot.inverse_dynamics(*(signal[k : k + 1] for signal in states))
        assert_allclose(alone, tau[k : k + 1], **EXACT)


def test_no_sample_is_no_sample(robot):
    nothing = np.empty((0, robot.n_joints))
    assert robot.inverse_dynamics(nothing, nothing, nothing).shape == (0, robot.n_joints)
    shape = (0, robot.n_joints, 10 * robot.n_links)
    assert robot.joint_torque_regressor(nothing, nothing, nothing).shape == shape


ACCEPTED = {
    "lists": lambda signal: signal.tolist(),
    "float32": lambda signal: signal.astype(np.float32).astype(np.float64).astype(np.float32),
    "columns first": np.asfortranarray,
    "every second of twice": lambda signal: np.repeat(signal, 2, axis=0)[::2],
    "backwards twice": lambda signal: signal[::-1].copy()[::-1],
    "transposed": lambda signal: signal.T.copy().T,
    "other byte order": lambda signal: signal.astype(">f8"),
    "read only": lambda signal: _read_only(signal),
}


def _read_only(signal):
    signal = signal.copy()
    signal.flags.writeable = False
    return signal


@pytest.mark.parametrize("form", ACCEPTED)
def test_forms_of_the_same_numbers_give_the_same_bits(robot, states, form):
    states = [signal.astype(np.float32).astype(np.float64) for signal in states]
    formed = [ACCEPTED[form](signal) for signal in states]
    assert_array_equal(robot.inverse_dynamics(*formed), robot.inverse_dynamics(*states))
    assert_array_equal(robot.joint_torque_regressor(*formed), robot.joint_torque_regressor(*states))


def test_integers_are_numbers(robot):
    q = np.ones((3, robot.n_joints), dtype=int)
    assert_array_equal(robot.inverse_dynamics(q, q, q), robot.inverse_dynamics(q * 1.0, q * 1.0, q * 1.0))


@pytest.mark.parametrize("name", ["q", "dq", "ddq"])
@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda x: x[:, :-1], r"^{name} has shape \(40, 4\), expected \(n_samples, 5\)$"),
        (lambda x: np.hstack([x, x]), r"^{name} has shape \(40, 10\), expected \(n_samples, 5\)$"),
        (lambda x: x[0], r"^{name} has shape \(5,\), expected \(n_samples, 5\)$"),
        (lambda x: x[None], r"^{name} has shape \(1, 40, 5\), expected \(n_samples, 5\)$"),
        (lambda x: np.float64(1), r"^{name} has shape \(\), expected \(n_samples, 5\)$"),
        (lambda x: x[0].tolist(), r"^{name} has shape .*, expected \(n_samples, 5\)$"),
        (lambda x: x[:-1], r"^(dq|ddq) has (39|40) samples, but q has (39|40)$"),
    ],
)
@pytest.mark.parametrize("method", ["inverse_dynamics", "joint_torque_regressor"])
def test_wrong_shapes_are_named(robot, states, method, name, spoil, sentence):
    arguments = dict(zip(("q", "dq", "ddq"), states, strict=True))
    arguments[name] = spoil(arguments[name])
    with pytest.raises(ValueError, match=sentence.format(name=name)):
        getattr(robot, method)(**arguments)


@pytest.mark.parametrize(
    ("phi", "sentence"),
    [
        (np.zeros(49), r"^phi has shape \(49,\), expected \(50,\)$"),
        (np.zeros((5, 10)), r"^phi has shape \(5, 10\), expected \(50,\)$"),
        ([0.0] * 51, r"^phi has shape .*, expected \(50,\)$"),
    ],
)
def test_wrong_parameters_are_named(robot, states, phi, sentence):
    with pytest.raises(ValueError, match=sentence):
        robot.inverse_dynamics(*states, phi)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["q", "dq", "ddq", "phi"])
def test_numbers_that_are_none_are_named_with_their_place(robot, states, name, bad):
    arguments = dict(zip(("q", "dq", "ddq"), states, strict=True)) | {"phi": robot.phi}
    spoiled = arguments[name] = arguments[name].copy()
    place = (7, 0) if name == "phi" else (7, 3)
    spoiled[7 if name == "phi" else place] = bad
    sentence = rf"^{name} holds .* at row {place[0]}, column {place[1]}; every value must be finite$"
    with pytest.raises(ValueError, match=sentence):
        robot.inverse_dynamics(**arguments)
    if name != "phi":
        del arguments["phi"]
        with pytest.raises(ValueError, match=sentence):
            robot.joint_torque_regressor(**arguments)


@pytest.mark.parametrize("bad", ["text", object(), [[1.0], [1.0, 2.0]], {"q": 1}])
@pytest.mark.parametrize("name", ["q", "dq", "ddq"])
def test_what_is_no_array_is_a_type_error_that_names_it(robot, states, name, bad):
    arguments = dict(zip(("q", "dq", "ddq"), states, strict=True))
    arguments[name] = bad
    with pytest.raises(TypeError, match=f"^{name} is not an array of numbers$"):
        robot.inverse_dynamics(**arguments)


def test_none_is_refused(robot, states):
    with pytest.raises((TypeError, ValueError), match=r"^dq "):
        robot.inverse_dynamics(states[0], None, states[2])


@pytest.mark.parametrize("gravity", [(0.0, np.nan, 0.0), (np.inf, 0.0, 0.0)])
def test_gravity_must_be_finite(robot, gravity):
    with pytest.raises(ValueError):
        robot.with_gravity(gravity)
    with pytest.raises(ValueError):
        RobotModel.from_urdf_string(random_chain(3).urdf, gravity=gravity)


def test_other_threads_run_during_a_batch(robot):
    states = random_states(400_000, robot.n_joints, seed=0)
    done, ticks, calls = threading.Event(), [], []

    def count():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.0005)

    counter = threading.Thread(target=count)
    counter.start()
    try:
        for _ in range(20):  # one call takes some milliseconds, and the machine may be busy
            start = time.perf_counter()
            robot.inverse_dynamics(*states)
            calls.append((start, time.perf_counter()))
    finally:
        done.set()
        counter.join()
    during = [tick for tick in ticks if any(start < tick < end for start, end in calls)]
    assert len(during) >= 5  # calls that hold the lock let none through


@pytest.mark.parametrize("n_samples", [1, 2, 70, 300])
def test_a_result_goes_where_it_is_told_to_the_same_bits(robot, n_samples):
    states = random_states(n_samples, robot.n_joints, seed=3)
    for work in (robot.inverse_dynamics, robot.rnea, robot.joint_torque_regressor):
        expected = work(*states)
        out = np.full_like(expected, np.nan)
        assert work(*states, out=out) is out
        assert_array_equal(out, expected)


def test_one_state_is_the_same_however_it_comes(robot):
    """The way of a single state and the way of all others, which a list takes: the same bits."""
    q, dq, ddq = random_states(5, robot.n_joints, seed=4)
    for work in (robot.inverse_dynamics, robot.joint_torque_regressor):
        together = work(q, dq, ddq)
        for k in range(len(q)):
            one = q[k : k + 1], dq[k : k + 1], ddq[k : k + 1]
            assert_array_equal(work(*one)[0], together[k])
            assert_array_equal(work(*(x.tolist() for x in one))[0], together[k])
    assert_array_equal(robot.inverse_dynamics(*one, phi=robot.phi), robot.inverse_dynamics(*one))


@pytest.mark.parametrize("n_samples", [1, 3])
def test_a_place_that_does_not_fit_is_refused(robot, n_samples):
    n = robot.n_joints
    states = random_states(n_samples, n, seed=5)
    fitting = np.zeros((n_samples, n))
    frozen = fitting.copy()
    frozen.flags.writeable = False
    strided = np.zeros((n_samples, 2 * n))[:, ::2]
    for out in (np.zeros((n_samples, n + 1)), np.zeros(n), fitting.astype(np.float32), strided, "here"):
        with pytest.raises(ValueError, match=rf"out must be a float64 array in C order of shape \({n_samples}, {n}\)"):
            robot.inverse_dynamics(*states, out=out)
    with pytest.raises(ValueError, match="out must be writable"):
        robot.inverse_dynamics(*states, out=frozen)


def test_one_bad_state_is_named_like_many(robot):
    good = np.zeros((1, robot.n_joints))
    bad = good.copy()
    bad[0, 2] = np.nan
    for work in (robot.inverse_dynamics, robot.joint_torque_regressor):
        with pytest.raises(ValueError, match="dq holds NaN at row 0, column 2"):
            work(good, bad, good)
        with pytest.raises(ValueError, match="ddq has 2 samples, but q has 1"):
            work(good, good, np.zeros((2, robot.n_joints)))
