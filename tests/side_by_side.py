"""`python tests/side_by_side.py [ARGUMENT...]`: the test files in as many processes of pytest as there are cores.

A process is as good as the whole run: no worker shares a standard stream or a thread with its neighbours, as tests that
start, stop and kill processes need it. A file stays whole and beside the others of its room, for tests share what is
costly to make: an arm that was simulated and identified once serves every file of the process.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
LONG = ("whole/test_measured.py", "house/test_docs.py", "equations/test_paper.py")
"""Files of about a minute and more. Each begins early and alone: none is the one that all others wait for."""
LEAST = 2
"""Files of a process: starting one takes two seconds."""
NONE_COLLECTED = 5
ENVIRONMENT = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "RAYON_NUM_THREADS"), "1") | os.environ
"""Each process has one core. More threads than cores spin while they wait for each other, up to half of all time."""


def main(arguments: list[str]) -> int:
    """Run all tests; the worst exit code. What each process says is printed when all have ended, failures last."""
    cores = os.cpu_count() or 1
    parts = shared_out(sorted(HERE.rglob("test_*.py")), [HERE / name for name in LONG], cores)
    with ThreadPoolExecutor(cores) as pool:
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


def shared_out(files: Sequence[Path], long: Sequence[Path], cores: int) -> list[list[Path]]:
    """Long files alone and first; of the others in their order ever smaller parts, so that all cores end together."""
    parts = [[path] for path in long if path in files]
    left = [path for path in files if path not in long]
    while left:
        n = max(-(-len(left) // (3 * cores)), LEAST)
        parts.append(left[:n])
        left = left[n:]
    return parts


def _run(files: list[Path], arguments: list[str]) -> tuple[int, str]:
    command = [sys.executable, "-m", "pytest", "-q", *arguments, *map(str, files)]
    done = subprocess.run(command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return 0 if done.returncode == NONE_COLLECTED else done.returncode, done.stdout.decode(errors="replace")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
