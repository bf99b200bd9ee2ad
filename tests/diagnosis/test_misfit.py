"""Names that do not hold: any function does as well, ripple was not seen to return."""

from types import SimpleNamespace

import numpy as np
import pytest
from exam.case import write_case
from helpers.diagnosed import ROBOT, measured

import dynid_rs as dyn
from dynid_rs.diagnosis import loop, misfit
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.rivals import valued
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.waves import SMOOTHER, of_signal, smoother, waves
from dynid_rs.model.placed import PlacedEffect


@pytest.mark.parametrize(("times", "nameless"), [(1.9, True), (2.1, False)])
def test_ripple_has_to_go_round_twice(monkeypatch, times, nameless):
    """Before that any curve is one, and so is what else of the angle has a name on the joint; not what has memory."""
    monkeypatch.setattr(misfit, "waves", lambda *_, **__: None)
    monkeypatch.setattr(misfit, "_likeliest", lambda *_: (-np.inf, 0))
    ripple = PlacedEffect.at("torque_ripple", 1, cycles=7.0)
    spring = PlacedEffect.at("joint_spring", 1)
    elsewhere = PlacedEffect.at("joint_spring", 0)
    bristles = PlacedEffect.at("friction_hysteresis", 1, presliding_distance=0.01)
    effects = (ripple, spring, elsewhere, bristles)
    belief = SimpleNamespace(
        beside=None,
        setup=SimpleNamespace(effects=effects, robot=SimpleNamespace(n_joints=2)),
        catalogue=SimpleNamespace(times_round=lambda s: times if s.kind == "torque_ripple" else float("inf")),
    )
    belief.named = {(e.kind, e.joints): Named(None, 90.0) for e in effects}
    contests = {(e.kind, e.joints): SimpleNamespace(beside=None, own=own_of(e.kind)) for e in effects}
    found = misfit.nameless(belief, contests)
    angle = of_signal(("q", 1))
    belief.named.clear()  # all were declared
    assert misfit.nameless(belief, contests) == {}
    assert found == ({("torque_ripple", (1,)): angle, ("joint_spring", (1,)): angle} if nameless else {})


@pytest.mark.parametrize(
    ("beside", "in_its_place", "at", "has_no_name", "tied"),
    [
        (-1.0, 99.0, 0, True, -1.0),
        (-1.0, 102.0, 0, True, 2.0),
        (-1.0, 96.0, 0, False, None),
        (4.0, 99.0, 0, True, None),
        (-1.0, 104.0, 0, True, None),
        (-1.0, 99.0, 1, True, None),
    ],
    ids=["as good", "better", "refuted", "misses something", "refutes the law", "of a sum"],
)
def test_a_law_that_nothing_speaks_against_is_a_tie_of_another_function(
    monkeypatch, beside, in_its_place, at, has_no_name, tied
):
    """Odds of 19 to 1, that is 2.9 nats, refute either; so does what is missing beside the law."""
    found, named = without_a_name(monkeypatch, (beside, 0), {("joint_spring", (1,)): (in_its_place, at)})
    assert (("joint_spring", (1,)) in found) is has_no_name
    assert named["joint_spring", (1,)].another_function == tied


def test_parts_of_what_has_no_name_are_no_ties(monkeypatch):
    """Two laws of one angle that are both open are ties; beside one that is told, or refuted, both are parts of one.

    What was declared has no name to lose.
    """
    spring, cylinder, ripple = ("joint_spring", (1,)), ("counterbalance", (1,)), ("torque_ripple", (1,))
    tied, refuted, told = (100.0, 0), (104.0, 0), (90.0, 0)
    for others, ties in (({cylinder: tied}, 2), ({cylinder: refuted}, 0), ({ripple: told}, 0)):
        found, named = without_a_name(monkeypatch, (-1.0, 0), {spring: tied, **others})
        assert set(found) == {spring, *others}
        assert sum(named[place].another_function is not None for place in found) == ties
    found, named = without_a_name(monkeypatch, (-1.0, 0), {spring: tied, cylinder: told}, declared=[cylinder])
    assert set(found) == {spring, cylinder}
    assert named[spring].another_function == 0.0


@pytest.mark.parametrize(
    ("in_its_place", "at", "tied"),
    [(90.0, 0, -10.0), (90.0, 1, -10.0), (100.0, 0, 0.0), (100.0, 1, None), (104.0, 0, None)],
    ids=["refuted", "a sum is refuted", "as good", "a sum is as good", "better"],
)
def test_ripple_that_was_not_seen_again_may_be_any_function(monkeypatch, in_its_place, at, tied):
    """However much better it is than smooth functions: what goes on beyond the runs tells."""
    place = ("torque_ripple", (0,))
    found, named = without_a_name(monkeypatch, (-1.0, 0), {place: (in_its_place, at)}, times=1.5)
    assert set(found) == {place}
    assert named[place].another_function == tied


