"""Two processes against one on streamed runs: the same units of work, one Rust thread in each process.

Rounds alternate. The wall clock's ratio needs two idle cores. Where other programs use them, processor time says more:
what two workers and the process that gathers their results use, laid on two cores, beside what one process uses.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from pathlib import Path
from typing import Any

os.environ["RAYON_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from helpers.made_runs import MadeRun, arm

from dynid_rs import ThreeLoopIdentifier
from dynid_rs.archive import Archive
from dynid_rs.archive.reduction import Reduced, Reduction, Totals, reduce_run
from dynid_rs.archive.survey import survey_run
from dynid_rs.archive.work import Work

N_RUNS, DURATION, ROUNDS = 32, 60.0, 5


def clocked(unit: Any, *arguments: Any) -> Any:
    """Result of a unit, with the processor time that it took [s]."""
    start = time.process_time()
    plain, arrays = unit(*arguments)
    return plain | {"processor": time.process_time() - start}, arrays


def survey_clocked(source: MadeRun) -> Any:
    return clocked(survey_run, source)


def reduce_clocked(source: MadeRun, reduction: Reduction) -> Any:
    return clocked(reduce_run, source, reduction)


def passes(n_jobs: int, sources: list[MadeRun], reduction: Reduction) -> tuple[float, float, float]:
    """Wall clock of both passes by `n_jobs` processes, processor time of the units, and of this process [s]."""
    work, totals, units = Work(n_jobs=n_jobs), Totals(reduction), 0.0
    wall, here = time.perf_counter(), time.process_time()
    for plain, _ in work.map(survey_clocked, sources):
        units += plain["processor"]
    for entry in work.map(reduce_clocked, sources, reduction):
        units += entry[0]["processor"]
        totals.add(Reduced.from_entry(entry))
    return time.perf_counter() - wall, units, time.process_time() - here


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=N_RUNS)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--json", action="store_true", help="for benches/scale.py")
    options = parser.parse_args()
    sources = [MadeRun(seed, DURATION) for seed in range(options.runs)]
    archive = Archive(arm(), sources[:6], memory=10**9)
    identifier = ThreeLoopIdentifier(arm(), residual=None).fit(archive.sample())
    reduction = Reduction.of(identifier)
    passes(2, sources[:4], reduction)  # starts the processes
    walls, projected = [], []
    for _ in range(options.rounds):
        one, _, whole = passes(1, sources, reduction)
        two, units, gathering = passes(2, sources, reduction)
        walls.append(one / two)
        projected.append(whole / (units / 2 + gathering))
        if options.json:
            continue
        print(
            f"wall clock {one:6.2f} s and {two:6.2f} s, {one / two:.2f} times; processor {whole:6.2f} s and "
            f"{units:6.2f} + {gathering:.2f} s, {projected[-1]:.2f} times on two idle cores",
            flush=True,
        )
    if options.json:
        print(json.dumps({"wall_clock": sorted(walls), "processor": sorted(projected)}))
        return
    for name, ratios in (("wall clock", walls), ("processor time", projected)):
        print(f"two processes by {name}: {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")
    print(f"load of the machine over the last five minutes: {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
