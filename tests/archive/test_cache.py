"""What is kept of streamed runs: reused by content, never trusted when damaged, never needed for the answer."""

from __future__ import annotations

import errno
import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from helpers.made_runs import MadeRun, arm
from helpers.run_files import write
from helpers.small_arm import dynid, refusal, run, snapshot, write_robot, write_runs
from numpy.testing import assert_array_equal

import dynid_rs.archive.work as work_module
from dynid_rs import ResidualCompensator, RobotModel, ThreeLoopIdentifier
from dynid_rs.archive import Archive, RunFile
from dynid_rs.archive.cache import SUFFIX, Cache, packed, unpacked
from dynid_rs.archive.survey import survey_run
from dynid_rs.archive.work import Work
from dynid_rs.commands._inputs import size_in_bytes
from dynid_rs.runs.readers import Config

ENTRY = ({"name": "a", "value": 0.1, "none": None}, {"x": np.arange(6.0).reshape(2, 3), "flags": np.array([True])})
KEYS = [f"{k:02x}" * 32 for k in range(5)]


def entries_of(folder):
    return {path.name: path.stat().st_mtime_ns for path in Cache(folder).entries()}


def test_what_is_put_comes_back(tmp_path):
    cache = Cache(tmp_path / "new" / "cache")
    assert cache.get(KEYS[0]) is None
    assert (cache.entries(), cache.n_bytes()) == ([], 0)
    cache.put(KEYS[0], ENTRY)
    plain, arrays = cache.get(KEYS[0])
    assert plain == ENTRY[0]
    assert set(arrays) == set(ENTRY[1])
    for name, values in ENTRY[1].items():
        assert_array_equal(arrays[name], values)
        assert arrays[name].dtype == values.dtype


def test_entries_may_be_removed_and_written_by_others_meanwhile(tmp_path):
    """Two threads stand for two processes: one keeps writing, one keeps clearing, and here one looks."""
    cache, failed, ended = Cache(tmp_path / "cache"), [], threading.Event()
    keys = [f"{k:02x}" * 32 for k in range(256)]

    def until_the_end(work):
        try:
            for key in itertools.cycle(keys):
                if ended.is_set():
                    return
                work(key)
        except OSError as error:
            failed.append(error)

    others = [lambda key: cache.put(key, ENTRY), lambda key: cache.keep(0)]
    threads = [threading.Thread(target=until_the_end, args=(work,)) for work in others]
    for thread in threads:
        thread.start()
    end = time.monotonic() + 2.0
    while time.monotonic() < end:
        try:
            cache.entries()
        except OSError as error:
            failed.append(error)
    ended.set()
    for thread in threads:
        thread.join()
    assert failed == []


def test_every_damage_is_seen():
    content = packed(ENTRY)
    assert unpacked(content) is not None
    rng = np.random.default_rng(0)
    for at in rng.integers(0, len(content), 200).tolist():
        flipped = bytearray(content)
        flipped[at] ^= 1 << int(rng.integers(8))
        assert unpacked(bytes(flipped)) is None
    for size in (0, 1, 20, len(content) - 1):
        assert unpacked(content[:size]) is None
    assert unpacked(content + b"x") is None


def test_a_damaged_entry_is_made_again(tmp_path):
    sources = [MadeRun(seed, 10.0) for seed in range(2)]
    first = list(Work(Cache(tmp_path)).map(survey_run, sources))
    path = Cache(tmp_path).entries()[0]
    whole = path.read_bytes()
    path.write_bytes(whole[:-7])
    again = list(Work(Cache(tmp_path)).map(survey_run, sources))
    assert [packed(entry) for entry in again] == [packed(entry) for entry in first]
    assert path.read_bytes() == whole


