"""The loop at 1 kHz, runs larger than memory, two processes: short runs of three benches, for docs/measured/scale.md.

Each is a program of its own, so that memory is that of one of them. For longer runs they are called by themselves:
`python benches/paced.py --duration 600`, `python benches/stream.py --gigabytes 100`, `python benches/processes.py`.
Or all together, `python benches/scale.py --gigabytes 100`: what they find is kept as JSON in target/scale as it
comes, and after a kill `--resume` takes what is there.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from measure import ROOT, machine

from dynid_rs.archive.work import program

INTRODUCTION = """# The loop and large data, measured

Written by `python benches/scale.py --seconds {seconds:g} --gigabytes {gigabytes:g} --rounds {rounds}`;
`make bench` does a
short one. Its parts: `python benches/paced.py --duration {seconds:g} -- --mlock --fifo 80`,
`python benches/stream.py --gigabytes {gigabytes:g}`, `python benches/processes.py`.

| what | figure | limit | met |
|---|---|---|---|"""

KEPT = ROOT / "target" / "scale"
PRIORITY = 80
COLD = 30.0
"""Seconds of the loop that does not wake early, at most."""

READING = """
Six joints everywhere. The loop: rigid body, friction, a mixture of ten components per joint, states through shared
memory at 1 kHz, memory locked and with real-time priority where that is permitted; `compute` is from bytes to bytes.
The loop wakes early and rehearses the cycle on a twin of its state; `cold` is without that (`--early 0`), after a
millisecond of sleep. `sleep only` is a second thread that does nothing else: what is in it is the machine's own, and
a host that takes the core away takes it from both. Runs: two encoders at 1 kHz, made on the fly, each read, checked
and reduced; samples per second of processor time, so that other programs count less. They still share caches and
clock rates with it, so one run, always the same, is done beside the others all along: the ratio that counts is that
of samples per second times its time. What grows in memory is what is known of every run, a few kB. Two processes by
processor time is what two workers and the process that gathers use, laid on two idle cores.
"""


class Benches:
    """Benches as programs; their figures are kept, and with `resume` those of this very program are taken."""

    def __init__(self, *, resume: bool) -> None:
        self._resume = resume
        KEPT.mkdir(parents=True, exist_ok=True)

    def __call__(self, script: str, *options: object, name: str = "") -> dict[str, Any]:
        """What a bench prints as JSON; `name` where one script does several."""
        command = [sys.executable, ROOT / "benches" / script, *options]
        words, place = list(map(str, command[1:])), KEPT / f"{name or Path(script).stem}.json"
        if self._resume and place.exists():
            kept = json.loads(place.read_text(encoding="utf-8"))
            if (kept["command"], kept.get("program")) == (words, program()):
                figures: dict[str, Any] = kept["figures"]
                return figures
        done = subprocess.run([sys.executable, *words], stdout=subprocess.PIPE, text=True, check=False)
        lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
        if not lines:
            raise SystemExit(f"{script}: {done.stdout}")
        figures = json.loads(lines[-1])
        place.write_text(json.dumps({"command": words, "program": program(), "figures": figures}), encoding="utf-8")
        return figures


def row(what: str, figure: str, limit: str = "", met: bool | None = None) -> str:
    """One line of the page."""
    answer = {None: "", True: "yes", False: "**no**"}[met]
    return f"| {what} | {figure} | {limit} | {answer} |"


def loop(bench: Benches, seconds: float) -> Iterator[str]:
    """The binary at 1 kHz, as a controller would run it, and without waking early."""
    asked = ["--mlock", "--fifo", str(PRIORITY)] if may_be_real_time() else []
    found = bench("paced.py", "--duration", seconds, "--", "--json", *asked)
    for part, words in (
        ("compute", "compute"),
        ("wake_up", "wake-up"),
        ("end_to_end", "end to end"),
        ("sleep_only", "sleep only"),
        ("awake_early", "awake early, of one core"),
    ):
        if part in found:
            yield times(words, found[part], limit=2e-6 if part == "compute" else None)
    missed, others = found["missed_by_compute"], found["missed_by_interruption"]
    figure = f"{missed} (of {found['missed']} missed; {others} while the core was taken away)"
    yield row("cycles missed because of computing", figure, "0", missed == 0)
    yield row("cycles that the thread which only sleeps would have missed", f"{found['missed_by_sleep_only']}")
    faults = found["page_faults"]
    yield row("page faults", f"{faults['minor']} minor, {faults['major']} major", "0", not any(faults.values()))
    cold = bench("paced.py", "--duration", min(seconds, COLD), "--", "--json", *asked, "--early", "0", name="cold")
    yield times("compute, cold", cold["compute"])


def times(words: str, part: dict[str, float], limit: float | None = None) -> str:
    """The row of one histogram; `limit` [s] of its p99."""
    figures = ", ".join(f"{key} {1e6 * part[key]:.2f}" for key in ("p50", "p99", "p99.9", "p99.99", "max"))
    wanted = ("", None) if limit is None else (f"p99 at most {1e6 * limit:g} us", part["p99"] <= limit)
    return row(f"{words}, {part['cycles']:,} cycles", f"{figures} us", *wanted)


def may_be_real_time() -> bool:
    """Whether this process may lock its memory and ask for real-time priority."""
    locked, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if os.geteuid() != 0 and locked != resource.RLIM_INFINITY:
        return False
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    os.sched_setscheduler(0, *before)
    return True


def streamed(bench: Benches, gigabytes: float) -> Iterator[str]:
    """Runs that are made on the fly."""
    found = bench("stream.py", "--gigabytes", gigabytes, "--json", "--keep", KEPT / "stream.partial.json")
    for phase in ("reading", "reducing"):
        part = found[phase]
        ratio = part["last"] / part["first"]
        figure = f"{part['first']:,.0f} and {part['last']:,.0f} samples per second ({ratio:.3f})"
        yield row(f"{phase}, first and last tenth of {found['runs']:,} runs, {found['gigabytes']:.3g} GB", figure)
        steady = part["ratio"]
        what = f"{phase}, last tenth over first, each beside one run that is done all along"
        yield row(what, f"{steady:.3f}", "within 10 %", abs(steady - 1) <= 0.1)
        memory = f"{part['peak_first']:.0f} and {part['peak_last']:.0f} MB"
        yield row(f"{phase}, peak memory after the first and the last tenth", memory)
    yield row("both passes", f"{found['gigabytes_per_minute']:.2f} GB per minute of processor")


def processes(bench: Benches, runs: int, rounds: int) -> Iterator[str]:
    """Two processes against one."""
    found = bench("processes.py", "--runs", runs, "--rounds", rounds, "--json")
    for name, words in (("processor", "by processor time"), ("wall_clock", "by the wall clock")):
        ratios = found[name]
        middle = ratios[len(ratios) // 2]
        limit = ("at least 1.8", middle >= 1.8) if name == "processor" else ("", None)
        yield row(f"two processes against one, {words}", f"{middle:.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})", *limit)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=15.0, help="of the loop")
    parser.add_argument("--gigabytes", type=float, default=0.5)
    parser.add_argument("--runs", type=int, default=8, help="that processes share")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--resume", action="store_true", help="take what an earlier call has kept in target/scale")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "measured" / "scale.md")
    options = parser.parse_args()
    head = INTRODUCTION.format(seconds=options.seconds, gigabytes=options.gigabytes, rounds=options.rounds)
    page = [head]
    bench = Benches(resume=options.resume)
    parts = (
        loop(bench, options.seconds),
        streamed(bench, options.gigabytes),
        processes(bench, options.runs, options.rounds),
    )
    for rows in parts:
        for line in rows:
            print(line, flush=True)
            page.append(line)
    page += [READING, *(f"* {line}" for line in machine())]
    options.page.parent.mkdir(parents=True, exist_ok=True)
    options.page.write_text("\n".join(page) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
