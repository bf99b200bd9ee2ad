"""Joints that warm up by one clock: the second one is asked with the first one's, and both settle together."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_search import ROBOT, measured, start

from dynid_rs.diagnosis import choice
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import stacked
from dynid_rs.diagnosis.choice import Weighed, weigh
from dynid_rs.diagnosis.dropping import standing
from dynid_rs.diagnosis.entries import effect_entries
from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.diagnosis.search import SHORTLIST, _in_vain, carries_over, outweighs_nothing, scan, search, shortlist
from dynid_rs.diagnosis.settling import settle
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import EVEN, columns_in, hypothesis_of
from dynid_rs.diagnosis.warmth import WARMING, clock, common_clock, on_one_clock, sharing_clocks
from dynid_rs.placed import PlacedEffect
from dynid_rs.simulation.effects import column_kinds

SHOULDER, ELBOW, WRIST = range(3)
TRUE, WRONG = 8.0, 14.0
"""Time constant of the arm [s], and one that is not it."""


def warming(joint, time_constant=WRONG):
    return PlacedEffect.at(WARMING, joint, time_constant=time_constant, reference_speed=0.0, transition_width=0.02)


@pytest.fixture(scope="module")
def runs():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(column_kinds, "WARM_UP", TRUE)
        return measured("thermal_friction:elbow:2", "thermal_friction:wrist:2", n_runs=3)


@pytest.fixture(scope="module")
def both(runs):
    """The two joints, on a clock that is not theirs."""
    return start(Setup(ROBOT, effects=(warming(ELBOW), warming(WRIST))), runs)


def test_other_joints_are_asked_with_the_clock_that_was_found(runs):
    state = start(Setup(ROBOT, effects=(warming(ELBOW, TRUE),)), runs)
    asked = on_one_clock(state.kinds, state.setup)
    assert [candidate.place for candidate in asked] == [(WARMING, (SHOULDER,)), (WARMING, (WRIST,))]
    for candidate in asked:
        assert candidate.n_searched == 0
        assert dict(candidate.shape)["time_constant"] == TRUE
    ranked, _ = scan(Beside(state.fit), state, asked)
    # Beside the same joint's own clocks, not instead of them.
    at_wrist = [item for _, item in ranked if (item.kind, item.joints) == (WARMING, (WRIST,))]
    assert sum(item is asked[1] for item in at_wrist) == 1
    assert sum(isinstance(item, Hypothesis) for item in at_wrist) == 1
    found = search(state.setup, runs)
    assert sorted(effect.joints for effect in found.setup.effects) == [(ELBOW,), (WRIST,)]
    assert sharing_clocks(found.setup.effects) == [[0, 1]]
    assert dict(clock(found.setup.effects[0]))["time_constant"] == pytest.approx(TRUE, rel=0.2)


def test_nobody_lends_a_clock_that_is_not_there_or_that_the_data_do_not_tell(runs):
    cold = start(Setup(ROBOT), runs)
    assert on_one_clock(cold.kinds, cold.setup) == []
    for time_constant in (5.0, 300.0):
        untold = replace(cold.setup, effects=(warming(ELBOW, time_constant),))
        assert on_one_clock(cold.kinds, untold) == []


def test_a_lent_clock_takes_nobodys_place_on_the_short_list(runs):
    state = start(Setup(ROBOT, effects=(warming(ELBOW, TRUE),)), runs)
    lent = on_one_clock(state.kinds, state.setup)[1]
    clocks = [replace(lent, shape=(("time_constant", TRUE + k),)) for k in range(2 * SHORTLIST)]
    last = state.kinds.grid(["joint_spring"])[0]
    ranked = [(1e6 - k, item) for k, item in enumerate([*clocks, last])]
    listed = [candidate.place for candidate in shortlist(Beside(state.fit), state.kinds, ranked)]
    assert listed == [*([lent.place] * len(clocks)), (last.kind, last.joints)]


def test_a_clock_that_is_shared_is_paid_for_once(both):
    separate = replace(both, setup=replace(both.setup, effects=(warming(ELBOW), warming(WRIST, WRONG + 1e-9))))
    shared, own = ([standing(state, k)[0] for k in (0, 1)] for state in (both, separate))
    assert shared[0].evidence == pytest.approx(own[0].evidence, abs=1e-3)
    assert shared[1].evidence > own[1].evidence + 1.0


def test_clocks_are_shared_only_where_time_and_source_agree():
    by_power = PlacedEffect.at(WARMING, WRIST, time_constant=TRUE, reference_speed=1.0, transition_width=0.02)
    assert sharing_clocks([warming(ELBOW), warming(WRIST, TRUE)]) == []
    assert sharing_clocks([warming(ELBOW, TRUE), by_power]) == []
    spring = PlacedEffect.at("joint_spring", ELBOW, rest_position=0.0)
    assert sharing_clocks([warming(SHOULDER), spring, warming(WRIST)]) == [[0, 2]]


def test_a_common_clock_is_the_one_that_takes_off_most_together(both):
    beside = Beside(both.fit, [column for columns in columns_in(both) for column in columns])
    found = common_clock(beside, both.kinds, [hypothesis_of(effect, both.kinds) for effect in both.setup.effects])
    times = {dict(hypothesis.shape)["time_constant"] for hypothesis in found}
    assert len(times) == 1
    assert times.pop() == pytest.approx(TRUE, rel=0.2)


def test_joints_on_one_clock_settle_together_and_the_report_says_so(both, runs):
    both = copy(both)
    settle(both, runs, [1])
    first, second = map(clock, both.setup.effects)
    assert first == second
    assert dict(first)["time_constant"] == pytest.approx(TRUE, rel=0.2)
    entries = [entry for _, entry in effect_entries(both, [])]
    assert [entry["kind"] for entry in entries] == [WARMING, WARMING]
    assert all("one time constant for elbow, wrist" in entry["note"] for entry in entries)


@pytest.mark.parametrize(
    ("figures", "lone", "enough"),
    [
        ({}, False, True),
        # One of three runs loses what the others gain: most of them gain, and on average.
        ({"left_out_ratio": 0.999, "pays": -0.1}, False, True),
        ({"left_out_ratio": 0.999, "pays": -0.1, "mean_log_ratio": -0.002}, False, False),
        # One of three runs gains what the others lose.
        ({"left_out_ratio": 0.999, "pays": -0.1, "median_log_ratio": 0.02}, False, False),
        ({"mean_log_ratio": 0.1}, False, True),
        ({"pays": -0.1, "mean_log_ratio": 0.1}, False, False),
        ({}, True, True),
        ({"left_out_ratio": 0.96}, True, False),
        ({"mean_log_ratio": 0.01}, True, False),
        ({"pays": 0.9}, True, False),
    ],
)
def test_what_carries_over(figures, lone, enough):
    usual = {"left_out_ratio": 0.9, "pays": 2.0, "mean_log_ratio": -0.05, "median_log_ratio": -0.05}
    weighed = Weighed(None, None, 10.0, np.zeros((1, 1)), **(usual | figures))
    assert carries_over(weighed, lone=lone) is enough


def test_one_more_name_on_a_joint_has_to_be_better_than_a_tie(both):
    def at(joint, evidence):
        return Weighed(SimpleNamespace(joints=(joint,)), None, evidence, np.zeros((1, 1)))

    assert outweighs_nothing(at(SHOULDER, 0.1), both.setup)
    assert not outweighs_nothing(at(SHOULDER, -0.1), both.setup)
    assert outweighs_nothing(at(WRIST, EVEN + 0.1), both.setup)
    assert not outweighs_nothing(at(WRIST, EVEN - 0.1), both.setup)


def test_a_median_of_runs_is_that_of_runs_left_out(both):
    beside = Beside(both.fit, columns_in(both)[1])
    candidate = both.kinds.candidate(hypothesis_of(both.setup.effects[1], both.kinds))
    without = beside.left_out(None)
    weighed = choice.tested(beside, weigh(beside, candidate), without)
    left = beside.left_out(stacked(candidate.columns), candidate.bounds)
    powers = [[np.sum(x[block][:, WRIST] ** 2) for block in beside.blocks] for x in (left, without)]
    logs = np.log(powers[0]) - np.log(powers[1])
    assert weighed.median_log_ratio == pytest.approx(np.median(logs))
    assert weighed.mean_log_ratio == pytest.approx(np.mean(logs))


def ripple(cycles):
    return PlacedEffect.at("torque_ripple", ELBOW, cycles=cycles)


@pytest.mark.parametrize(
    ("was", "now", "added", "dropped", "vain"),
    [
        ([], [], [ELBOW], [ELBOW], True),
        ([], [warming(ELBOW)], [ELBOW], [], False),
        ([], [warming(WRIST)], [ELBOW, WRIST], [ELBOW], False),
        ([warming(WRIST)], [], [ELBOW], [ELBOW, WRIST], False),
        # The line that was added is another one than the one that was dropped for it.
        ([ripple(9.2)], [ripple(10.0)], [ELBOW], [ELBOW], False),
        ([ripple(9.2)], [ripple(9.21)], [ELBOW], [ELBOW], True),
    ],
)
def test_a_step_that_drops_all_it_added_is_the_last(both, was, now, added, dropped, vain):
    def step(action, joint):
        candidate = SimpleNamespace(place=("stribeck", (joint,)))
        return SimpleNamespace(action=action, choice=SimpleNamespace(weighed=SimpleNamespace(candidate=candidate)))

    steps = [*(step("added", joint) for joint in added), *(step("dropped", joint) for joint in dropped)]
    before = replace(both.setup, effects=tuple(was))
    after = replace(both, setup=replace(both.setup, effects=tuple(now)))
    assert _in_vain(before, after, steps) is vain
