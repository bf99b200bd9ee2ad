"""`tests/campaigns/loop.py`: the oracle knows what it is told and no more; motions are played as they were planned."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from campaigns import loop, loop_page
from campaigns.loop_arm import Oracle, draw_unknown, error_of
from campaigns.loop_ways import SECONDS, Ways, played
from exam.declared import Band
from exam.hidden import shown_torque
from helpers.small_arm import dynid

import dynid_rs as dyn

SEED = 8


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return draw_unknown(SEED, tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def runs(arm):
    ways = Ways(arm)
    return [arm.played[ways.random(k)] for k in range(3)]


def test_the_oracle_errs_by_the_noise_and_less_with_more_runs(arm, runs):
    one, three = Oracle(arm, runs[:1]), Oracle(arm, runs)
    np.testing.assert_allclose(one.noise, three.noise, rtol=1e-9)
    assert (three.error > 0.9 * three.noise).all()
    assert (three.error < 1.3 * three.noise).all()
    assert np.mean(one.error / one.noise) > np.mean(three.error / three.noise)


def test_the_error_of_a_model_that_is_right_is_the_noise_of_the_channels(arm, runs, tmp_path):
    """Estimates that are the arm's torque without noise, written as `dynid estimate` writes them."""
    oracle, s = Oracle(arm, runs), arm.exam.world.runs[-1]
    torque = shown_torque(arm.exam, s)[:: s.every] * arm.exam.world.amperes
    path = tmp_path / "estimates.parquet"
    columns = {"t": s.recorded.t[::2]} | {f"tau_{j}": column[::2] for j, column in enumerate(torque.T)}
    pq.write_table(pa.table(columns), path)
    noise = error_of(arm, path, oracle)
    assert (noise > 0).all()
    assert (noise < 1.2 * oracle.noise).all()  # steps of encoders are in the oracle's noise, too
    assert len(oracle.counted) == len(Band(arm.exam.world.case.rate).instants(len(s.recorded.t)))


def test_a_planned_motion_is_played_as_it_was_planned(arm):
    ways = Ways(arm)
    plan = arm.folder / "quick.csv"
    quick = ("--duration", SECONDS, "--restarts", 1, "--iterations", 2)
    dynid("excite", arm.robot, "-o", plan, "--limits", ways.limits_file, *quick)
    path = arm.record(played(plan), SECONDS, "quick", 1)
    run, table = dyn.read_recording(path), pc.read_csv(plan)
    q = np.column_stack([np.asarray(table[f"q_{j}"]) for j in range(run.q.shape[1])])
    t = np.asarray(table["t"])
    planned = np.column_stack([np.interp(run.t - run.t[0], t, column) for column in q.T])
    np.testing.assert_allclose(run.q, planned, atol=0.02)  # steps of encoders, gears that yield
    other = dyn.read_recording(arm.record(played(plan), SECONDS, "again", 2))
    assert not np.array_equal(run.tau, other.tau)  # its own noise


def step(seconds, error, right=1, false=0, **more):
    told = {"seconds": seconds, "error": error, "worst": error, "right": right, "hidden": 1, "false": false}
    return told | {"ties": 0, "named": []} | more


def test_the_page_names_every_commit_that_its_figures_are_of(tmp_path, monkeypatch):
    """A campaign goes on where it broke off, and the program may be another one by then."""
    kept, page = tmp_path / "kept.json", tmp_path / "loop.md"
    steps = [step(20.0, 1.02, wanted=False)]
    arm = {"seed": 1, "kinds": [], "failure": None, "ways": dict.fromkeys(loop_page.WAYS, steps)}
    kept.write_text(json.dumps({"invocation": {"seed": 7, "arms": 2, "commit": "before"}, "arms": [arm]}))
    monkeypatch.setattr(loop, "examine", lambda seed, ends: {**arm, "seed": 2})
    monkeypatch.setattr(loop, "commit", lambda: "after")
    loop.main(["--seed", "7", "--arms", "2", "--keep", str(kept), "--page", str(page)])
    assert "at commit before, after. Arms" in page.read_text(encoding="utf-8")
    assert [one.get("commit") for one in json.loads(kept.read_text())["arms"]] == [None, "after"]


def test_the_page_says_what_was_needed_and_what_was_not_reached():
    loop = [step(20.0, 1.5, wanted=True), step(40.0, 1.02, wanted=False)]
    slow = [step(20.0 * k, 2.0 - k / 4) for k in range(1, 5)]
    arm = {"seed": 1, "kinds": ["stribeck"], "failure": None, "ways": {"loop": loop, "exciting": slow, "random": slow}}
    failed = {"seed": 2, "kinds": [], "failure": "diagnose: no", "ways": {}}
    page = loop_page.page({"seed": 7, "arms": 2, "commit": "abc"}, [arm, failed])
    assert "| the loop ends with an error within 5 % of the oracle's | 1 of 2 arms | **no** |" in page
    assert "needs | 1 of 2 arms | **no** |" in page
    assert "| 1 | stribeck | loop | 2 (said so) | 40 | 1 of 1 | 0 | 1.02 (1.02) | 40 |" in page
    assert "|  |  | exciting | 2 | 40 | 1 of 1 | 0 | 1.5 (1.5) | 80 |" in page
    assert "* 2: diagnose: no" in page
    assert "oracle's | 1 of 1 arms | yes |" in loop_page.tables([arm])
    assert loop_page.seconds_needed([step(20.0, 1.06)]) == np.inf
