"""Sizes that have a sign keep it in the fit that is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.estimates import estimates
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.signs import beyond_bounds
from dynid_rs.diagnosis.weighing import last_fit, weighed_again

ELBOW, WRIST = 1, 2
STAGE = (("partner", float(WRIST)), ("ratio", 0.5), ("transition_width", 0.02))
SHARED = Shaped("coupled_friction", (ELBOW, WRIST), STAGE).placed()


def believed(effect):
    return Belief.in_declared(Setup(ROBOT, effects=(effect,)), measured("stribeck:elbow"))


@pytest.mark.parametrize(
    ("sizes", "beyond"),
    [
        ((0.3, 0.01, 0.1, 0.0), []),
        ((-3.0, 0.01, 0.1, 0.01), [0]),
        ((0.3, -0.01, -1e-6, 0.01), [1, 2]),
        ((-3.0, -0.01, -0.1, 0.0), []),  # nothing would be left of it
    ],
)
def test_sizes_of_a_sign_that_physics_does_not_allow(sizes, beyond):
    places = [(ELBOW, 4), (ELBOW, 5), (WRIST, 7), (WRIST, 8)]
    x = np.full(9, -1.0)
    x[[at for _, at in places]] = sizes
    assert beyond_bounds([SHARED], [places], x) == {places[k][1] for k in beyond}


def test_a_size_that_may_have_either_sign_has_none_to_keep():
    ripple = Shaped("torque_ripple", (ELBOW,), (("cycles", 3.0),)).placed()
    places = [(ELBOW, at) for at in range(4)]
    assert beyond_bounds([ripple], [places], np.array([-1.0, 2.0, -3.0, 0.1])) == set()


def test_laws_of_one_joint_are_as_they_were():
    peak = Shaped("stribeck", (ELBOW,), (("stribeck_velocity", 0.1), ("exponent", 2.0), ("transition_width", 0.02)))
    assert beyond_bounds([peak.placed()], [[(ELBOW, 0), (ELBOW, 1)]], np.array([1.0, -1.0])) == set()


def test_the_last_fit_is_within_the_bounds():
    """A stage of another ratio than the true one would drive the wrist: the least error that drives none is told."""
    belief = Belief.in_declared(Setup(ROBOT), measured("coupled_friction:elbow"))
    geared = Shaped("coupled_friction", (ELBOW, WRIST), (*STAGE[:1], ("ratio", -1.0), *STAGE[2:]))
    belief.setup = replace(belief.setup, effects=(geared.placed(),))
    belief.refit()
    (places,) = belief.places()
    own = [at for _, at in places]
    free = weighed_again(belief.first, belief.fit, belief.setup, belief.train).links_.x_
    assert np.any(free[own] < 0)
    assert np.any(free[own] > 0)
    x = last_fit(belief, set()).links_.x_
    assert np.all(x[own] >= 0)
    assert np.any(x[own] == 0)
    assert np.any(x[own] > 0)
    nameless = last_fit(belief, {("coupled_friction", (ELBOW, WRIST))}).links_.x_
    assert np.all(nameless[own] >= 0)


def test_a_silent_joint_has_nothing_of_the_effect_and_says_so():
    silent = believed(replace(SHARED, silent=(ELBOW,)))
    (places,) = silent.places()
    sizes = {joint: silent.fit.links_.x_[[place for j, place in places if j == joint]] for joint in (ELBOW, WRIST)}
    assert np.all(sizes[ELBOW] == 0)
    assert np.all(sizes[WRIST] != 0)
    silent.named = {("coupled_friction", (ELBOW, WRIST)): None}
    known = estimates(silent)["coupled_friction", (ELBOW, WRIST)]
    assert [(one.value, one.interval) for one in known if one.joint == ELBOW and one.unit != "1"] == [(0.0, None)] * 2
    assert all(one.interval is not None for one in known if one.joint == WRIST)
    assert [one.name for one in known if one.joint is None] == ["ratio"]  # of the stage, which turns with both
