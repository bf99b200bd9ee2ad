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
