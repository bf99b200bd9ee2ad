"""`dynid-estimator --changes`: what the watch of Python says of a run, the program says of its states."""

from __future__ import annotations

import json
import subprocess
from subprocess import PIPE

import numpy as np
import pytest
from helpers import online_answers
from helpers.online_answers import csv_text, json_text
from helpers.watched_arm import CHANGES, model, recorded, watching

from dynid_rs import FormatError, Watch

CHANGED, CONTACT, MISSING = 8192, 2048, 8
estimator = online_answers.estimator
"""The fixture that finds the binary."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model and the settings of its watch."""
    folder = tmp_path_factory.mktemp("watched")
    model().save(folder / "model.json")
    watching().save(folder / "watch.json")
    return folder


@pytest.fixture(scope="module")
def harder():
    """A run with a change at 10 s, and its states."""
    run = recorded(40.0, 5, change=CHANGES["friction grown"][0], at=10.0)
    return run, {"t": run.t, "q": run.q, "dq": run.dq, "ddq": run.ddq, "tau": run.tau}


def answered(estimator, folder, text, *options):
    command = [estimator, folder / "model.json", "--changes", folder / "watch.json", *options]
    return subprocess.run(command, input=text, capture_output=True, text=True, timeout=120, check=False)


def test_settings_that_were_saved_watch_as_before(folder, harder):
    loaded, learned = Watch.load(folder / "watch.json", model()), watching()
    np.testing.assert_array_equal(loaded.inflation_, learned.inflation_)
    np.testing.assert_array_equal(loaded.memory_, learned.memory_)
    assert loaded.watch(harder[0]).changes == learned.watch(harder[0]).changes


def test_lines_and_sentences_say_what_python_says(estimator, folder, harder):
    run, states = harder
    said = watching().watch(run).changes
    assert [change.said for change in said] == ["named", "settled"]
    done = answered(estimator, folder, json_text(states))
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    told = [(line["t"], line["change"]) for line in lines if "change" in line]
    assert [t for t, _ in told] == [change.t for change in said]
    for (_, one), change in zip(told, said, strict=True):
        assert (one["kind"], run.joints[one["joint"]], one["said"]) == (change.kind, change.joint, change.said)
        assert one["size"] == change.size
        assert one["size"] - 1.96 * one["std"] == pytest.approx(change.interval[0], rel=1e-4)
    assert [line["t"] for line in lines if line["status"] & CHANGED] == [t for t, _ in told]
    sentences = [line for line in done.stderr.splitlines() if line.startswith("change: ")]
    assert len(sentences) == 2
    assert f"{said[0].t:.1f} s: {said[0].joint}: friction +" in sentences[0]
    assert sentences[1].endswith("(settled)")


def test_rows_say_it_in_their_status(estimator, folder, harder):
    run, states = harder
    done = answered(estimator, folder, csv_text(states))
    assert done.returncode == 0, done.stderr
    status = [int(line.rpartition(",")[2]) for line in done.stdout.splitlines()[1:]]
    changed = np.flatnonzero(np.array(status) & CHANGED)
    assert run.t[changed].tolist() == [change.t for change in watching().watch(run).changes]


def test_an_observer_does_not_deafen_the_watch(estimator, folder):
    """A constant torque is a contact too, for as long as it lasts."""
    change, kind, joint, size = CHANGES["offset"]
    run = recorded(50.0, 5, change=lambda terms, load: 3 * change(terms, load), at=10.0)
    states = {"t": run.t, "q": run.q, "dq": run.dq, "ddq": run.ddq, "tau": run.tau}
    done = answered(estimator, folder, json_text(states), "--observe")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert np.mean([line["status"] & CONTACT > 0 for line in lines if line["t"] > 12]) > 0.5
    named, settled = [line["change"] for line in lines if "change" in line]
    assert (named["kind"], named["joint"], settled["said"]) == (kind, joint, "settled")
    assert settled["size"] == pytest.approx(3 * size, rel=0.1)


