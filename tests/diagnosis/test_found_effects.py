"""What `diagnose` gives back: small frozen objects, in the words of the terminal, with everything of result.json."""

import dataclasses
import functools
import json

import matplotlib
import numpy as np
import pandas
import pytest
from helpers.diagnosed import ROBOT, columns_of, measured

import dynid_rs
from dynid_rs.base.wording import ANOTHER_FUNCTION, in_families
from dynid_rs.commands._diagnose_view import _effect
from dynid_rs.diagnosis import loop
from dynid_rs.diagnosis.found import FoundEffect, Unexplained
from dynid_rs.diagnosis.wording import named, next_experiments, unexplained_words

matplotlib.use("agg")  # no window, wherever this runs

JOINTS = ("shoulder", "elbow", "wrist")
STRIBECK = {
    "rank": 1,
    "kind": "stribeck",
    "joints": ["elbow"],
    "parameters": [
        {"name": "stribeck_pos", "value": 1.234, "unit": "N*m", "interval": [1.0, 1.5], "joint": "elbow"},
        {"name": "exponent", "value": 2.0, "unit": "1", "interval": None},
    ],
    "p_value": 1e-5,
    "rmse_test_before": [1.0, 2.0, 3.0],
    "rmse_test_after": [1.0, 1.5, 3.0],
    "ties": [],
    "told_apart_from": [{"kind": "joint_spring", "joints": ["elbow"], "log_evidence": 12.0}],
}
TIE = {"kind": "friction_hysteresis", "joints": ["elbow"], "separate": "dynid excite ROBOT --separate ..."}


COUPLED = [
    {"name": "coupled_friction", "value": 2.0, "unit": "N*m", "interval": [1.0, 3.0], "joint": "elbow"},
    {"name": "coupled_friction", "value": 4.0, "unit": "N*m", "interval": None, "joint": "wrist"},
    {"name": "ratio", "value": 1.0, "unit": "1", "interval": None},
]


def effect(**changes) -> FoundEffect:
    return FoundEffect.of(STRIBECK | changes, JOINTS)


def test_numbers_of_two_joints_say_whose_they_are():
    shared = effect(kind="coupled_friction", joints=["elbow", "wrist"], parameters=COUPLED)
    numbers = "coupled_friction of elbow 2.00 N*m (1.00 to 3.00), coupled_friction of wrist 4.00 N*m, ratio 1.00"
    assert str(shared) == f"coupled friction on elbow and wrist: {numbers}"
    assert "stribeck_pos 1.23 N*m" in str(effect())


@functools.cache
def runs():
    return measured("friction_hysteresis:elbow")


@functools.cache
def found() -> dynid_rs.Diagnosis:
    """By a robot and its runs alone: the last run is kept aside."""
    return dynid_rs.diagnose(ROBOT, runs())


def test_a_coefficient_has_one_interval_wherever_it_stands():
    """The table of parameters had that of a shape that is known; the declared law's coefficient has the same name."""
    result = found().result
    (entry,) = (each for each in result["effects"] if each["kind"] == "friction_hysteresis")
    (told,) = (number for number in entry["parameters"] if number["name"] == "hysteresis")
    rows = [
        row
        for row in result["parameters"]["joint"]
        if (row["name"], row["joint"]) == ("hysteresis", "elbow") and row["effect"] == "friction_hysteresis"
    ]
    assert sorted(row["declared"] for row in rows) == [False, True]
    (row,) = (row for row in rows if not row["declared"])
    assert row["interval"] == told["interval"]
    assert row["value"] == told["value"]


