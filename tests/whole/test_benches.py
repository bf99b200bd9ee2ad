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
