"""`python tests/side_by_side.py [ARGUMENT...]`: the test files in as many processes of pytest as there are cores.

A process is as good as the whole run: no worker shares a standard stream or a thread with its neighbours, as tests that
start, stop and kill processes need it. A file stays whole, for its tests share what is costly to make, and a few files
go together; whoever is done takes the next few.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
TOGETHER = 8
"""Files of a process: starting one takes two seconds, and the last ones to end should not be many."""
NONE_COLLECTED = 5


def main(arguments: list[str]) -> int:
    """Run all tests; the worst exit code. What each process says is printed when all have ended, failures last."""
    parts = shared_out(sorted(HERE.rglob("test_*.py")))
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        ended = list(pool.map(lambda part: _run(part, arguments), parts))
    for _, text in sorted(ended):
        print(text, flush=True)
    print(told([text for _, text in ended]), flush=True)
    return max(code for code, _ in ended)


def told(texts: list[str]) -> str:
    """What all processes' last lines say together, in pytest's own words."""
    counts = Counter[str]()
    for text in texts:
        for number, what in re.findall(r"(\d+) ([a-z]+)", text.rstrip().rpartition("\n")[2].partition(" in ")[0]):
            counts[what.removesuffix("s")] += int(number)
    return ", ".join(f"{number} {what}" for what, number in counts.items())


def shared_out(files: list[Path]) -> list[list[Path]]:
    """Files in parts of about as many, as cards are dealt: what is costly lies side by side by name."""
    n = -(-len(files) // TOGETHER)
    return [files[k::n] for k in range(n)]


def _run(files: list[Path], arguments: list[str]) -> tuple[int, str]:
    command = [sys.executable, "-m", "pytest", "-q", *arguments, *map(str, files)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return 0 if done.returncode == NONE_COLLECTED else done.returncode, done.stdout.decode(errors="replace")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
