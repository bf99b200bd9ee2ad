"""Results that belong together: whatever ends a run, and whenever, the folder holds one run's files and no mixture."""

import errno
import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from helpers.processes import ENVIRONMENT, process

import dynid_rs.base.together as together
from dynid_rs.base.files import filled_together, write_json, write_text
from dynid_rs.base.together import COMMITTED, finish_killed

NAMES = ("a.json", "b.parquet", "c.html", "d.json")


def fill(folder: Path, words: str, names: tuple[str, ...] = NAMES) -> None:
    with filled_together(folder) as stage:
        for name in names:
            write_text(stage / name, f"{words} {name}")


def words_in(folder: Path) -> set[str]:
    """Whose files these are; all names are there."""
    assert {name for name in os.listdir(folder) if not name.startswith(".dynid-")} == set(NAMES)
    return {(folder / name).read_text().split()[0] for name in NAMES}


CALLS = ("rename", "replace", "link", "mkdir", "fsync", "open")
HARMLESS = ("rename", "link", "mkdir", "open")
"""Some of these may fail: a lock or a link that is not to be had, a folder that is there, clearing up at the end."""


def failure_of(work) -> OSError | None:
    try:
        work()
    except OSError as error:
        return error
    return None


def nth(name: str, n: int, then, monkeypatch):
    """Let the n-th call of a function of `os` do something else."""
    whole, count = getattr(os, name), [0]

    def counted(*args, **kwargs):
        count[0] += 1
        return then(*args) if count[0] == n else whole(*args, **kwargs)

    monkeypatch.setattr(together.os, name, counted)
    return count


def refuse(*args):
    raise OSError(errno.EIO, "Input/output error", str(args[0]))


def test_every_call_that_fails_leaves_the_old_files(tmp_path, monkeypatch):
    """Each call in turn, until one more than there are: then the new files are there."""
    n_faults = 0
    for name in CALLS:
        for n in range(1, 100):
            folder = tmp_path / f"{name}_{n}"
            fill(folder, "old")
            with monkeypatch.context() as patch:
                count = nth(name, n, refuse, patch)
                failure = failure_of(lambda folder=folder: fill(folder, "new"))
            if failure is None:
                assert words_in(folder) == {"new"}
                assert count[0] < n or name in HARMLESS
            else:
                assert failure.is_sentence
                assert "input/output error" in str(failure)
                assert words_in(folder) == {"old"}
            n_faults += count[0] >= n
            fill(folder, "last")
            assert sorted(os.listdir(folder)) == sorted(NAMES)
            if count[0] < n:
                break
        else:
            pytest.fail(f"{name} has no end")
    assert n_faults >= 30


def test_what_is_refused_after_some_were_moved_is_put_back(tmp_path, monkeypatch):
    for name in NAMES[:3]:  # the fourth is not there yet
        (tmp_path / name).write_text(f"old {name}")
    inodes = {name: (tmp_path / name).stat().st_ino for name in NAMES[:3]}
    nth("replace", sum(1 for _ in NAMES), refuse, monkeypatch)
    with pytest.raises(OSError, match="input/output error"):
        fill(tmp_path, "new")
    assert {name: (tmp_path / name).stat().st_ino for name in os.listdir(tmp_path)} == inodes


KILLED = """
import os, signal, sys
from pathlib import Path
import dynid_rs.base.together as together
from dynid_rs.base.files import filled_together, write_text
folder, call, n, names = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4:]
whole, count = getattr(os, call), 0
def counted(*args, **kwargs):
    global count
    count += 1
    if count == n:
        os.kill(os.getpid(), signal.SIGKILL)
    return whole(*args, **kwargs)
with filled_together(folder) as stage:
    for name in names:
        write_text(stage / name, f"new {name}")
    setattr(together.os, call, counted)
"""


def killed_at(folder: Path, call: str, n: int) -> int:
    command = [sys.executable, "-c", KILLED, str(folder), call, str(n), *NAMES]
    return subprocess.run(command, env=ENVIRONMENT, check=False).returncode


