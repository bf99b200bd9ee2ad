"""`dynid contact`: what pushes an arm, in lines and as JSON, and thresholds for the estimator."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.run_files import write
from helpers.small_arm import dynid, refusal, run, write_robot
from helpers.watched_arm import model, recorded, write_runs
from numpy.testing import assert_allclose

import dynid_rs as dyn

PUSHED = (3.0, 4.0)


def pushed():
    run = recorded(6.0, 5)
    tau = run.tau.copy()
    tau[(run.t > PUSHED[0]) & (run.t < PUSHED[1]), 1] -= 60.0
    return replace(run, tau=tau)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model, two minutes of healthy runs, one in which the arm is pushed, and what is learned."""
    folder = tmp_path_factory.mktemp("pushed")
    model().save(folder / "model.json")
    runs = {"first": recorded(70.0, 1), "second": recorded(70.0, 2), "pushed": pushed(), "free": recorded(6.0, 6)}
    write_runs(folder, runs)
    healthy = ("--healthy", folder / "first.parquet", "--healthy", folder / "second.parquet")
    printed = dynid("contact", folder / "model.json", *healthy, "--save", folder / "contact.json")
    assert printed.exit_code == 0, printed.output
    assert f"settings: {folder / 'contact.json'}" in printed.stdout
    return folder


def test_a_push_is_said_with_its_joint_and_ends_with_1(folder):
    found = dynid(
        "contact", folder / "model.json", folder / "pushed.parquet", folder / "free.parquet",
        "--settings", folder / "contact.json", "--json",
    )  # fmt: skip
    assert found.exit_code == 1, found.output
    answer = json.loads(found.stdout)
    assert (answer["format"], answer["version"]) == ("dynid-contacts", 2)
    touched, free = answer["runs"]
    assert free["contacts"] == []
    assert answer["false_contacts_per_hour"] == 1.0
    assert touched["judged_seconds"] == pytest.approx(6.0, abs=0.1)
    assert touched["threshold"][1] < 60.0 / 2
    (contact,) = touched["contacts"]
    assert contact["joint"] == answer["joints"][1]
    assert contact["start"] == pytest.approx(PUSHED[0] + touched["delay"], abs=0.1)
    assert contact["end"] == pytest.approx(PUSHED[1] + touched["delay"], abs=0.3)
    assert contact["torque"] == pytest.approx(60.0, rel=0.3)


def test_people_read_lines(folder):
    said = dynid("contact", folder / "model.json", folder / "pushed.parquet", "--settings", folder / "contact.json")
    joint = model().robot.joint_names[1]
    lines = said.stdout.splitlines()
    assert sum("without contact off by" in line for line in lines) == model().robot.n_joints
    assert "pushed.parquet: 1 contact" in said.stdout
    assert f"on {joint}" in lines[-1]
    free = dynid("contact", folder / "model.json", folder / "free.parquet", "--settings", folder / "contact.json")
    assert free.exit_code == 0
    assert "free.parquet: nothing pushes the arm" in free.stdout


def test_the_table_holds_what_python_says(folder):
    out = folder / "external.parquet"
    run = folder / "pushed.parquet"
    dynid("contact", folder / "model.json", run, "--settings", folder / "contact.json", "-o", out)
    table = pq.read_table(out)
    said = dyn.MomentumObserver.load(folder / "contact.json", model()).observe(dyn.read_recording(run))
    for j in range(model().robot.n_joints):
        assert_allclose(np.asarray(table[f"external_{j}"]), said.external[:, j])
        assert_allclose(np.asarray(table[f"guide_{j}"]), said.guide[:, j])
    assert np.asarray(table["contact"]).tolist() == said.contact.tolist()


def test_fewer_false_contacts_are_higher_thresholds(folder):
    def threshold(rate):
        out = folder / "rate.parquet"
        options = ("--settings", folder / "contact.json", "--false-contacts", rate, "-o", out, "--force")
        dynid("contact", folder / "model.json", folder / "free.parquet", *options)
        return float(np.median(np.asarray(pq.read_table(out)["threshold_1"])))

    assert threshold("1/month") > threshold("60/hour")


def test_nothing_learned_is_said(folder):
    said = dynid("contact", folder / "model.json", folder / "pushed.parquet")
    assert "nothing was learned about false contacts" in said.stdout


