"""Two effects of a joint that hide each other are found together; what passes alone, or is not there, is no pair."""

from __future__ import annotations

import pytest
from helpers.diagnosed import ROBOT, found_in, measured, names

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hidden import hidden
from dynid_rs.diagnosis.search import forward
from dynid_rs.diagnosis.setup import Setup

HYSTERESIS, UNDER_LOAD = ("friction_hysteresis", (1,)), ("load_dependent_friction", (1,))


def believed(*wishes):
    return Belief.in_declared(Setup(ROBOT), measured(*wishes, n_runs=2))


def test_two_frictions_of_a_joint_look_like_a_third_one_at_a_time_and_like_themselves_together():
    belief = believed("friction_hysteresis:elbow:2", "load_dependent_friction:elbow:2")
    assert {HYSTERESIS, UNDER_LOAD}.isdisjoint(named.hypothesis.place for named in forward(belief))
    found = {named.hypothesis.place: named.log_odds for named in hidden(belief)}
    assert set(found) == {HYSTERESIS, UNDER_LOAD}
    assert min(found.values()) > 20.0


def test_a_diagnosis_names_both():
    runs = measured("friction_hysteresis:elbow:2", "load_dependent_friction:elbow:2")
    assert names(found_in(runs)) == {(kind, ("elbow",)) for kind, _ in (HYSTERESIS, UNDER_LOAD)}


def test_names_that_were_refused_are_in_no_pair():
    belief = believed("friction_hysteresis:elbow:2", "load_dependent_friction:elbow:2")
    assert HYSTERESIS not in {named.hypothesis.place for named in hidden(belief, {HYSTERESIS})}


@pytest.mark.parametrize(
    "wishes", [(), ("friction_hysteresis:elbow:2",), ("friction_hysteresis:elbow:2", "joint_spring:wrist:2")]
)
def test_what_is_alone_on_its_joint_is_no_pair(wishes):
    assert hidden(believed(*wishes)) == []
