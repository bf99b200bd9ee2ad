"""Threads: those that nobody can have are not waited for, and what they do side by side is what one does."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from contextvars import ContextVar

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


WHERE: ContextVar[str] = ContextVar("where", default="nowhere")


@pytest.mark.parametrize("asked", ["1", "2", "7", "9" * 5000])
def test_answers_side_by_side_are_in_the_order_of_what_was_asked(asked, monkeypatch):
    monkeypatch.setenv(RUST, asked)
    token = WHERE.set("here")
    try:
        found = threads.side_by_side(lambda item: (WHERE.get(), item**2), range(20))
    finally:
        WHERE.reset(token)
    assert found == [("here", item**2) for item in range(20)]
    assert threads.side_by_side(str, []) == []


def test_what_runs_side_by_side_already_asks_for_no_further_threads(monkeypatch):
    monkeypatch.setenv(RUST, "2")

    def within(_: int) -> bool:
        own = threading.get_ident()
        return all(other == own for other in threads.side_by_side(lambda _: threading.get_ident(), range(4)))

    assert threads.side_by_side(within, range(4)) == [True] * 4


def test_an_error_of_one_is_told(monkeypatch):
    monkeypatch.setenv(RUST, "2")
    with pytest.raises(ZeroDivisionError):
        threads.side_by_side(lambda item: 1 // item, [2, 1, 0, 3])
