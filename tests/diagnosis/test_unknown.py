"""Effects outside the catalogue: no wrong name, no harm, and what is left is told with its signals."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, errors, found_in, measured, names, recorded, rigid, with_effects
from helpers.nameless import Nameless

from dynid_rs.base.wording import kinds_said
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.entries import effect_entries
from dynid_rs.diagnosis.misfit import _parts_of, ended
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.unexplained import stood_in
from dynid_rs.diagnosis.waves import of_signal
from dynid_rs.model.placed import PlacedEffect
from dynid_rs.simulation import equip

WIDTH = 0.02
OUTSIDE = {
    "direction and another position": (1, lambda s: np.tanh(s.dq[:, 1] / WIDTH) * np.sin(2 * s.q[:, 0])),
    "two positions": (2, lambda s: np.sin(3 * s.q[:, 2]) * np.sin(2 * s.q[:, 1])),
    "hose over two joints": (2, lambda s: np.sin(s.q[:, 1] + s.q[:, 2])),
    "brake that drags in a window": (
        1,
        lambda s: np.tanh(s.dq[:, 1] / WIDTH) * np.exp(-(((s.q[:, 1] - 0.3) / 0.2) ** 2)),
    ),
}
SIGNALS = {
    "direction and another position": {"dq_elbow", "q_shoulder"},
    "two positions": {"q_elbow", "q_wrist"},
}
NO_HARM = 1.02


def strange(name, size=1.5):
    """Runs of an arm with a torque of `size` times the noise that no catalogue has."""
    joint, torque = OUTSIDE[name]
    arm = rigid()
    return recorded(equip(arm, [Nameless("nameless", (joint,), size * arm.noise_std[joint], torque=torque)]))


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_no_catalogue_has_gets_no_wrong_name_and_no_joint_is_worse(name):
    runs = strange(name)
    found = found_in(runs)
    assert names(found) == set()
    before, after = errors(found, runs[2:])
    assert np.all(after <= NO_HARM * before)


@pytest.mark.parametrize("name", SIGNALS)
def test_what_is_left_is_told_with_its_signals(name):
    joint, _ = OUTSIDE[name]
    found = found_in(strange(name, 4.0))
    (left,) = found.left
    assert left["joint"] == ("shoulder", "elbow", "wrist")[joint]
    assert {f"{d['signal']}".replace("_motor", "") for d in left["depends_on"]} == SIGNALS[name]
    assert 0.3 < left["share"] <= 1.0
    assert left["p_value"] < 0.05


def test_viscous_friction_along_the_way_is_nothing_else_than_friction_along_the_way():
    """Friction along the way, dry as it may be, is the nearest kind; where the rest of it shows it has no name."""
    arm = rigid()

    def viscous(signals):
        return signals.dq[:, 0] * np.cos(2 * signals.q[:, 0])

    found = found_in(recorded(equip(arm, [Nameless("nameless", (0,), 1.5 * arm.noise_std[0], torque=viscous)])))
    assert names(found) <= {(kind, ("shoulder",)) for kind in ("position_dependent_friction", "unknown")}


def test_a_name_that_is_none_costs_functions_of_the_same_angle_theirs_and_no_other():
    """A cylinder that is something else takes the spring beside it along, Stribeck's friction does not."""
    kinds = ("stribeck", "position_dependent_friction", "counterbalance", "joint_spring")
    effects = tuple(SimpleNamespace(kind=kind, joints=(1,)) for kind in kinds)
    belief = SimpleNamespace(
        setup=SimpleNamespace(effects=(*effects, SimpleNamespace(kind="joint_spring", joints=(2,))))
    )
    angle, speed = of_signal(("q", 1)), of_signal(("dq_motor", 1))
    for without_blame in ("stribeck", "position_dependent_friction"):
        assert _parts_of({(without_blame, (1,)): speed}, belief) == {}
    blamed = _parts_of({("stribeck", (1,)): speed, ("counterbalance", (1,)): angle}, belief)
    assert blamed == {("counterbalance", (1,)): angle, ("joint_spring", (1,)): angle}


