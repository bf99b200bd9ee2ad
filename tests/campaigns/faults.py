"""Every call that changes the disk fails in turn: `python tests/campaigns/faults.py --count 200` (needs strace).

strace answers in the system's place, so Python, Arrow and Rust are met alike. A command whose call has failed may end
with an error or do without; what must not be is a traceback, a file lost, a mixture of two runs, a leftover.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from helpers.small_arm import study

from campaigns.commands import BY_NAME, Writing, faults_of, is_new, lay_old_results, prepare, start

CALLS = (
    *("write", "writev", "pwrite64", "fsync", "fdatasync", "ftruncate", "flock"),
    *("rename", "renameat", "renameat2", "link", "linkat", "mkdir", "mkdirat", "unlink", "unlinkat", "rmdir"),
)
ERRORS = ("EIO", "ENOSPC")
FAILED = ("identify", "estimate", "simulate", "excite", "stream")


def traced(*options: str) -> tuple[str, ...]:
    """The beginning of a command line."""
    return ("strace", "-f", "--seccomp-bpf", "-qq", *options)


def calls_of(writing: Writing, folder: Path) -> Counter[str]:
    """How often each call comes in the process that writes."""
    lay_old_results(writing, folder)
    log = folder / "calls"
    code = start(writing, folder, *traced("-e", f"trace={','.join(CALLS)}", "-o", str(log))).wait()
    if code not in (0, 1) or not is_new(writing, folder):
        raise RuntimeError(f"{writing.name} fails under strace: {(folder / 'said').read_text()[-500:]}")
    lines = log.read_text(errors="replace").splitlines()
    first = lines[0].split()[0] if lines else ""
    named = (re.match(r"(\d+)\s+(\w+)\(", line) for line in lines)
    return Counter(match[2] for match in named if match and match[1] == first)


def fails(writing: Writing, folder: Path, call: str, k: int, error: str) -> list[str]:
    """What is wrong after the k-th `call` has failed."""
    lay_old_results(writing, folder)
    trace = traced("-e", f"trace={call}", "-e", f"inject={call}:error={error}:when={k}", "-o", "/dev/null")
    code = start(writing, folder, *trace).wait()
    said = (folder / "said").read_text(errors="replace")
    wrong = faults_of(writing, folder)
    if "Traceback" in said or "panicked" in said:
        wrong.append(f"a traceback: {said[-300:]}")
    if code not in (0, 1, 2, 141):
        wrong.append(f"exit code {code}: {said[-300:]}")
    if code == 2 and is_new(writing, folder) and call not in ("write", "flock"):
        wrong.append(f"refused, yet the new files are there: {said[-300:]}")
    return wrong


def campaign(names: tuple[str, ...], count: int, seed: int) -> dict[str, object]:
    """Figures, and whatever was found."""
    draw = random.Random(seed)
    found, tried = [], Counter[str]()
    with tempfile.TemporaryDirectory(prefix="faults-") as temporary:
        folder = Path(temporary)
        prepare(folder, study().output / "model.json")
        every = [
            (name, call, k)
            for name in names
            for call, n in sorted(calls_of(BY_NAME[name], folder).items())
            for k in range(1, n + 1)
        ]
        for name, call, k in draw.sample(every, min(count, len(every))):
            error = draw.choice(ERRORS)
            tried[call] += 1
            wrong = fails(BY_NAME[name], folder, call, k, error)
            if wrong:
                found.append({"command": name, "call": f"{call} {k}", "error": error, "wrong": wrong})
                print(f"{name}, {call} {k}, {error}: {wrong}", file=sys.stderr, flush=True)
    return {"of": len(every), "injected": sum(tried.values()), "by_call": dict(sorted(tried.items())), "found": found}


def main() -> int:
    """Print the figures as JSON; 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=FAILED, action="append")
    options = parser.parse_args()
    if shutil.which("strace") is None:
        print("error: strace is missing; install it (Debian: apt install strace)", file=sys.stderr)
        return 2
    figures = campaign(tuple(options.only or FAILED), options.count, options.seed)
    print(json.dumps(figures, indent=2))
    return int(bool(figures["found"]))


if __name__ == "__main__":
    sys.exit(main())