@pytest.mark.parametrize(
    ("shape", "tied"),
    [({"b": 0.66}, -10.0), ({"b": 0.0201}, -10.0), ({"gas_length": -99.0}, -10.0), ({"phase": 3.99}, None), ({}, None)],
    ids=["as long a lever", "as short a lever", "as long a column that pushes", "a turn has no end", "between"],
)
def test_a_cylinder_whose_shape_ends_where_those_of_the_kind_do_may_be_any_function(monkeypatch, shape, tied):
    """Its torque stays a law's: the links are fitted beside it."""
    place = ("counterbalance", (0,))
    found, named = without_a_name(monkeypatch, (-1.0, 0), {place: (90.0, 0)}, shape=shape)
    assert found == {}
    assert named[place].another_function == tied


def test_what_has_a_memory_is_no_function_of_an_angle_wherever_its_shape_ends(monkeypatch):
    place = ("friction_hysteresis", (0,))
    none = (-np.inf, 0)
    found, named = without_a_name(monkeypatch, none, {place: none}, shape={"presliding_distance": 2.91e-4})
    assert found == {}
    assert named[place].another_function is None


SHAPES = {
    "counterbalance": {"a": 1.0, "b": 0.3, "phase": 0.5, "gas_length": 10.0},
    "torque_ripple": {"cycles": 7.0},
    "joint_spring": {"rest_position": 0.0},
    "friction_hysteresis": {"presliding_distance": 0.01},
}


def own_of(kind, shape=()):
    """What a torque is worth in its place, with its shape."""
    return SimpleNamespace(value=100.0, hypothesis=SimpleNamespace(shape=tuple((SHAPES[kind] | dict(shape)).items())))


def without_a_name(monkeypatch, beside, in_its_place, times=9.0, declared=(), shape=()):
    """Places without a name and all names, of which each is worth 100; functions' evidence and places in the lists."""
    monkeypatch.setattr(misfit, "waves", lambda *_, **__: None)
    monkeypatch.setattr(misfit, "_likeliest", lambda model, *_: beside if model is None else model)
    effects = tuple(PlacedEffect.at(kind, *joints) for kind, joints in in_its_place)
    belief = SimpleNamespace(
        beside=None,
        setup=SimpleNamespace(effects=effects, robot=SimpleNamespace(n_joints=2)),
        catalogue=SimpleNamespace(times_round=lambda s: times if s.kind == "torque_ripple" else np.inf),
        named={place: Named(None, 90.0) for place in in_its_place if place not in declared},
    )
    contests = {
        place: SimpleNamespace(beside=value, own=own_of(place[0], shape)) for place, value in in_its_place.items()
    }
    return misfit.nameless(belief, contests), belief.named


def test_how_often_ripple_goes_round_is_told_by_the_runs():
    runs = measured(duration=10.0, rate=100.0)
    catalogue = Belief.in_declared(Setup(ROBOT), runs).catalogue
    (way,) = np.ptp(np.concatenate([run.q[:, 1:2] for run in runs]), axis=0)
    times = catalogue.times_round(Shaped("torque_ripple", (1,), (("cycles", 7.0),)))
    assert times == pytest.approx(7.0 * way / (2 * np.pi), rel=0.05)  # less what rests
    assert catalogue.times_round(Shaped("joint_spring", (1,), ())) == np.inf


def test_a_function_is_as_smooth_as_any_beforehand():
    """Waves that fall faster are the same torque for coefficients that are expected to be smaller; all are averaged."""
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=10.0, rate=100.0))
    function = waves(belief.catalogue, 1, [of_signal(("q", 1))])
    for more in SMOOTHER:
        falls = smoother(function, more)
        np.testing.assert_allclose(falls.unit, function.unit / np.arange(1.0, 11.0) ** more)
        np.testing.assert_allclose(falls.columns[1] / falls.unit, function.columns[1] / function.unit)
    each = [valued(belief.beside, belief.catalogue, smoother(function, more)).value for more in SMOOTHER]
    value = misfit._averaged(belief.beside, belief.catalogue, function)
    assert value == pytest.approx(np.log(np.mean(np.exp(each))))
    assert min(each) < value < max(each)


def test_a_law_whose_size_is_not_told_goes_on_where_the_links_do(tmp_path, monkeypatch):
    """It and gravity cancel each other: ended where the runs do, it was eleven times wrong a tenth of a radian on.

    This one may be nothing as well, so the last fit is kept from taking it out.
    """
    monkeypatch.setattr(loop, "without_nothing", lambda found: False)
    truth = write_case(174428166, tmp_path)
    train, test = ([dyn.read_recording(tmp_path / name) for name in truth[part]] for part in ("train", "test"))
    found = dyn.diagnose(dyn.read_robot(tmp_path / "robot.urdf"), train, test)
    assert [(entry["kind"], entry["told_as"]) for entry in found.entries] == [("unknown", "counterbalance")]
    assert test[0].q[:, 1].min() < min(run.q[:, 1].min() for run in train) - 0.05
    error = found.result["rmse"]["test"]
    assert np.max(np.array(error["after"]) / error["before"]) < 1.1
