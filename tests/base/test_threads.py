"""Threads that nobody can have: a number that is a slip does not make a command wait without end."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from helpers.processes import ENVIRONMENT
from helpers.small_arm import study

from dynid_rs.base import threads

RUST = "RAYON_NUM_THREADS"


@pytest.mark.parametrize("asked", ["", "0", "3", "1024", "-5", "many"])
def test_what_machines_have_and_what_is_no_number_stays(asked, monkeypatch):
    monkeypatch.setenv(RUST, asked)
    assert threads.limit() is None
    assert os.environ[RUST] == asked


@pytest.mark.parametrize("asked", ["100000000", "9" * 5000])
@pytest.mark.parametrize("name", [RUST, "RAYON_RS_NUM_CPUS"])
def test_absurd_numbers_are_ignored_with_a_sentence(name, asked, monkeypatch):
    monkeypatch.setenv(name, asked)
    said = threads.limit()
    assert said == f"{name} asks for more than 1024 threads; as many are used as there are processors"
    assert name not in os.environ


def test_a_command_ends_however_many_threads_it_is_asked_for(tmp_path):
    command = [sys.executable, "-m", "dynid_rs", "identify", study().robot, *study().runs, "-o", tmp_path / "out"]
    environment = ENVIRONMENT | {RUST: "100000000"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0
    assert done.stderr.startswith(f"note: {RUST} asks for more than 1024 threads; ")
