"""The paper's whole offline chain on one core: plan a motion, identify links, friction, and a mixture per joint."""

from __future__ import annotations

import statistics
from types import SimpleNamespace

import numpy as np
from identification import Problem
from measure import Row, processor_seconds, unit
from threadpoolctl import threadpool_limits

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.excitation.limits import ExcitationLimits
from dynid_rs.simulation import bundled_robot

N_SAMPLES = 10_000
N_SPEEDS = 2_000
N_POINTS = 2_000
N_COMPONENTS = 10
NOISE = 0.1
ROUNDS = 5
LIMIT = 0.25


class Chain:
    """Inputs of all four steps, made once."""

    def __init__(self) -> None:
        self.robot = dyn.RobotModel.from_urdf(bundled_robot())
        self.limits = ExcitationLimits.of_robot(self.robot)
        self.problem = Problem(N_SAMPLES)
        rng = np.random.default_rng(0)
        n = self.robot.n_joints
        speeds = rng.uniform(-2, 2, (N_SPEEDS, n))
        friction = [_core.friction_basis(speeds[:, j], 0.05, 0.01) @ rng.uniform(0.5, 2.0, 8) for j in range(n)]
        self.friction = np.stack(friction, axis=1) + NOISE * rng.standard_normal(speeds.shape)
        self.speeds = np.ascontiguousarray(speeds)
        self.points = rng.standard_normal((n, N_POINTS, 3)) @ (np.eye(3) + 0.2)

    def excitation(self):
        """Twenty seconds, 200 samples, one search of 30 steps."""
        plan = dyn.FourierExcitation(criterion="condition", n_restarts=1, n_jobs=1, random_state=0)
        return plan.fit(self.robot, self.limits)

    def identification(self):
        """Base parameters, weights and standard deviations."""
        return self.problem.ours()

    def friction_fits(self):
        """Shape by the search of the first loop (no links in these torques), coefficients by least squares."""
        n = self.robot.n_joints
        # What the identifier reads of a plan and of a run.
        plan = SimpleNamespace(robot=self.robot, n_own=8, friction=(None, slice(0, 8)), own=np.ones((n, 8), dtype=bool))
        every = np.arange(N_SPEEDS)
        run = SimpleNamespace(
            dq_motor=self.speeds,
            filter=None,
            rows=every,
            kept=every.tolist(),
            counted=np.ones(self.speeds.shape, dtype=bool),
            velocity_noise=lambda j: 1e-3,
        )
        rows = [np.column_stack([np.zeros((N_SPEEDS, 8)), self.friction[:, j]]) for j in range(n)]
        found = dyn.FrictionIdentifier().fit(plan, [run], [rows])
        shapes = zip(found.velocity_threshold_, found.transition_width_, strict=True)
        left = []
        for j, shape in enumerate(shapes):
            basis = _core.friction_basis(self.speeds[:, j], *shape)
            coefficients = np.linalg.lstsq(basis, self.friction[:, j], rcond=None)[0]
            left.append(np.std(self.friction[:, j] - basis @ coefficients))
        return left

    def mixtures(self):
        """One mixture per joint."""
        return [
            dyn.GaussianMixtureRegressor(N_COMPONENTS, solver="fused", random_state=0).fit(x[:, :2], x[:, 2])
            for x in self.points
        ]


def rows():
    """Goal G14."""
    chain = Chain()
    # What the fits leave is the noise that was put in.
    np.testing.assert_allclose(chain.friction_fits(), NOISE, rtol=0.1)
    steps = {
        "search of an exciting motion of 200 samples, 30 steps": chain.excitation,
        f"{N_SAMPLES:,} samples to base parameters": chain.identification,
        f"friction of six joints, {N_SPEEDS:,} points each": chain.friction_fits,
        f"six mixtures, {N_POINTS:,} points and {N_COMPONENTS} components each": chain.mixtures,
    }
    with threadpool_limits(limits=1):
        for step in steps.values():
            step()
        rounds = [[processor_seconds(step, 1) for step in steps.values()] for _ in range(ROUNDS)]
    for what, times in zip(steps, zip(*rounds, strict=True), strict=True):
        yield Row("", what, unit(statistics.median(times)), "")
    totals = [sum(times) for times in rounds]
    middle = statistics.median(totals)
    yield Row(
        "G14",
        "the whole chain",
        f"{unit(middle)} ({unit(min(totals))} to {unit(max(totals))})",
        "",
        limit=f"<= {LIMIT:g} s",
        met=middle <= LIMIT,
    )


if __name__ == "__main__":
    for line in rows():
        print(line, flush=True)
