"""Every figure side by side with its peer, written to docs/benchmarks.md. `--quick` leaves out what takes minutes."""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import dynamics
import excitation
import identification
import mixtures
import online
from measure import HEAD, ROOT, machine

INTRODUCTION = """# Benchmarks

Written by `make bench`. One thread each; ours and the peer run in turn in one process; times are the processor's,
medians over the rounds. A ratio says how many times faster ours is, with its least and greatest over the rounds. Before
anything is timed the two are checked to give the same numbers.
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave out what takes minutes")
    quick = parser.parse_args().quick
    parts = (
        ("One estimate, online", online.rows(100_000 if quick else online.CYCLES)),
        ("Dynamics", dynamics.rows()),
        ("Identification", identification.rows(large=not quick)),
        ("Excitation", excitation.rows()),
        ("Mixtures", mixtures.rows()),
    )
    page = [INTRODUCTION]
    for title, rows in parts:
        print(title, flush=True)
        page.append(f"## {title}\n\n{HEAD}")
        for row in rows:
            print(f"  {row}", flush=True)
            page.append(str(row))
        page.append("")
    page.append("## Machine\n")
    page.extend(f"* {line}" for line in machine())
    if not quick:
        (ROOT / "docs" / "benchmarks.md").write_text("\n".join(page) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
