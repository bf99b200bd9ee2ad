"""README.md does what it says: its commands and its Python are run against simulated files in an empty folder."""

import os
import re
import shlex
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from binaries import find_estimator
from data import ROOT
from run_files import write_csv
from small_arm import run, write_robot

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


def test_the_five_lines(folder):
    lines = block("sh", "dynid inspect").splitlines()
    assert len(lines) == 5
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


def test_the_python_block(folder, monkeypatch):
    monkeypatch.chdir(folder)
    names = {}
    exec(block("python", "ThreeLoopIdentifier"), names)
    measured = np.stack([run(2, encoders=2)[f"tau_{j}"] for j in range(3)], axis=1)
    assert names["tau"].shape == measured.shape
    # All samples, as measured: with the noise, and with standstill, which is not modelled.
    assert np.all(dynid_rs.rmse(measured, names["tau"]) < 0.5 * measured.std(axis=0))
    assert (folder / "model.json").is_file()


def test_the_config_block_is_one(folder):
    from dynid_rs.readers import read_config

    path = folder / "dynid.toml"
    path.write_text(block("toml", "[columns]"))
    assert read_config(path).columns == {"q": "actual_q_{i}"}
