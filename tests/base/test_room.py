"""How memory is held; where it runs out that is one sentence and exit code 2: 1 would say that the answer is no."""

from __future__ import annotations

import ctypes
import errno
import json
import os
import platform
import subprocess
import sys
from types import SimpleNamespace

import pytest
from helpers.small_arm import dynid, study

from dynid_rs.base import room
from dynid_rs.base.errors import DataError
from dynid_rs.base.room import RAN_OUT, ran_out


def chained(outer: Exception, inner: Exception, *, hidden: bool = False) -> Exception:
    """`outer`, raised where `inner` was caught."""
    outer.__context__, outer.__suppress_context__ = inner, hidden
    return outer


BROKEN = "The `scipy` install you are using seems to be broken"
MAP = "libscipy.so: failed to map segment from shared object"
RAN = {
    "python": MemoryError(),
    "system": OSError(errno.ENOMEM, "Cannot allocate memory"),
    "loader": ImportError(MAP),
    "behind another": chained(ImportError(BROKEN), ImportError(MAP)),
    "text of another process": chained(ImportError(BROKEN), RuntimeError(f"Traceback\nImportError: {MAP}\n")),
}
OTHER = {
    "an import": ImportError(BROKEN),
    "a file that says so": DataError("run.csv: 'Cannot allocate memory' is no number"),
    "a full disk": OSError(errno.ENOSPC, "No space left on device"),
    "another way was found": chained(ValueError("x"), ImportError(MAP), hidden=True),
}


@pytest.mark.parametrize("error", RAN.values(), ids=RAN)
def test_every_way_of_saying_it_is_known(error):
    assert ran_out(error)


@pytest.mark.parametrize("error", OTHER.values(), ids=OTHER)
def test_other_errors_are_others(error):
    assert not ran_out(error)


@pytest.mark.parametrize("error", [RAN["python"], RAN["loader"], RAN["behind another"], RAN["text of another process"]])
def test_a_command_says_it_to_people_and_programs(error, monkeypatch):
    def fails(*_, **__):
        raise error

    monkeypatch.setattr("dynid_rs.commands._inspection.read_run", fails)
    result = dynid("inspect", study().runs[0], "--json")
    assert result.exit_code == 2
    assert result.stderr == f"error: {RAN_OUT}\n"
    assert json.loads(result.stdout)["error"] == {"class": "MemoryError", "message": RAN_OUT}
    assert "--memory" in RAN_OUT


def asked_of_malloc(monkeypatch, library, **environment):
    """Let `one_heap` ask the allocator of a C library, in an environment that says this of malloc and no more."""
    for name in [name for name in os.environ if name.startswith("MALLOC_")]:
        monkeypatch.delenv(name)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(ctypes, "CDLL", library)
    room.one_heap()


def test_all_threads_share_a_heap_and_large_arrays_have_pages_of_their_own(monkeypatch):
    asked = {}
    asked_of_malloc(monkeypatch, lambda _: SimpleNamespace(mallopt=asked.__setitem__))
    assert asked == {room.M_ARENA_MAX: 1, room.M_MMAP_THRESHOLD: room.LARGE, room.M_TRIM_THRESHOLD: room.LARGE}


def test_what_the_environment_says_of_malloc_stays(monkeypatch):
    asked = {}
    asked_of_malloc(monkeypatch, lambda _: SimpleNamespace(mallopt=asked.__setitem__), MALLOC_ARENA_MAX="4")
    assert asked == {}


@pytest.mark.parametrize("refused", [None, OSError("no such library"), TypeError("a name is needed")])
def test_another_allocator_is_left_alone(monkeypatch, refused):
    """As on macOS, whose malloc has no such function, and where the program itself is no library."""
    looked_for = []

    def library(name):
        looked_for.append(name)
        if refused is not None:
            raise refused
        return SimpleNamespace()

    asked_of_malloc(monkeypatch, library)
    assert looked_for == [None]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_the_allocator_takes_what_it_is_asked():
    asked = "import ctypes; print([ctypes.CDLL(None).mallopt(p, v) for p, v in %r])"
    parameters = [(room.M_ARENA_MAX, 1), (room.M_MMAP_THRESHOLD, room.LARGE), (room.M_TRIM_THRESHOLD, room.LARGE)]
    done = subprocess.run([sys.executable, "-c", asked % parameters], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[1, 1, 1]"
