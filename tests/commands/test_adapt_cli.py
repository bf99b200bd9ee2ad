"""`dynid estimate --adapt`: the log, both errors, another model, and what the page shows."""

import json
import re

import numpy as np
import pytest
from helpers.data import ROOT
from helpers.small_arm import dynid, refusal
from helpers.watched_arm import CHANGES, LOAD, model, recorded, write_runs

import dynid_rs as dyn
from dynid_rs.model.adapt import Adaptation

PAGE = ROOT / "docs" / "how_to" / "adapt.md"


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("adapted")
    model().save(folder / "model.json")
    runs = {
        "warm": recorded(80.0, 4109, change=CHANGES["friction grown"][0], at=20.0),
        "loaded": recorded(80.0, 4110, change=CHANGES["load"][0]),
    }
    write_runs(folder, runs)
    return folder, runs


def test_the_page_shows_what_the_command_prints(arm, tmp_path, monkeypatch):
    folder, _ = arm
    monkeypatch.chdir(tmp_path)
    printed = dynid(
        "estimate", folder / "model.json", folder / "warm.parquet", "--adapt", "friction", "--save-adapted", "NEW.json"
    )
    assert printed.exit_code == 0, printed.output
    page = PAGE.read_text(encoding="utf-8")
    command = "dynid estimate MODEL.json warm.parquet --adapt friction --save-adapted NEW.json\n```\n\n```text\n"
    shown = page.split(command)[1].split("```")[0]
    lines = [
        line for line in printed.stdout.splitlines() if "following" in line or " -> " in line or "NEW.json" in line
    ]
    assert shown.splitlines() == lines
    assert (tmp_path / "NEW.json").is_file()


def test_json_has_what_python_says(arm):
    folder, runs = arm
    done = dynid("estimate", folder / "model.json", folder / "warm.parquet", "--adapt", "friction", "--json")
    answer = json.loads(done.stdout)
    followed = Adaptation(model()).adapt(runs["warm"])
    before, after = followed.rmse()
    adaptation = answer["adaptation"]
    assert adaptation["rmse_before"] == before.tolist()
    assert adaptation["rmse"] == after.tolist()
    assert adaptation["factors"] == followed.factors[-1].tolist()
    assert [one["to"] for one in adaptation["log"]] == [one.now for one in followed.log]
    assert after[1] < 0.8 * before[1]
    # Of the model as it is, all is as without.
    plain = json.loads(dynid("estimate", folder / "model.json", folder / "warm.parquet", "--json").stdout)
    assert plain == {**answer, "adaptation": None}


def test_the_model_that_is_written_holds_the_load_and_the_first_one_stays(arm, tmp_path):
    folder, runs = arm
    before = (folder / "model.json").read_bytes()
    options = ("--adapt", "friction,payload", "--adapt-mass", 4, "--save-adapted", tmp_path / "new.json")
    printed = dynid("estimate", folder / "model.json", folder / "loaded.parquet", *options)
    assert printed.exit_code == 0, printed.output
    assert re.search(
        r"^payload at the end: (1\.[89]|2|2\.\d+) kg, first moments .* kg\*m$", printed.stdout, re.MULTILINE
    )
    assert re.search(r" s: payload \S+ -> \S+ kg$", printed.stdout, re.MULTILINE)
    assert (folder / "model.json").read_bytes() == before
    run = runs["loaded"]
    new, old = (dyn.TorqueModel.load(path) for path in (tmp_path / "new.json", folder / "model.json"))
    errors = [run.tau - one.evaluate(run.q, run.dq, run.ddq)[0] for one in (old, new)]
    without, with_it = (np.sqrt(np.mean(error**2)) for error in errors)
    assert with_it < 0.4 * without
    np.testing.assert_allclose((new.phi - old.phi)[-10:-6], LOAD, atol=0.3)
    np.testing.assert_array_equal(new.phi[:-10], old.phi[:-10])
    again = dynid("estimate", folder / "model.json", folder / "loaded.parquet", *options)
    assert again.exit_code == 2
    assert "--force" in again.output


def test_wrong_use_is_refused_in_a_sentence(arm, tmp_path):
    folder, _ = arm
    own = ("estimate", folder / "model.json", folder / "warm.parquet")
    for options, said in [
        (("--adapt", "gain"), "expected friction, payload or friction,payload"),
        (("--adapt", "payload"), "give --adapt-mass KG"),
        (("--adapt-mass", 3), "go with --adapt"),
        (("--adapt", "friction,friction"), "each once, got 'friction,friction'"),
        (("--adapt", "friction", "--adapt-mass", 3), "--adapt-mass is the limit of a payload"),
        (
            ("--adapt", "payload", "--adapt-mass", -3),
            "--adapt-mass: expected what the arm may carry, above 0 to 100000 kg",
        ),
        (("--adapt", "payload", "--adapt-mass", "nan"), "above 0 to 100000 kg, got nan"),
        (("--save-adapted", tmp_path / "x.json"), "go with --adapt"),
        (("--adapt", "friction", "--save-adapted", tmp_path / "x.csv"), "written as JSON"),
        (("--adapt", "friction", "--save-adapted", folder / "model.json", "--force"), "model.json"),
    ]:
        assert said in refusal(dynid(*own, *options)), options
    short = recorded(80.0, 4111)[:50]
    write_runs(tmp_path, {"short": short})
    done = dynid("estimate", folder / "model.json", tmp_path / "short.parquet", "--adapt", "friction")
    assert "shorter than a fifth of a second" in refusal(done)
