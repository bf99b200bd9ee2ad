"""Eqs. 2, 13 and 19-25, each against a literal transcription on the full stacked matrix, with `numpy.linalg` alone.

The package never forms that matrix: it works on one triangular factor per joint. A small problem, 60 samples of three
joints, lets both be done.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_arm import URDF
from tolerances import ALGEBRAIC, statistical

from dynid_rs import LinkDynamicsIdentifier, RobotModel, _core
from dynid_rs.columns import Block, Observations, make_plan
from dynid_rs.links import residual_covariance, weighted_system

FACTORED = {"rtol": 1e-8, "atol": 1e-8}
"""Normal equations of the transcription against orthogonal factors: the condition number is squared on one side."""
M = 60
NOISE = np.array([[0.09, 0.02, 0.0], [0.02, 0.04, -0.01], [0.0, -0.01, 0.01]])
"""Covariance of the noise between joints [(N*m)^2]: different sizes, and not independent."""


def problem(seed=0, m=M, noise=NOISE):
    """Gamma (m, n, p) of base columns, rotor inertia and offset; tau (m, n); the same as the package's observations."""
    robot = RobotModel.from_urdf_string(URDF)
    n = robot.n_joints
    effects = [_core.Effect.rotor_inertia(), _core.Effect.torque_offset()]
    plan = make_plan(robot, effects)
    rng = np.random.default_rng(seed)
    q, dq, ddq = (rng.uniform(-2, 2, (m, n)) for _ in range(3))
    own = np.zeros((m, n, n * plan.n_own))
    for j in range(n):
        own[:, j, j * plan.n_own] = ddq[:, j]
        own[:, j, j * plan.n_own + 1] = 1.0
    Gamma = np.concatenate([robot.joint_torque_regressor(q, dq, ddq)[:, :, plan.pivots], own], axis=2)
    used = plan.estimable()
    true = np.where(used, rng.uniform(0.5, 2.0, plan.n_columns), 0.0)
    tau = Gamma @ true + rng.multivariate_normal(np.zeros(n), noise, m)
    rows = [np.column_stack([Gamma[:, j][:, plan.unknowns(j)], tau[:, j]]) for j in range(n)]
    blocks = [
        Block(k, part, [_core.triangular_factor(np.ascontiguousarray(r)) for r in part]) for k, part in halves(rows)
    ]
    observations = Observations(plan, blocks)
    return SimpleNamespace(robot=robot, plan=plan, q=q, dq=dq, ddq=ddq, Gamma=Gamma[:, :, used], tau=tau, used=used,
                           true=true[used], observations=observations)  # fmt: skip


def halves(rows):
    """Two runs, so that nothing is left out and no ridge is looked for."""
    half = len(rows[0]) // 2
    return [(0, [row[:half] for row in rows]), (1, [row[half:] for row in rows])]


@pytest.fixture(scope="module")
def small():
    return problem()


def stacked(small):
    """Gamma (n m, p) and tau (n m,), sample by sample: the matrix of Eq. 2 over all samples."""
    return small.Gamma.reshape(-1, small.Gamma.shape[2]), small.tau.ravel()


def blocks_of(covariance, m=M):
    """Sigma_6m of Eqs. 23 and 25: m equal blocks on the diagonal."""
    return np.kron(np.eye(m), covariance)


def generalised(Gamma, tau, covariance):
    """``(Gamma' S^-1 Gamma)^-1 Gamma' S^-1 tau``: Eqs. 23 and 25 as printed."""
    inverse = np.linalg.inv(covariance)
    return np.linalg.inv(Gamma.T @ inverse @ Gamma) @ Gamma.T @ inverse @ tau


def plain(Gamma, tau):
    return np.linalg.inv(Gamma.T @ Gamma) @ Gamma.T @ tau


def joint_errors(small, x):
    """E of Eq. 21, one row per joint: (n, m)."""
    Gamma, tau = stacked(small)
    return (tau - Gamma @ x).reshape(small.tau.shape).T


def fit(small, *arguments, **options):
    return LinkDynamicsIdentifier(*arguments, ridge=0.0, **options).fit(small.observations)


def test_equation_2_the_torque_is_regressor_times_parameters(small):
    """tau = Gamma Phi, with the base columns alone and with all ten per link."""
    phi = small.robot.phi
    tau = small.robot.inverse_dynamics(small.q, small.dq, small.ddq, phi)
    Y = small.robot.joint_torque_regressor(small.q, small.dq, small.ddq)
    assert_allclose(Y @ phi, tau, **ALGEBRAIC)
    base = small.robot.base_parameters()
    assert_allclose(Y[:, :, small.plan.pivots] @ base.project(phi), tau, **ALGEBRAIC)
    assert np.linalg.matrix_rank(Y.reshape(-1, 30), tol=1e-8) == base.n_base


