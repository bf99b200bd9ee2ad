"""Two effects of a joint that hide each other are found together; what passes alone, or is not there, is no pair."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, found_in, measured, names

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hidden import _may_hide, hidden
from dynid_rs.diagnosis.search import forward
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.trials import Asked, evidence

HYSTERESIS, UNDER_LOAD = ("friction_hysteresis", (1,)), ("load_dependent_friction", (1,))


def believed(*wishes, n_runs=2):
    return Belief.in_declared(Setup(ROBOT), measured(*wishes, n_runs=n_runs))


def pair_of(belief, *never):
    """What `hidden` finds of everything but some places, asked beside what is believed."""
    open_ = [h for h in belief.hypotheses() if h.place not in never]
    log_places = np.log(belief.n_sought(open_))
    return hidden(belief, Asked(*evidence(belief.beside, open_), log_places))


def test_two_frictions_of_a_joint_look_like_a_third_one_at_a_time_and_like_themselves_together():
    belief = believed("friction_hysteresis:elbow:2", "load_dependent_friction:elbow:2")
    assert [named.hypothesis.place for named in forward(belief)[0]] == [("load_hysteresis", (1,))]
    found = {named.hypothesis.place: named.log_odds for named in pair_of(belief)}
    assert set(found) == {HYSTERESIS, UNDER_LOAD}
    assert min(found.values()) > 20.0


def test_two_at_different_joints_are_no_pair():
    belief = believed()
    at = {(h.kind, h.joints): h for h in belief.catalogue.hypotheses()}
    elbow, wrist = at["friction_hysteresis", (1,)], at["load_dependent_friction", (2,)]
    assert _may_hide(elbow, at["load_dependent_friction", (1,)])
    assert not _may_hide(elbow, wrist)
    assert not _may_hide(elbow, elbow)
    shared, delay = at["coupled_friction", (1, 2)], replace(elbow, kind="torque_delay", joints=(0, 1, 2))
    assert _may_hide(elbow, shared)
    assert _may_hide(shared, wrist)
    assert not _may_hide(shared, at["coupled_friction", (0, 1)])
    assert not _may_hide(elbow, delay)
    assert not _may_hide(delay, shared)


def test_a_torque_that_two_joints_share_hides_one_of_either():
    """A coupled wrist and a spring on it had no name at all on a lone run: what each left was the other."""
    belief = believed("friction_hysteresis:wrist:0.8", "coupled_friction:wrist:0.1", n_runs=1)
    assert [named.hypothesis.place for named in forward(belief)[0]] == [("friction_hysteresis", (2,))]
    found = {named.hypothesis.place: named.log_odds for named in pair_of(belief)}
    assert set(found) == {("friction_hysteresis", (2,)), ("coupled_friction", (1, 2))}
    assert min(found.values()) > 20.0


def test_two_that_stand_in_for_what_has_no_name_are_no_pair(monkeypatch):
    """Beside a function that tells all that the two do, neither is likely."""
    belief = believed("friction_hysteresis:elbow:2", "load_dependent_friction:elbow:2")
    both = [
        belief.catalogue.of([s])[0] for s in belief.catalogue.grid if (s.kind, s.joints) in (HYSTERESIS, UNDER_LOAD)
    ]
    torque = {1: np.concatenate([h.columns[1] for h in both], axis=1)}
    monkeypatch.setattr("dynid_rs.diagnosis.hidden.lacks", lambda *_: SimpleNamespace(columns=torque))
    assert pair_of(belief) == []


def test_a_diagnosis_names_both():
    runs = measured("friction_hysteresis:elbow:2", "load_dependent_friction:elbow:2")
    assert names(found_in(runs)) == {(kind, ("elbow",)) for kind, _ in (HYSTERESIS, UNDER_LOAD)}


def test_names_that_were_refused_are_in_no_pair():
    belief = believed("friction_hysteresis:elbow:2", "load_dependent_friction:elbow:2")
    assert HYSTERESIS not in {named.hypothesis.place for named in pair_of(belief, HYSTERESIS)}


@pytest.mark.parametrize(
    "wishes", [(), ("friction_hysteresis:elbow:2",), ("friction_hysteresis:elbow:2", "joint_spring:wrist:2")]
)
def test_what_is_alone_on_its_joint_is_no_pair(wishes):
    assert pair_of(believed(*wishes)) == []
