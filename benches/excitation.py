"""Excitation objective and its gradient: against numpy on Pinocchio's regressors."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from measure import compare

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

N_SAMPLES = 200
N_VARIABLES = 66
"""Five harmonics and a centre of six joints: what the peer's finite differences step through."""


def rows():
    """Goal G8."""
    path = bundled_robot()
    robot = dyn.RobotModel.from_urdf(path)
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    pivots = robot.base_parameters().pivots
    objective = _core.Excitation(robot, pivots.tolist())
    q, dq, ddq = np.random.default_rng(0).uniform(-2, 2, (3, N_SAMPLES, robot.n_joints))

    def ours():
        return objective.value(q, dq, ddq, criterion="condition")

    def gradient():
        return objective.value_and_gradient(q, dq, ddq, criterion="condition")

    def theirs():
        W = np.empty((N_SAMPLES, robot.n_joints, len(pivots)))
        for k in range(N_SAMPLES):
            W[k] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])[:, pivots]
        s = np.linalg.svd(W.reshape(-1, len(pivots)), compute_uv=False)
        return s[0] / s[-1]

    def differences():
        for _ in range(N_VARIABLES + 1):
            theirs()

    np.testing.assert_allclose(ours(), theirs(), rtol=1e-9)
    what = f"condition number of {N_SAMPLES} samples"
    yield compare("G8", what, ours, "Pinocchio + numpy SVD", theirs, limit=30)
    yield compare(
        "G8",
        f"{what} with its gradient",
        gradient,
        f"{N_VARIABLES + 1} values of it",
        differences,
        limit=1000,
        rounds=5,
        note="exact in the motion, against forward differences in 66 Fourier coefficients",
    )
