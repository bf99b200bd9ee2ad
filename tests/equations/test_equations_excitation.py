"""Eqs. 13-18 of the double-encoder paper, each by its number, with Pinocchio's regressor and `numpy.linalg`."""

import numpy as np
import pytest
from helpers.engines import Pinocchio
from helpers.small_arm import URDF
from helpers.tolerances import ALGEBRAIC
from numpy.testing import assert_allclose

from dynid_rs import RobotModel, _core
from dynid_rs.excitation import ExcitationLimits, FourierExcitation, sufficient_bounds
from dynid_rs.excitation.problem import Problem
from dynid_rs.excitation.series import FourierSeries
from dynid_rs.simulation import FourierTrajectory

DURATION, RATE, N_HARMONICS = 8.0, 10.0, 4
TIMES = np.arange(round(DURATION * RATE)) / RATE
GRAVITY = (0.0, 0.0, -9.81)
OMEGA = np.array([[0.30, 0.05, 0.00], [0.05, 0.20, -0.04], [0.00, -0.04, 0.02]])
"""Covariance of the torque noise between joints [(N*m)^2]."""
_VALUES, _AXES = np.linalg.eigh(OMEGA)
ROOT = _AXES @ np.diag(_VALUES**-0.5) @ _AXES.T
"""Omega^(-1/2), the symmetric one."""
EIGENVALUES = {"rtol": 1e-8}
"""Singular values against roots of the Gram matrix's eigenvalues, condition numbers of some hundreds."""
BLOCK_RANK = 1e-9
"""Singular values below this part of the greatest are zero."""


@pytest.fixture(scope="module")
def robot():
    return RobotModel.from_urdf_string(URDF)


@pytest.fixture(scope="module")
def limits(robot):
    return ExcitationLimits.symmetric([2.0, 1.5, 1.5], [1.5, 1.2, 2.0], [4.0, 4.0, 6.0])


@pytest.fixture(scope="module")
def design(robot, limits):
    settings = {"n_restarts": 2, "max_iter": 15, "noise_covariance": OMEGA, "random_state": 0}
    return FourierExcitation(N_HARMONICS, DURATION, RATE, **settings).fit(robot, limits)


@pytest.fixture(scope="module")
def problem(robot, limits):
    """What the design minimises."""
    series = FourierSeries(N_HARMONICS, DURATION)
    options = {"criterion": "block", "whitening": ROOT, "constraints": ()}
    return Problem(robot, robot.base_parameters(), series, TIMES, limits, np.zeros(3), **options)


def regressor(robot, q, dq, ddq):
    """Gamma by Pinocchio, base columns only: (n, n_joints, n_base)."""
    columns = robot.base_parameters().pivots
    return Pinocchio(URDF, GRAVITY).joint_torque_regressor(q, dq, ddq)[:, :, columns]


def weighted(gamma):
    """Omega^(-1/2) Gamma, stacked: (n n_joints, n_base)."""
    return (ROOT @ gamma).reshape(-1, gamma.shape[2])


def condition(matrix, reference=None):
    """s_1 / s_r; the rank r is that of `reference`, a motion that excites everything."""
    s = np.linalg.svd(matrix, compute_uv=False)
    of = s if reference is None else np.linalg.svd(reference, compute_uv=False)
    return s[0] / s[np.sum(of > BLOCK_RANK * of[0]) - 1]


def sub_regressors(robot, q, dq, ddq):
    """Gamma*_alpha, Gamma*_beta, Gamma*_gamma, Gamma*: acceleration, velocity, position."""
    rest = np.zeros_like(q)
    position = weighted(regressor(robot, q, rest, rest))
    return (
        weighted(regressor(robot, q, rest, ddq)) - position,
        weighted(regressor(robot, q, dq, rest)) - position,
        position,
        weighted(regressor(robot, q, dq, ddq)),
    )


def sampled(design):
    return design.trajectory_.evaluate(TIMES)


def test_eq_13_weighted_condition_number_and_its_bound(robot, design):
    gamma = regressor(robot, *sampled(design))
    plain = np.linalg.cond(gamma.reshape(-1, gamma.shape[2]))
    assert_allclose(design.condition_number_, plain, **EIGENVALUES)
    star = design.merit_.whitened_condition_number
    assert_allclose(star, np.linalg.cond(weighted(gamma)), **EIGENVALUES)
    # The inequality as printed: cond(Omega^(-1/2)) is the root of cond(Omega).
    assert star <= np.sqrt(np.linalg.cond(OMEGA)) * plain
    assert abs(star / plain - 1) > 0.01


