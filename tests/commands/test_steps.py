"""Which step, of how many, and how long still."""

import re

import pytest

import dynid_rs.commands.diagnose as diagnose
from dynid_rs.commands import _job
from dynid_rs.commands._steps import Step, Steps, shown_time

PLAN = (Step(1, "reading"), Step(3, "search"), Step(1, "writing"))


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_words_belong_to_the_step_that_they_open_or_that_is_open(clock):
    steps = Steps(PLAN, clock)
    told = []
    for words in ("reading", "run_1.csv", "search 1 of 4 finished", "writing"):
        steps.say(words)
        told.append(steps.line())
    assert told == [
        "step 1 of 3: reading",
        "step 1 of 3: run_1.csv",
        "step 2 of 3: search 1 of 4 finished",
        "step 3 of 3: writing",
    ]


def test_the_time_that_is_left_follows_the_share_that_is_done(clock):
    steps = Steps(PLAN, clock)
    steps.say("reading")
    clock.now += 8
    assert steps.seconds_left is None  # nothing is done
    steps.say("search 2 of 4 finished")  # 1 + 3 / 2 of 5
    assert steps.seconds_left == pytest.approx(8)
    clock.now += 3
    assert steps.seconds_left == pytest.approx(5)
    assert steps.line().endswith("(about 5 s left)")
    clock.now += 60
    assert steps.seconds_left == 0.0
    steps.say("writing")
    assert steps.seconds_left == pytest.approx(71 / 4)


def test_steps_do_not_run_backwards(clock):
    steps = Steps(PLAN, clock)
    steps.say("writing")
    steps.say("reading")
    assert steps.line().startswith("step 3 of 3: reading")


def test_without_a_plan_there_are_the_words_alone(clock):
    steps = Steps((), clock)
    steps.say("3 of 5 robots")
    assert steps.line() == "3 of 5 robots"


@pytest.mark.parametrize(
    ("seconds", "said"), [(0, "1 s"), (89, "89 s"), (91, "2 min"), (3600, "60 min"), (5400, "1 h 30 min")]
)
def test_times_are_said_as_a_person_would(seconds, said):
    assert shown_time(seconds) == said


@pytest.mark.parametrize("plan", [_job.STEPS, diagnose.STEPS], ids=["identify", "diagnose"])
def test_what_is_said_on_the_way_opens_its_step(plan, monkeypatch, tmp_path):
    """The plans name words that the rooms below say; a step whose words changed would never come."""
    from contextlib import contextmanager

    from helpers.small_arm import dynid, write_robot, write_runs

    said = []

    @contextmanager
    def listening(*given):
        assert given == tuple(plan)
        yield said.append

    monkeypatch.setattr("dynid_rs.commands._console.progress", listening)
    name = "identify" if plan is _job.STEPS else "diagnose"
    dynid(name, write_robot(tmp_path), *write_runs(tmp_path), "-o", tmp_path / "out")
    optional = {"physically consistent parameters"}
    for step in plan:
        assert set(step.begins) & optional or any(words.startswith(step.begins) for words in said), step
    steps = Steps(plan)
    places = []
    for words in said:
        steps.say(words)
        places.append(int(re.match(r"step (\d+) of", steps.line())[1]))
    assert places == sorted(places)
    assert places[-1] == len(plan)
