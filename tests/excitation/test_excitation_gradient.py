"""Criteria of exciting motions and their gradients, against Pinocchio, numpy.linalg and central differences."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest
from helpers.data import URDF_ROBOTS, data_file
from helpers.engines import Pinocchio
from helpers.robots import random_chain, random_states
from helpers.tolerances import ALGEBRAIC, CENTRAL_DIFFERENCE, EXACT, PINOCCHIO, relative_error
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import RobotModel, _core

CRITERIA = (("block", (0.2, 0.5, 0.3)), ("condition", None), ("D", None), ("A", None))
CHAINS = (0, 1, 3, 4, 5, 9)
"""Two to eleven joints, all kinds."""
STEP = 1e-6


def chain(seed):
    """A random robot, its URDF and its gravity."""
    made = random_chain(seed)
    return RobotModel.from_urdf_string(made.urdf, gravity=made.gravity), made


def excitation(robot, **options):
    return _core.Excitation(robot, robot.base_parameters().pivots.tolist(), **options)


def literal_blocks(robot, q, dq, ddq, whitening=None):
    """Eq. 14's blocks as differences of regressors, whitened sample by sample (Eq. 13)."""
    base, still = robot.base_parameters(), np.zeros_like(q)
    whitening = np.eye(robot.n_joints) if whitening is None else whitening

    def rows(*motion):
        return (whitening @ base.reduce(robot.joint_torque_regressor(*motion))).reshape(-1, base.n_base)

    gravity = rows(q, still, still)
    return rows(q, still, ddq) - gravity, rows(q, dq, still) - gravity, gravity, rows(q, dq, ddq)


def test_a_block_of_which_nothing_is_seen_is_as_bad_as_one_that_lacks_a_direction():
    """A motion at constant speed has no acceleration block: its condition was 1, as if it were the best."""
    robot, _ = chain(1)
    q, dq, _ = random_states(40, robot.n_joints, 1)
    still = np.zeros_like(q)
    exciting = excitation(robot)
    assert exciting.conditions(q, dq, still)[1] == exciting.conditions(q[:1], dq[:1], q[:1])[1] == 1e8
    value, gradient = exciting.value_and_gradient(q, dq, still, criterion="block", weights=(1.0, 0.0, 0.0))
    assert value == exciting.value(q, dq, still, criterion="block", weights=(1.0, 0.0, 0.0))
    assert all(np.isfinite(part).all() for part in gradient)


def odd_whitening(n_joints):
    """A matrix that mixes all joints."""
    return np.eye(n_joints) + 0.3 * np.random.default_rng(3).normal(size=(n_joints, n_joints))


@pytest.mark.parametrize("seed", CHAINS)
@pytest.mark.parametrize("whitened", [False, True])
def test_blocks_are_the_differences_of_the_paper_and_add_up(seed, whitened):
    robot, _ = chain(seed)
    motion = random_states(7, robot.n_joints, seed)
    whitening = odd_whitening(robot.n_joints) if whitened else None
    *blocks, whole = literal_blocks(robot, *motion, whitening)
    found = excitation(robot, whitening=whitening).blocks(*motion)
    for block, expected in zip(found, blocks, strict=True):
        assert_allclose(block, expected, rtol=0, atol=1e-10 * np.abs(whole).max())
    assert_allclose(sum(found), whole, rtol=0, atol=1e-12 * np.abs(whole).max())


@pytest.mark.parametrize("seed", CHAINS)
def test_ranks_and_conditions_are_those_of_the_singular_values(seed):
    robot, _ = chain(seed)
    made = excitation(robot)
    probe = literal_blocks(robot, *random_states(100, robot.n_joints, seed + 50))
    expected = [np.linalg.matrix_rank(block, tol=1e-9 * np.linalg.norm(block, 2)) for block in probe]
    assert made.ranks == (expected[3], *expected[:3])
    assert made.ranks[0] == robot.base_parameters().n_base
    motion = random_states(60, robot.n_joints, seed)
    a, b, g, whole = literal_blocks(robot, *motion)
    for matrix, rank, found in zip((whole, a, b, g), made.ranks, made.conditions(*motion), strict=True):
        values = np.linalg.svd(matrix, compute_uv=False)
        # The Gram matrix squares the condition, and with it the rounding.
        assert_allclose(found, values[0] / values[rank - 1], rtol=1e-14 * found**2 + 1e-12)