def test_eq_14_objective_as_printed(robot, design):
    *blocks, whole = sub_regressors(robot, *sampled(design))
    assert_allclose(sum(blocks), whole, rtol=0, atol=1e-10 * np.abs(whole).max())
    rng = np.random.default_rng(0)
    *references, full = sub_regressors(robot, *rng.uniform(-2, 2, (3, 60, 3)))
    w = design.block_weights_
    expected = sum(w) * condition(whole, full)
    for weight, block, reference in zip(w, blocks, references, strict=True):
        expected += weight * condition(block, reference)
    assert_allclose(design.objective_, expected, **EIGENVALUES)
    # Over all base columns, as the paper has it, a block has no finite condition number: columns are missing in it.
    assert min(np.linalg.matrix_rank(block, tol=BLOCK_RANK) for block in blocks) < whole.shape[1]


def test_eq_14_weights_are_column_variances(robot, problem, design):
    """Mean variance of the columns of each block over the reference motions, made one in sum."""
    assert_allclose(problem.weights, design.block_weights_, rtol=1e-12)
    rng = np.random.default_rng(0)
    variances = np.zeros(3)
    for _ in range(8):
        x = problem.bounds.roughly_scaled(rng.standard_normal(problem.shape))
        motion = problem.series.trajectory(x, np.zeros(3)).evaluate(TIMES + 1e-12)  # at zero it rests by definition
        *blocks, _ = sub_regressors(robot, *motion)
        variances += [block.var(axis=0).mean() for block in blocks]
    assert_allclose(problem.weights, variances / variances.sum(), rtol=1e-6)


