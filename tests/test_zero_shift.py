"""The torque channel's zero from run to run, and rows at standstill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dynid_rs as dyn
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.zero_shift import zero_shifts
from dynid_rs.preprocessing import Band, prepare
from dynid_rs.simulation import bundled_robot, simulate, typical_arm


@pytest.fixture(scope="module")
def arm():
    return replace(typical_arm(dyn.RobotModel.from_urdf(bundled_robot())).rigid(), delay=0.0)


@pytest.fixture(scope="module")
def runs(arm):
    recordings = simulate(arm, n_runs=3, duration=15.0, rate=250.0, seed=0).recordings
    return [dyn.Recording(run.t, run.q, tau=run.tau, name=run.name, joints=run.joints) for run in recordings]


def fitted(setup, runs):
    return setup.identifier(residual=None).fit([setup.corrected(run) for run in runs])


def test_runs_with_one_zero_keep_it(arm, runs):
    setup = Setup(arm.robot)
    same, findings = zero_shifts(fitted(setup, runs), setup)
    assert same is setup
    assert findings == []


def test_zeros_that_differ_are_found_and_taken_off(arm, runs):
    put = np.array([0.0, 3.0, -1.5]) * arm.noise_std[2]
    shifted = [replace(run, tau=run.tau + zero * (np.arange(6) == 2)) for run, zero in zip(runs, put, strict=True)]
    setup = Setup(arm.robot)
    better, findings = zero_shifts(fitted(setup, shifted), setup)
    assert [finding.code for finding in findings] == ["torque_zero"]
    assert findings[0].column == "tau_2"
    zeros = np.array([better.torque_zero[run.name] for run in shifted])
    np.testing.assert_allclose(zeros[:, 2], put - put.mean(), atol=0.15 * arm.noise_std[2])
    assert not zeros[:, [0, 1, 3, 4, 5]].any()
    again, more = zero_shifts(fitted(better, shifted), better)
    assert more == []
    assert again is better


def test_a_run_that_was_not_fitted_keeps_its_zero(arm, runs):
    setup = replace(Setup(arm.robot), torque_zero={"another": np.ones(6)})
    assert setup.corrected(runs[0]) is runs[0]


def test_pauses_are_rows_only_on_request(runs):
    run = runs[0]
    halt = run.n_samples // 2
    q = np.concatenate([run.q[:halt], np.repeat(run.q[halt : halt + 1], 500, axis=0), run.q[halt:]])
    tau = np.concatenate([run.tau[:halt], np.repeat(run.tau[halt : halt + 1], 500, axis=0), run.tau[halt:]])
    paused = dyn.Recording(np.arange(len(q)) / 250.0, q, tau=tau)
    without, with_pause = (prepare(paused, Band(5.0), 250.0, standstill=standstill) for standstill in (False, True))
    assert np.sum(~without.moving) - np.sum(~with_pause.moving) >= 500
    assert not without.moving[halt + 100 : halt + 400].any()
    assert with_pause.moving[halt + 100 : halt + 400].all()
