"""A third loop that gets what the others leave: it changes its own joint alone, judged by what they had not seen."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_arm import URDF

from dynid_rs import RobotModel, ThreeLoopIdentifier
from dynid_rs.identification.residual import ResidualCompensator
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.systems import block_residuals
from dynid_rs.simulation import simulate, typical_arm

ELBOW = 1
SIZE = 10.0
"""Slope [N m/rad] of a torque that grows with the angle on either side, which no term of the model has."""


@cache
def runs(seed=0):
    """Runs of the small arm with one encoder per joint; something pulls at the elbow, by its angle."""
    arm = typical_arm(RobotModel.from_urdf_string(URDF)).rigid()
    recordings = simulate(arm, n_runs=3, duration=12.0, rate=200.0, seed=seed, derivatives=True).recordings
    pulled = []
    for recording in recordings:
        tau = recording.tau.copy()
        tau[:, ELBOW] += SIZE * np.abs(recording.q[:, ELBOW])
        pulled.append(replace(recording, tau=tau, q_motor=None, dq_motor=None))
    return pulled


@cache
def identified():
    return ThreeLoopIdentifier(RobotModel.from_urdf_string(URDF)).fit(runs()[:2])


def test_other_joints_are_what_they_are_without_it():
    """Joints share the links: what one joint's third loop takes off would end up in the others' torque."""
    found = identified()
    assert found.residual_.inputs_ == "joint_state"
    assert found.residual_.kept.tolist() == [False, True, False]
    assert (found.n_iter_, found.converged_) == (1, True)
    states = found.states(runs()[2])
    (total, terms, _), (without, parts, _) = evaluate(found.model_, states), evaluate(found.two_loop_model_, states)
    others = [0, 2]
    assert_array_equal(total[:, others], without[:, others])
    assert_array_equal(terms[:, : parts.shape[1]], parts)
    error = [np.std(states.in_band(states.tau - tau)[:, ELBOW]) for tau in (total, without)]
    assert error[0] < 0.95 * error[1], error


def test_forced_on_every_joint_it_changes_no_other_term():
    found = identified()
    states = found.states(runs()[2])
    forced = evaluate(found.model_with(found.residual_.candidates_), states)[1]
    parts = evaluate(found.two_loop_model_, states)[1]
    assert_array_equal(forced[:, : parts.shape[1]], parts)


def test_what_is_left_unseen_is_that_of_a_fit_to_the_other_blocks():
    """Against least squares on the rows themselves, prior and weights as they are."""
    found = identified()
    observations, links = found.observations_, found.links_
    plan, posterior = observations.plan, links.posterior_
    for k, left in enumerate(links.residuals_unseen(observations)):
        rows = [posterior.pull]
        for block in (block for i, block in enumerate(observations.blocks) if i != k):
            for j, part in enumerate(block.rows):
                wide = np.zeros((len(part), plan.n_columns + 1))
                wide[:, plan.unknowns(j)], wide[:, -1] = part[:, :-1], part[:, -1]
                rows.append(links.weights_[j] * wide)
        system = np.concatenate(rows)[:, np.append(plan.estimable(), True)]
        norms = np.linalg.norm(system[:, :-1], axis=0)
        x = np.zeros(plan.n_columns)
        x[plan.estimable()] = np.linalg.lstsq(system[:, :-1] / norms, system[:, -1], rcond=None)[0] / norms
        expected = block_residuals(observations, x, links.torque_scale_)
        seen = block_residuals(observations, links.x_, links.torque_scale_)
        for part, other in zip(left, expected, strict=True):
            assert_allclose(part, other, rtol=0, atol=1e-6 * np.abs(other).max())
        assert np.all(np.sum(left[k] ** 2, axis=0) > np.sum(seen[k] ** 2, axis=0))


@pytest.mark.parametrize(("carries_over", "kept"), [(True, True), (False, False)])
def test_what_the_others_have_seen_of_a_run_does_not_speak_for_it(carries_over, kept):
    """Leftovers of one law in both runs; fitted without a run, the first two loops leave of it what has no such law."""
    states = identified().runs_
    left, unseen = [], []
    rng = np.random.default_rng(0)
    for run in states:
        q = run.q[run.rows]
        left.append(np.abs(q) - np.abs(q).mean() + 0.1 * rng.normal(size=q.shape))
    for out in range(2):
        there = [
            part if carries_over else part + 2 * np.cos(5.0 * run.dq[run.rows]) * (-1) ** (k == out)
            for k, (part, run) in enumerate(zip(left, states, strict=True))
        ]
        unseen.append(there)
    third = ResidualCompensator(inputs="joint_state", method="rbf").fit(states, left, unseen=unseen)
    assert third.kept[ELBOW:].tolist() == [kept] * 2
