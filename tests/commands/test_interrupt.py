"""Ctrl-C at many moments: code 130, one sentence that holds, nothing half-written, and the way on that was said."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

import pytest
from helpers.processes import ENVIRONMENT
from helpers.small_arm import dynid, snapshot, write_robot, write_runs
from test_fleet import FLEET

STRUCK = """if True:
    import contextlib, os, signal, sys, threading
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background inherits "ignore"
    kind, name, count = sys.argv.pop(1), sys.argv.pop(1), int(sys.argv.pop(1))
    left = [count]

    def strike():
        left[0] -= 1
        if left[0] == 0:
            os.kill(0, signal.SIGINT)  # the whole group, as a terminal does

    if kind == "import":
        class Finder:
            @staticmethod
            def find_spec(module, path=None, target=None):
                if module == name:
                    strike()
        sys.meta_path.insert(0, Finder)
    elif kind in ("swallowed in an import", "swallowed"):  # as libraries do that try one import after another
        import builtins
        real = __import__
        class Finder:
            @staticmethod
            def find_spec(module, path=None, target=None):
                if module == name:
                    swallow()
        def swallow():
            try:
                strike()
            except BaseException:
                raise ImportError("cannot import " + name)
        def imported(module, *arguments, **options):
            if module == name and left[0] > 0:
                swallow()
            return real(module, *arguments, **options)
        if kind == "swallowed":
            builtins.__import__ = imported
        else:
            sys.meta_path.insert(0, Finder)
    elif kind == "ignored":  # as a callback's or a destructor's is
        import dynid_rs.runs.readers as readers
        real = readers.read
        def read(*arguments, **options):
            with contextlib.suppress(KeyboardInterrupt):
                strike()
            return real(*arguments, **options)
        readers.read = read
    elif kind == "process":  # that has just been started
        import _posixsubprocess
        real = _posixsubprocess.fork_exec
        def started(*arguments):
            process = real(*arguments)
            if name in str(arguments[0]):
                threading.Timer(0.03, strike).start()
            return process
        _posixsubprocess.fork_exec = started
    elif kind == "call":
        real = getattr(os, name)
        def called(*arguments, **options):
            real(*arguments, **options)
            strike()
        setattr(os, name, called)
    else:
        import dynid_rs.commands._console as console
        real = console.progress
        @contextlib.contextmanager
        def progress(*plan):
            with real(*plan) as shown:
                def say(words):
                    shown(words)
                    if words.startswith(name):
                        threading.Timer(0.05, strike).start() if kind == "after" else strike()
                yield say
        console.progress = progress
    if kind == "twice":
        import dynid_rs.commands._run as run
        run._complain = lambda text: os.kill(os.getpid(), signal.SIGINT)
    from dynid_rs.__main__ import main
    main()
