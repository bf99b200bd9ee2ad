"""Names that only come near: each of these cases was told wrongly before."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from nameless import measured as nameless_runs
from nameless import plain_arm, with_nameless
from numpy.testing import assert_allclose
from test_deflection import gear, value
from test_diagnosis_search import ARM, ROBOT, TYPICAL, measured, start

from dynid_rs.diagnosis import remainder as remaining
from dynid_rs.diagnosis import search as searching
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.deflection import examine_signals
from dynid_rs.diagnosis.deflection.fitting import finished_gear, search_gear
from dynid_rs.diagnosis.deflection.terms import columns_of
from dynid_rs.diagnosis.dropping import drop_doubtful_gains
from dynid_rs.diagnosis.floor import floor
from dynid_rs.diagnosis.hypothesis import Hypothesis, at_a_bound
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.late_clock import with_late_clock
from dynid_rs.diagnosis.leftovers import run_residuals, search_leftovers
from dynid_rs.diagnosis.patchwork import as_unknown, nameless_patchworks, patchworks
from dynid_rs.diagnosis.remainder import Remainder, lines_told, nearest_effects, what_is_left
from dynid_rs.diagnosis.remainder_entries import nearest_names, unknown_entries
from dynid_rs.diagnosis.rotor_share import with_rotors
from dynid_rs.diagnosis.search import scan
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import Search, columns_in, fitted
from dynid_rs.diagnosis.unknown import find_unknown
from dynid_rs.placed import PlacedEffect
from dynid_rs.simulation import build_effects, parse_wish, simulate

ELBOW = 1


def test_a_late_torque_channel_is_found_after_the_search_and_none_where_there_is_none():
    runs = measured("torque_delay:elbow:2", n_runs=3)
    state = start(Setup(ROBOT), runs)
    found, delay = with_late_clock(state, Setup(ROBOT), runs)
    assert delay is not None
    assert delay.places == ((ELBOW,),)
    low, high = delay.intervals()[0]
    assert found.setup.torque_delay[ELBOW] == pytest.approx(delay.value[0])
    assert 0 < low < high
    left = [Beside(s.fit).residual[:, ELBOW].std() for s in (state, found)]
    assert left[1] < left[0]
    on_time = measured(n_runs=3)
    state = start(Setup(ROBOT), on_time)
    assert with_late_clock(state, Setup(ROBOT), on_time) == (state, None)
    early = start(Setup(ROBOT, torque_delay=np.full(ROBOT.n_joints, 0.01)), on_time)
    found, delay = with_late_clock(early, early.setup, on_time)
    assert delay is not None
    assert delay.places == ()
    assert not found.setup.torque_delay.any()


def test_a_spring_is_weighed_beside_every_cylinder():
    state = start(Setup(ROBOT), measured("counterbalance:elbow:2", n_runs=3))
    beside = Beside(state.fit)
    ranked, _ = scan(beside, state, [])
    places = [(item.kind, item.joints) for _, item in ranked]
    cylinder = ranked[places.index(("counterbalance", (ELBOW,)))][1]
    spring = ranked[places.index(("joint_spring", (ELBOW,)))][1]
    # However far down the list it is.
    listed = list(searching.shortlist(beside, state.kinds, [(1e6, cylinder), (1.0, spring)]))
    assert [candidate.kind for candidate in listed] == ["counterbalance", "joint_spring"]


def test_a_shape_without_an_end_stands_in_nobodys_way(monkeypatch):
    state = start(Setup(ROBOT), measured("joint_spring:elbow:1", n_runs=3))
    beside = Beside(state.fit)
    ranked, _ = scan(beside, state, [])
    first, second = (item for _, item in ranked[:2])
    real = searching.refined_candidate
    monkeypatch.setattr(searching, "refined_candidate", lambda b, k, h: None if h is first else real(b, k, h))
    listed = list(searching.shortlist(beside, state.kinds, [(1e6, first), (1.0, second)]))
    assert [candidate.place for candidate in listed] == [(second.kind, second.joints)]


def test_friction_that_goes_on_changing_is_thermal_and_one_that_is_warm_at_once_is_not():
    def warm(time_constant):
        shape = (("time_constant", time_constant), ("reference_speed", 0.0), ("transition_width", 0.02))
        return Hypothesis("thermal_friction", (ELBOW,), shape)

    assert not at_a_bound(warm(300.0))
    assert not at_a_bound(warm(7.0))
    assert at_a_bound(warm(5.0))


def test_a_gain_has_to_stand_out_beside_everything_else():
    for wishes, kept in (((), ()), (("torque_gain:elbow:1",), (ELBOW,))):
        runs = measured(*wishes, n_runs=3)
        state = start(Setup(ROBOT, gain_joints=(ELBOW,)), runs)
        state.n_tests = 300.0
        drop_doubtful_gains(state, runs)
        assert state.setup.gain_joints == kept


def patched():
    shape = {"a": 1.0, "b": 0.3, "phase": 0.0, "gas_length": 1.0}
    return [
        PlacedEffect.at("counterbalance", ELBOW, **shape),
        PlacedEffect.at("joint_spring", ELBOW, rest_position=0.0),
        PlacedEffect.at("torque_ripple", 0, cycles=3.1),
    ]


def test_a_cylinder_with_a_spring_beside_it_is_a_function_without_a_name():
    effects = patched()
    ((cylinder, spring),) = patchworks(effects)
    assert (cylinder.kind, spring.kind) == ("counterbalance", "joint_spring")
    assert patchworks(effects[1:]) == []
    teeth = PlacedEffect.at("torque_ripple", ELBOW, cycles=9.0)
    assert patchworks([effects[0], teeth]) == []
    errors = {f"rmse_{runs}_{when}": [1.0] for runs in ("train", "test") for when in ("before", "after")}
    entries = [
        {"kind": effect.kind, "joints": [ROBOT.joint_names[effect.joints[0]]], "evidence": 5.0 - k, "parameters": [1]}
        | errors
        for k, effect in enumerate(effects)
    ]
    pairs = list(zip(effects, entries, strict=True))
    unknown, ripple = as_unknown(pairs, nameless_patchworks(effects, ROBOT.joint_names))
    assert (unknown["kind"], unknown["parameters"]) == ("unknown", [])
    assert unknown["depends_on"][0]["signal"] == f"q_{ROBOT.joint_names[ELBOW]}"
    assert "counterbalance, joint spring" in unknown["note"]
    assert ripple is entries[2]


def left_at(joint, signals, share):
    """What a `find_unknown` would say, as far as names are weighed by it."""
    return SimpleNamespace(
        joint=joint, share=share, depends_on=tuple((s, 1.0) for s in signals), term=object(), explained=share
    )


def test_a_name_that_leaves_most_of_its_own_signals_unexplained_is_told_as_unknown(monkeypatch):
    runs = measured("joint_spring:elbow:2", n_runs=3)
    spring = PlacedEffect.at("joint_spring", ELBOW, rest_position=0.0)
    setup = Setup(ROBOT, effects=(spring,))
    state = Search(setup, fitted(setup, runs), None)
    state.kinds = Kinds(state.fit)
    explained = float(np.mean(Beside(state.fit, columns_in(state)[0]).residual[:, ELBOW] ** 2))
    after = float(np.mean(Beside(state.fit).residual[:, ELBOW] ** 2))
    # The spring is all there is: whatever were left of its signals, it explains most of what could be explained.
    floor_ = SimpleNamespace(value=np.full(ROBOT.n_joints, 0.5 * np.sqrt(after)))
    both = [("q", ELBOW), ("q", 0)]
    assert nearest_effects(state, Remainder(floor_, [left_at(ELBOW, both, 0.9)], [])) == {}
    assert explained > 10 * after
    # Where more than it explains is left of its signals it only comes near; not where little is, or of others.
    monkeypatch.setattr(remaining, "FORCED", 2.0)
    assert nearest_effects(state, Remainder(floor_, [left_at(ELBOW, both, 0.9)], [])) == {ELBOW: [spring]}
    assert nearest_effects(state, Remainder(floor_, [left_at(ELBOW, both, 0.1)], [])) == {}
    assert nearest_effects(state, Remainder(floor_, [left_at(ELBOW, [("dq", ELBOW)], 0.9)], [])) == {}
    left = Remainder(floor_, [left_at(ELBOW, both, 0.9)], [], {ELBOW: [spring]})
    (group,) = nearest_names(left, ROBOT.joint_names)
    assert list(group.effects) == [spring]
    assert [d["signal"] for d in group.depends_on] == [f"q_{ROBOT.joint_names[j]}" for j in (ELBOW, 0)]
    assert unknown_entries(left, ROBOT.joint_names) == []


@pytest.mark.parametrize(("cycles", "amplitude", "kept"), [(8.0, 0.5, False), (8.0, 50.0, True), (72.0, 0.5, True)])
def test_a_slow_line_beside_a_greater_rest_of_the_same_position_is_no_name(cycles, amplitude, kept):
    state = start(Setup(ROBOT), measured(n_runs=3))
    size = float(np.sqrt(np.mean(Beside(state.fit).residual[:, ELBOW] ** 2)))
    line = SimpleNamespace(joints=(ELBOW,), lines=[SimpleNamespace(order=cycles, amplitude=amplitude * size)])
    left = Remainder(None, [left_at(ELBOW, [("q", ELBOW)], 0.9)], [])
    assert lines_told([line], state, left) == ([line] if kept else [])


@pytest.fixture(scope="module")
def arm():
    return plain_arm()


def strange(arm, joint, torque):
    plans = simulate(arm, n_runs=3, duration=20, rate=50, seed=7).trajectories
    return nameless_runs(with_nameless(arm, joint, torque, 1.5, plans), n_runs=3, trajectories=plans, seed=3)


def test_viscous_friction_along_the_way_is_not_dry_friction_along_the_way(arm):
    joint = 0
    runs = strange(arm, joint, lambda s: s.dq[:, joint] * np.cos(2 * s.q[:, joint]))
    nearest = PlacedEffect.at("position_dependent_friction", joint, cycles=2.0, transition_width=0.02)
    found = start(Setup(arm.robot, effects=(nearest,)), runs)
    remainder = what_is_left(found, runs)
    assert found.setup.effects == ()
    (unknown,) = (u for u in remainder.unexplained if u.joint == joint)
    assert {signal for signal, _ in unknown.depends_on} == {("q", joint), ("dq", joint)}
    assert unknown.term in remainder.terms


def test_a_friction_that_drives_its_joint_is_none(arm):
    joint = 0
    friction = PlacedEffect.at("stribeck", joint, stribeck_velocity=0.1, exponent=1.0, transition_width=0.02)
    wave = PlacedEffect.at("position_dependent_friction", joint, cycles=2.0, transition_width=0.02)

    def bump(s):
        return np.tanh(s.dq[:, joint] / 0.02) * np.exp(-np.abs(s.dq[:, joint]) / 0.1)

    for sign, drives in ((1.0, False), (-1.0, True)):
        found = start(Setup(arm.robot, effects=(friction, wave)), strange(arm, joint, lambda s, x=sign: x * bump(s)))
        assert remaining._drives(found, friction) == drives
        # What only varies round a friction that stays is told apart from its mean.
        assert not remaining._drives(found, wave)


def test_two_names_beside_a_term_are_one_function_without_a_name(arm):
    joint = 0
    runs = strange(arm, joint, lambda s: s.dq[:, joint] * np.cos(2 * s.q[:, joint]))
    names = (
        PlacedEffect.at("position_dependent_friction", joint, cycles=2.0, transition_width=0.02),
        PlacedEffect.at("load_dependent_friction", joint, transition_width=0.02),
    )
    found = start(Setup(arm.robot, effects=names), runs)
    groups = remaining._beside_terms(found, [SimpleNamespace(joint=joint)])
    assert groups == [list(names), [names[0]], [names[1]]]
    assert remaining._beside_terms(found, [SimpleNamespace(joint=1)]) == []
    remainder = what_is_left(found, runs)
    assert found.setup.effects == ()
    assert [term.joint for term in remainder.terms] == [joint]


def test_a_name_that_is_there_stays_beside_a_term(arm):
    joint = 2

    def torque(s):
        hard = 3 * np.tanh(s.dq[:, joint] / 0.02) * np.exp(-((s.dq[:, joint] / 0.1) ** 2))
        return hard + s.dq[:, joint] * np.cos(2 * s.q[:, 1])

    runs = strange(arm, joint, torque)
    friction = PlacedEffect.at("stribeck", joint, stribeck_velocity=0.1, exponent=2.0, transition_width=0.02)
    found = start(Setup(arm.robot, effects=(friction,)), runs)
    remainder = what_is_left(found, runs)
    assert found.setup.effects == (friction,)
    assert [term.joint for term in remainder.terms] == [joint]


def test_teeth_behind_a_differential_depend_on_both_angles(arm):
    runs = strange(arm, 4, lambda s: np.sin(7 * (s.q[:, 4] + s.q[:, 3])))
    fit = start(Setup(arm.robot), runs).fit
    leftovers = search_leftovers(fit)
    (unknown,) = find_unknown(fit, floor(fit, fit.runs_, run_residuals(fit), leftovers), leftovers)
    assert {signal for signal, _ in unknown.depends_on} == {("q", 3), ("q", 4)}


def test_play_under_a_load_that_is_not_known_well_leaves_no_bend_behind():
    """Near zero load a small error of the load moves a gear with play farther than its spring alone does."""
    stiffness, gap, width = 2e4, 3e-4, 2.0

    def deflection(tau, dq):
        x = np.clip(tau / width, -1.0, 1.0)
        return tau / stiffness + gap / 2 * (15 * x - 10 * x**3 + 3 * x**5) / 8

    runs = []
    for seed in range(4):
        run = gear(deflection, seed=seed)
        off = np.stack([np.sin(run.q), np.cos(run.q)], axis=1)
        # One standard deviation of each direction; the prediction is off by about that.
        runs.append(
            replace(run, load=run.load + off @ np.array([0.8, -0.6]), load_error=np.column_stack([off, 0 * off[:, 0]]))
        )
    found = {finding.kind: finding for finding in examine_signals(runs[:3], runs[3:])}
    assert set(found) == {"joint_elasticity", "backlash"}
    for kind, name, true in (("joint_elasticity", "stiffness", stiffness), ("backlash", "gap", gap)):
        low, high = value(found[kind], name).interval
        assert low < true < high, name
    gear_ = finished_gear(search_gear(runs[:3], turning=True), runs[:3])
    names = ["compliance", "cubic", "backlash"]
    x = [gear_.compliance, gear_.cubic, gear_.half_gap]
    assert gear_.half_gap == pytest.approx(gap / 2, rel=0.05)
    for run, errors in zip(gear_.runs, gear_.errors, strict=True):
        way = run.load_error @ gear_.turn[:, 0]
        ends = []
        for h in (5e-4, -5e-4):
            moved = replace(run, load=run.load + h * way)
            columns = [columns_of(name, moved, gear_.shapes, way)[:, 0] for name in names]
            ends.append(np.tensordot(x, columns, 1))
        high, low = ends
        assert_allclose(errors[:, 0], (high - low) / 1e-3, rtol=0, atol=0.1 * np.abs(errors[:, 0]).max())


def test_what_follows_the_load_tells_the_rotor_from_the_link():
    """The first joint's rotor moves as its link does; friction under load grows with the link's part alone."""
    for joint, told in ((0, True), (2, False)):
        wish = f"load_dependent_friction:{ROBOT.joint_names[joint]}:20"
        (effect,) = build_effects([parse_wish(wish)], TYPICAL)
        shape = {"transition_width": float(effect.shape["transition_width"][joint])}
        placed = PlacedEffect.at("load_dependent_friction", joint, **shape)
        runs = measured(wish, n_runs=3)
        state = start(Setup(ROBOT, effects=(placed,)), runs)
        setup = with_rotors(state)
        assert (setup is not state.setup) == told
        if told:
            ((held,),) = (setup.held,)
            assert held.effect.kind == "rotor_inertia"
            assert held.coefficients[0] == pytest.approx(ARM.rotor_inertia[joint], rel=0.3)
            left = [Beside(fitted(s, runs)).residual[:, joint].std() for s in (state.setup, setup)]
            assert left[1] < left[0]
