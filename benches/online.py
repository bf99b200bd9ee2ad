"""Time of one torque estimate: the Rust bench, its percentiles as rows."""

from __future__ import annotations

import json
import shutil
import subprocess

from measure import ROOT, Row

CYCLES = 10_000_000
LIMITS = {"p50_ns": 300, "p99.9_ns": 500}
"""Free-running, on the widest registers [ns]."""


def rows(cycles: int = CYCLES):
    """Goal G12 as far as one estimate is concerned."""
    if shutil.which("cargo") is None:
        yield Row("G12", "one torque estimate", "cargo is missing", "")
        return
    command = ["cargo", "bench", "--quiet", "-p", "dynid-core", "--bench", "estimate", "--", str(cycles)]
    lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    found = [json.loads(line) for line in lines if line.startswith("{")]
    clock = next(entry for entry in found if entry["what"] == "clock alone")
    yield Row(
        "", f"the clock alone, {cycles:,} readings", f"p50 {clock['p50_ns']} ns, p99.9 {clock['p99.9_ns']} ns", ""
    )
    widest = found[-1]["path"]
    for entry in found[1:]:
        figures = ", ".join(f"{key[:-3]} {entry[key]}" for key in ("p50_ns", "p99_ns", "p99.9_ns", "p99.99_ns")) + " ns"
        what = f"{entry['what']}, {entry['cycles']:,} cycles, {entry['path']}"
        if entry["what"] == "estimate" and entry["path"] == widest:
            met = all(entry[key] <= most for key, most in LIMITS.items())
            yield Row(
                "G12",
                what,
                figures,
                "",
                None,
                None,
                "p50 <= 300, p99.9 <= 500 ns",
                met,
                "holds one reading of the clock",
            )
        else:
            yield Row("", what, figures, "")
