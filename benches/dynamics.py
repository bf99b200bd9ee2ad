"""Inverse dynamics and regressor: batches and single calls against Pinocchio and CasADi, in Python and compiled."""

from __future__ import annotations

import native
import numpy as np
import pinocchio as pin
from measure import compare

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

N_SAMPLES = 4096


def rows():
    """Goals G1 to G4."""
    path = bundled_robot()
    robot = dyn.RobotModel.from_urdf(path)
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-2, 2, (3, N_SAMPLES, robot.n_joints))
    check(robot, model, data, q, dq, ddq)

    def pinocchio_torques():
        for k in range(N_SAMPLES):
            pin.rnea(model, data, q[k], dq[k], ddq[k])

    def pinocchio_regressors():
        stacked = np.empty((N_SAMPLES, robot.n_joints, 10 * robot.n_joints))
        for k in range(N_SAMPLES):
            stacked[k] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])

    yield compare(
        "G3",
        "inverse dynamics of a batch, per sample",
        lambda: robot.inverse_dynamics(q, dq, ddq),
        "Pinocchio, Python",
        pinocchio_torques,
        per=N_SAMPLES,
    )
    yield compare(
        "G1",
        "regressor of a batch into a new array, per sample",
        lambda: robot.joint_torque_regressor(q, dq, ddq),
        "Pinocchio, Python",
        pinocchio_regressors,
        per=N_SAMPLES,
        limit=70 if _core.processor_path() == "avx512" else 35,
    )
    kept = np.empty((N_SAMPLES, robot.n_joints, 10 * robot.n_joints))
    yield compare(
        "G1",
        "regressor of a batch into a given array, per sample",
        lambda: robot.joint_torque_regressor(q, dq, ddq, out=kept),
        "Pinocchio, Python",
        pinocchio_regressors,
        per=N_SAMPLES,
    )
    one_q, one_dq, one_ddq = q[:1], dq[:1], ddq[:1]
    room = np.empty((1, robot.n_joints, 10 * robot.n_joints))
    yield compare(
        "G4",
        "one regressor from Python into a given array",
        lambda: robot.joint_torque_regressor(one_q, one_dq, one_ddq, out=room),
        "Pinocchio, Python",
        lambda: pin.computeJointTorqueRegressor(model, data, q[0], dq[0], ddq[0]),
        limit=15,
    )
    yield compare(
        "G4",
        "one regressor from Python",
        lambda: robot.joint_torque_regressor(one_q, one_dq, one_ddq),
        "Pinocchio, Python",
        lambda: pin.computeJointTorqueRegressor(model, data, q[0], dq[0], ddq[0]),
        limit=10,
    )
    yield compare(
        "",
        "one inverse dynamics from Python",
        lambda: robot.inverse_dynamics(one_q, one_dq, one_ddq),
        "Pinocchio, Python",
        lambda: pin.rnea(model, data, q[0], dq[0], ddq[0]),
    )
    yield from native.rows(robot, model, q, dq, ddq)


def check(robot, model, data, q, dq, ddq):
    """The two do the same: regressors need the same frames, torques are enough."""
    expected = np.array([pin.rnea(model, data, *state) for state in zip(q[:64], dq[:64], ddq[:64], strict=True)])
    np.testing.assert_allclose(robot.inverse_dynamics(q[:64], dq[:64], ddq[:64]), expected, rtol=0, atol=1e-12)
