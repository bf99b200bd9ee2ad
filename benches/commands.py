"""What whole commands take, as processes: seconds of the processor and of the clock, and memory at its peak."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from measure import ROOT, Row

sys.path.insert(0, str(ROOT / "tests"))

from helpers import data
from helpers.measured_sets import COMMAND, SETS

THREADS = ("RAYON_NUM_THREADS", "OPENBLAS_NUM_THREADS")
ROUNDS = 3
N_RUNS = 5
MEASURED = "ur10e"
START, IDENTIFY, DIAGNOSE = (0.15, None), (1.0, None), (3.0, 300e6)
"""Goals: seconds by the clock of two idle cores, and bytes; of the diagnosis on the measured arm."""


def rows(measured: bool) -> Iterator[Row]:
    """Start, `identify` and `diagnose` of the simulated laboratory, `diagnose` of a measured arm where its data is."""
    dynid = [sys.executable, "-c", COMMAND]
    yield _row("`dynid --help`", [*dynid, "--help"], START)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _taken([*dynid, "simulate", "-o", str(folder), "--runs", str(N_RUNS)])
        *train, test = (str(folder / f"run_{k}.parquet") for k in range(N_RUNS))
        given = [str(folder / "robot.urdf"), *train, "--test", test, "-o", str(folder / "result"), "--force"]
        yield _row("`dynid identify`, simulated laboratory", [*dynid, "identify", *given], IDENTIFY)
        yield _row("`dynid diagnose`, simulated laboratory", [*dynid, "diagnose", *given])
        if measured and data.place().is_dir():
            arm = SETS[MEASURED]
            for verb, goal in (("identify", None), ("diagnose", DIAGNOSE)):
                command = [*arm.command(folder / MEASURED, verb), "--force"]
                yield _row(f"`dynid {verb}`, {arm.title}", command, goal)


def _row(what: str, command: Sequence[str], goal: tuple[float, float | None] | None = None) -> Row:
    taken = [_taken(command) for _ in range(ROUNDS)]
    seconds, walls = sorted(own for own, _, _ in taken), sorted(wall for _, wall, _ in taken)
    most = max(memory for _, _, memory in taken)
    figure = (
        f"{seconds[ROUNDS // 2]:.2f} s ({seconds[0]:.2f} to {seconds[-1]:.2f}) of the processor, "
        f"{walls[ROUNDS // 2]:.2f} s by the clock, {most / 1e6:.0f} MB"
    )
    if goal is None:
        return Row("", what, figure, "")
    most_seconds, most_bytes = goal
    met = walls[ROUNDS // 2] <= most_seconds and (most_bytes is None or most <= most_bytes)
    limit = f"<= {most_seconds:g} s" + (f", {most_bytes / 1e6:.0f} MB" if most_bytes else "")
    return Row("", what, figure, "", limit=limit, met=met)


ALONE = """
import json, os, subprocess, sys, time
start = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
wall = time.perf_counter() - start
print(json.dumps([os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss]))
"""
"""A process of its own that starts a command: until it has begun, a child counts as large as who starts it."""


def _taken(command: Sequence[str]) -> tuple[float, float, float]:
    """Seconds of the processor, of the clock, and bytes at the peak of a command; 1 is an answer too."""
    alone = [sys.executable, "-S", "-c", ALONE, *command]
    # As a user types them: the other figures are of one thread.
    own = {name: value for name, value in os.environ.items() if name not in THREADS}
    said = subprocess.run(alone, stdout=subprocess.PIPE, text=True, env=own, check=True).stdout
    code, seconds, wall, size = json.loads(said)
    if code not in (0, 1):
        raise subprocess.CalledProcessError(code, command)
    unit = 1 if sys.platform == "darwin" else 1024  # of the resident size
    return seconds, wall, float(size * unit)


if __name__ == "__main__":
    for line in rows(measured=True):
        print(line, flush=True)
