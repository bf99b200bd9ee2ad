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
from dynid_rs.diagnosis.signs import with_signs

ELBOW, WRIST = 1, 2
STAGE = (("partner", float(WRIST)), ("ratio", 0.5), ("transition_width", 0.02))
SHARED = Shaped("coupled_friction", (ELBOW, WRIST), STAGE).placed()


def believed(effect):
    return Belief.in_declared(Setup(ROBOT, effects=(effect,)), measured("stribeck:elbow"))


@pytest.mark.parametrize(
    ("sizes", "silent"), [((0.3, 0.1), ()), ((-3.0, 0.1), (ELBOW,)), ((0.3, -1e-6), (WRIST,)), ((-3.0, -0.1), ())]
)
def test_a_joint_whose_size_has_the_wrong_sign_is_silent_unless_none_is_left(sizes, silent):
    belief = believed(SHARED)
    (places,) = belief.places()
    own = [place for _, place in places]
    belief.fit.links_.x_[own] = np.array([sizes[0], -0.01, sizes[1], -0.01])  # viscous parts may be anything
    (effect,) = with_signs(belief).effects
    assert effect == replace(SHARED, silent=silent)


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


def test_laws_of_one_joint_are_as_they_were():
    alone = Shaped("stribeck", (ELBOW,), (("stribeck_velocity", 0.1), ("exponent", 2.0), ("transition_width", 0.02)))
    belief = believed(alone.placed())
    belief.fit.links_.x_[[place for _, place in belief.places()[0]]] = -1.0
    assert with_signs(belief).effects == belief.setup.effects
