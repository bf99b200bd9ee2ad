"""What a torque may be instead, once all names are in: another kind, or a function of its angle without a name."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, entry_of, found_in, names, recorded, rigid, with_effects
from helpers.nameless import Nameless
from helpers.small_arm import URDF
from scipy.special import logsumexp

from dynid_rs import RobotModel
from dynid_rs.base.wording import kinds_said
from dynid_rs.diagnosis import rivals as rivals_module
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.rivals import Contest, is_one_cause, settle_rivals, valued, weigh_rivals
from dynid_rs.diagnosis.settling import settle
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.shapes import polished
from dynid_rs.diagnosis.waves import SIZES
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


SPRING, CYLINDER = ("joint_spring", (1,)), ("counterbalance", (1,))


def believed(true, wrong):
    """An arm with one torque on the elbow that is believed to be another kind."""
    belief = Belief.in_declared(Setup(ROBOT), recorded(with_effects(rigid(), f"{true}:elbow:1"))[:2])
    shapes = belief.catalogue.of([s for s in belief.catalogue.grid if (s.kind, s.joints) == (wrong, (1,))])
    best = max(shapes, key=lambda h: belief.beside.screened([h])[0].value)
    belief.accept([Named(best, 40.0)])
    settle(belief)
    return belief


@pytest.mark.parametrize("wrong", ["joint_spring", "torque_ripple"])
def test_a_kind_that_is_likelier_takes_the_place_of_a_name(wrong):
    """What came first was the likeliest beside fewer names. The newcomer's shape settles beside everything."""
    belief = believed("counterbalance", wrong)
    before = belief.left[1]
    contests = settle_rivals(belief)
    assert list(belief.named) == list(contests) == [CYLINDER]
    assert belief.named[CYLINDER].log_odds > 40.0
    assert belief.named[CYLINDER].ties == ()
    after = belief.left[1]
    assert after < 0.85 * before
    settle(belief)
    assert belief.left[1] == pytest.approx(after, rel=0.01)


def test_a_kind_that_does_not_stay_the_likelier_one_goes_again(monkeypatch):
    belief = believed("counterbalance", SPRING[0])
    weigh, kept = rivals_module.weigh_rivals, belief.kept
    weighed = []

    def doubted(belief):
        contests = weigh(belief)
        weighed.append(list(contests))
        if CYLINDER in contests:
            own = contests[CYLINDER].own
            contests[CYLINDER].rivals[SPRING] = replace(own, value=own.value + 0.1)
        return contests

    monkeypatch.setattr(rivals_module, "weigh_rivals", doubted)
    settle_rivals(belief)
    assert weighed == [[SPRING], [CYLINDER], [SPRING]]
    assert list(belief.named) == [SPRING]
    assert belief.setup == kept.setup
    assert belief.fit is kept.fit


@pytest.mark.parametrize("spoiled", ["only", "helps"])
def test_what_is_not_asked_or_does_not_hold_takes_no_place(monkeypatch, spoiled):
    belief = believed("counterbalance", SPRING[0])
    if spoiled == "only":
        belief.only = frozenset(belief.named)
    else:
        monkeypatch.setattr(rivals_module, "helps", lambda *_: False)
    settle_rivals(belief)
    assert list(belief.named) == [SPRING]
    assert belief.named[SPRING].ties[0][0] == CYLINDER


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


@pytest.mark.parametrize(("true", "is_there"), [("friction_hysteresis", True), ("joint_spring", False)])
def test_a_shape_that_was_looked_for_has_the_price_of_its_step_of_the_grid(true, is_there):
    """Against the mean evidence of many shapes over all cells of the grid, each as likely beforehand."""
    arm = with_effects(rigid(), f"{true}:elbow:1")
    belief = Belief.in_declared(Setup(ROBOT), recorded(arm)[:2])
    beside, catalogue = belief.beside, belief.catalogue
    grid = [s for s in catalogue.grid if (s.kind, s.joints) == ("friction_hysteresis", (1,))]
    start = max(catalogue.of(grid), key=lambda h: beside.screened([h])[0].value)
    best = polished(beside, catalogue, start)
    ((name, _),) = best.shape

    def evidence(shape):
        (h,) = catalogue.of([shape])
        columns = beside.evidence_for(replace(h, sizes=SIZES))[1]
        return beside.with_columns(columns).best.evidence - beside.best.evidence

    values = np.log([dict(shaped.shape)[name] for shaped in grid])
    half = float(np.ptp(values)) / (len(grid) - 1) / 2
    even = np.exp(np.linspace(values.min() - half, values.max() + half, 120))
    around = [evidence(Shaped(best.kind, best.joints, ((name, x),))) for x in even.tolist()]
    averaged = float(logsumexp(around)) - np.log(len(even))
    found = valued(beside, catalogue, best).value
    price = found - evidence(Shaped(best.kind, best.joints, best.shape))
    assert found == pytest.approx(averaged, abs=1.0)  # shapes far away are no straight line
    assert (price < -1.5) == is_there  # what is not there is as good in any shape


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
