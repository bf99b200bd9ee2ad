"""Torque that elastic gears lose: fitted along the deflection that two encoders show, harmless where there is one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.kinds import Hypothesis, Kinds, bounds_of, stacked
from dynid_rs.placed import PlacedEffect
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm

N = 6
DISTANCE = 1e-4
"""Of the simulated gears [rad]."""
EFFECTS = [PlacedEffect.at("gear_hysteresis", j, hysteresis_distance=DISTANCE) for j in range(N)]
CLEAN = 0.25
"""What white noise of the torque leaves in the band, as a part of it: 0.2 and what three short runs scatter."""


def elastic(exact):
    """Arm with elastic gears, and three runs of it; `exact`: encoders that see the deflection and nothing else."""
    robot = _core.RobotModel.from_urdf(str(bundled_robot()))
    typical = typical_arm(robot)
    arm = equip(replace(typical.rigid(), delay=0.0), build_effects([parse_wish("joint_elasticity")], typical))
    arm = replace(arm, kinematic_error=np.zeros(N)) if exact else arm
    return robot, arm, simulate(arm, n_runs=3, duration=20, rate=250, seed=0).recordings


@pytest.fixture(scope="module")
def exact():
    return elastic(exact=True)


@pytest.fixture(scope="module")
def plain(exact):
    robot, _, runs = exact
    return dyn.ThreeLoopIdentifier(robot, residual=None).fit(runs)


@pytest.fixture(scope="module")
def one_encoder(exact):
    robot, _, runs = exact
    runs = [dyn.Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints) for r in runs]
    return dyn.ThreeLoopIdentifier(robot, residual=None, effects=EFFECTS).fit(runs)


def lost(fit):
    """Fitted size of the hysteresis (n_joints,) [N m]."""
    ((_, coefficients),) = [term for term in fit.model_.effects if term[0].kind == "gear_hysteresis"]
    return coefficients[:, 0]


def test_the_loss_of_the_gear_is_found_along_its_deflection(exact, plain):
    robot, arm, runs = exact
    fit = dyn.ThreeLoopIdentifier(robot, residual=None, effects=EFFECTS).fit(runs)
    assert (plain.links_.noise_std_ > 4 * CLEAN * arm.noise_std).all()
    assert (fit.links_.noise_std_ < CLEAN * arm.noise_std).all()
    assert_allclose(lost(fit), arm.hysteresis, rtol=0.03)


def test_a_gear_that_turns_unevenly_spoils_the_deflection_but_not_all():
    """20 microradians of kinematic error stand beside 100 of the hysteresis' way."""
    robot, arm, runs = elastic(exact=False)
    fit = dyn.ThreeLoopIdentifier(robot, residual=None, effects=EFFECTS).fit(runs)
    without = dyn.ThreeLoopIdentifier(robot, residual=None).fit(runs)
    assert (fit.links_.noise_std_ < 0.6 * without.links_.noise_std_).all()
    assert_allclose(lost(fit), arm.hysteresis, rtol=0.2)


def test_the_scan_tries_it_where_gears_bend(plain, one_encoder):
    kinds = Kinds(plain)
    grid = kinds.grid(["gear_hysteresis"])
    assert sorted({h.joints for h in grid}) == [(j,) for j in range(N)]
    beside = Beside(plain)
    for j in range(N):
        own = [h for h in grid if h.joints == (j,)]
        gains = [
            beside.gains(stacked(columns), [slice(0, 1)], [bounds_of(h)])[0].power
            for h, columns in zip(own, kinds.columns(own), strict=True)
        ]
        assert dict(own[int(np.argmax(gains))].shape)["hysteresis_distance"] == DISTANCE
    # A joint whose encoders say the same, and a run with one of them.
    states = kinds.runs
    stiff = [replace(run, q_motor=np.where(np.arange(N) == 2, run.q, run.q_motor)) for run in states]
    kinds.runs = stiff
    assert {h.joints for h in kinds.grid(["gear_hysteresis"])} == {(j,) for j in range(N) if j != 2}
    kinds.runs = [*states[1:], Kinds(one_encoder).runs[0]]
    assert kinds.grid(["gear_hysteresis"]) == []


def test_one_encoder_does_no_harm(one_encoder):
    assert_array_equal(lost(one_encoder), 0.0)
    assert np.isfinite(one_encoder.links_.noise_std_).all()
    kinds = Kinds(one_encoder)
    assert kinds.grid(["gear_hysteresis"]) == []
    # Who asks for its columns all the same gets no gain from them.
    hypothesis = Hypothesis("gear_hysteresis", (0,), (("hysteresis_distance", DISTANCE),))
    columns = kinds.once(hypothesis)
    assert_array_equal(columns[0], 0.0)
    (gain,) = Beside(one_encoder).gains(columns, [slice(0, 1)], [bounds_of(hypothesis)])
    assert (gain.power, gain.own, gain.coefficients.tolist()) == (0.0, 0.0, [0.0])
