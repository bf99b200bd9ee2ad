"""Nothing of a test run touches what is learned: whatever happens in it, the training side keeps its bits."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, columns_of, measured
from helpers.run_files import write
from helpers.small_arm import URDF, dynid, run

from dynid_rs.diagnosis.setup import Setup
from dynid_rs.sensors.contact import find_contacts, windows_of


def bigger(columns):
    """Half as much torque again."""
    return {n: 1.5 * x if n.startswith("tau_") else x for n, x in columns.items()}


def noisier(columns):
    """Noise of a newton metre."""
    rng = np.random.default_rng(0)
    return {n: x + rng.standard_normal(len(x)) if n.startswith("tau_") else x for n, x in columns.items()}


def pushed(columns):
    """Two pushes, as hard as the arm's own weight."""
    push = sum(40.0 * np.exp(-(((columns["t"] - at) / 0.1) ** 2)) for at in (3.0, 5.0))
    return {n: x + push if n.startswith("tau_") else x for n, x in columns.items()}


def shortened(columns):
    """Its first five seconds."""
    return {n: x[columns["t"] - columns["t"][0] < 5.0] for n, x in columns.items()}


def learned(folder, command, train, test):
    """The training side of a result: the model's bytes, effects with their numbers, errors on training runs."""
    folder.mkdir()
    robot = folder / "robot.urdf"
    robot.write_text(URDF)
    runs = [write(folder / f"run_{k}.parquet", columns) for k, columns in enumerate([*train, *test])]
    tests = [option for path in runs[len(train) :] for option in ("--test", path)]
    done = dynid(command, robot, *runs[: len(train)], *tests, "-o", folder / "out")
    assert done.exit_code in (0, 1), done.output
    result = json.loads((folder / "out" / "result.json").read_text())
    effects = [(e["kind"], e["joints"], e["parameters"], e["rmse_train_before"]) for e in result["effects"]]
    excluded = {name: x for name, x in result["data"].get("excluded", {}).items() if name in result["data"]["train"]}
    return {
        "model": (folder / "out" / "model.json").read_bytes(),
        "effects": effects,
        "excluded": excluded,
        "rmse": result["rmse"]["train"],
        "parameters": result["parameters"],
        "history": result["history"],
        "steps": result.get("steps"),
    }


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    return learned(tmp_path_factory.mktemp("identified") / "p", "identify", [run(0), run(1)], [run(2)])


@pytest.mark.parametrize("change", [bigger, noisier, pushed, shortened])
def test_identify(tmp_path, identified, change):
    assert learned(tmp_path / "changed", "identify", [run(0), run(1)], [change(run(2))]) == identified


@pytest.fixture(scope="module")
def four_runs():
    """An arm with an effect to be found, pushed once in a training run."""
    runs = [columns_of(recording) for recording in measured("stribeck:elbow:2", n_runs=4, seed=5)]
    t = runs[1]["t"]
    runs[1] = runs[1] | {"tau_1": runs[1]["tau_1"] + 15.0 * np.exp(-(((t - 6.0) / 0.15) ** 2))}
    return runs


@pytest.fixture(scope="module")
def plain(tmp_path_factory, four_runs):
    found = learned(tmp_path_factory.mktemp("plain") / "p", "diagnose", four_runs[:2], four_runs[2:])
    assert found["effects"], "there should be an effect to compare"
    assert found["excluded"], "there should be a contact in training, so that its limits count"
    return found


@pytest.mark.parametrize("change", [bigger, noisier, pushed, shortened])
def test_diagnose(tmp_path, four_runs, plain, change):
    changed = [change(columns) for columns in four_runs[2:]]
    assert learned(tmp_path / "changed", "diagnose", four_runs[:2], changed) == plain


def test_test_runs_are_judged_each_by_itself():
    """A push in one test run neither hides nor makes a contact in another."""
    recordings = measured(n_runs=5, seed=5)
    fit = Setup(ROBOT).identifier(residual=None).fit(recordings[:3])
    tests = [fit.states(recording) for recording in recordings[3:]]
    hard, soft = (_with_push(states, force) for states, force in zip(tests, (200.0, 8.0), strict=True))
    alone = [contact for states in (hard, soft) for contact in find_contacts(fit, fit.raw_runs_, [states])]
    assert {contact.run for contact in alone} == {hard.name, soft.name}
    assert find_contacts(fit, fit.raw_runs_, [hard, soft]) == alone
    assert set(windows_of(alone)) == {hard.name, soft.name}


def _with_push(states, force):
    push = force * np.exp(-(((states.t - 6.0) / 0.15) ** 2))
    return replace(states, tau=states.tau + push[:, None] * np.array([0.0, 1.0, 0.0]))
