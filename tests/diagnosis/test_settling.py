"""Shapes that settle together, changes of structure that are taken back, gains that are asked again."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured, rigid, with_effects

from dynid_rs.diagnosis import standing
from dynid_rs.diagnosis.belief import Belief, Named, following
from dynid_rs.diagnosis.search import accept
from dynid_rs.diagnosis.settling import _moved, settle
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped, is_valid
from dynid_rs.diagnosis.slopes import effect_slopes, friction_slopes
from dynid_rs.diagnosis.standing import backward
from dynid_rs.diagnosis.structural.encoder_eccentricity import added
from dynid_rs.identification.smooth_friction import in_reach, sign_shape, tanh_widths

ELBOW, WRIST = 1, 2
FAR = 0.05
"""An encoder's error [rad] that none of the runs has."""


def test_a_peak_of_friction_settles_with_the_sign_that_it_turns_round_with():
    """From a velocity half as large again and a wider sign, along a valley that neither leads along alone."""
    wish = "stribeck:elbow:4"
    (effect,) = with_effects(rigid(), wish).effects
    truth = {value.name: value.value[0] for value in effect.values}
    runs = measured(wish)
    belief = Belief.in_declared(Setup(ROBOT), runs)
    width = 1.5 * tanh_widths(belief.fit.observations_.plan.friction[0])[ELBOW]
    far = (("stribeck_velocity", 1.5 * truth["stribeck_velocity"]), ("exponent", 2.0), ("transition_width", width))
    far = (*far, ("sharpness", 0.0))
    belief = Belief.in_declared(Setup(ROBOT, effects=(Shaped("stribeck", (ELBOW,), far).placed(),)), runs)
    before = belief.kept
    settle(belief)
    assert belief.is_likelier_than(before)
    shape = belief.setup.effects[0].shape_at(ELBOW)
    assert shape["stribeck_velocity"] == pytest.approx(truth["stribeck_velocity"], rel=0.15)
    noise = rigid().noise_std[ELBOW]
    assert belief.left[ELBOW] < 1.2 * noise


def test_a_step_moves_every_shape_and_none_out_of_its_range():
    sign = (("transition_width", 0.02), ("sharpness", 2.0))
    peak = (("stribeck_velocity", 0.1), ("exponent", 2.0), *sign)
    stage = (("partner", float(WRIST)), ("ratio", 0.5), *sign)
    effects = (
        Shaped("stribeck", (ELBOW,), peak).placed(),
        Shaped("coupled_friction", (ELBOW, WRIST), stage).placed(),
    )
    belief = Belief.in_declared(Setup(ROBOT, effects=effects), measured("stribeck:elbow"))
    slopes = effect_slopes(belief)
    assert {slope.name for slope in slopes} >= {"stribeck_velocity", "ratio"}
    (peak, shared), _ = _moved(belief, slopes, np.full(len(slopes), 0.1))
    assert peak.shape_at(ELBOW)["stribeck_velocity"] == pytest.approx(0.1 * np.exp(0.1), rel=1e-12)
    assert shared.shape_at(ELBOW)["ratio"] == pytest.approx(0.6, rel=1e-12)
    (peak, _), _ = _moved(belief, slopes, np.full(len(slopes), 20.0))
    assert peak.shape_at(ELBOW)["stribeck_velocity"] == 0.1


def test_a_step_leads_to_no_ripple_that_does_not_return(monkeypatch):
    """Less than a cycle on the joint's way is any curve, and the likelier for it."""
    effects = (Shaped("torque_ripple", (ELBOW,), (("cycles", 7.0),)).placed(),)
    belief = Belief.in_declared(Setup(ROBOT, effects=effects), measured("stribeck:elbow"))
    slopes = [slope for slope in effect_slopes(belief) if slope.name == "cycles"]
    monkeypatch.setattr(belief.catalogue, "_turns", np.full(3, 0.15))
    (ripple,), _ = _moved(belief, slopes, np.array([-0.03]))
    assert ripple.shape_at(ELBOW)["cycles"] == pytest.approx(7.0 * np.exp(-0.03))
    (ripple,), _ = _moved(belief, slopes, np.array([-0.3]))
    assert ripple.shape_at(ELBOW)["cycles"] == 7.0


