"""Steps of the search that have nothing to do leave what is believed as it is, and fit nothing anew."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis import search
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.search import merge
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.trials import Asked, evidence


def test_where_nothing_is_named_nothing_is_put_in_its_place():
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=2))
    fit = belief.fit
    assert merge(belief) is False
    assert belief.fit is fit


@pytest.mark.parametrize(("falls", "goes_on"), [(set(), False), ({("joint_spring", (0,))}, True)])
def test_a_second_look_that_finds_nothing_changes_nothing(monkeypatch, falls, goes_on):
    """Unless a name became unlikely, beside what was held in between."""
    done = []
    for step in ("name", "settle", "sized", "harmless"):
        monkeypatch.setattr(search, step, lambda *_, step=step: done.append(step))
    monkeypatch.setattr(search, "backward", lambda *_: falls)
    monkeypatch.setattr(search, "merge", lambda _: False)
    search.look(SimpleNamespace(named={("joint_spring", (0,)): None}), print, once_more=True)
    assert done == (["name", "settle", "sized", "harmless"] if goes_on else ["name"])


def test_a_name_that_goes_again_leaves_its_place_to_another(monkeypatch):
    """The likeliest kind alone, and unlikely once everything was fitted again: the next likeliest is asked."""
    wrong, right = [SimpleNamespace(hypothesis=SimpleNamespace(place=(kind, (0,)))) for kind in ("wrong", "right")]
    belief = SimpleNamespace(named=[])

    def forward(_, refused):
        left = [n for n in (wrong, right) if n.hypothesis.place not in refused and n not in belief.named]
        return left[:1], None

    def backward(_):
        gone = [n for n in belief.named if n is wrong]
        belief.named = [n for n in belief.named if n is right]
        return {n.hypothesis.place for n in gone}

    monkeypatch.setattr(search, "forward", forward)
    monkeypatch.setattr(search, "backward", backward)
    monkeypatch.setattr(search, "hidden", lambda *_: [])
    monkeypatch.setattr(search, "on_trial", lambda *_: False)
    monkeypatch.setattr(search, "share_a_clock", lambda _: None)
    monkeypatch.setattr(search, "accept", lambda _, found, *__, **___: belief.named.extend(found) or found)
    search.name(belief, lambda _: None)
    assert belief.named == [right]


SATURATED, STAND_IN = ("torque_saturation", (1,)), ("load_hysteresis", (1,))


@pytest.fixture
def saturated():
    """A lone run of an elbow whose torque is cut off, and what was asked beside the declared model."""
    belief = Belief.in_declared(Setup(ROBOT), measured("torque_saturation:elbow:8", duration=6.0, n_runs=1))
    open_ = belief.hypotheses()
    return belief, Asked(*evidence(belief.beside, open_), np.log(belief.n_sought(open_)))


def test_a_name_on_trial_is_asked_beside_the_fit_with_it(saturated):
    """A fit that lacks it has lost what its columns are made of."""
    belief, asked = saturated
    assert search.on_trial(belief, asked, set())
    assert set(belief.named) == {SATURATED}
    assert belief.named[SATURATED].log_odds > asked.values[SATURATED].value - asked.log_places + SURE


def test_what_does_not_pass_its_trial_leaves_everything_as_it_was(saturated):
    belief, asked = saturated
    fit, refused = belief.fit, set()
    asked.values.pop(SATURATED)
    assert not search.on_trial(belief, asked, refused)
    assert refused == {STAND_IN}
    assert belief.fit is fit
    assert (belief.named, belief.setup.effects, belief.steps) == ({}, (), [])


def test_what_is_not_likely_alone_has_no_trial(saturated, monkeypatch):
    belief, asked = saturated
    unlikely = {place: replace(value, value=min(value.value, SURE)) for place, value in asked.values.items()}
    monkeypatch.setattr(belief, "accept", None)
    assert not search.on_trial(belief, replace(asked, values=unlikely), set())
    assert belief.named == {}
