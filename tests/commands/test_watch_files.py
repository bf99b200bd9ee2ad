"""`dynid watch --report, --prometheus, --ros`: each alone and all together, whole or not at all."""

import json
import os
import re

import pytest
from helpers.data import ROOT
from helpers.small_arm import dynid, refusal
from helpers.watched_arm import CHANGES, model, recorded, write_runs
from prometheus_client.parser import text_string_to_metric_families

OPTIONS = {"--report": "health.html", "--prometheus": "watch.prom", "--ros": "ros.json"}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The model's file, two healthy runs, and one with a change at 20 s."""
    folder = tmp_path_factory.mktemp("watched")
    model().save(folder / "model.json")
    runs = {
        "first": recorded(40.0, 1),
        "second": recorded(40.0, 2),
        "same": recorded(40.0, 3),
        "harder": recorded(60.0, 5, change=CHANGES["friction grown"][0], at=20.0),
    }
    write_runs(folder, runs)
    return folder


def watched(arm, *runs, options=(), healthy=True):
    learned = ("--healthy", arm / "first.parquet", "--healthy", arm / "second.parquet") if healthy else ()
    return dynid("watch", arm / "model.json", *(arm / f"{run}.parquet" for run in runs), *learned, *options)


def all_in(folder):
    return [part for option, name in OPTIONS.items() for part in (option, folder / name)]


def test_all_of_them_with_json_and_settings_say_the_same(arm, tmp_path):
    settings = tmp_path / "watch.json"
    printed = watched(arm, "same", "harder", options=[*all_in(tmp_path), "--json", "--save", settings])
    assert printed.exit_code == 1, printed.output
    answer = json.loads(printed.stdout)
    settled = answer["runs"][1]["changes"][-1]
    joint = answer["joints"][1]
    page = (tmp_path / "health.html").read_text(encoding="utf-8")
    assert "<code>first.parquet</code>, <code>second.parquet</code>" in page
    assert "in 1 of 2\u00a0runs something has changed: friction of joint_2" in page
    found = series_of((tmp_path / "watch.prom").read_text(encoding="utf-8"))
    labels = frozenset({"robot": "six_axis", "joint": joint, "kind": "friction"}.items())
    sizes = {own: value for (name, own), value in found.items() if name == "dynid_watch_change_ratio" and value}
    assert sizes == {labels: settled["size"]}
    status = json.loads((tmp_path / "ros.json").read_text(encoding="utf-8"))["status"]
    assert [one["level"] for one in status] == [0, 2, 0, 0, 0, 0, 0]
    other = tmp_path / "again"
    other.mkdir()
    again = watched(arm, "same", "harder", options=[*all_in(other), "--settings", settings], healthy=False)
    assert again.exit_code == 1, again.output
    assert again.stdout.splitlines()[-3:] == [f"{option[2:]}: {other / name}" for option, name in OPTIONS.items()]
    for name in ("watch.prom", "ros.json"):
        assert (other / name).read_bytes() == (tmp_path / name).read_bytes()


def series_of(text):
    """Values of Prometheus' text by name and labels."""
    return {
        (one.name, frozenset(one.labels.items())): one.value
        for family in text_string_to_metric_families(text)
        for one in family.samples
    }


def test_the_how_to_shows_what_is_printed(arm, tmp_path):
    page = (ROOT / "docs" / "how_to" / "watch.md").read_text(encoding="utf-8")
    printed = watched(arm, "same", "harder", options=all_in(tmp_path))
    (said,) = (block for block in re.findall(r"```text\n(.*?)```", page, re.S) if "harder.parquet:" in block)
    lines = printed.stdout.replace(f"{tmp_path}/", "").splitlines()
    assert said.splitlines() == [line for line in lines if not line.startswith("warning:")]
    (shown,) = (block for block in re.findall(r"```text\n(.*?)```", page, re.S) if block.startswith("dynid_watch_"))
    found = series_of((tmp_path / "watch.prom").read_text(encoding="utf-8"))
    for series, value in series_of(shown).items():
        assert found[series] == pytest.approx(value, rel=1e-3), series
    message = json.loads((tmp_path / "ros.json").read_text(encoding="utf-8"))["status"][1]
    start = json.dumps({key: message[key] for key in ("level", "name", "message", "hardware_id")})
    assert f'{start[:-1]}, "values": [...]}}' in page