@pytest.mark.parametrize("weighting", ["joint_variance", "full_covariance"])
def test_equation_13_whitened_rows_are_the_regressor_times_the_inverse_root(small, weighting):
    """Gamma* = Omega^(-1/2) Gamma: any root gives the same Gamma*' Gamma*, Gamma*' tau* and tau*' tau*."""
    links = fit(small, weighting)
    omega = np.diag(np.diag(links.covariance_)) if weighting == "joint_variance" else links.covariance_
    values, axes = np.linalg.eigh(omega)
    root = axes @ np.diag(values**-0.5) @ axes.T
    Gamma, tau = stacked(small)
    star = np.kron(np.eye(M), root) @ np.column_stack([Gamma, tau])
    system = weighted_system(small.observations, links)[:, np.append(small.used, True)]
    assert_allclose(system.T @ system, star.T @ star, rtol=1e-9, atol=1e-9 * np.abs(star.T @ star).max())


def test_equations_19_and_20_plain_least_squares(small):
    """tau = Gamma Phi + delta, every joint's noise alike."""
    expected = plain(*stacked(small))
    assert_allclose(fit(small, None).x_[small.used], expected, **FACTORED)
    assert_allclose(fit(small, start="least_squares", max_iter=1).x_[small.used], expected, **FACTORED)


def test_equations_21_to_23_one_plain_step_and_one_reweighting(small):
    """The paper's weighted least squares as printed: E, Sigma_ii = var(E_i), Phi_WLS."""
    Gamma, tau = stacked(small)
    errors = joint_errors(small, plain(Gamma, tau))  # Eq. 21
    sigma = np.diag(np.mean(errors**2, axis=1))  # Eq. 22; E has no mean to take off, each joint has an offset...
    assert_allclose(errors.mean(axis=1)[small.plan.own[:, 1]], 0, atol=1e-9)  # ...where one can be told
    expected = generalised(Gamma, tau, blocks_of(sigma))  # Eq. 23
    links = fit(small, start="least_squares", max_iter=2)
    assert links.n_iter_ == 2
    assert_allclose(links.x_[small.used], expected, **FACTORED)
    assert np.abs(expected - plain(Gamma, tau)).max() > 1e-3


@pytest.mark.parametrize("start", ["least_squares", "torque"])
def test_equations_21_to_23_iterated_until_nothing_changes(small, start):
    """From any start, the fixed point: Phi_WLS with the variances of its own errors."""
    Gamma, tau = stacked(small)
    expected = plain(Gamma, tau)
    for _ in range(100):
        sigma = np.diag(np.mean(joint_errors(small, expected) ** 2, axis=1))
        expected = generalised(Gamma, tau, blocks_of(sigma))
    links = fit(small, start=start, max_iter=100, tol=1e-12)
    assert links.converged_
    assert_allclose(links.x_[small.used], expected, **FACTORED)


def test_equation_24_the_covariance_with_its_divisor(small):
    """Omega = E E' / (m - rank(Gamma)), as printed; the package's own divides by m - rank / n."""
    Gamma, tau = stacked(small)
    links = fit(small, None)
    errors = joint_errors(small, plain(Gamma, tau))
    rank = np.linalg.matrix_rank(Gamma)
    assert rank == small.used.sum()
    printed = residual_covariance(small.observations, links.x_, links.torque_scale_, as_printed=True)
    assert_allclose(printed, errors @ errors.T / (M - rank), **FACTORED)
    assert_allclose(links.covariance_, errors @ errors.T / (M - rank / 3), **FACTORED)


def test_the_divisor_of_equation_24_is_too_small_and_the_share_is_right():
    """Over 200 draws of few samples and like noise: m - rank/n gives the mean variance, m - rank far more."""
    ours, printed = [], []
    for seed in range(200):
        small = problem(seed, m=40, noise=0.04 * np.eye(3))
        links = fit(small, None)
        own, paper = (
            residual_covariance(small.observations, links.x_, links.torque_scale_, as_printed=flag)
            for flag in (False, True)
        )
        ours.append(np.trace(own) / 0.12)
        printed.append(np.trace(paper) / 0.12)
    error = np.std(ours) / np.sqrt(200)
    assert_allclose(np.mean(ours), 1.0, **statistical(error))
    assert np.mean(printed) > 1.25


def test_equation_25_generalised_least_squares_with_the_full_covariance(small):
    """Omega of the plain errors, as printed; any factor of Omega gives the same estimate."""
    Gamma, tau = stacked(small)
    errors = joint_errors(small, plain(Gamma, tau))
    omega = errors @ errors.T / (M - np.linalg.matrix_rank(Gamma))
    expected = generalised(Gamma, tau, blocks_of(omega))
    links = fit(small, "full_covariance", start="least_squares", max_iter=1)
    assert_allclose(links.x_[small.used], expected, **FACTORED)
    diagonal = generalised(Gamma, tau, blocks_of(np.diag(np.diag(omega))))
    assert np.abs(expected - diagonal).max() > 1e-3


@pytest.mark.parametrize("options", [{"start": "ridge"}, {"weighting": "variance"}, {"ridge": -1.0}])
def test_choices_that_are_none_are_refused(small, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        LinkDynamicsIdentifier(**options).fit(small.observations)