@pytest.mark.parametrize(("call", "n", "whose"), [("link", 3, "old"), ("replace", 1, "new"), ("replace", 3, "new")])
def test_a_kill_leaves_one_runs_files(call, n, whose, tmp_path):
    """Before the first file moves they are the old ones; from then on the next run goes on moving."""
    fill(tmp_path, "old")
    assert killed_at(tmp_path, call, n) == -signal.SIGKILL
    assert any(name.startswith(".dynid-") for name in os.listdir(tmp_path))
    write_json(tmp_path / "other", {})
    (tmp_path / "other").unlink()
    assert words_in(tmp_path) == {whose}
    assert sorted(os.listdir(tmp_path)) == sorted(NAMES)


def test_the_next_results_are_not_overtaken_by_a_killed_runs(tmp_path):
    fill(tmp_path, "old")
    assert killed_at(tmp_path, "replace", 2) == -signal.SIGKILL
    fill(tmp_path, "newest")
    finish_killed(tmp_path)
    assert words_in(tmp_path) == {"newest"}


def test_what_somebody_wrote_after_the_kill_stays(tmp_path):
    fill(tmp_path, "old")
    assert killed_at(tmp_path, "replace", 2) == -signal.SIGKILL
    (tmp_path / "d.json").write_text("mine d.json")
    finish_killed(tmp_path)
    assert [(tmp_path / name).read_text().split()[0] for name in NAMES] == ["new", "new", "new", "mine"]


def test_a_report_is_not_made_of_two_runs(tmp_path):
    """It reads what the killed run wrote, all of it."""
    from helpers.small_arm import study

    for name in os.listdir(study().output):
        shutil.copy(study().output / name, tmp_path / name)
    journal = tmp_path / f".dynid-0123456789ab{COMMITTED}"
    journal.mkdir(0o700)
    (tmp_path / "result.json").rename(journal / "result.json")
    (tmp_path / "result.json").write_text("an older one")
    os.utime(tmp_path / "result.json", (0, 0))
    done = process("report", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert sorted(os.listdir(tmp_path)) == sorted(os.listdir(study().output))


@pytest.mark.skipif(os.geteuid() != 0, reason="files cannot be given away here")
def test_a_strangers_folder_is_not_believed(tmp_path):
    """In a folder that many may write to, its files would take the place of ours."""
    for change in (lambda path: os.chown(path, 12345, 12345), lambda path: path.chmod(0o777)):
        fill(tmp_path, "ours")
        journal = tmp_path / f".dynid-0123456789ab{COMMITTED}"
        journal.mkdir(0o700)
        (journal / "a.json").write_text("theirs")
        change(journal)
        finish_killed(tmp_path)
        assert words_in(tmp_path) == {"ours"}
        shutil.rmtree(journal)


def test_a_device_is_not_replaced_by_a_killed_runs_file(tmp_path):
    journal = tmp_path / f".dynid-0123456789ab{COMMITTED}"
    journal.mkdir(0o700)
    (journal / "pipe").write_text("new")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match=r"an earlier run was killed .* \(pipe is no file there\); remove .* run again"):
        write_text(tmp_path / "a", "x")
    assert stat.S_ISFIFO((tmp_path / "pipe").lstat().st_mode)
    assert (journal / "pipe").read_text() == "new"


def test_two_at_once_do_not_mix(tmp_path):
    fill(tmp_path, "first")
    seen: list[set[str]] = []
    workers = [threading.Thread(target=lambda k=k: [fill(tmp_path, f"w{k}") for _ in range(40)]) for k in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
        with together.alone_in(tmp_path):
            seen.append(words_in(tmp_path))
    assert all(len(words) == 1 for words in seen)
    assert sorted(os.listdir(tmp_path)) == sorted(NAMES)


def test_a_file_system_without_links_or_locks(tmp_path, monkeypatch):
    monkeypatch.setattr(together.os, "link", refuse)
    monkeypatch.setattr(together.fcntl, "flock", refuse)
    fill(tmp_path, "old")
    nth("replace", 3, refuse, monkeypatch)
    with pytest.raises(OSError, match="input/output error"):
        fill(tmp_path, "new")
    assert words_in(tmp_path) == {"old"}
