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
        timeout=240,
        check=False,
    )


def peak_bytes() -> int:
    """Most memory that this process ever had [bytes].

    On Linux `getrusage` does not tell: what it says begins with the peak of the process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        words = status.read_text(encoding="utf-8").split()
        return 1024 * int(words[words.index("VmHWM:") + 1])
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # in bytes on macOS
