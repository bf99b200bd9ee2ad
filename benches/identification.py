"""Samples to base parameters, weights and standard deviations: against FIGAROH and against numpy on Pinocchio."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
from measure import Row, compare, unit

import dynid_rs as dyn
from dynid_rs.simulation import bundled_robot

try:
    from figaroh.tools.qrdecomposition import QRDecomposer
    from figaroh.tools.regressor import RegressorBuilder, RegressorConfig, get_index_eliminate
except ImportError:
    QRDecomposer = None

OFFSET = dyn.Effect.torque_offset()
NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


class Problem:
    """Samples of the bundled arm with noise, links and one offset per joint unknown."""

    def __init__(self, n_samples: int) -> None:
        path = bundled_robot()
        self.robot = dyn.RobotModel.from_urdf(path)
        self.model = pin.buildModelFromUrdf(str(path))
        self.data = self.model.createData()
        rng = np.random.default_rng(0)
        n = self.robot.n_joints
        self.q, self.dq, self.ddq = rng.uniform(-2, 2, (3, n_samples, n))
        self.tau = self.robot.inverse_dynamics(self.q, self.dq, self.ddq) + 0.3
        self.tau += rng.standard_normal(self.tau.shape) * np.linspace(0.5, 0.05, n)

    def ours(self):
        return dyn.fit_base_parameters(self.robot, self.q, self.dq, self.ddq, self.tau, effects=[OFFSET])

    def figaroh(self):
        """Its public steps, and its weights: regressor, elimination, double QR, weighted least squares, inverse."""
        n = self.robot.n_joints
        config = RegressorConfig(has_joint_offset=True, additional_columns=1)
        builder = RegressorBuilder(SimpleNamespace(model=self.model, data=self.data), config)
        W = builder.build_basic_regressor(self.q, self.dq, self.ddq, {"act_idxv": range(n)})
        names = {f"{name}{j}": 0.0 for j in range(n) for name in NAMES} | {f"off{j}": 0.0 for j in range(n)}
        gone, left = get_index_eliminate(W, names, 1e-6)
        W = np.delete(W, gone, axis=1)
        tau = self.tau.T.ravel()
        W_base, _, _, phi = QRDecomposer().double_decomposition(tau, W, left)
        return weighted(W_base, tau, phi, n)

    def numpy(self):
        """Pinocchio's regressors stacked, base columns known, least squares by numpy."""
        n, pivots = self.robot.n_joints, self.robot.base_parameters().pivots
        W = np.zeros((len(self.q), n, len(pivots) + n))
        W[:, range(n), range(len(pivots), len(pivots) + n)] = 1.0
        for k in range(len(self.q)):
            Y = pin.computeJointTorqueRegressor(self.model, self.data, self.q[k], self.dq[k], self.ddq[k])
            W[k, :, : len(pivots)] = Y[:, pivots]
        W = W.transpose(1, 0, 2).reshape(-1, W.shape[2])
        tau = self.tau.T.ravel()
        phi, *_ = np.linalg.lstsq(W, tau, rcond=None)
        return weighted(W, tau, phi, n)


def weighted(W, tau, phi, n_joints):
    """Two rounds of weights from the joints' own residuals, rows joint by joint; parameters, deviations, noise."""
    for _ in range(2):
        left = (tau - W @ phi).reshape(n_joints, -1)
        noise = np.sqrt((left**2).sum(axis=1) / (left.shape[1] - W.shape[1] / n_joints))
        scale = np.repeat(1.0 / noise, left.shape[1])
        rows = W * scale[:, None]
        covariance = np.linalg.inv(rows.T @ rows)
        phi = covariance @ (rows.T @ (tau * scale))
    return phi, np.sqrt(np.diag(covariance)), noise


def rows(large: bool):
    """Goals G5 to G7."""
    problem = Problem(10_000)
    fit = problem.ours()
    phi, std, _ = problem.numpy()
    n_base = fit.base.n_base
    np.testing.assert_allclose(fit.parameters, phi[:n_base], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(fit.std, std[:n_base], rtol=1e-3)
    yield compare(
        "G6",
        "samples to base parameters, 10,000 samples",
        problem.ours,
        "Pinocchio + numpy lstsq",
        problem.numpy,
        limit=50,
        rounds=5,
    )
    if QRDecomposer is None:
        yield Row("G5", "samples to base parameters", "", "FIGAROH is not installed")
    else:
        # Other columns of the same space: what they predict is the same.
        theirs = problem.figaroh()
        np.testing.assert_allclose(np.sort(theirs[2]), np.sort(fit.noise_std), rtol=1e-3)
        yield compare(
            "G5",
            "samples to base parameters, 10,000 samples",
            problem.ours,
            "FIGAROH",
            problem.figaroh,
            limit=250,
            rounds=3,
        )
        if large:
            tall = Problem(100_000)
            yield compare(
                "G5",
                "samples to base parameters, 100,000 samples",
                tall.ours,
                "FIGAROH",
                tall.figaroh,
                limit=450,
                rounds=1,
            )
    found = json.loads(
        subprocess.run(
            [sys.executable, Path(__file__).with_name("memory.py")], capture_output=True, text=True, check=True
        ).stdout
    )
    yield Row(
        "G7",
        "10^6 samples of six joints, one thread",
        unit(found["seconds"]),
        "",
        None,
        None,
        "<= 0.2 s",
        found["seconds"] <= 0.2,
    )
    for what, key in (
        ("memory beyond the inputs for them, first call and all", "megabytes"),
        ("of it beyond that of 2,000 samples", "growth"),
    ):
        yield Row("G7", what, f"{found[key]:.1f} MB", "", None, None, "<= 4 MB", found[key] <= 4.0)
