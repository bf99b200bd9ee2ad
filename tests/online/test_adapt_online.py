"""`dynid-estimator --adapt`: what follows in Python follows in the program, to the last bit."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from helpers import online_answers
from helpers.data import ROOT
from helpers.online_answers import csv_text, json_text
from helpers.watched_arm import CHANGES, model, recorded, watching

from dynid_rs.model.adapt import Adaptation

ADAPTED, AT_LIMIT, CONTACT, CHANGED = 16384, 32768, 2048, 8192
estimator = online_answers.estimator
"""The fixture that finds the binary."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("adapted")
    model().save(folder / "model.json")
    watching().save(folder / "watch.json")
    return folder


def states_of(run):
    return {"t": run.t, "q": run.q, "dq": run.dq, "ddq": run.ddq, "tau": run.tau}


@pytest.fixture(scope="module")
def harder():
    run = recorded(60.0, 4105, change=CHANGES["friction grown"][0], at=10.0)
    return run, states_of(run)


@pytest.fixture(scope="module")
def text(harder):
    return json_text(harder[1])


@pytest.fixture(scope="module")
def following(estimator, folder, text):
    """What the program says of that run, and its lines, while it follows friction."""
    done = answered(estimator, folder, text, *FRICTION)
    assert done.returncode == 0, done.stderr
    return done, [json.loads(line) for line in done.stdout.splitlines()]


def answered(estimator, folder, text, *options):
    command = [estimator, folder / "model.json", *options]
    return subprocess.run(command, input=text, capture_output=True, text=True, timeout=120, check=False)


FRICTION = ("--adapt", "friction")


def test_torques_log_and_sentences_are_those_of_python(harder, following):
    run, _ = harder
    followed = Adaptation(model()).adapt(run)
    done, lines = following
    np.testing.assert_array_equal([line["tau"] for line in lines], followed.tau)
    total = np.sum([list(line["terms"].values()) for line in lines], axis=1)
    np.testing.assert_allclose(total + [line["adaptation"] for line in lines], followed.tau, atol=1e-9)
    told = [(line["t"], line["adapted"]) for line in lines if "adapted" in line]
    assert [line["t"] for line in lines if line["status"] & ADAPTED] == [t for t, _ in told]
    assert len(told) == len(followed.log) >= 3
    for (t, one), expected in zip(told, followed.log, strict=True):
        assert (t, one["part"], run.joints[one["joint"]]) == (expected.t, expected.part, expected.joint)
        assert (one["from"], one["to"], one["reason"]) == (expected.before, expected.now, expected.reason)
        assert one["estimate"] - 1.96 * one["std"] == pytest.approx(expected.interval[0], rel=1e-4)
    sentences = [line for line in done.stderr.splitlines() if line.startswith("adapted: ")]
    assert len(sentences) == len(told)
    assert all(f"{run.joints[1]}: friction times 1." in sentence for sentence in sentences)
    assert f"```text\n{done.stderr}```" in (ROOT / "docs" / "how_to" / "adapt.md").read_text(encoding="utf-8")


def test_rows_have_columns_of_their_own(estimator, folder, harder):
    _, states = harder
    done = answered(estimator, folder, csv_text(states), *FRICTION)
    head, *rows = done.stdout.splitlines()
    names = head.split(",")
    assert names[-7:] == [*(f"adaptation_{j}" for j in range(6)), "status"]
    last = dict(zip(names, map(float, rows[-1].split(",")), strict=True))
    terms = [name[:-2] for name in names if name.endswith("_1") and name not in ("tau_1", "std_1")]
    assert sum(last[f"{name}_1"] for name in terms) == pytest.approx(last["tau_1"], abs=1e-9)
    assert last["adaptation_1"] != 0


def test_without_it_every_byte_is_as_before_and_with_it_before_it_has_moved(estimator, folder, harder, text):
    run, states = harder
    plain = answered(estimator, folder, text)
    total = model().evaluate(run.q, run.dq, run.ddq)[0]
    np.testing.assert_array_equal([json.loads(line)["tau"] for line in plain.stdout.splitlines()], total)
    assert "adapt" not in plain.stdout
    rest = {name: values[:3000] for name, values in states.items()}
    rest |= {"dq": 0.0 * rest["dq"], "ddq": 0.0 * rest["ddq"]}
    plain, following = (answered(estimator, folder, csv_text(rest), *options) for options in ((), FRICTION))
    zeros = ",".join(["0.0"] * 6)
    for one, other in zip(plain.stdout.splitlines()[1:], following.stdout.splitlines()[1:], strict=True):
        head, _, status = one.rpartition(",")
        assert other == f"{head},{zeros},{status}"


def test_the_watch_says_what_is_followed_and_the_observer_does_not(estimator, folder):
    """What friction has grown by is no contact once it is followed; that it has is said all the same."""
    run = recorded(60.0, 4106, change=lambda terms, load: 0.9 * CHANGES["friction grown"][0](terms, load), at=10.0)
    text = json_text(states_of(run))
    options = ("--observe", "--changes", folder / "watch.json")
    lines = {}
    for name, more in {"without": (), "with": FRICTION}.items():
        done = answered(estimator, folder, text, *options, *more)
        lines[name] = [json.loads(line) for line in done.stdout.splitlines()]
    for key in ("change", "terms", "std"):
        assert [line.get(key) for line in lines["with"]] == [line.get(key) for line in lines["without"]]
    late = {name: [np.abs(line["external"][1]) for line in own[-10_000:]] for name, own in lines.items()}
    assert np.mean(late["with"]) < 0.6 * np.mean(late["without"])