def test_only_what_has_changed_is_done_again(tmp_path, monkeypatch):
    robot = RobotModel.from_urdf(write_robot(tmp_path))
    paths = write_runs(tmp_path)
    asked = []

    def unit(source):
        asked.append(source.name)
        return survey_run(source)

    def surveyed(sources):
        asked.clear()
        list(Work(Cache(tmp_path / "cache")).map(unit, sources))
        return sorted(asked)

    sources = [RunFile(path, path.name, robot, Config()) for path in paths]
    assert len(surveyed(sources)) == 3
    assert surveyed(sources[::-1]) == []
    columns = run(1)
    columns["tau_0"][7] += 1e-9
    write(paths[1], columns)
    assert surveyed(sources) == ["run_1.parquet"]
    assert len(surveyed([RunFile(p, p.name, robot, Config(signs={"q": (-1.0,)})) for p in paths])) == 3
    heavier = RobotModel.from_urdf_string(
        paths[0].with_name("robot.urdf").read_text().replace('mass value="8"', 'mass value="9"')
    )
    assert len(surveyed([RunFile(p, p.name, heavier, Config()) for p in paths])) == 3
    monkeypatch.setattr(work_module, "program", lambda: "another version")
    assert len(surveyed(sources)) == 3


def identify(folder, *arguments):
    """Stream two runs into `folder`/out, tested on a third."""
    robot, paths = write_robot(folder), write_runs(folder)
    common = ("--residual", "none", "--memory", "10MB", "--force", "-o", folder / "out")
    return dynid("identify", robot, *paths, *common, *arguments)


def test_a_cache_changes_nothing(tmp_path):
    assert identify(tmp_path).exit_code in (0, 1)
    without = snapshot(tmp_path / "out")
    for _ in range(2):
        assert identify(tmp_path, "--cache", tmp_path / "cache").exit_code in (0, 1)
        assert snapshot(tmp_path / "out") == without
    assert len(Cache(tmp_path / "cache").entries()) == 4  # two runs, surveyed and reduced