@pytest.mark.parametrize(("option", "name"), OPTIONS.items())
def test_each_alone_and_the_code_is_the_answer_s(arm, tmp_path, option, name):
    printed = watched(arm, "same", options=[option, tmp_path / name])
    assert printed.exit_code == 0, printed.output
    first, *_, last = printed.stdout.splitlines()
    assert (first, last) == ("same.parquet: nothing has changed", f"{option[2:]}: {tmp_path / name}")
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(("option", "name"), OPTIONS.items())
def test_what_cannot_be_written_is_said_in_a_sentence_before_any_work(arm, tmp_path, option, name):
    (tmp_path / "kept").write_text("kept")
    (tmp_path / "link").symlink_to(tmp_path / "kept")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for place, words in {
        "none/file": "does not exist; create it first",
        "folder": "this is a folder",
        "link": "this is a symbolic link",
        "pipe": "this is a pipe",
        "kept/file": "is not a folder",
    }.items():
        assert words in refusal(watched(arm, "same", options=[option, tmp_path / place]))
    for read in ("model.json", "same.parquet", "first.parquet"):
        content = (arm / read).read_bytes()
        assert "is read here and would be replaced" in refusal(watched(arm, "same", options=[option, arm / read]))
        assert (arm / read).read_bytes() == content
    assert f"no run to watch for {option}" in refusal(watched(arm, options=[option, tmp_path / name]))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "kept", "link", "pipe"]


def test_settings_that_are_read_are_not_replaced(arm, tmp_path):
    settings = tmp_path / "watch.json"
    watched(arm, options=["--save", settings])
    said = refusal(watched(arm, "same", options=["--settings", settings, "--ros", settings], healthy=False))
    assert "is read here and would be replaced" in said


def test_two_files_are_not_one(arm, tmp_path):
    both = ["--report", tmp_path / "one", "--ros", tmp_path / "sub" / ".." / "one"]
    (tmp_path / "sub").mkdir()
    assert "--report and --ros are to be two files" in refusal(watched(arm, "same", options=both))
    assert not (tmp_path / "one").exists()


@pytest.mark.parametrize(("option", "name"), [*OPTIONS.items(), ("--save", "watch.json")])
def test_what_no_watch_has_written_is_replaced_with_force_only(arm, tmp_path, option, name):
    """Recordings were replaced without a word; what a watch has written stays its own, run after run."""
    for content in ("t,q_0,tau_0\n0,1,2\n", '{"header": {}, "status": []}', "<!DOCTYPE html><title>Mine</title>", ""):
        (tmp_path / name).write_text(content)
        said = refusal(watched(arm, "same", options=[option, tmp_path / name]))
        assert said == (
            f"{tmp_path / name}: there is a file already, which no {option} of `dynid watch` has written; "
            "name another file, or replace it with --force"
        )
        assert (tmp_path / name).read_text() == content
    assert watched(arm, "same", options=[option, tmp_path / name, "--force"]).exit_code == 0
    written = (tmp_path / name).read_bytes()
    assert watched(arm, "harder", options=[option, tmp_path / name]).exit_code == 1
    assert (tmp_path / name).read_bytes() != written or option == "--save"


def test_what_one_option_has_written_another_does_not_replace(arm, tmp_path):
    """Exchanged names are a slip."""
    written = {**OPTIONS, "--save": "watch.json"}
    assert watched(arm, "same", options=[*all_in(tmp_path), "--save", tmp_path / "watch.json"]).exit_code == 0
    for option in written:
        for other, name in written.items():
            if option != other:
                said = refusal(watched(arm, "same", options=[option, tmp_path / name]))
                assert f"which no {option} of `dynid watch` has written" in said
