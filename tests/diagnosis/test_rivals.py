"""What a torque may be instead, once all names are in: another kind, or a function of its angle without a name."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import entry_of, found_in, names, recorded, rigid, with_effects
from helpers.nameless import Nameless
from helpers.small_arm import URDF

from dynid_rs import RobotModel
from dynid_rs.base.wording import kinds_said
from dynid_rs.diagnosis import rivals as rivals_module
from dynid_rs.diagnosis.belief import Named
from dynid_rs.diagnosis.rivals import Contest, is_one_cause, settle_rivals, weigh_rivals
from dynid_rs.diagnosis.wording import named
from dynid_rs.simulation import equip


@pytest.mark.parametrize(("odds", "ties", "refuted"), [(-2.9, 1, 0), (-3.0, 0, 1), (5.0, 1, 0)])
def test_a_rival_is_a_tie_up_to_odds_of_nineteen_to_one(monkeypatch, odds, ties, refuted):
    """Kinds that are no better than none are neither."""
    place, other = ("joint_spring", (1,)), ("counterbalance", (1,))

    def contest(belief, effect, columns):
        value = lambda x: SimpleNamespace(value=x)  # noqa: E731
        return Contest(None, value(50.0), {other: value(50.0 + odds), ("stribeck", (1,)): value(2.0)})

    monkeypatch.setattr(rivals_module, "contest", contest)
    belief = SimpleNamespace(
        setup=SimpleNamespace(effects=[SimpleNamespace(kind=place[0], joints=place[1])]),
        places=lambda: [[]],
        named={place: Named(None, 40.0)},
    )
    weigh_rivals(belief)
    assert (len(belief.named[place].ties), len(belief.named[place].refuted)) == (ties, refuted)


class Contested:
    """A belief in one torque; `values` of each kind depend on which of them is believed."""

    def __init__(self, values):
        self.values, self.kind, self.merged = values, "counterbalance", []
        self.named = {("counterbalance", (1,)): Named(None, 40.0)}

    def contests(self, _):
        value = {kind: SimpleNamespace(value=x, hypothesis=kind) for kind, x in self.values[self.kind].items()}
        rivals = {(kind, (1,)): value[kind] for kind in value if kind != self.kind}
        return {(self.kind, (1,)): Contest(None, value[self.kind], rivals)}

    def merge(self, places, hypothesis, log_odds):
        self.kind = hypothesis
        self.named = {(hypothesis, (1,)): Named(None, log_odds)}
        self.merged.append((hypothesis, log_odds))


@pytest.mark.parametrize(
    ("in_the_end", "merged"),
    [
        pytest.param({"counterbalance": 49.0, "joint_spring": 50.0}, [("joint_spring", 42.0)], id="it stays"),
        pytest.param({"counterbalance": 51.0, "joint_spring": 50.0}, [("joint_spring", 42.0)], id="no turns are taken"),
        pytest.param(
            {"counterbalance": 51.0, "joint_spring": 50.0, "stribeck": 50.5},
            [("joint_spring", 42.0), ("stribeck", 42.5)],
            id="a third one",
        ),
    ],
)
def test_the_likelier_of_two_kinds_is_believed(monkeypatch, in_the_end, merged):
    """What came first was the likeliest beside fewer names; nothing that was given up comes back."""
    belief = Contested(
        {kind: in_the_end for kind in in_the_end} | {"counterbalance": {"counterbalance": 48.0, "joint_spring": 50.0}}
    )
    monkeypatch.setattr(rivals_module, "weigh_rivals", belief.contests)
    settle_rivals(belief)
    assert belief.merged == merged


def test_of_places_that_no_motion_tells_the_first_is_kept(monkeypatch):
    belief = Contested({"counterbalance": {"counterbalance": 48.0, "joint_spring": 50.0}})
    belief.named = {("counterbalance", (1,)): Named(None, 40.0, same=(("joint_spring", (1,)),))}
    monkeypatch.setattr(rivals_module, "weigh_rivals", belief.contests)
    settle_rivals(belief)
    assert belief.merged == []


def test_a_spring_is_told_from_a_cylinder_where_its_line_shows():
    found = found_in(recorded(with_effects(rigid(), "joint_spring:wrist:1")))
    entry = entry_of(found, "joint_spring")
    assert entry["ties"] == []
    assert "counterbalance" in {other["kind"] for other in entry["told_apart_from"]}


def test_a_spring_along_a_short_way_may_be_a_cylinder():
    """Some cylinder pulls as evenly over a few degrees; the torque is kept, and what may be its cause is said."""
    arm = with_effects(rigid(), "joint_spring:elbow:0.3")
    (entry,) = found_in(recorded(arm)).entries
    assert set(kinds_said(entry)) == {"joint_spring", "counterbalance"}
    assert (entry["kind"], entry["joints"]) == ("unknown", ["elbow"])
    assert named(entry, ("shoulder", "elbow", "wrist")) in (
        "joint spring or counterbalance on elbow",
        "counterbalance or joint spring on elbow",
    )


def test_a_coupling_behind_parallel_axes_has_two_places_that_no_motion_tells():
    """With more inertia in link and rotor, that of axes 2 and 3 of three parallel ones is that of 1 and 3.

    Inertials of the file would tell which, where they are believed.
    """
    planar = URDF.replace('axis xyz="0 0 1"', 'axis xyz="0 1 0"')
    bare = RobotModel.from_urdf_string(re.sub("<inertial>.*?</inertial>", "", planar, flags=re.S))
    arm = rigid(RobotModel.from_urdf_string(planar))
    pair = ((1, 2), (2, 1))
    effects = [
        Nameless("nameless", (j,), 1.0, torque=lambda signals, other=other: 0.05 * signals.ddq[:, other])
        for j, other in pair
    ]
    found = found_in(recorded(equip(arm, effects)), bare)
    (entry,) = (entry for entry in found.entries if entry.get("told_as") == "inertial_coupling")
    (tie,) = entry["ties"]
    assert {tuple(entry["joints"]), tuple(tie["joints"])} == {("elbow", "wrist"), ("shoulder", "wrist")}
    assert (entry["kind"], tie["kind"], tie["same_torque"]) == ("unknown", "inertial_coupling", True)
    (effect,) = (effect for effect in found.effects if effect.kinds == ("inertial_coupling",))
    assert not effect.ties[0].separate
    assert not [q for q in found.asked.questions if q.second.candidates]


def test_a_kind_and_what_it_becomes_without_a_length_are_one_cause():
    assert is_one_cause("load_dependent_friction", "load_hysteresis")
    assert is_one_cause("load_hysteresis", "load_dependent_friction")
    assert not is_one_cause("load_hysteresis", "friction_hysteresis")


def test_a_side_effect_of_the_wrong_sign_does_not_refute_what_is_clearly_there():
    """A sign that turns round otherwise than declared leaves a little of the viscous part below zero."""
    arm = rigid()

    def shared(sign):
        def torque(signals):
            v = signals.dq[:, 1] - signals.dq[:, 2]
            size = 4 * min(arm.noise_std[1], arm.noise_std[2])
            return sign * (size * np.tanh(v / 0.05) - 0.15 * size * v)

        return torque

    effects = [Nameless("nameless", (j,), 1.0, torque=shared(sign)) for j, sign in ((1, 1.0), (2, -1.0))]
    assert ("coupled_friction", ("elbow", "wrist")) in names(found_in(recorded(equip(arm, effects))))
