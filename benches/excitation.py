"""Excitation objective, its gradient and a whole search: against numpy and SciPy on Pinocchio's regressors."""

from __future__ import annotations

import statistics

import numpy as np
import pinocchio as pin
from measure import Row, compare, processor_seconds, unit
from scipy.optimize import minimize

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.excitation.limits import ExcitationLimits
from dynid_rs.excitation.problem import Problem
from dynid_rs.excitation.series import FourierSeries
from dynid_rs.simulation import bundled_robot

N_SAMPLES = 200
N_VARIABLES = 66
"""Five harmonics and a centre of six joints: what the peer's finite differences step through."""

N_ITERATIONS = 30
"""Of the whole search, in both: the peer takes a tenth of a second for each."""
N_STARTS = 2


def rows():
    """Goals G8 and G9."""
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
    yield search_row(robot, model, data, pivots)


def search_row(robot, model, data, pivots):
    """A whole search: the same starts, bounds and number of steps of SLSQP; all that differs is who evaluates."""
    limits = ExcitationLimits.of_robot(robot)
    start = limits.start()
    series = FourierSeries(6, 10.0)
    t = np.arange(N_SAMPLES) * 10.0 / N_SAMPLES
    problem = Problem(
        robot, robot.base_parameters(), series, t, limits, start, criterion="condition", whitening=None, constraints=()
    )

    def theirs(x):
        q, dq, ddq = problem.motion(x.reshape(problem.shape))
        W = np.empty((N_SAMPLES, robot.n_joints, len(pivots)))
        for k in range(N_SAMPLES):
            W[k] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])[:, pivots]
        s = np.linalg.svd(W.reshape(-1, len(pivots)), compute_uv=False)
        return np.log(s[0] / s[-1])

    def ours(x):
        value, slope = problem.smooth(x.reshape(problem.shape))
        return value, slope.ravel()

    rooms = {
        "type": "ineq",
        "fun": lambda x: problem.rooms(x.reshape(problem.shape)),
        "jac": lambda x: problem.room_slopes(x.reshape(problem.shape)).reshape(-1, x.size),
    }

    def searched(objective, exact, first):
        settings = {"maxiter": N_ITERATIONS, "ftol": 1e-12}
        result = minimize(objective, first, jac=exact, method="SLSQP", constraints=[rooms], options=settings)
        motion = problem.repaired(result.x.reshape(problem.shape))
        return problem.value(motion)

    rng = np.random.default_rng(0)
    firsts = [0.95 * problem.drawn(rng).ravel() for _ in range(N_STARTS)]
    np.testing.assert_allclose(ours(firsts[0])[0], theirs(firsts[0]), rtol=1e-9)
    searched(ours, True, firsts[0])
    conditions, times = [], []
    for first in firsts:
        both = []
        for objective, exact in ((ours, True), (theirs, None)):
            both.append(processor_seconds(lambda: conditions.append(searched(objective, exact, first)), 1))  # noqa: B023
        times.append(both)
    own, other = (statistics.median(column) for column in zip(*times, strict=True))
    ratios = [theirs / ours for ours, theirs in times]
    reached = [f"{a:.4g} ({b:.4g})" for a, b in zip(conditions[::2], conditions[1::2], strict=True)]
    as_good = all(a <= b for a, b in zip(conditions[::2], conditions[1::2], strict=True))
    return Row(
        "G9",
        f"search of {firsts[0].size} variables, {N_ITERATIONS} steps of SLSQP from each of {N_STARTS} starts",
        unit(own),
        f"{unit(other)} (SLSQP on Pinocchio + numpy, forward differences)",
        other / own,
        (min(ratios), max(ratios)),
        ">= 150",
        other / own >= 150 and as_good,
        f"met only where no condition number is above theirs (in brackets): {', '.join(reached)}; "
        "both are given the bounds' exact slopes",
    )