def odd_series(seed, n_joints=3):
    """A series with every coefficient of its own, at rest nowhere."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 5, n_joints))
    return FourierTrajectory(rng.normal(size=n_joints), a, b, 0.7, rest=0.0)


def printed_series(given, t, i):
    """Eq. 15 of joint i, term by term: position, velocity, acceleration (n,) each."""
    w, total = given.fundamental, np.zeros((3, len(t)))
    for term in range(1, len(given.sin_coef) + 1):
        a, b = given.sin_coef[term - 1, i], given.cos_coef[term - 1, i]
        total[0] += a / (w * term) * np.sin(w * term * t) - b / (w * term) * np.cos(w * term * t)
        total[1] += a * np.cos(w * term * t) + b * np.sin(w * term * t)
        total[2] += w * (-a * term * np.sin(w * term * t) + b * term * np.cos(w * term * t))
    return total + np.array([[given.offset[i]], [0.0], [0.0]])


def test_eq_15_series_as_printed():
    given = odd_series(0)
    t = np.linspace(1e-6, given.duration - 1e-6, 301)
    for i in range(3):
        for ours, theirs in zip(given.evaluate(t), printed_series(given, t, i), strict=True):
            assert_allclose(ours[:, i], theirs, **ALGEBRAIC)


def test_eq_15_velocity_and_acceleration_by_complex_step():
    """The series is analytic, so that its imaginary part at t + ih is h times its derivative."""
    given, h = odd_series(1), 1e-30
    t = np.linspace(0.1, given.duration - 0.1, 50)
    omega = given.fundamental * np.arange(1.0, 6.0)
    angle = np.outer(t + 1j * h, omega)
    q = np.sin(angle) @ (given.sin_coef / omega[:, None]) - np.cos(angle) @ (given.cos_coef / omega[:, None])
    dq = np.cos(angle) @ given.sin_coef + np.sin(angle) @ given.cos_coef
    _, ours_dq, ours_ddq = given.evaluate(t)
    assert_allclose(ours_dq, q.imag / h, **ALGEBRAIC)
    assert_allclose(ours_ddq, dq.imag / h, **ALGEBRAIC)


def test_eq_16_designed_motion_keeps_every_line(limits, design):
    t = np.linspace(0, DURATION, 8001)
    for i in range(3):
        for signal, (low, high) in zip(
            printed_series(design.trajectory_, t, i),
            (limits.position[:, i], limits.velocity[:, i], limits.acceleration[:, i]),
            strict=True,
        ):
            assert low <= signal.min() < signal.max() <= high
            assert_allclose(signal[[0, -1]], 0, atol=1e-12)  # theta, its rate and acceleration at t_s and t_e


def test_eq_16_least_objective(problem, design):
    """No random motion within the same limits, scaled until it uses them, has a lower objective."""
    rng = np.random.default_rng(5)
    others = [problem.value(problem.bounds.scaled(rng.standard_normal(problem.shape))) for _ in range(300)]
    assert design.objective_ < 0.9 * min(others)


def test_eq_17_bounds_as_printed():
    """Sums of amplitudes, and nothing on a fine grid exceeds them."""
    for seed in range(5):
        given = odd_series(seed)
        t = np.linspace(1e-9, given.duration - 1e-9, 4001)
        found = sufficient_bounds(given)
        for i in range(3):
            position, velocity, acceleration = abs(given.offset[i]), 0.0, 0.0
            for term in range(1, 6):
                size = np.sqrt(given.sin_coef[term - 1, i] ** 2 + given.cos_coef[term - 1, i] ** 2)
                position += size / (given.fundamental * term)
                velocity += size
                acceleration += given.fundamental * term * size
            assert_allclose(found[:, i], [position, velocity, acceleration], **ALGEBRAIC)
            assert (np.abs(printed_series(given, t, i)).max(axis=1) <= found[:, i]).all()


@pytest.mark.parametrize("start", [0.0, 0.4])
def test_eq_18_free_coefficients_are_the_null_space(start):
    """Three sums of zero (or theta_0 as far off as the start is), and everything else that they allow."""
    series = FourierSeries(N_HARMONICS, DURATION)
    x = np.random.default_rng(2).normal(size=(series.n_free, 2))
    made = series.trajectory(x, np.full(2, start))
    w, order = 2 * np.pi / DURATION, np.arange(1, N_HARMONICS + 1)
    for i in range(2):
        assert_allclose(sum(made.cos_coef[k - 1, i] / (w * k) for k in order) - made.offset[i], -start, atol=1e-12)
        assert_allclose(sum(made.sin_coef[k - 1, i] for k in order), 0, atol=1e-12)
        assert_allclose(sum(w * k * made.cos_coef[k - 1, i] for k in order), 0, atol=1e-12)
    conditions = np.zeros((3, 2 * N_HARMONICS + 1))  # on (a, b, theta_0) of one joint
    conditions[0, N_HARMONICS:] = [*(1 / (w * order)), -1.0]
    conditions[1, :N_HARMONICS] = 1.0
    conditions[2, N_HARMONICS:-1] = w * order
    assert series.n_free == conditions.shape[1] - np.linalg.matrix_rank(conditions)


def test_eq_16_to_18_a_closed_form_of_two_terms():
    """n = 2 leaves one free coefficient of each kind: a_2 = -a_1, b_2 = -b_1 / 2, theta_0 = (3/4) b_1 / w."""
    made = FourierSeries(2, DURATION).trajectory(np.array([[0.3], [0.8]]), np.zeros(1))
    (a_1,), (a_2,) = made.sin_coef
    (b_1,), (b_2,) = made.cos_coef
    assert_allclose([a_2, b_2], [-a_1, -b_1 / 2], **ALGEBRAIC)
    assert_allclose(made.offset[0], 0.75 * b_1 / made.fundamental, **ALGEBRAIC)
    assert min(abs(a_1), abs(b_1)) > 0.1


def test_eqs_13_and_14_of_the_core(robot, design):
    """The four numbers that the objective is made of, one by one, and their sum."""
    core = _core.Excitation(robot, robot.base_parameters().pivots.tolist(), whitening=ROOT)
    rng = np.random.default_rng(0)
    motion = rng.uniform(-2, 2, (3, 60, 3))
    a, b, g, whole = sub_regressors(robot, *motion)
    parts = np.array([condition(x) for x in (whole, a, b, g)])
    assert_allclose(core.conditions(*motion), parts, **EIGENVALUES)
    w = 0.7, 1.9, 0.4  # not one in sum, or the first term's factor would not show
    assert_allclose(core.value(*motion, criterion="block", weights=w), parts @ [sum(w), *w], **EIGENVALUES)