def test_a_push_is_not_followed_with_an_observer(estimator, folder):
    """A hand that brakes a joint: friction itself, but for its size."""
    brake = CHANGES["friction grown"][0]
    run = recorded(45.0, 4107, change=lambda terms, load: 20.0 * brake(terms, load), at=20.0)
    lines = {}
    for options in ((), ("--observe",)):
        done = answered(estimator, folder, json_text(states_of(run)), *FRICTION, *options)
        own = [json.loads(line) for line in done.stdout.splitlines()]
        lines[options] = np.abs([line["adaptation"] for line in own]).max(axis=1)
        if options:
            contact = np.array([line["status"] & CONTACT > 0 for line in own])
            assert contact[run.t > 21].mean() > 0.7
    assert lines[()][run.t > 21].max() > 5
    assert lines[("--observe",)][run.t > 21].max() < 0.2 * lines[()][run.t > 21].max()


def test_a_payload_follows_within_what_the_arm_may_carry(estimator, folder):
    run = recorded(80.0, 4108, change=CHANGES["load"][0])
    done = answered(estimator, folder, json_text(states_of(run)), "--adapt", "friction,payload", "--adapt-mass", "1")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    told = [line["adapted"] for line in lines if "adapted" in line and line["adapted"]["part"] == "payload"]
    stopped = [one for one in told if one["reason"] == "limit"]
    assert stopped
    assert all(one["to"] == 1.0 and one["estimate"] > 1.0 for one in stopped)
    assert max(one["to"] for one in told) == 1.0
    assert lines[-1]["status"] & AT_LIMIT
    assert "payload " in done.stderr
    assert "kg, stopped at its limit" in done.stderr


def test_what_was_learnt_survives_a_restart(estimator, folder, harder, tmp_path):
    run, states = harder
    cut = run.n_samples // 2
    first, second = ({name: x[part] for name, x in states.items()} for part in (slice(cut), slice(cut, None)))
    file = tmp_path / "known.json"
    for options in ((), ("--changes", folder / "watch.json")):
        file.unlink(missing_ok=True)
        done = answered(estimator, folder, json_text(first), *FRICTION, *options, "--remember", file)
        assert done.returncode == 0, done.stderr
        if not options:
            assert file.read_text() == Adaptation(model()).adapt(run[:cut]).remembered
        done = answered(estimator, folder, json_text(second), *FRICTION, *options, "--remember", file)
        begun = np.array(json.loads(done.stdout.splitlines()[0])["adaptation"])
        assert np.abs(begun).max() > 0.5
        other = answered(
            estimator, folder, json_text(second), *FRICTION, *options, "--adapt-memory", "30", "--remember", file
        )
        assert "of other settings" in other.stderr
        assert np.abs(json.loads(other.stdout.splitlines()[0])["adaptation"]).max() == 0.0
    spoiled = file.read_bytes().replace(b'numbers":[', b'numbers":[7,', 1)
    file.write_bytes(spoiled)
    options = ("--adapt-memory", "30", "--changes", folder / "watch.json")
    done = answered(estimator, folder, json_text(second), *FRICTION, *options, "--remember", file)
    assert (done.returncode, done.stdout) == (2, "")
    assert "remove this one to begin anew" in done.stderr
    assert file.read_bytes() == spoiled


def test_torques_that_are_no_numbers_move_nothing(estimator, folder, harder, following):
    _, states = harder
    tau = states["tau"].copy()
    tau[20_000:20_003] = 1.7e308
    tau[21_000] = -1e154
    tau[22_000] = 9e99
    spoiled = answered(estimator, folder, json_text({**states, "tau": tau}), *FRICTION)
    one = np.array([line["tau"] for line in following[1]])
    other = np.array([json.loads(line)["tau"] for line in spoiled.stdout.splitlines()])
    assert np.all(np.isfinite(other))
    assert np.abs(one - other).max() < 0.3


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--adapt", "gain"), "expected friction, payload or friction,payload"),
        (("--adapt", "payload"), "give --adapt-mass KG"),
        (("--adapt-mass", "3"), "go with --adapt"),
        (("--adapt", "friction", "--adapt-factor", "1.5:2"), "expected LEAST:MOST"),
        (("--adapt", "friction", "--adapt-memory", "0"), "expected seconds of motion"),
        (("--adapt", "friction", "--adapt-reach", "nan"), "expected m"),
    ],
)
def test_wrong_use_is_one_sentence(estimator, folder, options, said):
    done = answered(estimator, folder, "", *options)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert said in done.stderr


def test_states_without_a_torque_are_refused(estimator, folder, harder):
    states = {name: values[:10] for name, values in harder[1].items() if name != "tau"}
    done = answered(estimator, folder, json_text(states), *FRICTION)
    assert done.returncode == 2
    assert "--adapt need the measured torque of every joint" in done.stderr