@pytest.mark.parametrize("seed", CHAINS)
@pytest.mark.parametrize("whitened", [False, True])
def test_criteria_are_what_their_names_say(seed, whitened):
    robot, _ = chain(seed)
    motion = random_states(60, robot.n_joints, seed)
    whitening = odd_whitening(robot.n_joints) if whitened else None
    made = excitation(robot, whitening=whitening)
    a, b, g, whole = literal_blocks(robot, *motion, whitening)

    def condition(matrix, rank):
        values = np.linalg.svd(matrix, compute_uv=False)
        return values[0] / values[rank - 1]

    w, ranks = (0.2, 0.5, 0.3), made.ranks
    total = condition(whole, ranks[0])
    eq_14 = sum(w) * total + sum(
        weight * condition(block, rank) for weight, block, rank in zip(w, (a, b, g), ranks[1:], strict=True)
    )
    information = np.linalg.inv(np.linalg.qr(whole, mode="r"))
    expected = {
        "block": eq_14,
        "condition": total,
        "D": -np.linalg.slogdet(whole.T @ whole)[1],
        "A": np.sum(information**2),
    }
    for criterion, weights in CRITERIA:
        value = made.value(*motion, criterion=criterion, weights=weights)
        assert_allclose(value, expected[criterion], rtol=1e-8, err_msg=criterion)
        assert value == made.value_and_gradient(*motion, criterion=criterion, weights=weights)[0]


@pytest.mark.parametrize("seed", CHAINS)
@pytest.mark.parametrize("whitened", [False, True])
@pytest.mark.parametrize(("criterion", "weights"), CRITERIA)
def test_gradients_are_central_differences(seed, whitened, criterion, weights):
    robot, _ = chain(seed)
    n = robot.n_joints
    motion = np.array(random_states(40, n, seed))
    made = excitation(robot, whitening=odd_whitening(n) if whitened else None)

    def smooth(motion):
        value = made.value(*motion, criterion=criterion, weights=weights)
        return value if criterion == "D" else np.log(value)

    value, gradient = made.value_and_gradient(*motion, criterion=criterion, weights=weights)
    gradient = np.array(gradient) / (1 if criterion == "D" else value)
    rng = np.random.default_rng(seed)
    for signal in range(3):  # q, dq and ddq, each alone
        direction = np.zeros_like(motion)
        direction[signal] = rng.normal(size=direction[signal].shape)
        difference = (smooth(motion + STEP * direction) - smooth(motion - STEP * direction)) / (2 * STEP)
        # Rounding of the eigenvalues, which have the square of the condition, comes through the small step.
        noise = 1e-16 * made.conditions(*motion)[0] ** 2 / STEP * 10
        size = np.linalg.norm(gradient[signal]) * np.linalg.norm(direction)
        assert_allclose(np.sum(gradient * direction), difference, rtol=1e-5, atol=1e-6 * size + noise)


@pytest.mark.parametrize("seed", CHAINS)
def test_the_torque_gradient_is_pinocchios(seed):
    robot, made = chain(seed)
    n = robot.n_joints
    engine = Pinocchio(made.urdf, made.gravity)
    q, dq, ddq = random_states(8, n, seed)
    direction = np.random.default_rng(seed).normal(size=q.shape)
    expected = [np.empty_like(q) for _ in range(3)]
    for k, state in enumerate(zip(engine.configurations(q), dq, ddq, strict=True)):
        by_q, by_dq, by_ddq = pin.computeRNEADerivatives(engine.model, engine.data, *state)
        by_ddq = np.triu(by_ddq) + np.triu(by_ddq, 1).T  # Pinocchio fills the upper half
        for out, derivative in zip(expected, (by_q, by_dq, by_ddq), strict=True):
            out[k] = direction[k] @ derivative
    found = _core.inverse_dynamics_gradient(robot, q, dq, ddq, direction)
    for actual, wanted in zip(found, expected, strict=True):
        assert relative_error(actual, wanted) < 100 * PINOCCHIO


@pytest.mark.parametrize("robot_name", URDF_ROBOTS)
def test_the_torque_gradient_of_real_arms_is_a_central_difference(robot_name):
    path = data_file(robot_name)
    robot = RobotModel.from_urdf(path)
    phi = np.random.default_rng(0).normal(size=10 * robot.n_joints)
    q, dq, ddq = random_states(4, robot.n_joints, 1)
    direction = np.ones_like(q)
    found = np.array(_core.inverse_dynamics_gradient(robot, q, dq, ddq, direction, phi))
    for j in range(robot.n_joints):
        step = STEP * np.eye(robot.n_joints)[j]
        for signal in range(3):
            ahead, behind = np.array([q, dq, ddq]), np.array([q, dq, ddq])
            ahead[signal] += step
            behind[signal] -= step
            torques = [robot.inverse_dynamics(*motion, phi).sum(axis=1) for motion in (ahead, behind)]
            difference = (torques[0] - torques[1]) / (2 * STEP)
            assert_allclose(found[signal][:, j], difference, rtol=1e-6, atol=1e-6 * np.abs(torques).max())


