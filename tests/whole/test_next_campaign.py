"""`tests/campaigns/next_experiment.py`: an arm that is moved on shows that motion; what is wrong is counted wrong."""

from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import next_experiment, next_page
from campaigns.next_arm import draw_arm
from campaigns.next_experiment import limits_of

from dynid_rs import FourierExcitation, RobotModel, read_recording

SEED = 7


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return draw_arm(SEED, tmp_path_factory.mktemp("arm"))


def test_the_minute_is_two_runs_and_one_for_the_test(arm):
    seconds = [read_recording(path).duration for path in (*arm.runs, arm.test)]
    assert seconds == pytest.approx([30.0, 30.0, 20.0], abs=0.1)
    assert len(arm.truth["effects"]) == 1


def test_what_is_recorded_is_the_motion_that_was_asked_for(arm):
    robot = RobotModel.from_urdf(arm.robot)
    design = FourierExcitation(duration=20.0, start=arm.limits["middle"], n_restarts=1, max_iter=3, random_state=0).fit(
        robot, limits_of(arm)
    )
    run = read_recording(arm.record(design.trajectory_.evaluate, 20.0, "more"))
    asked = design.trajectory_.evaluate(run.t - run.t[0])[0]
    assert run.duration == pytest.approx(20.0, abs=0.1)
    np.testing.assert_allclose(run.q, asked, atol=0.02)  # gears that yield, steps of encoders
    assert design.merit_.violations(limits_of(arm)) == 0


def case(open_, settled, kind="stribeck"):
    step = {"settled": settled, "named": settled, "tie": False, "false": 0}
    ways = {way: [step] for way in next_page.WAYS} if open_ else {}
    if open_:
        ways["designed"] = [{**step, "times": 2.0, "cpu_s": 3.0, "chances": [0.9]}]
    first = {"settled": not open_, "named": not open_, "tie": open_, "false": 0}
    questions = [{"kind": kind, "tie": True, "log_odds": 0.0}]
    return {"effect": kind, "open": open_, "failure": None, "ways": ways, "first": first, "questions": questions}


def test_the_page_counts_open_cases_alone():
    page = next_page.page(
        {"seed": 1, "minutes": 5.0, "commit": "abc"}, [case(True, True), case(True, False), case(False, True)]
    )
    assert "3 cases drawn" in page
    assert "2 open after a minute" in page
    assert "| designed (`dyn.next_experiment`) | 1 of 2 (50 %) | 1 of 2 (50 %) | 0 of 2 |" in page
    assert "In 2 of 2 open cases" in page


def test_a_way_that_stops_with_an_error_has_not_settled_its_case(monkeypatch):
    """It left the case out of all counts before, as one in which nothing had been open."""

    def fails(*_):
        raise ValueError("no motion keeps the limits")

    left = {"settled": False, "named": False, "tie": True, "false": 1}
    monkeypatch.setattr(next_experiment, "_planned", fails)
    monkeypatch.setattr(next_experiment, "judged", lambda arm, found: left)
    monkeypatch.setattr(next_experiment, "diagnosed", lambda *_: SimpleNamespace(asked=object()))
    monkeypatch.setattr(next_experiment, "draw_arm", lambda *_: DRAWN)
    monkeypatch.setattr(next_experiment.dyn.RobotModel, "from_urdf", lambda *_: None)
    monkeypatch.setattr(next_experiment, "_questions", lambda asked: [])
    stopped = next_experiment.examine(5)
    assert stopped["open"]
    assert stopped["ways"]["random"] == [{**left, "failure": "ValueError: no motion keeps the limits"}]
    page = next_page.page({"seed": 1, "minutes": 5.0, "commit": "abc"}, [case(True, True), stopped])
    assert "2 open after a minute" in page
    assert "| random | 1 of 2 (50 %) | 1 of 2 (50 %) | 1 of 2 |" in page
    assert "* 5, designed: ValueError: no motion keeps the limits" in page


DRAWN = SimpleNamespace(
    robot="robot.urdf",
    runs=[],
    truth={"effects": [{"kind": "stribeck", "ratio": 0.4}], "case": {"motion": "fourier"}},
)