def test_torques_that_are_no_numbers_are_none(estimator, folder, harder):
    run, states = harder
    tau = states["tau"].copy()
    tau[1000:1003] = 1.7e308
    tau[2000] = -1e154
    lines = answered(estimator, folder, json_text({**states, "tau": tau})).stdout.splitlines()
    status = [json.loads(line)["status"] for line in lines]
    assert [k for k, bits in enumerate(status) if bits & MISSING] == [1000, 1001, 1002, 2000]
    told = [json.loads(line)["change"] for line in lines if '"change"' in line]
    assert [(one["kind"], one["said"]) for one in told] == [("friction", "named"), ("friction", "settled")]
    assert run.n_samples == len(lines)


def test_every_change_of_a_long_log_is_said(estimator, folder, harder):
    """A log is read in a blink, and its lines say as much as its sentences; so they do before a line that is broken."""
    _, states = harder
    n, parts = len(states["t"]), 6
    many = {name: np.concatenate([values] * parts) for name, values in states.items()}
    many["t"] = 0.002 * np.arange(parts * n)
    done = answered(estimator, folder, json_text(many) + "broken\n")
    assert done.returncode == 2
    said = [line for line in done.stderr.splitlines() if line.startswith("change: ")]
    assert len(said) == done.stdout.count('"change"') > 4


def test_positions_alone_are_watched_too(estimator, folder, harder):
    _, states = harder
    done = answered(estimator, folder, json_text({name: states[name] for name in ("t", "q", "tau")}), "--step", "0.002")
    told = [json.loads(line)["change"] for line in done.stdout.splitlines() if '"change"' in line]
    assert [one["kind"] for one in told] == ["friction", "friction"]
    assert told[1]["size"] == pytest.approx(0.2, rel=0.15)


def test_nothing_is_said_where_nothing_has_changed(estimator, folder):
    run = recorded(40.0, 6)
    states = {"t": run.t, "q": run.q, "dq": run.dq, "ddq": run.ddq, "tau": run.tau}
    done = answered(estimator, folder, json_text(states))
    assert done.returncode == 0
    assert "change" not in done.stdout + done.stderr


def test_states_without_a_torque_are_refused(estimator, folder, harder):
    states = {name: values for name, values in harder[1].items() if name != "tau"}
    done = answered(estimator, folder, json_text(states))
    assert done.returncode == 2
    assert "--changes and --adapt need the measured torque of every joint" in done.stderr


