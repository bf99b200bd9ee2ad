"""Pushes arms that the exam draws: detection delay against false alarms, for thresholds of every kind; writes the page.

python tests/campaigns/contacts.py --seed N [--arms 4] [--page docs/measured/contacts.md] [--jobs 1] [--keep FILE.json]

The product sees a robot file and recordings. With --keep what was found stays in FILE, and the same command goes on
where it broke off. Arms of seeds below 1000 are for choosing (--choose), those from 1000 on for reporting. With
DYNID_DATA set the page has a section on measured runs too.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # arms are worked on side by side
os.environ.setdefault("RAYON_NUM_THREADS", "1")
if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from exam.draw import REPORTED, stream

from campaigns import contacts_page
from campaigns.contacts_arm import TRAINED, examine
from campaigns.contacts_measured import examine_measured
from campaigns.guiding import guide
from campaigns.kept import commit

LARGEST = 2**31
GUIDED = 2
"""Arms that a hand guides, of those that are drawn: the loop goes through pipes, sample by sample."""

Figures = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for."""
    options = _parser().parse_args(arguments)
    invocation = {"seed": options.seed, "arms": options.arms, "choose": options.choose, "commit": commit()}
    found: Figures = {"invocation": invocation, "done": {}}
    if options.keep is not None and options.keep.exists():
        found = json.loads(options.keep.read_text(encoding="utf-8"))
        if {**found["invocation"], "commit": ""} != {**invocation, "commit": ""}:
            raise SystemExit(f"error: {options.keep} is of another call; give another file")
    jobs = jobs_of(options.seed, options.arms, options.choose)
    waiting = {name: job for name, job in jobs.items() if name not in found["done"]}
    with ProcessPoolExecutor(options.jobs) as pool:
        running = {pool.submit(work, job): name for name, job in waiting.items()}
        for future in as_completed(running):
            name = running[future]
            found["done"][name] = {**future.result(), "commit": commit()}
            print(f"[{len(found['done'])}/{len(jobs)}] {name}", flush=True)
            if options.keep is not None:
                options.keep.write_text(json.dumps(found) + "\n", encoding="utf-8")
    results = [found["done"][name] for name in jobs]
    print(contacts_page.tables(results))
    if options.page is not None:
        contacts_page.write(options.page, found["invocation"], results)
        print(f"page: {options.page}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Campaign of contacts and hand guiding")
    parser.add_argument("--seed", type=int, required=True, help="from which arms, motions and pushes are drawn")
    parser.add_argument("--arms", type=int, default=4, help="arms that are drawn")
    parser.add_argument("--choose", action="store_true", help="draw arms of seeds below 1000")
    parser.add_argument("--page", type=Path, help="write tables and figure to this Markdown file")
    parser.add_argument("--jobs", type=int, default=1, help="arms side by side")
    parser.add_argument("--keep", type=Path, help="file in which figures stay; goes on where it broke off")
    return parser


def jobs_of(seed: int, arms: int, choose: bool) -> dict[str, tuple[str, int, str]]:
    """What is to be done, by name: kind of work, seed of the arm, how well its model is known."""
    rng = stream(seed, 54)
    drawn = rng.choice(REPORTED, arms, replace=False) if choose else REPORTED + rng.choice(LARGEST - REPORTED, arms)
    jobs: dict[str, tuple[str, int, str]] = {}
    for k, arm in enumerate(map(int, drawn)):
        jobs |= {f"{knowledge} {k}": ("push", arm, knowledge) for knowledge in TRAINED}
        jobs |= {f"guide {k}": ("guide", arm, "")} if k < GUIDED else {}
        jobs |= {"measured": ("measured", seed, "")} if k == 0 and os.environ.get("DYNID_DATA") else {}
    return jobs


def work(job: tuple[str, int, str]) -> Figures:
    """Do one job; an arm that stops with an error is counted, and its error is kept."""
    kind, seed, knowledge = job
    done = {"push": lambda: examine(seed, knowledge), "guide": lambda: guide(seed)}
    try:
        found = examine_measured(seed) if kind == "measured" else done[kind]()
    except (ValueError, RuntimeError) as error:
        return {"work": kind, "seed": seed, "knowledge": knowledge, "failure": f"{type(error).__name__}: {error}"}
    return {"work": kind, "failure": None, **found}


if __name__ == "__main__":
    sys.exit(main())
