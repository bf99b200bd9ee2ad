"""`dynid demo`: the whole road on what the package carries, which the laboratory makes again."""

import importlib.util
import io
import json
import re
import shlex

import numpy as np
import pyarrow as pa
import pytest
from helpers.data import ROOT
from helpers.small_arm import dynid, refusal, snapshot

import dynid_rs.commands.demo as command

LIMIT = 400_000
"""Bytes that the wheel may carry for it."""
HALF_A_STEP = 0.5 + 1e-6
"""Of the last decimal: numbers that lie between two are rounded either way on another processor."""


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "dynid-demo"
    return folder, dynid("demo", "-o", folder)


def recorder():
    spec = importlib.util.spec_from_file_location("record", ROOT / "examples" / "demo" / "record.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def table(packed):
    text = pa.CompressedInputStream(pa.BufferReader(packed), "zstd").read().decode()
    header = text.partition("\n")[0].split(",")
    return dict(zip(header, np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1).T, strict=True))


def test_the_runs_are_what_the_laboratory_makes(tmp_path):
    record = recorder()
    record.record(tmp_path)
    carried = snapshot(record.PACKAGED)
    made = snapshot(tmp_path)
    assert sorted(carried) == sorted(made) == ["run_0.csv.zst", "run_1.csv.zst", "run_2.csv.zst", "truth.json"]
    assert sum(map(len, carried.values())) <= LIMIT
    for name in (name for name in made if name.startswith("run")):
        ours, theirs = table(carried[name]), table(made[name])
        assert list(ours) == list(theirs) == ["t", *(f"{s}_{j}" for s in ("q", "tau") for j in range(6))]
        for column, values in ours.items():
            step = 10.0 ** -record.DECIMALS[column.partition("_")[0]]
            np.testing.assert_allclose(values, theirs[column], rtol=0, atol=2 * HALF_A_STEP * step)
    truth = [json.loads(files["truth.json"]) for files in (carried, made)]
    assert truth[0]["effects"] == truth[1]["effects"]


def test_the_road_ends_at_what_was_hidden(shown):
    folder, printed = shown
    assert printed.exit_code == 0, printed.output
    assert "Hidden: friction hysteresis on joint_3. Found: friction hysteresis on joint_3." in printed.stdout
    report = folder / "diagnosed" / "report.html"
    assert f"Open {report} in a browser" in printed.stdout
    assert report.is_file()
    assert all(f"\n{step} of 4. " in printed.stdout for step in range(1, 5))
    effect = json.loads((folder / "diagnosed" / "result.json").read_text())["effects"][0]
    (truth,) = json.loads((folder / "truth.json").read_text())["effects"]
    assert (effect["kind"], effect["joints"]) == (truth["kind"], truth["joints"])


def test_numbers_of_one_thing_are_the_same_and_others_have_other_names(shown):
    folder, printed = shown
    said = printed.stdout
    results = [json.loads((folder / name / "result.json").read_text()) for name in ("identified", "diagnosed")]
    tests = [result["rmse"]["test"] for result in results]
    np.testing.assert_allclose(tests[0]["wls"], tests[1]["wls"], rtol=1e-12)
    if not np.allclose(tests[0]["after"], tests[1]["before"], rtol=5e-3):
        assert "`before` is another fit than `three loops`" in " ".join(said.split())
    # The sentence's ends stand in the column of the table.
    ends = re.search(r"the error changes by (\S+ %) to (\S+ %), joint by joint", " ".join(said.split())).groups()
    cells = [[cell.strip() for cell in line.split("│")] for line in said.splitlines() if line.startswith("│")]
    changes = sorted((row[6] for row in cells if len(row) == 10), key=lambda text: float(text.split()[0]))
    assert len(changes) == 6
    assert ends == (changes[0], changes[-1])


def test_its_commands_can_be_typed(shown):
    """As they stand: they do it again, or say that it is done."""
    lines = [line for line in shown[1].stdout.splitlines() if line.startswith("$ ")]
    words = [shlex.split(line.removeprefix("$ dynid ")) for line in lines]
    assert [first for first, *_ in words] == ["inspect", "identify", "diagnose", "estimate"]
    inspected, *others = (dynid(*command) for command in words)
    assert inspected.exit_code == 0
    assert all("--force" in refusal(printed) for printed in others)


def test_a_finished_folder_and_strangers_files_are_not_replaced(shown, tmp_path):
    folder, _ = shown
    before = snapshot(folder)
    assert "holds a finished result already (result.json)" in refusal(dynid("demo", "-o", folder))
    assert snapshot(folder) == before
    (tmp_path / "robot.urdf").write_text("mine")
    assert "robot.urdf: there is one already" in refusal(dynid("demo", "-o", tmp_path))
    assert snapshot(tmp_path) == {"robot.urdf": b"mine"}


def nothing_found(words, *, silent):
    """Stand-in for the commands: all of them run, and the diagnosis is empty."""
    if words[0] == "diagnose":
        folder = command.Path(words[words.index("-o") + 1])
        folder.mkdir()
        (folder / "result.json").write_text('{"effects": []}')
    return 0


def test_an_effect_that_is_not_found_is_a_no(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "_run", nothing_found)
    printed = dynid("demo", "-o", tmp_path / "d", "--json")
    assert printed.exit_code == 1
    answer = json.loads(printed.stdout)
    assert (answer["format"], answer["found"]) == ("dynid-demo", [])
    assert answer["put_in"] == [{"kind": "friction_hysteresis", "joints": ["joint_3"]}]


def test_a_step_that_fails_ends_the_road(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "_run", lambda words, silent: 2 if words[0] == "identify" else 0)
    printed = dynid("demo", "-o", tmp_path / "d")
    assert printed.exit_code == 2
    assert "3 of 4" not in printed.stdout


def test_for_programs_there_is_one_json_value(tmp_path, monkeypatch):
    """The commands' own tables stay away from it."""
    road = command.Road.steps

    def without_the_long_part(self):
        return [step for step in road(self) if step[1][0] == "inspect"]

    monkeypatch.setattr(command.Road, "steps", without_the_long_part)
    monkeypatch.setattr(command, "_found", lambda folder: [{"kind": "friction_hysteresis", "joints": ["joint_3"]}])
    printed = dynid("demo", "-o", tmp_path / "d", "--json")
    assert printed.exit_code == 0, printed.output
    (step,) = json.loads(printed.stdout)["steps"]
    assert step["command"][:2] == ["dynid", "inspect"]
    assert step["exit_code"] == 0