@pytest.mark.parametrize("seed", CHAINS)
def test_points_are_where_pinocchio_sees_them(seed):
    robot, made = chain(seed)
    engine = Pinocchio(made.urdf, made.gravity)
    rng = np.random.default_rng(seed)
    q, _, _ = random_states(5, robot.n_joints, seed)
    links = rng.integers(0, robot.n_joints, size=4).tolist()
    places = rng.normal(size=(4, 3))
    found = _core.point_places(robot, q, links, places)
    for k, configuration in enumerate(engine.configurations(q)):
        pin.forwardKinematics(engine.model, engine.data, configuration)
        expected = [engine.data.oMi[link + 1].act(place) for link, place in zip(links, places, strict=True)]
        assert_allclose(found[k], expected, **ALGEBRAIC)

    weights = rng.normal(size=found.shape)
    gradient = _core.point_gradient(robot, q, links, places, weights)
    for j in range(robot.n_joints):
        step = STEP * np.eye(robot.n_joints)[j]
        difference = _core.point_places(robot, q + step, links, places) - _core.point_places(
            robot, q - step, links, places
        )
        expected = np.sum(weights * difference, axis=(1, 2)) / (2 * STEP)
        assert_allclose(gradient[:, j], expected, atol=1e-8, rtol=CENTRAL_DIFFERENCE["rtol"])


def test_many_threads_at_once_see_the_same_numbers():
    robot, _ = chain(4)
    made = excitation(robot)
    motions = [random_states(30 + k, robot.n_joints, k) for k in range(12)]

    def evaluate(motion):
        value, gradient = made.value_and_gradient(*motion, criterion="block", weights=(1, 1, 1))
        return value, *gradient

    alone = [evaluate(motion) for motion in motions]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(3):
            together = list(pool.map(evaluate, motions))
            for one, other in zip(alone, together, strict=True):
                for a, b in zip(one, other, strict=True):
                    assert_allclose(a, b, **EXACT)


@pytest.mark.parametrize("path", ["baseline", "avx2", "avx512"])
def test_a_shorter_motion_finds_nothing_of_the_longer_one_before_it(path):
    """Memory is kept between evaluations; narrow lanes leave the end of a group of eight samples alone."""
    usual = _core.processor_path()
    try:
        _core.processor_path(path)
    except ValueError as missing:
        pytest.skip(str(missing))
    try:
        robot, _ = chain(4)
        used = excitation(robot)
        for n_samples in (40, 33, 34, 39, 36):
            motion = random_states(n_samples, robot.n_joints, n_samples)
            for criterion, weights in CRITERIA:
                again, gradient = used.value_and_gradient(*motion, criterion=criterion, weights=weights)
                value, expected = excitation(robot).value_and_gradient(*motion, criterion=criterion, weights=weights)
                assert again == value
                assert_array_equal(gradient, expected)
    finally:
        _core.processor_path(usual)


def test_without_gravity_its_block_says_nothing():
    robot = chain(4)[0].with_gravity((0.0, 0.0, 0.0))
    made = excitation(robot)
    motion = random_states(60, robot.n_joints, 0)
    assert made.ranks[3] == 0
    assert np.isnan(made.conditions(*motion)[3])
    value = made.value(*motion, criterion="block", weights=(1.0, 0.0, 5.0))
    total, acceleration = made.conditions(*motion)[:2]
    assert_allclose(value, 6 * total + acceleration, **ALGEBRAIC)


def test_a_motion_that_says_nothing_has_a_finite_criterion():
    robot, _ = chain(4)
    made = excitation(robot)
    still = np.zeros((10, robot.n_joints))
    for criterion, weights in CRITERIA:
        value, gradient = made.value_and_gradient(still, still, still, criterion=criterion, weights=weights)
        assert np.isfinite(value)
        assert np.isfinite(gradient).all()
    assert made.value(still, still, still, criterion="condition") == pytest.approx(1e8)


def test_spoiled_input_is_refused():
    robot, _ = chain(4)
    made = excitation(robot)
    q, dq, ddq = random_states(5, robot.n_joints, 0)
    with pytest.raises(ValueError, match="dq has 4 samples, but q has 5"):
        made.value(q, dq[:4], ddq, criterion="D")
    with pytest.raises(ValueError, match="motion has the wrong shape"):
        made.value(q[:0], dq[:0], ddq[:0], criterion="D")
    with pytest.raises(ValueError, match="q holds NaN at row 2"):
        made.value(np.where(np.arange(5)[:, None] == 2, np.nan, q), dq, ddq, criterion="D")
    with pytest.raises(ValueError, match="choose block, condition, D or A"):
        made.value(q, dq, ddq, criterion="E")
    for weights in (None, (1.0, -1.0, 1.0), (1.0, np.nan, 1.0)):
        with pytest.raises(ValueError, match="three weights"):
            made.value(q, dq, ddq, criterion="block", weights=weights)
    for pivots in ([], [3, 1], [2, 2], [10 * robot.n_joints]):
        with pytest.raises(ValueError, match="pivots"):
            _core.Excitation(robot, pivots)
    with pytest.raises(ValueError, match="whitening"):
        excitation(robot, whitening=np.eye(robot.n_joints)[:2])
    with pytest.raises(ValueError, match="direction"):
        _core.inverse_dynamics_gradient(robot, q, dq, ddq, q[:, :2])
    with pytest.raises(ValueError, match="points"):
        _core.point_places(robot, q, [robot.n_joints], np.zeros((1, 3)))
    with pytest.raises(ValueError, match="one per link"):
        _core.point_places(robot, q, [0, 1], np.zeros((1, 3)))
