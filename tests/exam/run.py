"""`make exam`: draws cases, has them diagnosed, and writes the page.

python tests/exam/run.py [--seeds 0-19,40] [--count 200] [--page docs/measured/exam.md] [--jobs 2] [--keep DIR]
                         [--only 3,7]

Without --seeds fresh ones are drawn from the clock, 1000 or more: those are for reporting. Seeds below 1000 are for
choosing. With --keep the cases stay in DIR, and the same command goes on where it broke off.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # cases are worked on side by side
if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from exam.draw import REPORTED
from exam.examine import OUTCOME, Way, default_program, examine
from exam.page import goals_table, page
from exam.tally import Outcome, complaints

INVOCATION = "exam.json"
LARGEST = 2**31


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for; 1 if a case has failed."""
    options = _parser().parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="exam-") as temporary:
        folder = options.keep or Path(temporary)
        invocation = _invocation(options, folder)
        if invocation is None:
            sys.stderr.write(f"error: {folder} holds other seeds or another version; give an empty folder\n")
            return 2
        wanted = options.only or invocation["seeds"]
        outcomes = _outcomes(wanted, folder, options)
    print(goals_table(outcomes))
    if options.page is not None:
        machine = f"{os.cpu_count()} processors, {options.jobs} cases side by side."
        text = page(outcomes, invocation["version"], machine)
        partial = options.page.with_suffix(".part")
        partial.write_text(text, encoding="utf-8")
        partial.replace(options.page)
        print(f"page: {options.page}")
    return int(any(outcome["failure"] for outcome in outcomes))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Exam of dynid diagnose")
    parser.add_argument("--seeds", type=seeds_of, help="as in 0-19,40; fresh ones by default")
    parser.add_argument("--count", type=int, default=200, help="how many fresh seeds")
    parser.add_argument("--only", type=seeds_of, help="these of the seeds")
    parser.add_argument("--page", type=Path, help="write the tables to this Markdown file")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="cases side by side")
    parser.add_argument("--keep", type=Path, help="folder in which cases and scores stay; goes on where it broke off")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds after which a case is given up")
    parser.add_argument("--program", default=default_program(), help="the command that is examined")
    return parser


def seeds_of(text: str) -> list[int]:
    """Seeds of `1000-1199,5`."""
    seeds = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        seeds += range(int(first), int(last or first) + 1)
    return seeds


def fresh_seeds(count: int) -> list[int]:
    """Seeds for reporting that nobody has looked at, drawn from the clock."""
    rng = np.random.default_rng(time.time_ns())
    return sorted(int(seed) for seed in REPORTED + rng.choice(LARGEST - REPORTED, count, replace=False))


def _invocation(options: argparse.Namespace, folder: Path) -> dict | None:
    """Return seeds and version of this exam: those of a folder that goes on, or new ones; None where they clash."""
    path, version = folder / INVOCATION, _version(options.program)
    if path.exists():
        begun = json.loads(path.read_text(encoding="utf-8"))
        same = begun["version"] == version and (options.seeds is None or options.seeds == begun["seeds"])
        return begun if same else None
    folder.mkdir(parents=True, exist_ok=True)
    begun = {"seeds": options.seeds or fresh_seeds(options.count), "version": version}
    path.write_text(json.dumps(begun) + "\n", encoding="utf-8")
    return begun


def _version(program: str) -> str:
    """Return what is examined, in words: the package's version, and the commit where there is one."""
    told = subprocess.run([program, "--version"], capture_output=True, text=True, check=False).stdout.strip()
    command = ["git", "describe", "--always", "--dirty"]
    here = Path(__file__).resolve().parent
    try:
        commit = subprocess.run(command, capture_output=True, text=True, check=False, cwd=here).stdout.strip()
    except FileNotFoundError:
        commit = ""
    return f"{told or 'dynid'}{f', commit {commit}' if commit else ''}."


def _outcomes(seeds: list[int], folder: Path, options: argparse.Namespace) -> list[Outcome]:
    threads = max(1, (os.cpu_count() or 1) // options.jobs)
    way = Way(options.program, options.timeout, threads, options.keep is not None)
    done = {seed: folder / str(seed) / OUTCOME for seed in seeds}
    outcomes = [json.loads(path.read_text(encoding="utf-8")) for path in done.values() if path.exists()]
    with ProcessPoolExecutor(options.jobs) as pool:
        waiting = [pool.submit(examine, seed, folder / str(seed), way) for seed in seeds if not done[seed].exists()]
        for future in as_completed(waiting):
            outcome = future.result()
            outcomes.append(outcome)
            wrong = "; ".join(complaints(outcome)) or "right"
            print(f"[{len(outcomes)}/{len(seeds)}] {outcome['seed']} {outcome['group']}: {wrong}", flush=True)
    return outcomes


if __name__ == "__main__":
    raise SystemExit(main())