def test_a_folder_that_cannot_be_written(tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.write_text("")
    for place in (in_the_way, in_the_way / "below", "/proc/cache"):
        sentence = refusal(identify(tmp_path, "--cache", place))
        assert str(place) in sentence
    assert not (tmp_path / "out").exists()


def test_a_full_disk_costs_a_warning_and_not_the_answer(tmp_path, monkeypatch):
    assert identify(tmp_path).exit_code in (0, 1)
    model = (tmp_path / "out" / "model.json").read_bytes()
    real = Cache.put

    def no_space(path):
        raise OSError(errno.ENOSPC, "No space left on device")

    def put(self, key, entry):
        with monkeypatch.context() as full:
            full.setattr("dynid_rs.base.files._sync", no_space)
            real(self, key, entry)

    monkeypatch.setattr(Cache, "put", put)
    assert identify(tmp_path, "--cache", tmp_path / "cache").exit_code in (0, 1)
    monkeypatch.undo()
    assert (tmp_path / "out" / "model.json").read_bytes() == model
    findings = json.loads((tmp_path / "out" / "result.json").read_text())["data"]["findings"]
    (finding,) = [finding for finding in findings if finding["code"] == "cache_not_written"]
    assert finding["severity"] == "warning"
    assert "4 intermediate results could not be kept" in finding["message"]
    assert "no space left on device" in finding["message"]
    assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []


def test_the_command_says_what_a_cache_holds_and_clears_it(tmp_path):
    folder = tmp_path / "cache"
    cache = Cache(folder)
    for k, key in enumerate(KEYS):
        cache.put(key, ENTRY)
        os.utime(cache.path(key), (1000 + k, 1000 + k))
    stranger = folder / "00" / "notes.txt"
    stranger.write_text("not ours")
    left_behind = folder / "01" / f".dynid-0123456789ab{SUFFIX}"
    left_behind.write_bytes(b"half")
    size = cache.n_bytes() // 5
    assert json.loads(dynid("cache", folder, "--json").stdout) == {"entries": 5, "bytes": 5 * size, "removed": 0}
    assert left_behind.exists()
    printed = dynid("cache", folder, "--keep", f"{2 * size + 1}")
    assert printed.stdout.splitlines()[0] == "3 entries removed"
    assert [path.stem for path in cache.entries()] == KEYS[3:]  # the youngest
    assert not left_behind.exists()
    assert json.loads(dynid("cache", folder, "--clear", "--json").stdout) == {"entries": 0, "bytes": 0, "removed": 2}
    assert [path for path in folder.rglob("*") if path.is_file()] == [stranger]


def test_refusals_of_the_command(tmp_path):
    assert "there is no such folder" in refusal(dynid("cache", tmp_path / "nowhere"))
    assert "give one of them" in refusal(dynid("cache", tmp_path, "--clear", "--keep", "1GB"))
    assert "--keep must be a size" in refusal(dynid("cache", tmp_path, "--keep", "some"))


STREAM = """
import sys
from pathlib import Path
from helpers.made_runs import MadeRun, arm
from dynid_rs import ThreeLoopIdentifier
from dynid_rs.archive import Archive
from dynid_rs.archive.cache import Cache
from dynid_rs.archive.work import Work
sources = [MadeRun(seed, 10.0) for seed in range(8)]
archive = Archive(arm(), sources, memory=60_000_000, work=Work(Cache(Path(sys.argv[1]))))
archive.check()
learned = archive.fit(ThreeLoopIdentifier(arm(), residual=None), archive.sample(), None)
learned.identifier.model_.save(sys.argv[2])
"""


def started(folder, model):
    paths = os.pathsep.join(path for path in sys.path if path)
    return subprocess.Popen(
        [sys.executable, "-c", STREAM, str(folder), str(model)],
        env=os.environ | {"PYTHONPATH": paths},
        stderr=subprocess.PIPE,
    )


def finished(folder, model):
    process = started(folder, model)
    _, complaint = process.communicate(timeout=240)
    assert process.returncode == 0, complaint.decode()
    return model.read_bytes()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The model that is made at once, and names of what is kept on the way."""
    folder = tmp_path_factory.mktemp("undisturbed")
    return finished(folder / "cache", folder / "model.json"), set(entries_of(folder / "cache"))


@pytest.mark.parametrize("killed_at", [3, 11])
def test_a_kill_loses_at_most_one_run(tmp_path, undisturbed, killed_at):
    """Killed in the first pass (8 surveys) and in the second: every entry stays, and the model is the same."""
    model, names = undisturbed
    folder = tmp_path / "cache"
    process = started(folder, tmp_path / "killed.json")
    until = time.monotonic() + 200
    while len(Cache(folder).entries()) < killed_at and process.poll() is None and time.monotonic() < until:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert not (tmp_path / "killed.json").exists()
    kept = entries_of(folder)
    assert killed_at <= len(kept) < 16
    assert finished(folder, tmp_path / "resumed.json") == model
    now = entries_of(folder)
    assert len(now) == 16
    assert {name: now[name] for name in kept} == kept  # nothing that was there was made again
    assert set(now) == names


@pytest.mark.parametrize(("memory", "compensator"), [("1GB", "mixture"), ("1GB", "rbf"), ("8MB", "mixture")])
def test_third_loops_and_priors_of_the_sample_are_hashed_too(tmp_path, memory, compensator):
    """A sample of all runs with a third loop, and one of a lone piece, beside which a prior stands."""
    robot = RobotModel.from_urdf(write_robot(tmp_path))
    sources = [RunFile(path, path.name, robot, Config()) for path in write_runs(tmp_path, encoders=2)]
    cache = Cache(tmp_path / "cache")

    def fitted():
        archive = Archive(robot, sources, memory=size_in_bytes("", memory), work=Work(cache))
        identifier = ThreeLoopIdentifier(robot, residual=ResidualCompensator(method=compensator))
        return archive.fit(identifier, archive.sample(), None).identifier

    first = fitted()
    kept = entries_of(tmp_path / "cache")
    assert len(kept) == 6
    second = fitted()
    assert entries_of(tmp_path / "cache") == kept
    assert second.model_.__reduce__()[1] == first.model_.__reduce__()[1]


def test_streaming_from_a_cache_alone_gives_the_same_bits(tmp_path):
    """The second time no run is reduced: the same entries, the same tree."""
    sources = [MadeRun(seed, 10.0) for seed in range(5)]

    def fitted():
        archive = Archive(arm(), sources, memory=60_000_000, work=Work(Cache(tmp_path)))
        return archive.fit(ThreeLoopIdentifier(arm(), residual=None), archive.sample(), None).identifier

    first, second = fitted(), fitted()
    assert_array_equal(second.links_.x_, first.links_.x_)
    assert_array_equal(second.parameter_covariance(), first.parameter_covariance())
    assert len(Cache(tmp_path).entries()) == 10