def test_a_change_of_structure_that_makes_the_data_less_probable_is_taken_back():
    belief = Belief.in_declared(Setup(ROBOT), measured())
    place = ("encoder_eccentricity", (ELBOW,))
    (h,) = (h for h in belief.hypotheses() if h.place == place)
    h = replace(h, accept=lambda setup, x: added(setup, ELBOW, np.array([FAR, 0.0])))
    before, refused = belief.kept, set()
    belief.refit = lambda friction=None: Belief.refit(_with(belief, FAR), friction)
    assert accept(belief, [Named(h, 10.0)], refused) == []
    assert refused == {place}
    assert belief.named == {}
    assert belief.setup is before.setup
    assert belief.steps == []


@pytest.mark.parametrize("together", [True, False])
def test_of_a_pair_both_are_believed_or_none(together):
    """Where the structure's half is refused the other stays alone only where it passed alone."""
    belief = Belief.in_declared(Setup(ROBOT), measured())
    at = {h.place: h for h in belief.hypotheses()}
    spring = at["joint_spring", (ELBOW,)]
    moved = replace(
        at["encoder_eccentricity", (ELBOW,)], accept=lambda setup, x: added(setup, ELBOW, np.array([FAR, 0.0]))
    )
    belief.is_likelier_than = lambda before: False
    found = accept(belief, [Named(moved, 10.0), Named(spring, 10.0)], set(), together=together)
    kept = set() if together else {spring.place}
    assert {named.hypothesis.place for named in found} == set(belief.named) == kept


def test_a_clock_that_is_wrong_is_no_likelier():
    late = replace(Setup(ROBOT), torque_delay=0.1)
    belief = Belief.in_declared(Setup(ROBOT), measured())
    declared = belief.kept
    belief.setup = late
    belief.refit()
    assert not belief.is_likelier_than(declared)
    wrong = belief.kept
    belief.restore(declared)
    assert belief.is_likelier_than(wrong)


def test_both_signs_of_friction_that_two_joints_share_turn_round_with_one_width():
    sign = (("transition_width", 0.02), ("sharpness", 2.0))
    shared = Shaped("coupled_friction", (ELBOW, WRIST), (("partner", float(WRIST)), ("ratio", 1.0), *sign))
    belief = Belief.in_declared(Setup(ROBOT, effects=(shared.placed(),)), measured("stribeck:elbow"))
    reached = {(slope.name, slope.joint): set(slope.columns) for slope in friction_slopes(belief)}
    assert reached["transition_width", ELBOW] == reached["sharpness", ELBOW] == {ELBOW, WRIST}
    assert reached["transition_width", WRIST] == {WRIST}


def test_every_effect_turns_round_with_its_joint_s_friction():
    belief = Belief.in_declared(Setup(ROBOT), measured("stribeck:elbow:4"))
    (h,) = [h for h in belief.catalogue.hypotheses() if h.place == ("position_dependent_friction", (ELBOW,))][:1]
    belief.setup = replace(belief.setup, effects=(Shaped(h.kind, h.joints, h.shape).placed(),))
    width, sharpness = np.array([0.01, 0.02, 0.03]), np.array([1.2, 1.5, 4.0])
    belief.reshape(belief.setup.effects, (width, sharpness))
    friction, shape = belief.fit.friction_, belief.setup.effects[0].shape_at(ELBOW)
    assert shape["transition_width"] == friction.transition_width_[ELBOW]
    assert shape["sharpness"] == friction.sharpness_[ELBOW]


def test_a_peak_of_friction_is_no_narrower_than_its_sign():
    """Not in the grid, not by a step, and not where friction's sign has become wider beside it."""
    belief = Belief.in_declared(Setup(ROBOT), measured("stribeck:elbow:4"))
    for h in belief.catalogue.hypotheses():
        if h.kind == "stribeck":
            assert dict(h.shape)["stribeck_velocity"] >= dict(h.shape)["transition_width"]
    sign = (("transition_width", 0.02), ("sharpness", 2.0))
    narrow = (("stribeck_velocity", 0.01), ("exponent", 2.0), *sign)
    assert not is_valid("stribeck", narrow)
    (followed,) = following([Shaped("stribeck", (ELBOW,), narrow).placed()], (np.full(3, 0.03), np.full(3, 1.5)))
    assert followed.shape_at(ELBOW)["stribeck_velocity"] == 0.03


