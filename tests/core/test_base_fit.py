"""Base parameters straight from samples, against numpy on the stacked observation matrix."""

import numpy as np
import pytest
from helpers.tolerances import ALGEBRAIC

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.simulation import bundled_robot


@pytest.fixture(scope="module")
def robot():
    return dyn.RobotModel.from_urdf(bundled_robot())


def samples(robot, n_samples, noise, seed=0):
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.uniform(-2.0, 2.0, (3, n_samples, robot.n_joints))
    tau = robot.inverse_dynamics(q, dq, ddq) + 0.3 + noise * rng.standard_normal(q.shape)
    return q, dq, ddq, tau


def stacked(robot, base, q, dq, ddq):
    """Base columns and one column of ones per joint: (n_samples, n_joints, n_base + n_joints)."""
    Y = robot.joint_torque_regressor(q, dq, ddq)[..., base.pivots]
    ones = np.broadcast_to(np.eye(robot.n_joints), (*Y.shape[:2], robot.n_joints))
    return np.concatenate([Y, ones], axis=2)


def test_weighted_least_squares_is_that_of_the_stacked_matrix(robot):
    noise = np.array([0.5, 2.0, 0.1, 0.03, 0.02, 0.01])
    q, dq, ddq, tau = samples(robot, 700, noise)
    fit = dyn.fit_base_parameters(robot, q, dq, ddq, tau, effects=[dyn.Effect.torque_offset()])
    W = stacked(robot, fit.base, q, dq, ddq)
    width = W.shape[2]
    weights = np.ones(robot.n_joints)
    for _ in range(3):
        rows, rhs = (W / weights[:, None]).reshape(-1, width), (tau / weights).ravel()
        theta, *_ = np.linalg.lstsq(rows, rhs, rcond=None)
        covariance = np.linalg.inv(rows.T @ rows)
        left = tau - W @ theta
        weights = np.sqrt((left**2).sum(axis=0) / (len(tau) - width / robot.n_joints))
    n_base = fit.base.n_base
    np.testing.assert_allclose(fit.parameters, theta[:n_base], **ALGEBRAIC)
    np.testing.assert_allclose(fit.effects[:, 0], theta[n_base:], **ALGEBRAIC)
    np.testing.assert_allclose(fit.std, np.sqrt(np.diag(covariance))[:n_base], rtol=1e-9)
    np.testing.assert_allclose(fit.noise_std, weights, **ALGEBRAIC)
    np.testing.assert_allclose(fit.noise_std, noise, rtol=0.15)
    assert fit.effects.shape == fit.effects_std.shape == (robot.n_joints, 1)


def test_true_parameters_come_back(robot):
    fit = dyn.fit_base_parameters(robot, *samples(robot, 20_000, 0.05), effects=[dyn.Effect.torque_offset()])
    true = fit.base.project(robot.phi)
    q, dq, ddq, _ = samples(robot, 50, 0.0, seed=1)
    expected = robot.inverse_dynamics(q, dq, ddq)
    np.testing.assert_allclose(robot.inverse_dynamics(q, dq, ddq, fit.phi), expected, atol=0.05)
    assert np.all(np.abs(fit.parameters - true) < 5 * fit.std)


def test_without_effects_and_without_weights(robot):
    q, dq, ddq, tau = samples(robot, 300, 0.1)
    fit = dyn.fit_base_parameters(robot, q, dq, ddq, tau - 0.3, n_reweightings=0)
    W = robot.joint_torque_regressor(q, dq, ddq)[..., fit.base.pivots].reshape(-1, fit.base.n_base)
    theta, *_ = np.linalg.lstsq(W, (tau - 0.3).ravel(), rcond=None)
    np.testing.assert_allclose(fit.parameters, theta, **ALGEBRAIC)
    assert fit.effects.shape == (robot.n_joints, 0)


@pytest.mark.parametrize("path", ["baseline", "avx2", "avx512"])
def test_every_path_of_the_processor_finds_the_same(robot, path):
    before = _core.processor_path()
    data = samples(robot, 500, 0.1)
    expected = dyn.fit_base_parameters(robot, *data)
    try:
        _core.processor_path(path)
    except ValueError:
        pytest.skip(f"this processor has no {path}")
    try:
        found = dyn.fit_base_parameters(robot, *data)
        np.testing.assert_allclose(found.parameters, expected.parameters, **ALGEBRAIC)
        if before != "baseline" and path != "baseline":
            assert np.array_equal(found.parameters, expected.parameters)
    finally:
        _core.processor_path(before)


def test_bad_input_is_refused(robot):
    q, dq, ddq, tau = samples(robot, 100, 0.1)
    with pytest.raises(ValueError, match="the data do not tell the base columns apart"):
        dyn.fit_base_parameters(robot, np.zeros_like(q), np.zeros_like(q), np.zeros_like(q), tau)
    with pytest.raises(ValueError, match="samples are too few"):
        dyn.fit_base_parameters(robot, q[:3], dq[:3], ddq[:3], tau[:3])
    with pytest.raises(ValueError, match="tau has 99 samples"):
        dyn.fit_base_parameters(robot, q, dq, ddq, tau[1:])
    with pytest.raises(ValueError, match="expected one of baseline"):
        _core.processor_path("mmx")