def test_an_effect_with_its_numbers():
    one = effect()
    assert (one.name, one.kinds, one.joints, one.is_unknown, one.is_tied) == (
        "stribeck",
        ("stribeck",),
        ("elbow",),
        False,
        False,
    )
    first, second = one.parameters
    assert (first.name, first.value, first.unit, first.interval, first.joint) == (
        "stribeck_pos",
        1.234,
        "N*m",
        (1.0, 1.5),
        "elbow",
    )
    assert (second.interval, second.joint) == (None, None)
    assert (str(first), str(second)) == ("stribeck_pos 1.23 N*m (1.00 to 1.50)", "exponent 2.00")
    assert str(one) == "stribeck on elbow: stribeck_pos 1.23 N*m (1.00 to 1.50), exponent 2.00"
    assert [str(rival) for rival in one.told_apart_from] == ["joint spring on elbow"]
    assert one.rmse_test_after == (1.0, 1.5, 3.0)


def test_one_or_the_other():
    one = effect(kind="unknown", told_as="stribeck", ties=[TIE])
    assert one.kinds == ("stribeck", "friction_hysteresis")
    assert one.name == "stribeck or friction hysteresis"
    assert one.is_tied
    assert not one.is_unknown
    assert one.ties[0].separate == TIE["separate"]
    assert str(one) == (
        "stribeck or friction hysteresis on elbow: stribeck_pos 1.23 N*m (1.00 to 1.50), exponent 2.00; "
        "not told apart from friction hysteresis on elbow: dynid excite ROBOT --separate ..."
    )


def test_a_law_or_another_function_of_the_position():
    tie = {"kind": ANOTHER_FUNCTION, "joints": ["elbow"]}
    depends = [{"signal": "q_elbow", "strength": 1.0, "direct": True}]
    one = effect(kind="unknown", told_as="joint_spring", parameters=[], ties=[tie], depends_on=depends)
    assert (one.kinds, one.is_tied, one.is_unknown) == (("joint_spring", ANOTHER_FUNCTION), True, False)
    assert one.ties[0].separate == ""
    assert str(one) == (
        "joint spring or another function of the position on elbow; "
        "not told apart from another function of the position on elbow"
    )
    result = {"effects": [one.entry], "unexplained": [], "joints": ["shoulder", "elbow"], "data": {"findings": []}}
    assert next_experiments(result) == [
        "Joint spring on elbow and another function of the position on elbow differ beyond the positions that the runs "
        "have shown; one that goes there decides."
    ]


def test_one_place_or_the_other():
    """Behind parallel axes a coupling of two joints is the same torque at two others, and no motion tells."""
    tie = {"kind": "inertial_coupling", "joints": ["shoulder", "wrist"], "same_torque": True}
    one = effect(kind="unknown", told_as="inertial_coupling", joints=["elbow", "wrist"], parameters=[], ties=[tie])
    assert (one.kinds, one.name, one.is_tied, one.is_unknown) == (
        ("inertial_coupling",),
        "inertial coupling",
        True,
        False,
    )
    assert (one.ties[0].separate, one.ties[0].same_torque) == ("", True)
    assert str(one) == (
        "inertial coupling on elbow and wrist, or on shoulder and wrist; "
        "not told apart from inertial coupling on shoulder and wrist, and no motion can"
    )


def test_effects_are_one_family_where_they_may_be_the_same_at_the_same_places():
    def one_of(kind, *joints, ties=()):
        found = {"kind": "unknown", "told_as": kind} if ties else {"kind": kind}
        return {**found, "joints": list(joints), "ties": list(ties)}

    here, there = ({"kind": "b", "joints": ["elbow"]}, {"kind": "b", "joints": ["wrist"]})
    elsewhere = {"kind": "a", "joints": ["shoulder", "wrist"]}
    families = in_families(
        [
            one_of("a", "elbow", ties=[here]),
            one_of("a", "shoulder", "elbow", ties=[elsewhere]),
            one_of("a", "wrist", ties=[there]),
            one_of("a", "elbow", "wrist"),
            one_of("a", "shoulder"),
        ]
    )
    assert [named(family, JOINTS) for family in families] == [
        "a or b on elbow and wrist",
        "a on shoulder and elbow, or on shoulder and wrist",
        "a of the whole robot",
    ]


