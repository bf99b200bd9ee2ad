"""A short run of `tests/campaigns/watch.py`, and its judge: what is wrong is counted wrong. Hours are run by hand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from campaigns import watch, watch_page
from campaigns.watch_changes import AT, CHANGES, Truth
from campaigns.watch_clean import alarms_of, watch_clean
from campaigns.watch_judge import judge

from dynid_rs.base.changes import Change
from dynid_rs.model.watch import Watched

JOINTS = ("a", "b")
NAMED = Change(25.25, "friction", "b", 0.19, (0.15, 0.23))
SETTLED = replace(NAMED, t=47.2, size=0.21, interval=(0.19, 0.23), said="settled")
FEW = ("fourier", "fourier", "fourier", "pauses", "moves")
TRUTH = Truth(("friction",), 1, 0.2)


def watched(*changes):
    """A minute and forty seconds in rows; joint b moves every second row."""
    t = 0.2 * np.arange(1, 501)
    moves = np.ones((500, 2), dtype=bool)
    moves[::2, 1] = False
    return Watched("run", changes, t, np.zeros((500, 2)), np.ones((500, 2)), moves)


def judged(*changes, truth=TRUTH):
    return judge("friction +20 %", 1, truth, JOINTS, watched(*changes), AT)


def test_a_right_name_is_right_and_its_time_is_that_of_motion():
    outcome = judged(NAMED, SETTLED)
    assert (outcome.name, outcome.settled, outcome.covered) == ("right", "right", True)
    assert (outcome.early, outcome.more) == (0, 0)
    assert outcome.time == pytest.approx(5.25)
    assert outcome.motion == pytest.approx(2.6)
    assert outcome.error == pytest.approx(0.05)


def test_a_delay_is_counted_from_the_change_and_not_from_the_row_nearest_to_it():
    """A watch that differentiates positions begins its first row some samples after the run."""
    frozen = Truth(("frozen",), 1, None)
    seen = watched(Change(AT + 0.051, "frozen", "b", 0.0, (0.0, 0.0)))
    outcome = judge("channel frozen", 1, frozen, JOINTS, replace(seen, t=seen.t + 0.009), AT)
    assert outcome.time == pytest.approx(0.051)
    assert outcome.motion == 0.0  # the row that ends 9 ms after the change lies before it
    outcome = judge("friction +20 %", 1, TRUTH, JOINTS, replace(watched(NAMED), t=seen.t + 0.009), AT)
    assert outcome.motion == pytest.approx(2.6)


@pytest.mark.parametrize("wrong", [{"joint": "a"}, {"kind": "gain"}, {"kind": "load"}, {"kind": "unknown"}])
def test_a_wrong_joint_or_kind_is_wrong(wrong):
    outcome = judged(replace(NAMED, **wrong), replace(SETTLED, **wrong))
    assert (outcome.name, outcome.settled, outcome.error) == ("wrong", "wrong", None)


@pytest.mark.parametrize(
    ("named", "name"),
    [
        (replace(NAMED, either="gain of b"), "either"),
        (replace(NAMED, kind="gain", either="friction of b"), "either"),
        (replace(NAMED, kind="gain", either="friction of a"), "wrong"),
        (replace(NAMED, kind="load", either="constant torque of b"), "wrong"),
    ],
)
def test_one_of_two_names_counts_as_that_if_one_is_right(named, name):
    assert judged(named).name == name
    assert judged(named).settled == "none"


def test_a_load_is_on_no_joint_and_may_be_the_other_of_two_names():
    truth = Truth(("load",), None, 1.0)
    assert judged(replace(NAMED, kind="load", joint="a"), truth=truth).name == "right"
    assert judged(replace(NAMED, either="a load"), truth=truth).name == "either"
    assert judged(NAMED, truth=truth).name == "wrong"


def test_what_is_said_too_early_is_no_answer_and_silence_is_none():
    outcome = judged(replace(NAMED, t=AT - 0.2))
    assert (outcome.name, outcome.early) == ("none", 1)
    outcome = judged(NAMED, replace(SETTLED, said="withdrawn"), replace(NAMED, t=60.0, joint="a"))
    assert (outcome.settled, outcome.more, outcome.covered) == ("withdrawn", 1, None)
    assert judged(NAMED, replace(SETTLED, interval=(0.21, 0.23))).covered is False


def test_false_alarms_are_counted_once_each_with_what_became_of_them():
    later = [replace(NAMED, t=t, said=said) for t, said in ((1, "named"), (2, "withdrawn"), (3, "named"))]
    assert [became for *_, became in alarms_of([(change.t, change) for change in later])] == ["withdrawn", "open"]


def test_marks_are_missed_by_wrong_names_late_ones_and_alarms():
    assert watch_page.likely(0.116) == 1
    assert watch_page.within([1.0] * 19 + [None], 0.95) == 1.0
    assert watch_page.within([1.0] * 18 + [None] * 2, 0.95) == np.inf
    clean, changes = quick()
    for spoil, mark in (
        ({"name": "wrong"}, "right name in 95 %, without"),
        ({"motion": 61.0}, "friction +20 %"),
        ({"motion": 2.2}, "5 % of rated"),
        ({"early": 1}, "the same before"),
    ):
        spoiled = {**changes, "outcomes": [{**o, **spoil} for o in changes["outcomes"]]}
        (line,) = (line for line in watch_page.marks_table([clean, spoiled]).splitlines() if f"| {mark}" in line)
        assert line.endswith("| **no** |"), line
    alarmed = {**clean, "alarms": [(1.0, "friction", "settled")]}
    assert (
        "at most one a day | 1 in 0.02 h; 0.001 are promised at most, on average | **no** |"
        in watch_page.marks_table([alarmed])
    )


@cache
def quick():
    """Results of a minute in which nothing changes, and of changes of every kind, of a seed for choosing."""
    clean = {"work": "clean", "seed": 3, "failure": None, **watch_clean(3, 60_000, FEW).to_json()}
    return clean, {"work": "changes", "seed": 3, "failure": None, **watch.examine(3, FEW)}


def test_an_arm_of_the_exam_is_silent_while_nothing_changes_and_names_what_does():
    clean, changes = quick()
    assert (clean["alarms"], clean["cycles"]) == ([], 60_000)
    assert max(changes["error"]) < 1.5
    told = {outcome["label"]: outcome for outcome in changes["outcomes"]}
    assert list(told) == list(CHANGES)
    for label, outcome in told.items():
        if label not in watch_page.FAULTS:
            assert outcome["name"] in ("right", "either"), outcome
            assert outcome["settled"] == "right", outcome
    text = watch_page.page(
        {"seed": 3, "cycles": 60_000, "cases": 1, "commit": "-"}, [clean, changes], "## Why\n\nSo.\n"
    )
    assert text.endswith("## Why\n\nSo.\n")
    assert "| friction +20 % | 1 |" in text


def test_an_arm_that_stops_with_an_error_is_counted():
    result = watch.work(("changes", -1, 0))
    assert result["failure"].startswith("ValueError")
    assert "Stopped with an error: 1." in "\n".join(watch_page._identified([result]))
    clean, changes = quick()
    marks = watch_page.marks_table([clean, changes, result])
    assert "| friction +20 % named within 60 s of motion | 1 of 2 | **no** |" in marks
    page = watch_page.page({"seed": 3, "cycles": 1, "cases": 2, "commit": "-"}, [clean, changes, result], "")
    assert "* friction +20 %, arm -1, stopped with an error: no name" in page