def test_a_name_that_only_stands_in_for_what_has_none_goes_and_a_right_one_beside_it_stays():
    """A fluid takes the elbow along with the wrist's speed; friction that both share is the nearest name of it."""
    arm = with_effects(rigid(), "friction_hysteresis:elbow:2")

    def drag(signals):
        return signals.dq[:, 2] * np.abs(signals.dq[:, 2])

    runs = recorded(equip(arm, [*arm.effects, Nameless("nameless", (1,), 4.0 * arm.noise_std[1], torque=drag)]))
    belief = Belief.in_declared(Setup(ROBOT), runs[:2])
    right, wrong = ("friction_hysteresis", (1,)), ("coupled_friction", (1, 2))
    for place in (right, wrong):
        shapes = [h for h in belief.catalogue.hypotheses() if h.place == place]
        scores = [score.value for score in belief.beside.screened(shapes)]
        belief.accept([Named(shapes[int(np.argmax(scores))], max(scores))])
    assert set(belief.named) == {right, wrong}
    (left,) = stood_in(belief)
    assert set(belief.named) == {right}
    assert (left.joint, left.signals) == (1, (("dq_motor", 2),))


def test_functions_of_an_angle_without_a_name_end_where_the_runs_do():
    ripple = PlacedEffect.at("torque_ripple", 1, cycles=3.0)
    spring, stribeck = PlacedEffect.at("joint_spring", 2, rest_position=0.1), PlacedEffect("stribeck", (1,))
    setup = Setup(rigid().robot, effects=(ripple, spring, stribeck))
    angles = [(-1.0, 1.0), (-0.3, 0.2), (0.0, 1.0)]
    after = ended(setup, {("torque_ripple", (1,)), ("stribeck", (1,))}, angles)
    assert after.effects == (ripple.held((-0.3, 0.2)), spring, stribeck)
    assert after.effects[0].shape_at(1) == {"cycles": 3.0, "held_from": -0.3, "held_to": 0.2}


def test_clean_runs_leave_nothing():
    found = found_in(recorded(rigid(), seed=4))
    assert found.left == []


@cache
def cable(size):
    """Runs of an arm with a cable that is drawn tight at one end of the elbow's way, and what is found in them."""
    arm = rigid()

    def tight(signals):
        slack = signals.q[:, 1] - 0.3
        return np.expm1(np.maximum(slack, 0.0) / 0.2)

    runs = recorded(equip(arm, [Nameless("nameless", (1,), size * arm.noise_std[1], torque=tight)]))
    return runs, found_in(runs)


def test_what_has_no_name_says_nothing_new_beyond_its_runs():
    _, found = cable(6.0)
    model = found.after.model_
    ended = [dict(effect.shape) for effect, _ in model.effects if "held_from" in dict(effect.shape)]
    assert ended
    assert [[shape["held_from"][1], shape["held_to"][1]] for shape in ended] == [list(model.domain[0][1])] * len(ended)


@pytest.mark.parametrize("size", [2.0, 6.0])
def test_a_cable_that_is_drawn_tight_is_no_cylinder(size):
    """What bends once at an end of the way fits a cylinder or a spring nearly; the rest of it is told by the angle."""
    runs, found = cable(size)
    assert {kind for kind, _ in names(found)} <= {"unknown"}
    before, after = errors(found, runs[2:])
    assert np.all(after <= NO_HARM * before)


def test_what_has_no_name_has_no_other_one_either():
    """Where a law's size may be none, or any function does better, so it is with what explains no more than the law."""
    belief = Belief.in_declared(Setup(ROBOT), measured("joint_spring:elbow:2", n_runs=2))
    springs = [Shaped("joint_spring", (j,), (("rest_position", 0.0),)) for j in (1, 2)]
    there, not_there = (("joint_spring", (j,)) for j in (1, 2))
    ties = [((("counterbalance", (j,)), -1.0),) for j in (1, 2)]
    hypotheses = belief.catalogue.of(springs)
    belief.accept([Named(h, 20.0, ties=tied) for h, tied in zip(hypotheses, ties, strict=True)])
    entries = {tuple(entry["joints"]): entry for entry in effect_entries(belief, (), {})}
    assert kinds_said(entries["elbow",]) == ["joint_spring", "counterbalance"]
    assert (entries["wrist",]["kind"], kinds_said(entries["wrist",])) == ("unknown", [])
    assert not_there in belief.named
    refuted = effect_entries(belief, (), {there: of_signal(("q", 1))})
    assert [kinds_said(entry) for entry in refuted] == [[], []]
