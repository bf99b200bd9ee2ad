"""Every figure side by side with its peer, written to docs/measured/benchmarks.md.

`--quick` leaves out what takes minutes.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import chain
import commands
import dynamics
import excitation
import footprint
import identification
import limits
import mixtures
import online
from measure import HEAD, ROOT, machine

INTRODUCTION = """# Benchmarks

Written by `make bench`. One thread each; ours and the peer run in turn in one process; times are the processor's,
medians over the rounds. A ratio says how many times faster ours is, with its least and greatest over the rounds. Before
anything is timed the two are checked to give the same numbers.

![Operations per nanosecond over operations per byte](figures/benchmarks.svg)

The lines are what one thread of this machine can do: arithmetic in registers, bytes out of each cache and of memory.
A kernel stands at the operations of its formulas, counted by running them on a number that counts, over the bytes of
what goes in and comes out; how far it stands below the lines is what it leaves. Turning rows of samples into lanes and
back counts as no operation.
"""

READING = """## Reading these figures

* The goals come from a prototype on a Zen 5 whose 512-bit units are whole and which did nothing else. A processor that
  runs 512-bit instructions in two halves (Zen 4) gains little over `avx2`, and a core that others share is slower for
  vector code than the ratio to scalar peers tells. Percentiles above p99 are then those of being interrupted.
* A regressor leaves here row by row, as numpy wants it, not in the lanes' order; of one call from Python
  about half is the arithmetic, the rest is checking three arrays and making a fourth.
* Base parameters come from sums of products where the condition of the columns, torque and all, allows it, and from
  orthogonal reflections where it does not, block by block; tests hold both to the same parameters.
* The search of G9 leaves to SciPy's SLSQP what is not an objective, in both; its own share, the bounds' and numpy's, is
  most of what is left of ours.
* The chain (G14) has no peer here: its limit was set against the paper's own computing. Mixtures are iterated in Rust
  (`solver="fused"`), from scikit-learn's start.
* A command's figure is the processor's of a whole process, start, report and files included; of `dynid --help` all is
  start.
* Of the wheel (G13) the compiled module is most, and of the module the kernels, which stand in it once for each kind of
  processor. Its profile (`[profile.wheel]`) optimises across crates, and what reads files for size.
* CasADi's C is that of `benches/arm_graph.py`, which leaves out every product with a zero of the robot file, and writes
  only entries that can differ from zero; ours takes any numbers, and one regressor writes all entries. A calibrated arm
  has no such zeros.
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave out what takes minutes")
    quick = parser.parse_args().quick
    parts = (
        ("What this machine can do, and our share of it", limits.rows()),
        ("One estimate, online", online.rows(100_000 if quick else online.CYCLES)),
        ("Dynamics", dynamics.rows()),
        ("Identification", identification.rows(large=not quick)),
        ("Excitation", excitation.rows()),
        ("Mixtures", mixtures.rows(large=not quick)),
        ("The whole chain", chain.rows()),
        ("Commands", commands.rows(measured=not quick)),
        ("Footprint", footprint.rows(wheel=not quick)),
    )
    page = [INTRODUCTION]
    for title, rows in parts:
        print(title, flush=True)
        page.append(f"## {title}\n\n{HEAD}")
        for row in rows:
            print(f"  {row}", flush=True)
            page.append(str(row))
        page.append("")
    page.append(READING)
    page.append("## Machine\n")
    page.extend(f"* {line}" for line in machine())
    if not quick:
        (ROOT / "docs" / "measured" / "benchmarks.md").write_text("\n".join(page) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
