"""Eqs. 1, 2, 13 and 19-25, each against a literal transcription on the full stacked matrix, with `numpy.linalg` alone.

The package never forms that matrix: it works on one triangular factor per joint. A small problem, 60 samples of three
joints, lets both be done.
"""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from helpers import printed
from helpers.engines import Pinocchio
from helpers.robots import random_chain, random_states
from helpers.small_arm import URDF
from helpers.tolerances import ALGEBRAIC, PINOCCHIO, relative_error, statistical
from numpy.testing import assert_allclose

from dynid_rs import LinkDynamicsIdentifier, RobotModel, _core
from dynid_rs.regression.columns import Block, Observations, make_plan
from dynid_rs.regression.fitted import weighted_system
from dynid_rs.regression.systems import block_residuals, residual_covariance

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
    delta = rng.multivariate_normal(np.zeros(n), noise, m)
    tau = Gamma @ true + delta
    rows = [np.column_stack([Gamma[:, j][:, plan.unknowns(j)], tau[:, j]]) for j in range(n)]
    blocks = [
        Block(k, part, [_core.triangular_factor(np.ascontiguousarray(r)) for r in part]) for k, part in halves(rows)
    ]
    observations = Observations(plan, blocks)
    return SimpleNamespace(robot=robot, plan=plan, q=q, dq=dq, ddq=ddq, Gamma=Gamma[:, :, used], tau=tau, used=used,
                           true=true[used], delta=delta, observations=observations)  # fmt: skip


def halves(rows):
    """Two runs."""
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
    return LinkDynamicsIdentifier(*arguments, prior=None, **options).fit(small.observations)


K = np.array([3.0, 2.6, 1.1, 0.9, -0.4, 0.3, 0.05, 0.07])
"""Friction coefficients in the order of `FRICTION_NAMES`."""


@pytest.mark.parametrize("seed", [3, 4, 8])
def test_eq_1_inertia_coriolis_gravity_friction_and_residual(seed):
    """M, C and G each by an algorithm of its own in Pinocchio; friction and mixture literally, all in one model."""
    chain = random_chain(seed)
    robot = RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)
    engine, n = Pinocchio(chain.urdf, chain.gravity), robot.n_joints
    phi = engine.phi
    q, dq, ddq = random_states(25, n, seed)
    rigid = []
    for pose, speed, acceleration in zip(engine.configurations(q), dq, ddq, strict=True):
        upper = np.triu(pin.crba(engine.model, engine.data, pose))
        inertia = upper + np.triu(upper, 1).T
        coriolis = pin.computeCoriolisMatrix(engine.model, engine.data, pose, speed)
        gravity = pin.computeGeneralizedGravity(engine.model, engine.data, pose)
        rigid.append(inertia @ acceleration + coriolis @ speed + gravity)
    rng = np.random.default_rng(seed)
    q_motor, dq_motor = q + 1e-3 * rng.normal(size=q.shape), dq + 1e-2 * rng.normal(size=q.shape)
    friction = np.stack([printed.friction(speed, 0.1, 0.02, K) for speed in dq_motor.T], axis=1)
    size = np.array([3e-3, 0.03, 5.0])
    mixture = np.array([0.4, 0.6]), size * rng.normal(size=(2, 3)), np.stack([np.diag((3 * size) ** 2)] * 2)
    mixture[2][1] += 0.3 * np.outer(3 * size, 3 * size)
    regression = _core.GaussianMixtureRegression(*mixture)
    u = np.stack([q_motor - q, dq_motor - dq], axis=2)
    residual = np.stack([printed.mixture_regression(*mixture, u[:, j]) for j in range(n)], axis=1)
    model = _core.TorqueModel(
        robot,
        phi,
        [(_core.Effect.friction([0.1] * n, [0.02] * n), np.tile(K, (n, 1)))],
        residual=("deflection", [regression] * n),
        encoder_delay=[0.0] * n,
        noise_std=[1.0] * n,
        domain=([[-4.0, 4.0]] * n, [4.0] * n, [11.0] * n),
    )
    total, terms, status = model.evaluate(q, dq, ddq, q_motor, dq_motor, ddq)
    assert (status == 0).all()
    for k, expected in enumerate((np.array(rigid), friction, residual)):
        assert relative_error(terms[:, k], expected) < 100 * PINOCCHIO
    assert relative_error(total, np.array(rigid) + friction + residual) < 100 * PINOCCHIO


