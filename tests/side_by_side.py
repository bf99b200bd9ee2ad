"""`python tests/side_by_side.py [ARGUMENT...]`: the test files in as many processes of pytest as there are cores.

A process is as good as the whole run: no worker shares a standard stream or a thread with its neighbours, as tests that
start, stop and kill processes need it. A file stays whole, for its tests share what is costly to make.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
NONE_COLLECTED = 5


def main(arguments: list[str]) -> int:
    """Run all tests; the worst exit code. What each process says is printed when it has ended, failures last."""
    parts = shared_out(sorted(HERE.rglob("test_*.py")), os.cpu_count() or 1)
    with tempfile.TemporaryDirectory() as folder:
        running = [_started(part, arguments, Path(folder) / f"{k}.txt") for k, part in enumerate(parts)]
        ended = []
        for process, said in running:
            code = process.wait()
            ended.append((0 if code == NONE_COLLECTED else code, said.read_text(encoding="utf-8", errors="replace")))
    for _, text in sorted(ended):
        print(text, flush=True)
    return max(code for code, _ in ended)


def shared_out(files: list[Path], n: int) -> list[list[Path]]:
    """Files in at most `n` parts, one after the other as cards are dealt: what is costly lies side by side by name."""
    return [files[k::n] for k in range(min(n, len(files)))]


def _started(files: list[Path], arguments: list[str], said: Path) -> tuple[subprocess.Popen[bytes], Path]:
    command = [sys.executable, "-m", "pytest", "-q", *arguments, *map(str, files)]
    with said.open("wb") as out:
        return subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT), said


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
