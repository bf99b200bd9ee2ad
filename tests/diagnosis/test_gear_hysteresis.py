"""Torque that elastic gears lose: fitted along the load, sought where two encoders show that they yield."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hypotheses import Catalogue
from dynid_rs.model.placed import PlacedEffect
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm

N = 6
CLEAN = 0.25
"""What white noise of the torque leaves in the band, as a part of it: 0.2 and what three short runs scatter."""


@pytest.fixture(scope="module")
def elastic():
    """Arm with elastic gears that turn unevenly, and three runs of it."""
    robot = _core.RobotModel.from_urdf(str(bundled_robot()))
    typical = typical_arm(robot)
    arm = equip(replace(typical.rigid(), delay=0.0), build_effects([parse_wish("joint_elasticity")], typical))
    return robot, arm, simulate(arm, n_runs=3, duration=20, rate=250, seed=0).recordings


@pytest.fixture(scope="module")
def plain(elastic):
    robot, _, runs = elastic
    return dyn.ThreeLoopIdentifier(robot, residual=None).fit(runs)


def wind_up_load(arm):
    """Load [N m] over which the simulated teeth turn round: their way times the stiffness."""
    return arm.hysteresis_distance * arm.stiffness


def placed(arm):
    return [
        PlacedEffect.at("gear_hysteresis", j, hysteresis_load=wind_up_load(arm)[j], carried_load=arm.hysteresis[j])
        for j in range(N)
    ]


def lost(fit):
    """Fitted size of the hysteresis (n_joints,) [N m]."""
    ((_, coefficients),) = [term for term in fit.model_.effects if term[0].kind == "gear_hysteresis"]
    return coefficients[:, 0]


def test_the_loss_of_the_gear_is_found_along_its_load(elastic, plain):
    """The teeth's way is the load's over the stiffness, less what the teeth carry themselves."""
    robot, arm, runs = elastic
    fit = dyn.ThreeLoopIdentifier(robot, residual=None, effects=placed(arm)).fit(runs)
    assert (plain.links_.noise_std_ > 4 * CLEAN * arm.noise_std).all()
    assert (fit.links_.noise_std_ < 0.5 * plain.links_.noise_std_).all()
    assert (fit.links_.noise_std_ < 2 * CLEAN * arm.noise_std).all()
    assert_allclose(lost(fit), arm.hysteresis, rtol=0.2)


def test_one_encoder_is_enough_to_fit_it(elastic, plain):
    robot, arm, runs = elastic
    runs = [dyn.Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints) for r in runs]
    fit = dyn.ThreeLoopIdentifier(robot, residual=None, effects=placed(arm)).fit(runs)
    assert (fit.links_.noise_std_ < 0.5 * plain.links_.noise_std_).all()
    assert_allclose(lost(fit), arm.hysteresis, rtol=0.2)
    assert not [shaped for shaped in Catalogue(fit).grid if shaped.kind == "gear_hysteresis"]


def test_the_search_tries_it_where_gears_bend(elastic, plain):
    _, arm, _ = elastic
    catalogue = Catalogue(plain)
    tried = [h for h in catalogue.hypotheses() if h.kind == "gear_hysteresis"]
    assert sorted({h.joints for h in tried}) == [(j,) for j in range(N)]
    scores = Beside.of(plain).screened(tried)
    for j in range(N):
        own = [(score.value, h) for score, h in zip(scores, tried, strict=True) if h.joints == (j,)]
        value, best = max(own, key=lambda pair: pair[0])
        assert value > 0
        assert 1 / 4 < dict(best.shape)["hysteresis_load"] / wind_up_load(arm)[j] < 4


def test_a_joint_whose_encoders_say_the_same_is_not_asked(elastic):
    robot, _, runs = elastic
    same = [replace(run, q_motor=np.where(np.arange(N) == 2, run.q, run.q_motor)) for run in runs]
    fit = dyn.ThreeLoopIdentifier(robot, residual=None).fit(same)
    asked = {shaped.joints for shaped in Catalogue(fit).grid if shaped.kind == "gear_hysteresis"}
    assert asked == {(j,) for j in range(N) if j != 2}
