"""README.md does what it says: its commands and its Python are run against simulated files in an empty folder."""

import json
import os
import re
import shlex
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.binaries import find_estimator
from helpers.data import ROOT
from helpers.run_files import write_csv
from helpers.small_arm import run, write_robot

import dynid_rs

README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str, word: str) -> str:
    """The fenced block of a language that holds a word."""
    blocks = re.findall(rf"```{language}\n(.*?)```", README, re.S)
    (found,) = (text for text in blocks if word in text)
    return found


@pytest.fixture
def folder(tmp_path):
    """robot.urdf, run_a.csv, run_b.csv and run_c.csv of the small arm."""
    write_robot(tmp_path)
    for k, letter in enumerate("abc"):
        write_csv(tmp_path / f"run_{letter}.csv", run(k, encoders=2))
    return tmp_path


def on_the_path(folder: Path) -> dict[str, str]:
    """Environment in which `dynid` is this package and `dynid-estimator` the built binary."""
    programs = folder / "bin"
    programs.mkdir()
    package = Path(dynid_rs.__file__).parents[1]
    start = f"import sys; sys.path.insert(0, {str(package)!r}); from dynid_rs.cli import main; main()"
    dynid = programs / "dynid"
    dynid.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -c {shlex.quote(start)} "$@"\n')
    dynid.chmod(dynid.stat().st_mode | stat.S_IXUSR)
    (programs / "dynid-estimator").symlink_to(find_estimator())
    return os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}


def test_the_six_lines(folder):
    lines = block("sh", "dynid inspect").splitlines()
    assert len(lines) == 6
    assert lines[0].startswith("pip install .")  # what `on_the_path` stands for
    environment = on_the_path(folder)
    for line in lines[1:]:
        done = subprocess.run(
            ["sh", "-c", line], cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        assert done.stdout
    # The last line is the online binary: one answer per state, under one header.
    states = (folder / "states.csv").read_text().splitlines()
    assert len(done.stdout.splitlines()) == len(states)
    said = re.search(r"`result/` then holds (.*?)\.\s", README.replace("\n", " "))
    assert said
    names = re.findall(r"`([\w.]+)`", said[1])
    assert sorted(names) == sorted(path.name for path in (folder / "result").iterdir())


NUMBER = r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?!\w)"


def words(text: str) -> list[str]:
    """Words of a printed answer, frames left out, with # for every number."""
    return re.sub(r"[━┏┳┓┡╇╉╋┩│└┴┘┃─]+", " ", re.sub(NUMBER, "#", text)).split()


def numbers(text: str) -> tuple[list[float], list[float]]:
    """Percentages, and all other numbers."""
    both = re.sub(rf"({NUMBER}) to ({NUMBER}) %", r"\1 % to \2 %", text)  # an interval says its unit once
    every = [(float(number), bool(percent)) for number, percent in re.findall(rf"({NUMBER})(\s*%)?", both)]
    return [x for x, percent in every if percent], [x for x, percent in every if not percent]


def test_the_diagnosis_prints_what_stands_there(tmp_path):
    environment = on_the_path(tmp_path)
    for line in block("sh", "dynid diagnose").splitlines():
        done = subprocess.run(
            ["sh", "-c", line], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=240, check=False
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    said = block("text", "friction hysteresis on")
    assert words(said) == words(done.stdout)[: len(words(said))]
    for shown, printed, tolerance in zip(numbers(said), numbers(done.stdout), ((0, 3), (0.1, 0)), strict=True):
        np.testing.assert_allclose(printed[: len(shown)], shown, rtol=tolerance[0], atol=tolerance[1])
    (effect,) = json.loads((tmp_path / "found" / "result.json").read_text())["effects"]
    (truth,) = json.loads((tmp_path / "lab" / "truth.json").read_text())["effects"]
    assert (effect["kind"], effect["joints"]) == (truth["kind"], truth["joints"])
    put_in = {parameter["name"]: parameter["value"] for parameter in truth["parameters"]}
    assert f"{put_in['hysteresis'][0]:.3g} N m over {put_in['presliding_distance'][0]:.3g} rad" in README


def test_the_diagnosis_in_python(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    names = {}
    exec(block("python", "dyn.diagnose"), names)
    said = capsys.readouterr().out.splitlines()
    assert said == [str(effect) for effect in names["found"].effects]
    assert names["found"].after.n_iter_ > 0
    assert (folder / "model.json").is_file()


def test_the_python_block(folder, monkeypatch):
    monkeypatch.chdir(folder)
    names = {}
    exec(block("python", "ThreeLoopIdentifier"), names)
    measured = np.stack([run(2, encoders=2)[f"tau_{j}"] for j in range(3)], axis=1)
    assert names["tau"].shape == measured.shape
    assert np.all(names["r2"] > 0.9)
    # All samples, as measured: with the noise, and with standstill, which is not modelled.
    assert np.all(dynid_rs.rmse(measured, names["tau"]) < 0.5 * measured.std(axis=0))
    assert (folder / "model.json").is_file()


def test_the_config_block_is_one(folder):
    from dynid_rs.runs.readers import read_config

    path = folder / "dynid.toml"
    path.write_text(block("toml", "[columns]"))
    assert read_config(path).columns == {"q": "actual_q_{i}"}
