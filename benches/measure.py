"""What every benchmark shares: two things run in turn, medians and spread, and the page of all rows."""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from dynid_rs import _core

ROOT = Path(__file__).resolve().parent.parent
PEERS = ("numpy", "scipy", "scikit-learn", "pin", "casadi", "figaroh", "gmr")


@dataclass(frozen=True)
class Row:
    """One line of the page: our figure, the peer's, how many times faster, and what was to be reached."""

    goal: str
    what: str
    ours: str
    peer: str
    ratio: float | None = None
    spread: tuple[float, float] | None = None
    limit: str = ""
    met: bool | None = None
    note: str = ""

    def __str__(self) -> str:
        ratio = "" if self.ratio is None else f"{self.ratio:.3g}"
        if self.spread is not None:
            ratio += f" ({self.spread[0]:.3g} to {self.spread[1]:.3g})"
        met = {None: "", True: "yes", False: "**no**"}[self.met]
        cells = (self.goal, self.what, self.ours, self.peer, ratio, self.limit, met, self.note)
        return "| " + " | ".join(cells) + " |"


HEAD = """| goal | what | ours | peer | times faster (spread) | limit | met | |
|---|---|---|---|---|---|---|---|"""


def processor_seconds(work: Callable[[], object], n: int) -> float:
    """Seconds of the processor per call, over `n` calls: other people's jobs do not count."""
    start = time.process_time()
    for _ in range(n):
        work()
    return (time.process_time() - start) / n


def alternate(ours: Callable[[], object], theirs: Callable[[], object], *, rounds: int = 7, least: float = 0.02):
    """Seconds per call of both in every round, run in turn, each for at least `least` seconds."""
    counts = []
    for work in (ours, theirs):
        work()
        once = processor_seconds(work, 1)
        counts.append(max(1, int(least / max(once, 1e-7))))
    pairs = zip((ours, theirs), counts, strict=True)
    works = list(pairs)
    return [tuple(processor_seconds(work, n) for work, n in works) for _ in range(rounds)]


def unit(seconds: float) -> str:
    """Seconds with a fitting unit."""
    for size, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")):
        if seconds >= size:
            return f"{seconds / size:.3g} {name}"
    return f"{seconds / 1e-9:.3g} ns"


def compare(
    goal: str,
    what: str,
    ours: Callable[[], object],
    peer: str,
    theirs: Callable[[], object],
    *,
    per: int = 1,
    limit: float | None = None,
    rounds: int = 7,
    note: str = "",
) -> Row:
    """A row of two things that do the same; times are divided by `per` (samples)."""
    times = alternate(ours, theirs, rounds=rounds)
    ratios = [theirs / ours for ours, theirs in times]
    own, other = (statistics.median(column) / per for column in zip(*times, strict=True))
    ratio = other / own
    return Row(
        goal,
        what,
        unit(own),
        f"{unit(other)} ({peer})",
        ratio,
        (min(ratios), max(ratios)),
        "" if limit is None else f">= {limit:g}",
        None if limit is None else ratio >= limit,
        note,
    )


def machine() -> Iterable[str]:
    """What the figures hang on."""
    model = next(
        (
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
            if line.startswith("model name")
        ),
        platform.processor(),
    )
    yield f"Processor: {model}, {os.cpu_count()} cores seen, kernels on `{_core.processor_path()}`."
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    yield f"Load at the end (1, 5, 15 minutes): {load}; above the number of cores, figures are of shared cores."
    rust = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=False).stdout.strip()
    yield f"Python {platform.python_version()}, {rust or 'no rustc'}."
    yield ", ".join(f"{name} {known_version(name)}" for name in PEERS) + "."


def known_version(name: str) -> str:
    """Version of a package, or that it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
