"""A fleet of simulated arms, some of them odd in a known way: what `dynid fleet` finds, and the page about it.

python tests/campaigns/fleet.py --seed N [--arms 1000] [--odd 0.1] [--jobs 1] [--page docs/measured/fleet.md]
                                [--folder DIR]

The product sees robot files, recordings and a fleet file. With --folder everything stays there, and the same command
goes on where it broke off. Seeds below 1000 are for choosing, those from 1000 on for reporting.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # arms are worked on side by side
os.environ.setdefault("RAYON_NUM_THREADS", "1")
if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
import pyarrow.parquet as pq
from exam.draw import stream

import dynid_rs as dyn
from campaigns import fleet_page
from campaigns.fleet_arms import write_fleet
from campaigns.fleet_judge import clean_fleets, coverage, judge_arm, tails, unseen

Figures = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for."""
    options = _parser().parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="dynid-fleet-") as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        found = campaign(folder, options.seed, options.arms, options.odd, options.jobs)
    found["invocation"] = {"seed": options.seed, "arms": options.arms, "odd": options.odd}
    print(fleet_page.marks_table(found))
    if options.page is not None:
        options.page.write_text(fleet_page.page(found), encoding="utf-8")
        print(f"page: {options.page}")
    return 0


def campaign(folder: Path, seed: int, n_arms: int, odd: float, jobs: int) -> Figures:
    """Draw, identify, judge."""
    begin = time.perf_counter()
    toml, arms = write_fleet(folder, seed, range(n_arms), odd)
    print(f"{n_arms} arms written in {time.perf_counter() - begin:.0f} s", flush=True)
    output = folder / "out"
    cost = _identify(toml, output, jobs)
    print(f"identified, {cost['seconds']:.2f} s per arm", flush=True)
    answer = json.loads((output / "fleet.json").read_text(encoding="utf-8"))
    rows = {row["name"]: row for row in answer["robots"]}
    failed = [(name, row["message"]) for name, row in rows.items() if row["status"] == "failed"]
    there = [arm for arm in arms if rows[arm.name]["status"] != "failed"]
    judged = [judge_arm(arm, rows[arm.name]) for arm in there]
    table = _quantities(output, answer)
    clean = [arm for arm in there if arm.odd is None]
    fleet = dyn.identify_fleet(toml, output)  # nothing is done again
    return {
        "arms": judged,
        "failed": failed,
        "cost": cost | {"report_bytes": (output / "fleet.html").stat().st_size},
        "pooling": {key: answer["pooling"][key] for key in ("false_alarms", "n_tests", "limit", "least_arms")},
        "coverage": coverage({arm.name: arm for arm in there}, table),
        "tails": tails({arm.name for arm in clean}, table),
        "unseen": unseen(fleet, clean, folder, output),
        "clean_fleets": clean_fleets(fleet.types_[0], stream(seed, 61), answer["pooling"]["false_alarms"]),
    }


def _identify(toml: Path, output: Path, jobs: int) -> Figures:
    command = [sys.executable, "-m", "dynid_rs", "fleet", toml, "-o", output, "--jobs", str(jobs), "--json"]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    # Between one row and the next, whichever call wrote them.
    written = np.sort([path.stat().st_mtime for path in (output / ".rows").glob("*.json")])
    return {"seconds": float(np.median(np.diff(written))) * jobs, "memory": memory, "jobs": jobs}


def _quantities(output: Path, answer: Figures) -> dict[str, Any]:
    """Columns of quantities.parquet, and the speed at which friction is meant."""
    table = pq.read_table(output / "quantities.parquet")
    columns = {name: table[name].to_numpy() for name in table.column_names}
    speeds = {
        (one["name"], quantity["place"]): quantity["at"]
        for one in answer["pooling"]["types"]
        for quantity in one["quantities"]
        if quantity["kind"] == "friction"
    }
    at = [speeds.get(pair, 0.0) for pair in zip(columns["type"], columns["place"], strict=True)]
    return columns | {"at": np.array(at)}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Campaign of dynid fleet")
    parser.add_argument("--seed", type=int, required=True, help="from which arms, motions and oddities are drawn")
    parser.add_argument("--arms", type=int, default=1000)
    parser.add_argument("--odd", type=float, default=0.1, help="share of arms that are odd")
    parser.add_argument("--jobs", type=int, default=1, help="robots at the same time")
    parser.add_argument("--page", type=Path, help="write the tables to this Markdown file")
    parser.add_argument("--folder", type=Path, help="keep everything here")
    return parser


if __name__ == "__main__":
    sys.exit(main())
