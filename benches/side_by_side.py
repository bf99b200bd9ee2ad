"""Speed side by side with a peer, in one process, alternating; prints medians and their ratio.

The peer for dynamics is Pinocchio's Python interface, for least squares numpy on the stacked observation matrix.
"""

from __future__ import annotations

import resource
import statistics
import time

import numpy as np
import pinocchio as pin

import dynid_rs as dyn
from dynid_rs.simulation import bundled_robot, simulate, typical_arm

ROUNDS = 7
N_SAMPLES = 20_000


def alternate(ours, theirs):
    """Median seconds of both, run in turn."""
    times = ([], [])
    for _ in range(ROUNDS):
        for function, record in zip((ours, theirs), times, strict=True):
            start = time.perf_counter()
            function()
            record.append(time.perf_counter() - start)
    return tuple(statistics.median(record) for record in times)


def row(what, ours, theirs, peer):
    mine, other = alternate(ours, theirs)
    print(f"{what:<44} {1e3 * mine:9.2f} ms  {1e3 * other:9.2f} ms ({peer})  {other / mine:6.1f} x")


def main():
    path = bundled_robot()
    robot = dyn.RobotModel.from_urdf(path)
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    rng = np.random.default_rng(0)
    q, dq, ddq = (rng.uniform(-2, 2, (N_SAMPLES, robot.n_joints)) for _ in range(3))

    def pinocchio_rnea():
        for k in range(N_SAMPLES):
            pin.rnea(model, data, q[k], dq[k], ddq[k])

    def pinocchio_regressor():
        stacked = np.empty((N_SAMPLES, robot.n_joints, 10 * robot.n_joints))
        for k in range(N_SAMPLES):
            stacked[k] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])

    row(
        f"inverse dynamics, {N_SAMPLES} samples",
        lambda: robot.inverse_dynamics(q, dq, ddq),
        pinocchio_rnea,
        "Pinocchio",
    )
    row(
        f"regressor, {N_SAMPLES} samples, stored",
        lambda: robot.joint_torque_regressor(q, dq, ddq),
        pinocchio_regressor,
        "Pinocchio",
    )
    runs = simulate(typical_arm(robot), n_runs=3, duration=20.0, rate=250.0, seed=0).recordings
    start = time.perf_counter()
    dyn.ThreeLoopIdentifier(robot).fit(runs)
    print(f"three loops on 60 s of six-joint data at 250 Hz: {time.perf_counter() - start:.2f} s")
    print(f"peak memory of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
