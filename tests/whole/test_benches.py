"""What `make bench` takes minutes for, once and small: it is run by hand, and nobody would see that it stopped."""

import json
import subprocess
import sys

from helpers.data import ROOT

SMALL = """
import json
import chain, commands

said = [str(row) for row in chain.rows()]
print(json.dumps([said, commands._taken(["true"])]))
"""


def test_the_chain_and_the_clock_of_commands_still_run():
    done = subprocess.run(
        [sys.executable, "-c", SMALL], cwd=ROOT / "benches", stdout=subprocess.PIPE, text=True, check=True
    )
    rows, (_, _, size) = json.loads(done.stdout.splitlines()[-1])
    assert any("the whole chain" in row for row in rows)
    assert size < 50e6, "a command that does nothing is as large as who measures it"


def test_the_memory_of_a_process_is_its_own_however_large_who_started_it():
    """A bench of memory that is started by one that had a gigabyte said 0.0 MB of whatever it did."""
    grown = run_by_a_large_one("memory.py")
    assert 0.5 < grown["megabytes"] < 50.0
    assert grown["growth"] <= grown["megabytes"]


def run_by_a_large_one(script):
    """What a bench prints that is started by a process that has had half a gigabyte."""
    large = (
        f"import subprocess, sys; bytes(b'1') * 500_000_000; subprocess.run([sys.executable, {script!r}], check=True)"
    )
    done = subprocess.run(
        [sys.executable, "-c", large], cwd=ROOT / "benches", stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout)