def test_something_without_a_name():
    depends = [{"signal": "q_elbow", "strength": 0.93, "direct": True}]
    one = effect(kind="unknown", told_as="stribeck", depends_on=depends)
    assert (one.kind, one.kinds, one.name, one.is_unknown) == ("unknown", (), "unknown", True)
    assert str(one) == "unknown on elbow, depends on q_elbow (0.93)"  # not the numbers of the law that stands in
    assert "1. unknown on elbow, depends on q_elbow (0.93)" in one._repr_html_()
    assert "stribeck" not in one._repr_html_()  # in a notebook neither
    assert "stribeck" in effect()._repr_html_()
    assert one.parameters
    assert (one.depends_on[0].signal, one.depends_on[0].strength) == ("q_elbow", 0.93)


def test_the_whole_robot():
    assert str(effect(joints=list(JOINTS), parameters=[])) == "stribeck of the whole robot"


def test_what_is_left():
    entry = {"joint": "wrist", "share": 0.42, "p_value": 1e-4, "depends_on": [{"signal": "t", "strength": 0.5}]}
    one = Unexplained.of(entry)
    assert (
        str(one) == unexplained_words(entry) == "unexplained on wrist: 42 % of the error's power, depends on t (0.50)"
    )
    assert (one.joint, one.share, one.depends_on[0].signal) == ("wrist", 0.42, "t")
    assert one.to_dict() == entry