@pytest.mark.parametrize("verb", ["diagnose", "identify"])
def test_what_its_runs_did_not_tell_raises_thresholds(tmp_path, verb):
    """The folder of a result says what its runs left unknown: a few seconds of motion."""
    robot = write_robot(tmp_path)
    short, test = (write(tmp_path / f"short_{k}.csv", run(k)) for k in range(2))
    dynid(verb, robot, short, "--test", test, "-o", tmp_path / "result")
    long = [write(tmp_path / f"long_{k}.csv", run(k, duration=40.0)) for k in range(3)]
    healthy = [part for path in long for part in ("--healthy", path)]
    for name in ("alone", "beside"):
        given = tmp_path / "result" / ("model.json" if name == "alone" else "")
        said = dynid("contact", given, *healthy, "--save", tmp_path / f"{name}.json")
        assert said.exit_code == 0, said.output
    alone, beside = (json.loads((tmp_path / f"{name}.json").read_text())["directions"] for name in ("alone", "beside"))
    assert alone == []
    assert len(beside) > 3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "no run to look at"),
        (("free.parquet", "--window", "-5"), "window: an odd number of samples from 5 to 101, found -5"),
        (("free.parquet", "--time-constant", "0"), "time_constant: a number of seconds from 1e-05 to 100, found 0"),
        (("free.parquet", "--healthy", "free.parquet"), "both looked at and said to be healthy"),
        (("free.parquet", "--healthy", "pushed.parquet"), "6 s of healthy runs are too few"),
        (("free.parquet", "-o", "x.csv"), "is written as Parquet; give it the ending .parquet"),
        (("--save", "x.json"), "name them with --healthy RUN"),
        (("free.parquet", "--settings", "contact.json", "--save", "x.json"), "--settings holds what"),
        (("free.parquet", "pushed.parquet", "-o", "x.parquet"), "--output is of one run"),
        (("free.parquet", "--settings", "contact.json", "--window", "5"), "--settings says which"),
        (("free.parquet", "--false-contacts", "seldom"), "--false-contacts: expected a number above 0 per hour"),
        (("free.parquet", "--false-contacts", "0/hour"), "--false-contacts: expected a number above 0 per hour"),
        (("free.parquet", "--settings", "first.parquet"), "first.parquet"),
        (("free.parquet", "-o", "free.parquet"), "free.parquet"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(folder, options, words):
    paths = [folder / text if "." in text else text for text in options]
    assert words in refusal(dynid("contact", folder / "model.json", *paths))


def test_what_is_to_be_saved_cannot_do_without_healthy_runs(folder, tmp_path):
    options = ("--healthy", folder / "pushed.parquet", "--save", tmp_path / "x.json")
    assert refusal(dynid("contact", folder / "model.json", *options)).endswith("name runs of two minutes in all")


def test_nothing_that_is_there_is_replaced_unasked_and_nothing_that_is_read_at_all(folder, tmp_path):
    (tmp_path / "found").mkdir()
    for name in ("model.json", "free.parquet"):
        (tmp_path / "found" / name).write_bytes((folder / name).read_bytes())
    run, settings = tmp_path / "found" / "free.parquet", ("--settings", folder / "contact.json")
    out = tmp_path / "out.parquet"
    out.write_text("mine")
    said = dynid("contact", tmp_path / "found", run, *settings, "-o", out)
    assert "there is one already" in refusal(said)
    assert out.read_text() == "mine"
    assert dynid("contact", tmp_path / "found", run, *settings, "-o", out, "--force").exit_code == 0
    assert out.read_bytes()[:4] == b"PAR1"
    inside = tmp_path / "found" / "model.json"
    healthy = ("--healthy", folder / "first.parquet", "--healthy", folder / "second.parquet", "--save", inside)
    assert "is read here and would be replaced" in refusal(dynid("contact", tmp_path / "found", *healthy, "--force"))
    assert inside.read_bytes() == (folder / "model.json").read_bytes()


def test_a_folder_without_a_model_is_called_that(folder, tmp_path):
    said = refusal(dynid("contact", tmp_path, folder / "free.parquet"))
    assert "holds no model.json" in said


def with_unit(text, unit):
    content = json.loads(text)
    return json.dumps(content | {"torque_unit": unit})


def test_thresholds_of_another_unit_or_rate_are_refused(folder, tmp_path):
    """Ampere's are a tenth of newton metres': a push was missed."""
    other = tmp_path / "ampere.json"
    other.write_text(with_unit((folder / "contact.json").read_text(), "A"))
    said = refusal(dynid("contact", folder / "model.json", folder / "pushed.parquet", "--settings", other))
    assert "in another unit than the model, which is in N*m" in said
    slow = rows_of(folder / "pushed.parquet", tmp_path / "slow.csv", slice(None, None, 4))
    said = refusal(dynid("contact", folder / "model.json", slow, "--settings", folder / "contact.json"))
    assert "recorded at 125 Hz, thresholds were learned at 500 Hz" in said


def test_what_other_runs_say_is_said_beside_one_that_cannot_be_read(folder, tmp_path):
    """A night of runs, one of which is damaged, or recorded at another rate."""
    slow = rows_of(folder / "pushed.parquet", tmp_path / "slow.csv", slice(None, None, 4))
    table = pq.read_table(folder / "free.parquet")
    columns = {name: np.asarray(table[name]) for name in table.column_names}
    columns["q_1"] = columns["q_1"] + 100.0 * (columns["t"] > 3)
    torn = write(tmp_path / "torn.parquet", columns)
    runs = (folder / "pushed.parquet", slow, torn, folder / "free.parquet")
    asked = ("contact", folder / "model.json", *runs, "--settings", folder / "contact.json")
    said = dynid(*asked)
    assert said.exit_code == 2
    assert "pushed.parquet: 1 contact" in said.stdout
    assert "free.parquet: nothing pushes the arm" in said.stdout
    first, second = said.stderr.splitlines()
    assert first.startswith("error: slow.csv: recorded at 125 Hz")
    assert second.startswith("error: torn.parquet")
    answer = json.loads(dynid(*asked, "--json").stdout)
    assert [len(one["contacts"]) for one in answer["runs"]] == [1, 0]
    assert answer["error"] == answer["errors"][0]
    assert answer["errors"][1]["file"] == "torn.parquet"
    alone = dynid("contact", folder / "model.json", torn, "--settings", folder / "contact.json", "--json")
    assert list(json.loads(alone.stdout)) == ["error"]


def rows_of(run, path, rows, *, names=None):
    """A file of some rows, and some columns, of a run."""
    table = pq.read_table(run)
    return write(path, {name: np.asarray(table[name])[rows] for name in names or table.column_names})


def test_the_table_of_a_run_with_a_gap_holds_all_its_parts(folder, tmp_path):
    t = np.asarray(pq.read_table(folder / "pushed.parquet")["t"])
    kept = (t < 2.0) | (t > 2.6)
    run, out = rows_of(folder / "pushed.parquet", tmp_path / "gap.csv", kept), tmp_path / "out.parquet"
    said = dynid("contact", folder / "model.json", run, "--settings", folder / "contact.json", "-o", out)
    assert said.exit_code == 1, said.output
    table = pq.read_table(out)
    assert len(table) == np.count_nonzero(kept)
    assert np.asarray(table["contact"]).any()


def test_a_run_that_is_shorter_than_the_filter_is_not_said_to_be_free(folder, tmp_path):
    names = ["t", *(f"{signal}_{j}" for signal in ("q", "tau") for j in range(model().robot.n_joints))]
    run = rows_of(folder / "free.parquet", tmp_path / "short.csv", slice(30), names=names)
    said = dynid("contact", folder / "model.json", run, "--window", "101")
    assert "could not be judged" in said.stdout
    assert "nothing pushes" not in said.stdout


@pytest.mark.parametrize(
    ("name", "value"), [("turning", [-1.0] * 6), ("directions", [{"phi": [1.0], "effects": [[1.0], [1.0]]}])]
)
def test_damaged_settings_are_refused_with_their_file_and_the_mend(folder, tmp_path, name, value):
    damaged = tmp_path / "damaged.json"
    content = json.loads((folder / "contact.json").read_text())
    assert len(content["turning"]) == 6
    damaged.write_text(json.dumps(content | {name: value}))
    said = refusal(dynid("contact", folder / "model.json", folder / "free.parquet", "--settings", damaged))
    assert f"{damaged}: damaged, or of another model" in said
    assert "write it anew with `dynid contact MODEL --healthy RUN --save`" in said