def test_a_width_beyond_its_reach_stays_where_it_is_until_it_is_moved():
    runs = Belief.in_declared(Setup(ROBOT), measured()).fit.runs_
    width, sharpness = np.array([1e-6, 0.01, 9.0]), np.full(3, 2.5)
    kept, _ = in_reach((width, sharpness), (width, sharpness), runs)
    np.testing.assert_array_equal(kept, width)
    further, _ = in_reach((width * [0.5, 1.0, 2.0], sharpness), (width, sharpness), runs)
    np.testing.assert_array_equal(further, width)


def _with(belief: Belief, error: float) -> Belief:
    """The belief with an encoder's error that no step takes back."""
    belief.named = {}
    belief.setup = added(belief.setup, ELBOW, np.array([error, 0.0]) - belief.setup.encoder_error[ELBOW])
    return belief


def test_a_gain_that_has_become_none_goes():
    belief = Belief.in_declared(Setup(ROBOT), measured())
    (h,) = (h for h in belief.hypotheses() if h.place == ("torque_gain", (ELBOW,)))
    belief.accept([Named(h, 10.0)])
    assert belief.setup.gain_joints == (ELBOW,)
    assert backward(belief) == {h.place}
    assert belief.setup.gain_joints == ()


def test_a_gain_that_is_one_stays():
    belief = Belief.in_declared(Setup(ROBOT), measured("torque_gain:elbow"))
    (h,) = (h for h in belief.hypotheses() if h.place == ("torque_gain", (ELBOW,)))
    belief.accept([Named(h, 10.0)])
    assert backward(belief) == set()


def test_another_shape_of_the_grid_may_be_the_best_beside_all_others():
    """A shape that was right before other names came is only polished nearby; three cycles are not near one."""
    wish = "position_dependent_friction:elbow:5"
    (effect,) = with_effects(rigid(), wish).effects
    truth = {value.name: value.value[0] for value in effect.values}
    runs = measured(wish)
    fit = Belief.in_declared(Setup(ROBOT), runs).fit
    width, sharpness = (float(shape[ELBOW]) for shape in sign_shape(fit.observations_.plan.friction[0]))
    other = 1.0 if truth["cycles"] > 1.5 else 3.0
    shape = (("cycles", other), ("transition_width", width), ("sharpness", sharpness))
    wrong = Shaped("position_dependent_friction", (ELBOW,), shape)
    belief = Belief.in_declared(Setup(ROBOT, effects=(wrong.placed(),)), runs)
    settle(belief)
    assert belief.setup.effects[0].shape_at(ELBOW)["cycles"] == pytest.approx(truth["cycles"], rel=0.05)


@pytest.mark.parametrize(("gain", "spread"), [(1.09, 0.02), (0.97, 0.05)])
def test_a_gain_s_factor_is_the_density_at_none_before_over_that_after(monkeypatch, gain, spread):
    """Dickey 1971: of a model that holds another the Bayes factor is that of its prior and posterior at the other."""
    from scipy.stats import norm

    monkeypatch.setattr(standing, "gain_spread", lambda fit, j, std: spread)
    links = SimpleNamespace(torque_scale_=np.array([1.0, gain, 1.0]))
    named = [("torque_gain", (ELBOW,)), ("stribeck", (WRIST,))]
    belief = SimpleNamespace(fit=SimpleNamespace(links_=links), named=named)
    beside = SimpleNamespace(best=SimpleNamespace(covariance=np.eye(2)))
    expected = norm.logpdf(0.0, 0.0, standing.USUAL[0]) - norm.logpdf(0.0, np.log(gain), spread)
    assert standing._gains(belief, beside) == {("torque_gain", (ELBOW,)): pytest.approx(expected, rel=1e-12)}
