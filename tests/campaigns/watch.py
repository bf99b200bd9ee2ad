"""Watches arms that the exam draws: hours in which nothing changes, and changes of every kind; writes the page.

python tests/campaigns/watch.py --seed N [--cycles 10000000] [--cases 20] [--page docs/measured/watch.md]
                                [--jobs 2] [--keep FILE.json]

The product sees a robot file and recordings. With --keep what was found stays in FILE, and the same command goes on
where it broke off. Seeds below 1000 are for choosing, those from 1000 on for reporting.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # arms are worked on side by side
os.environ.setdefault("RAYON_NUM_THREADS", "1")
if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from exam.draw import REPORTED, stream

from campaigns import watch_page
from campaigns.kept import commit
from campaigns.watch_arm import LEARNED, MOTIONS, draw_watched, prepare
from campaigns.watch_changes import AT, CHANGES, ENDS
from campaigns.watch_clean import watch_clean
from campaigns.watch_judge import judge

ARMS = 5
"""In which nothing changes."""
HEALTHY, HEALTHY_SECONDS = (0.5, 0.5, 0.5), 80.0
LARGEST = 2**31

Figures = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for."""
    options = _parser().parse_args(arguments)
    found = _kept(options)
    jobs = jobs_of(options.seed, options.cycles, options.cases)
    waiting = {name: job for name, job in jobs.items() if name not in found["done"]}
    with ProcessPoolExecutor(options.jobs) as pool:
        running = {pool.submit(work, job): name for name, job in waiting.items()}
        for future in as_completed(running):
            name = running[future]
            found["done"][name] = future.result()
            print(f"[{len(found['done'])}/{len(jobs)}] {name}", flush=True)
            if options.keep is not None:
                options.keep.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    results = [found["done"][name] for name in jobs]
    print(watch_page.marks_table(results))
    if options.page is not None:
        before = options.page.read_text(encoding="utf-8") if options.page.exists() else ""
        options.page.write_text(watch_page.page(found["invocation"], results, before), encoding="utf-8")
        print(f"page: {options.page}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Campaign of dynid watch")
    parser.add_argument("--seed", type=int, required=True, help="from which arms, motions and changes are drawn")
    parser.add_argument("--cycles", type=int, default=10_000_000, help="in which nothing changes, of all arms together")
    parser.add_argument("--cases", type=int, default=20, help="arms on which each kind of change is tried once")
    parser.add_argument("--page", type=Path, help="write the tables to this Markdown file")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="arms side by side")
    parser.add_argument("--keep", type=Path, help="file in which figures stay; goes on where it broke off")
    return parser


def _kept(options: argparse.Namespace) -> Figures:
    """What an earlier call has kept, if it was the same."""
    invocation = {"seed": options.seed, "cycles": options.cycles, "cases": options.cases, "commit": commit()}
    if options.keep is not None and options.keep.exists():
        kept = json.loads(options.keep.read_text(encoding="utf-8"))
        if kept["invocation"] != invocation:
            raise SystemExit(f"error: {options.keep} is of another call or commit; give another file")
        return kept
    return {"invocation": invocation, "done": {}}


def jobs_of(seed: int, cycles: int, cases: int) -> dict[str, tuple[str, int, int]]:
    """What is to be done, by name: kind of work, seed of the arm, cycles."""
    drawn = REPORTED + stream(seed, 44).choice(LARGEST - REPORTED, ARMS + cases, replace=False)
    clean = {f"clean {k}": ("clean", int(s), cycles // ARMS) for k, s in enumerate(drawn[:ARMS])}
    return clean | {f"changes {k}": ("changes", int(s), 0) for k, s in enumerate(drawn[ARMS:])}


def work(job: tuple[str, int, int]) -> Figures:
    """Do one job; an arm that stops with an error is counted, and its error is kept."""
    kind, seed, cycles = job
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an identification that has not converged shows in its error
            found = watch_clean(seed, cycles).to_json() if kind == "clean" else examine(seed)
    except (ValueError, RuntimeError) as error:
        return {"work": kind, "seed": seed, "failure": f"{type(error).__name__}: {error}"}
    return {"work": kind, "seed": seed, "failure": None, **found}


def examine(seed: int, motions: Sequence[str] = LEARNED) -> Figures:
    """Draw the arm of a seed, and put each change into a run of its own."""
    arm = draw_watched(seed)
    ready = prepare(arm, warmths=HEALTHY, seconds=HEALTHY_SECONDS, motions=motions)
    outcomes = []
    for k, (label, put) in enumerate(CHANGES.items()):
        rng = stream(seed, 42, k)
        change, truth = put(rng, ready)
        motion = str(rng.choice(MOTIONS))
        run = arm.record(ready.first + k, ENDS, motion, change=change)
        outcome = judge(label, seed, truth, arm.joints, ready.watch.watch(run), float(run.t[0]) + AT)
        outcomes.append(outcome.to_json() | {"motion_kind": motion})
    case = arm.world.case
    about = {"joints": case.n_joints, "encoders": case.n_encoders, "mass": case.mass, "error": ready.error.tolist()}
    return {**about, "outcomes": outcomes}


if __name__ == "__main__":
    sys.exit(main())
