"""Steps of the search that have nothing to do leave what is believed as it is, and fit nothing anew."""

from types import SimpleNamespace

import pytest
from helpers.diagnosed import ROBOT, measured

from dynid_rs.diagnosis import search
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.search import merge
from dynid_rs.diagnosis.setup import Setup


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
    monkeypatch.setattr(search, "share_a_clock", lambda _: None)
    monkeypatch.setattr(search, "accept", lambda _, found, *__, **___: belief.named.extend(found) or found)
    search.name(belief, lambda _: None)
    assert belief.named == [right]