def test_settings_of_another_arm_are_refused(estimator, folder, tmp_path):
    said = json.loads((folder / "watch.json").read_text())
    said["joints"][2] = "elsewhere"
    (tmp_path / "watch.json").write_text(json.dumps(said))
    command = [estimator, folder / "model.json", "--changes", tmp_path / "watch.json"]
    done = subprocess.run(command, input="", capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "--changes: the joints of the file are not those of the model" in done.stderr
    with pytest.raises(FormatError, match="of an arm with other joints"):
        Watch.load(tmp_path / "watch.json", model())


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda text: text[: len(text) // 2], "EOF"),
        (lambda text: text.replace("dynid-watch-settings", "dynid-model"), "not a watch's settings"),
        (lambda text: text.replace('"version": 3', '"version": 7'), "version 7"),
        (lambda text: text.replace('"row": 0.2', '"row": -1'), "row"),
        (lambda text: text.replace('"row": 0.2', '"row": 1e999'), "out of range"),
        (lambda text: text.replace('"joints": [', '"joints": ["one more",'), "values of inflation for 7 joints"),
        (lambda text: "[" * 100_000, "not a watch's settings"),
        (lambda text: text.replace('"memory"', '"\\u001b[31mmemory"'), "unknown field"),
    ],
    ids=["cut", "format", "newer", "range", "infinite", "length", "deep", "unknown"],
)
def test_files_that_are_no_settings_are_refused_in_one_sentence(estimator, folder, tmp_path, spoil, said):
    path = tmp_path / "watch.json"
    text = (folder / "watch.json").read_text()
    path.write_text(spoil(text))
    assert path.read_text() != text
    with pytest.raises(FormatError, match="write it anew") as refused:
        Watch.load(path, model())
    assert said in str(refused.value)
    command = [estimator, folder / "model.json", "--changes", path]
    done = subprocess.run(command, input="", capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert said in done.stderr
    assert "\x1b" not in done.stderr


def parts(states, at):
    return [{name: part(values) for name, values in states.items()} for part in (lambda x: x[:at], lambda x: x[at:])]


def test_what_was_known_survives_a_restart(estimator, folder, harder, tmp_path):
    """In two runs of the program a change is said as in one, and as in Python, which goes on with the same file."""
    run, states = harder
    whole = watching().watch(run).changes
    cut = int(np.searchsorted(run.t, whole[0].t + 5.0))
    first, second = parts(states, cut)
    file = tmp_path / "known.json"
    done = answered(estimator, folder, json_text(first), "--remember", file)
    assert done.stderr.count("change: ") == 1
    # As much as Python knows by then, to the last bit.
    assert file.read_text() == watching().watch(run[:cut]).remembered
    known = file.read_text()
    done = answered(estimator, folder, json_text(second), "--remember", file)
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("change: "))
    assert line.endswith("(settled)")
    assert file.read_text() == watching().watch(run[cut:], remembered=known).remembered
    assert list(tmp_path.iterdir()) == [file]


def test_what_is_of_another_model_is_not_used_and_what_is_none_is_not_replaced(estimator, folder, harder, tmp_path):
    run, states = harder
    file = tmp_path / "known.json"
    other = Watch(model()).watch(run)  # of other settings
    file.write_text(other.remembered)
    done = answered(estimator, folder, json_text(states), "--remember", file)
    assert done.returncode == 0
    assert "note: " in done.stderr
    assert "the watch begins anew" in done.stderr
    assert done.stderr.count("change: ") == 2
    assert file.read_text() == watching().watch(run).remembered
    for spoiled in (b"", b"{}", file.read_bytes()[:-20], file.read_bytes().replace(b"[0.0,0.0", b"[7.0,0.0", 1)):
        file.write_bytes(spoiled)
        done = answered(estimator, folder, json_text(states), "--remember", file)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.count("\n") == 1
        assert f"{file}: " in done.stderr
        assert file.read_bytes() == spoiled
    model_before = (folder / "model.json").read_bytes()
    assert answered(estimator, folder, json_text(states), "--remember", folder / "model.json").returncode == 2
    assert (folder / "model.json").read_bytes() == model_before


def test_what_could_not_be_kept_is_an_error_at_the_end(estimator, folder, harder, tmp_path):
    """The answers and the report of times are there; the exit code says that what was learned is not."""
    _, states = harder
    away = tmp_path / "away"
    away.mkdir()
    command = [estimator, folder / "model.json", "--changes", folder / "watch.json", "--remember", away / "known.json"]
    first, *rest = json_text({name: values[:5000] for name, values in states.items()}).splitlines(keepends=True)
    with subprocess.Popen([*command, "--histogram"], stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True) as process:
        process.stdin.write(first)
        process.stdin.flush()
        answer = process.stdout.readline()
        away.rmdir()
        answers, said = process.communicate("".join(rest), timeout=120)
    assert process.returncode == 2
    assert (answer + answers).count("\n") == 1 + len(rest)
    (line,) = (line for line in said.splitlines() if "--remember" in line)
    assert line.startswith(f"error: --remember: {away / 'known.json'}: ")
    assert "p99" in said  # the report of times


def test_remembering_needs_a_watch(estimator, folder):
    command = [estimator, folder / "model.json", "--remember", "x"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--remember goes with --changes" in done.stderr
