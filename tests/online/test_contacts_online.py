"""`dynid-estimator --observe --contacts --guide`: what Python's observer says of a run, and a hand in the loop."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from helpers import online_answers
from helpers.online_answers import csv_text, json_text
from helpers.watched_arm import STEP, model, recorded

import dynid_rs as dyn
from dynid_rs.model.assembly import with_parts

estimator = online_answers.estimator
"""The fixture that finds the binary."""
N = 6


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A model and what healthy runs say of its observer."""
    folder = tmp_path_factory.mktemp("guided")
    model().save(folder / "model.json")
    observer = dyn.MomentumObserver(model(), false_contacts_per_hour=1.0)
    observer.fit([recorded(70.0, seed) for seed in (1, 2)]).save(folder / "contact.json")
    return folder


def answered(estimator, folder, text, *options):
    command = [estimator, folder / "model.json", *options]
    return subprocess.run(command, input=text, capture_output=True, text=True, timeout=120, check=False)


def pushed():
    run = recorded(6.0, 5)
    tau = run.tau.copy()
    tau[(run.t > 3) & (run.t < 4), 1] -= 60.0
    return replace(run, tau=tau)


def test_lines_say_what_python_says(estimator, folder):
    run = pushed()
    said = dyn.MomentumObserver.load(folder / "contact.json", model()).observe(run)
    states = {"t": run.t, "q": run.q, "dq": run.dq, "ddq": run.ddq, "tau": run.tau}
    options = ("--observe", "--contacts", folder / "contact.json", "--guide")
    done = answered(estimator, folder, json_text(states), *options)
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    np.testing.assert_array_equal([line["external"] for line in lines], said.external)
    np.testing.assert_array_equal([line["guide"] for line in lines], said.guide)
    assert [bool(line["status"] & 2048) for line in lines] == said.contact.tolist()
    assert said.contact.any()
    assert said.guide.any()
    rows = answered(estimator, folder, csv_text(states), *options).stdout.splitlines()
    first = rows[0].split(",").index("guide_0")
    assert rows[0].split(",")[first - 1] == f"external_{N - 1}"
    guide = [[float(x) for x in row.split(",")[first : first + N]] for row in rows[1:]]
    np.testing.assert_array_equal(guide, said.guide)
    fewer = answered(estimator, folder, json_text(states), *options[:3], "--false-contacts", "1e6")
    assert sum(json.loads(line)["status"] & 2048 > 0 for line in fewer.stdout.splitlines()) > said.contact.sum()
    assert "guide" not in json.loads(fewer.stdout.splitlines()[0])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--guide",), "--contacts and --guide go with --observe"),
        (("--contacts", "contact.json"), "--contacts and --guide go with --observe"),
        (("--observe", "--contacts", "contact.json", "--observer-time", "0.1"), "--contacts FILE says these"),
        (("--observe", "--contacts", "contact.json", "--window", "7"), "--contacts FILE says these"),
        (("--observe", "--contacts", "model.json"), "not an observer's uncertainty"),
        (("--observe", "--contacts", "other.json"), "the joints of the file are not those of the model"),
        (("--observe", "--contacts", "effects.json"), "of another model"),
        (("--observe", "--contacts", "nowhere.json"), "nowhere.json"),
    ],
)
def test_what_does_not_fit_is_one_sentence(estimator, folder, options, said):
    text = (folder / "contact.json").read_text()
    (folder / "other.json").write_text(text.replace("joint_1", "another"))
    direction = {"phi": [0.0] * 60, "effects": [[0.0] * 6]}
    (folder / "effects.json").write_text(json.dumps(json.loads(text) | {"directions": [direction]}))
    command = [estimator, "model.json", *options]
    done = subprocess.run(command, input="", capture_output=True, text=True, timeout=60, check=False, cwd=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def guided(estimator, folder, hand, rule, seconds=6.0):
    """The way of every joint that follows `rule(external, guide)` at damping 40, with a model that is 15 % wrong."""
    truth = with_parts(model(), 1.15 * model().robot.phi, model().effects)
    rng = np.random.default_rng(8)
    keep = np.exp(-STEP / 0.2)
    q, dq, asked, noise = np.full(N, 0.4), np.zeros(N), np.zeros(N), np.zeros(N)
    ways = []
    options = ("--observe", "--contacts", folder / "unsure.json", "--guide")
    command = [estimator, folder / "model.json", *options]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        for k in range(round(seconds / STEP)):
            t = k * STEP
            ddq = (asked - dq) / 0.02
            dq = dq + STEP * ddq
            q = q + STEP * dq
            noise = keep * noise + 0.5 * np.sqrt(1 - keep**2) * rng.normal(size=N)
            tau = truth.evaluate(q[None], dq[None], ddq[None])[0][0] + noise - hand(t)
            state = {"t": t, "q": q.tolist(), "dq": dq.tolist(), "ddq": ddq.tolist(), "tau": tau.tolist()}
            process.stdin.write(json.dumps(state) + "\n")
            process.stdin.flush()
            answer = json.loads(process.stdout.readline())
            asked = rule(np.array(answer["external"]), np.array(answer["guide"])) / 40.0
            ways.append(q - 0.4)
        process.stdin.close()
    return np.array(ways)


def test_an_arm_that_a_hand_guides_does_not_drift_by_itself(estimator, folder):
    """The model is 15 % wrong: with what is known of that the arm stands; with a zone by healthy runs it drifts."""
    observer = dyn.MomentumObserver(model(), false_contacts_per_hour=1.0, directions=OffBy(0.15))
    healthy = [recorded(70.0, seed) for seed in (1, 2)]
    observer.fit(healthy).save(folder / "unsure.json")
    zone = observer.greatest_

    def identified(external, said):
        return said

    def constant(external, said):
        return np.sign(external) * np.maximum(np.abs(external) - zone, 0.0)

    def none(t):
        return np.zeros(N)

    def hand(t):
        torque = np.zeros(N)
        torque[1] = -400.0 if t > 3 else 0.0
        return torque

    assert np.abs(guided(estimator, folder, none, identified, 4.0)).max() == 0.0
    assert np.abs(guided(estimator, folder, none, constant, 4.0)).max() > 0.05
    way = guided(estimator, folder, hand, identified, 4.5)
    assert way[-1, 1] < -0.05
    assert np.abs(way[: round(3 / STEP)]).max() == 0.0


class OffBy:
    """Every link may be off by a share of its own parameters, as a direction of its own."""

    def __init__(self, share):
        self.share = share

    def to_json(self):
        directions = []
        for link in range(N):
            phi = np.zeros(10 * N)
            own = slice(10 * link, 10 * link + 10)
            phi[own] = self.share * model().robot.phi[own]
            effects = [np.zeros(values.size).tolist() for _, values in model().effects]
            directions.append({"phi": phi.tolist(), "effects": effects})
        return directions