"""


def struck(moment, *arguments):
    """`dynid` with an interrupt at a moment; its one sentence."""
    done = subprocess.run(
        [sys.executable, "-c", STRUCK, *map(str, moment), *map(str, arguments)],
        env=ENVIRONMENT,
        start_new_session=True,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 130, done.stderr
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("interrupted")
    return lines[0]


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    return write_robot(folder), *write_runs(folder)


def leftovers(folder):
    return [name for name in snapshot(folder) if ".dynid-" in name]


UNFINISHED = {
    "while it starts": ("import", "typer", 1),
    "before the numbers": ("import", "numpy", 1),
    "in an import that is swallowed": ("swallowed in an import", "pyarrow.parquet", 1),
    "an import that is swallowed": ("swallowed", "pyarrow.parquet", 1),
    "in a callback": ("ignored", "", 1),
    "reading": ("say", "reading", 1),
    "the fit": ("say", "round 1: link", 1),
    "in a computation": ("after", "channels", 1),
    "testing": ("say", "testing", 1),
    "the first file": ("call", "replace", 1),
    "the last but one": ("call", "replace", 3),
}


@pytest.mark.parametrize("moment", UNFINISHED.values(), ids=UNFINISHED)
def test_identify_leaves_nothing(moment, arm, tmp_path):
    robot, *runs = arm
    said = struck(moment, "identify", robot, *runs, "-o", tmp_path / "out", "--residual", "none")
    assert snapshot(tmp_path) == {}
    if moment[0] != "import":
        assert said == f"interrupted: nothing was written to {tmp_path / 'out'}; the same command begins again"


def test_what_is_being_put_in_its_place_is_finished(arm, tmp_path):
    robot, *runs = arm
    out = tmp_path / "out"
    said = struck(("call", "rename", 1), "identify", robot, *runs, "-o", out, "--residual", "none")
    assert said == f"interrupted: {out / 'result.json'} and what belongs to it are complete"
    assert sorted(snapshot(out)) == ["model.json", "report.html", "residuals.parquet", "result.json"]


def test_an_older_result_stays(arm, tmp_path):
    robot, *runs = arm
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "result.json").write_text("{}")
    words = ("identify", robot, *runs, "-o", tmp_path / "out", "--residual", "none", "--force")
    assert "nothing was written" in struck(("call", "replace", 2), *words)
    assert snapshot(tmp_path / "out") == {"result.json": b"{}"}


def test_streamed_runs_are_kept(arm, tmp_path):
    robot, *runs = arm
    words = ("identify", robot, *runs, "-o", tmp_path / "out", "--residual", "none", "--memory", "10MB")
    cache = tmp_path / "cache"
    said = struck(("say", "reading: 2 of", 1), *words, "--cache", cache)
    kept = len(list(cache.rglob("*.dynid")))
    assert kept == 2
    assert said.endswith(f"the same command begins again, from the {kept} intermediate results that {cache} keeps")
    assert not (tmp_path / "out").exists()
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize(
    "moment", [("say", "looking for effects", 1), ("after", "channels", 1), ("call", "replace", 2)]
)
def test_diagnose_leaves_nothing(moment, arm, tmp_path):
    robot, *runs = arm
    said = struck(moment, "diagnose", robot, *runs, "-o", tmp_path / "out")
    assert "the same command begins again" in said
    assert snapshot(tmp_path) == {}


DESIGN = ("--duration", 4, "--harmonics", 2, "--restarts", 3, "--iterations", 5, "--jobs", 1)


def test_a_search_goes_on_where_it_was_struck(arm, tmp_path):
    whole, struck_at = tmp_path / "whole.csv", tmp_path / "plan.csv"
    assert dynid("excite", arm[0], "-o", whole, *DESIGN).exit_code == 0
    said = struck(("say", "search 2 of", 1), "excite", arm[0], "-o", struck_at, *DESIGN)
    state = tmp_path / "plan.restarts.json"
    assert said.startswith("interrupted: no trajectory was written; the same command with --resume goes on from ")
    assert len(json.loads(state.read_text())["restarts"]) == 2
    assert not struck_at.exists()
    assert dynid("excite", arm[0], "-o", struck_at, *DESIGN, "--resume").exit_code == 0
    assert struck_at.read_bytes() == whole.read_bytes()
    assert not state.exists()


@pytest.mark.parametrize("moment", [("after", "searching", 1), ("call", "replace", 6)], ids=["in a search", "writing"])
def test_excite_leaves_no_half_of_a_design(moment, arm, tmp_path):
    words = () if moment[0] == "after" else DESIGN  # by default seconds pass before the first search has ended
    said = struck(moment, "excite", arm[0], "-o", tmp_path / "plan.csv", *words)
    assert set(snapshot(tmp_path)) <= {"plan.restarts.json"}
    assert ("--resume" in said) == (tmp_path / "plan.restarts.json").exists()


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_fleet_goes_on_with_the_others(jobs, tmp_path):
    (tmp_path / "arm").mkdir()
    write_robot(tmp_path / "arm")
    write_runs(tmp_path / "arm")
    (tmp_path / "fleet.toml").write_text(FLEET)
    words = ("fleet", tmp_path / "fleet.toml", "-o", tmp_path / "out", "--jobs", jobs)
    moment = ("say", "1 of 2", 1) if jobs == 1 else ("after", "0 of 2", 1)
    done = int(re.match(r"interrupted: (\d) of 2 robots are done and kept; ", struck(moment, *words))[1])
    assert jobs == 2 or done == 1
    assert not (tmp_path / "out" / "fleet.csv").exists()
    assert leftovers(tmp_path) == []
    before = snapshot(tmp_path / "out")
    assert dynid(*words).exit_code == 0
    after = snapshot(tmp_path / "out")
    assert sum(row["status"] == "done" for row in json.loads(after["fleet.json"])["robots"]) == 2
    kept = {name: x for name, x in before.items() if name.startswith("first/")} if done else {}
    assert kept.items() <= after.items()


def test_processes_that_are_starting_say_nothing(tmp_path):
    (tmp_path / "arm").mkdir()
    write_robot(tmp_path / "arm")
    write_runs(tmp_path / "arm")
    (tmp_path / "fleet.toml").write_text(FLEET)
    words = ("fleet", tmp_path / "fleet.toml", "-o", tmp_path / "out", "--jobs", 2)
    assert struck(("process", "popen_loky", 1), *words).startswith("interrupted: 0 of 2 robots are done and kept; ")
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("kind", ["import", "swallowed in an import", "swallowed"])
def test_init_and_an_import_that_is_struck(kind, arm, tmp_path):
    robot, *runs = arm
    struck((kind, "pyarrow.parquet", 1), "init", robot, *runs, "-o", tmp_path / "dynid.toml")
    assert snapshot(tmp_path) == {}


@pytest.mark.parametrize("moment", [("say", "run 1 of", 1), ("call", "replace", 2)], ids=["at a run", "writing"])
def test_simulate_leaves_nothing(moment, tmp_path):
    said = struck(moment, "simulate", "-o", tmp_path / "lab", "--runs", 3, "--duration", 5, "--ideal")
    assert said.endswith("the same command makes the same runs from the beginning")
    assert snapshot(tmp_path) == {}


def test_who_presses_twice_does_not_wait(arm, tmp_path):
    robot, *runs = arm
    words = ("twice", "round 1: link", "1", "identify", robot, *runs, "-o", tmp_path / "out", "--residual", "none")
    command = [sys.executable, "-c", STRUCK, *map(str, words)]
    done = subprocess.run(
        command, env=os.environ | ENVIRONMENT, start_new_session=True, capture_output=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")


def test_demo_says_how_to_go_on(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", STRUCK, "say", "filtering", "1", "demo", "-o", str(tmp_path / "demo")],
        env=ENVIRONMENT,
        start_new_session=True,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 130
    assert done.stderr.splitlines()[1:] == [f"dynid demo -o {tmp_path / 'demo'} --force begins again"]
