"""Memory that runs out is one sentence and exit code 2: 1 would say that the answer is no."""

from __future__ import annotations

import errno
import json

import pytest
from helpers.small_arm import dynid, study

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