def test_eq_1_contact_is_what_the_model_leaves():
    """No term stands for J' F_ext: of the torque in contact, by Pinocchio's recursion, that is what is left."""
    engine = Pinocchio(URDF, (0.0, 0.0, -9.81))
    robot = RobotModel.from_urdf_string(URDF)
    q, dq, ddq = random_states(20, 3, 0)
    force = pin.Force(np.array([10.0, -4.0, 7.0, 0.5, -0.3, 0.2]))  # on the last link, in its own frame
    last = engine.model.njoints - 1
    for state in zip(q, dq, ddq, strict=True):
        forces = pin.StdVec_Force()
        forces.extend([pin.Force.Zero()] * last + [force])
        in_contact = pin.rnea(engine.model, engine.data, *state, forces)
        J = pin.computeJointJacobian(engine.model, engine.data, state[0], last)
        left = in_contact - robot.inverse_dynamics(*(x[None] for x in state))[0]
        assert_allclose(left, -J.T @ force.vector, **ALGEBRAIC)


def test_eq_2_rows_of_the_fit_are_pinocchios_regressor_beside_the_printed_friction():
    """[Gamma_link Gamma_f] of every joint as the fit takes them, and their product with [Phi_link Phi_f]."""
    engine, robot = Pinocchio(URDF, (0.0, 0.0, -9.81)), RobotModel.from_urdf_string(URDF)
    plan = make_plan(robot, [_core.Effect.friction([0.1] * 3, [0.02] * 3)])
    q, dq, ddq = random_states(40, 3, 1)
    friction = np.stack([printed.friction(speed, 0.1, 0.02, K) for speed in dq.T], axis=1)
    tau = engine.inverse_dynamics(q, dq, ddq) + friction
    rows = _core.observe(
        robot, list(plan.effects), plan.pivots.tolist(), q, dq, ddq, q, dq, ddq, tau, kept=list(range(40))
    )
    whole = engine.joint_torque_regressor(q, dq, ddq)
    n_base = np.linalg.matrix_rank(whole.reshape(-1, 30), tol=1e-9)
    assert len(plan.pivots) == n_base == np.linalg.matrix_rank(whole[:, :, plan.pivots].reshape(-1, n_base), tol=1e-9)
    phi_base = robot.base_parameters().project(engine.phi)
    for j in range(3):
        moved = plan.pivots >= 10 * j
        gamma = np.column_stack([printed.friction_columns(dq[:, j], 0.1, 0.02), whole[:, j][:, plan.pivots[moved]]])
        assert_allclose(rows[j], np.column_stack([gamma, tau[:, j]]), **ALGEBRAIC)
        assert_allclose(gamma @ np.concatenate([K, phi_base[moved]]), tau[:, j], **ALGEBRAIC)


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


def test_eq_19_the_residual_is_delta_off_the_columns(small):
    """tau = Gamma Phi + delta: what the fit leaves is (1 - Q Q') delta with Q from numpy's own QR of Gamma."""
    Gamma, _ = stacked(small)
    Q, _ = np.linalg.qr(Gamma)
    delta = small.delta.ravel()
    links = fit(small, None)
    left = np.concatenate(block_residuals(small.observations, links.x_, links.torque_scale_))
    assert_allclose(left.ravel(), delta - Q @ (Q.T @ delta), **FACTORED)


def test_eq_20_noise_of_each_joint_is_found_as_large_as_it_is():
    """E(delta delta') over 200 draws: the variances that were put in, and no correlation between the joints."""
    put_in = np.diag([0.09, 0.04, 0.01])
    found = []
    for seed in range(200):
        links = fit(problem(seed, noise=put_in))
        found.append(links.covariance_)
        assert_allclose(links.noise_std_, np.sqrt(np.diag(links.covariance_)), rtol=0.2)
    found = np.array(found)
    error = found.std(axis=0) / np.sqrt(len(found))
    beside = ~np.eye(3, dtype=bool)
    assert (np.abs(found.mean(axis=0))[beside] < 5 * error[beside]).all()
    assert_allclose(np.diagonal(found.mean(axis=0)), np.diag(put_in), rtol=0.05)


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