def test_they_are_frozen_and_give_copies():
    one = effect(ties=[TIE])
    for thing, name in ((one, "kind"), (one.parameters[0], "value"), (one.ties[0], "joints")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(thing, name, None)
    one.to_dict()["joints"].append("wrist")
    assert one.to_dict() == STRIBECK | {"ties": [TIE]}
    assert one.parameters[0].to_dict() == STRIBECK["parameters"][0]


def test_what_is_no_curve_is_not_drawn():
    with pytest.raises(ValueError, match="stribeck on elbow is no curve over a signal; its numbers are in parameters"):
        effect().plot()


@pytest.mark.parametrize(
    ("signal", "quantity", "labels"),
    [
        ("tau_link_elbow", "friction_torque", ("load [N·m]", "friction torque [N·m]")),
        ("dq_elbow", "torque", ("speed [N·m]", "torque [N·m]")),
        ("way_elbow", None, ("way since the motion turned round [N·m]", "torque [N·m]")),
    ],
)
def test_a_curve_has_its_quantities_and_units(signal, quantity, labels):
    x = np.linspace(-1, 1, 50).tolist()
    plot = {"signal": signal, "unit": "N*m", "joint": "elbow", "x": x, "partial": x, "curve_x": x, "curve": x}
    if quantity is not None:
        plot |= {"quantity": quantity, "curve_low": (np.array(x) - 0.1).tolist(), "curve_high": x}
    panel = effect(plot=plot).plot()
    assert (panel.get_xlabel(), panel.get_ylabel()) == labels
    assert panel.get_title(loc="left") == "stribeck, elbow"
    assert len(panel.collections) == (quantity is not None)
    dots, curve = panel.lines[:2]
    np.testing.assert_array_equal(curve.get_ydata(), x)
    assert dots.get_label() == "left without this effect"
    only_a_curve = effect(plot=plot | {"x": [], "partial": []}).plot()  # as ripple has it
    assert only_a_curve.lines[1].get_label() == "stribeck"


def test_a_deflection_is_drawn_as_one():
    x = np.linspace(-1, 1, 50).tolist()
    plot = {"signal": "tau_link_elbow", "unit": "N*m", "joint": "elbow", "x": x, "partial": x, "curve_x": x, "curve": x}
    panel = effect(plot=plot | {"quantity": "deflection", "value_unit": "rad"}).plot()
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("load [N·m]", "motor minus link angle [rad]")


def test_a_robot_and_its_runs_are_enough():
    (one,) = found().effects
    assert (one.kind, one.joints) == ("friction_hysteresis", ("elbow",))
    hysteresis = next(number for number in one.parameters if number.name == "hysteresis")
    assert hysteresis.unit == "N*m"
    assert hysteresis.interval[0] < hysteresis.value < hysteresis.interval[1]
    assert [run.name for run in found().test] == [runs()[-1].name]
    assert [f.code for f in found().findings if f.code == "test_run_chosen"] == ["test_run_chosen"]


def test_what_is_diagnosed_may_be_given_as_data_frames(monkeypatch):
    seen = {}

    def stop(setup, train, test, after, on_progress):
        seen.update(setup=setup, train=train, test=test)
        raise KeyboardInterrupt

    monkeypatch.setattr(loop, "_traced", stop)
    frames = [pandas.DataFrame(columns_of(run)).rename(columns={"t": "stamp"}) for run in runs()]
    setup = dynid_rs.Setup(ROBOT, options={"config": {"t": "stamp"}})
    with pytest.raises(KeyboardInterrupt):
        dynid_rs.diagnose(setup, frames[:-1], frames[-1])
    assert seen["setup"] is setup
    for given, run in zip([*seen["train"], *seen["test"]], runs(), strict=True):
        np.testing.assert_array_equal(given.q, run.q)
        np.testing.assert_array_equal(given.tau, run.tau)
    with pytest.raises(KeyboardInterrupt):
        dynid_rs.diagnose(ROBOT, runs()[0])
    (first,), (rest,) = seen["train"], seen["test"]  # a lone run: its last third is kept aside
    assert rest.before is first
    assert rest.duration == pytest.approx(runs()[0].duration / 3, rel=0.01)


@pytest.mark.parametrize("wrong", ["robot.urdf", pandas.DataFrame()])
def test_what_is_no_robot(wrong):
    with pytest.raises(ValueError, match=r"diagnose takes a RobotModel or a Setup first, and runs behind it, got"):
        dynid_rs.diagnose(wrong, runs())


def test_the_result_is_that_of_the_terminal():
    result = found().result
    assert [effect.to_dict() for effect in found().effects] == result["effects"]
    json.dumps([effect.to_dict() for effect in found().effects], allow_nan=False)
    (one,) = found().effects
    assert _effect(result["effects"][0], result) == f"1. {one}"
    said = str(found()).splitlines()
    assert said[0] == found().verdict == result["verdict"]
    assert said[1] == f"1. {one}"
    assert found().next_experiments == result["next_experiment"]


def test_a_notebook_shows_the_numbers_of_an_effect():
    one = effect(ties=[TIE])
    assert repr(one) == f"<FoundEffect {one}>"
    html = one._repr_html_()
    for said in ("1. stribeck on elbow", "1.234 N·m", "1 to 1.5", "Not told apart from friction hysteresis on elbow."):
        assert said in html


def test_it_is_short_and_shows_a_table():
    assert repr(found()) == "<Diagnosis of small_arm: friction hysteresis on elbow>"
    html = found()._repr_html_()
    assert "friction hysteresis" in html
    assert "hysteresis 1." in html
    assert found().verdict.split(":")[0] in html


def test_the_table_says_what_the_sentences_say(monkeypatch):
    """Numbers of two joints with their joints, and of an effect without a name none."""
    shared = effect(kind="coupled_friction", joints=["elbow", "wrist"], parameters=COUPLED)
    made = dataclasses.replace(found())
    made.__dict__["effects"] = (shared, effect(kind="unknown", told_as="stribeck"))
    monkeypatch.setattr(dynid_rs.Diagnosis, "verdict", "Two effects.")
    html = made._repr_html_()
    assert "coupled_friction of elbow 2.00 N*m (1.00 to 3.00); coupled_friction of wrist 4.00 N*m; ratio 1.00" in html
    assert "stribeck" not in html


def test_without_a_test_run_nothing_is_said_of_errors():
    empty = dataclasses.replace(found(), test=())
    with pytest.raises(ValueError, match="there is no test run, so nothing is said of errors"):
        _ = empty.verdict
