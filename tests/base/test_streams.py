"""Programs that are started without standard streams (`2>&-`): what is said has nowhere to go; nothing else changes."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from helpers.processes import ENVIRONMENT
from helpers.result_files import FILES
from helpers.small_arm import study

LOST = "error: standard output cannot be written (bad file descriptor), the answer is lost; send it to another place\n"


def closed(streams: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """`dynid` from a shell that closes streams for it."""
    command = [sys.executable, "-m", "dynid_rs", *map(str, arguments)]
    shell = ["sh", "-c", f'exec "$@" {streams}', "sh", *command]
    return subprocess.run(shell, env=ENVIRONMENT, capture_output=True, text=True, timeout=240, check=False)


def inspect(*options: str) -> tuple[object, ...]:
    return ("inspect", study().runs[0], *options)


def identify(folder: object, *options: str) -> tuple[object, ...]:
    return ("identify", study().robot, *study().runs, "-o", folder, *options)


def test_without_standard_error_the_answer_is_the_same(tmp_path):
    assert closed("2>&-", *inspect()).stdout == closed("", *inspect()).stdout
    done = closed("2>&-", *identify(tmp_path / "out", "--json"))
    assert done.returncode == 0
    assert json.loads(done.stdout)
    assert closed("2>&-", "inspect", tmp_path / "none.csv").returncode == 2
    # Nothing was written into a file that has got the number of the closed stream.
    for name in ("model.json", "result.json"):
        json.loads((tmp_path / "out" / name).read_text())


@pytest.mark.parametrize("options", [(), ("--json",)], ids=["text", "json"])
def test_without_standard_output_results_are_written_and_the_answer_is_lost(options, tmp_path):
    for arguments in (inspect(*options), identify(tmp_path / "out", *options)):
        done = closed(">&-", *arguments)
        assert (done.returncode, done.stderr) == (2, LOST)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == FILES


def test_without_any_stream(tmp_path):
    for arguments in (("--version",), ("inspect", "--help"), inspect(), ("inspect", tmp_path / "none.csv")):
        assert closed("<&- >&- 2>&-", *arguments).returncode == 2
    assert closed("<&-", *inspect()).returncode == 0
