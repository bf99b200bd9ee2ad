"""`dynid` in a process of its own, for what only a process shows: streams, signals, exit codes."""

import os
import subprocess
import sys
from pathlib import Path

import dynid_rs

DYNID = (sys.executable, "-c", "from dynid_rs.cli import main; main()")
ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(dynid_rs.__file__).parents[1])}


def process(*arguments: object, code: str = DYNID[2], **environment: str) -> subprocess.CompletedProcess[str]:
    """`dynid` in a process of its own, with its streams."""
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=ENVIRONMENT | environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
