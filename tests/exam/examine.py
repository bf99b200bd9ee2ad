"""One case from its seed to its score: written, given to `dynid diagnose` as a user would, read, compared."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exam.case import ROBOT, write_case
from exam.score import score

OUTCOME = "outcome.json"
REFUSED = 2
"""Exit code of wrong use or unreadable input: no case is either."""


@dataclass(frozen=True)
class Way:
    """How cases are run: the command, the seconds after which one is given up, the threads it may use."""

    program: str
    timeout: float
    threads: int
    keep_runs: bool


def examine(seed: int, folder: Path, way: Way) -> dict[str, Any]:
    """Return the score of one case, which is also stored in its folder."""
    begun = time.perf_counter()
    truth = write_case(seed, folder)
    made = time.perf_counter() - begun
    runs = [str(folder / name) for name in truth["train"]]
    tests = [part for name in truth["test"] for part in ("--test", str(folder / name))]
    command = [way.program, "diagnose", str(folder / ROBOT), *runs, *tests, "-o", str(folder / "found")]
    shutil.rmtree(folder / "found", ignore_errors=True)
    begun = time.perf_counter()
    code, told = _run(command, way)
    seconds = time.perf_counter() - begun
    result = _result(folder / "found" / "result.json")
    outcome = score(truth, result, seconds, _failure(code, told, result)) | {"made": made}
    if outcome["failure"]:
        outcome["message"] = told.strip().splitlines()[-1][-300:] if told.strip() else ""
    if not way.keep_runs:
        shutil.rmtree(folder)
        folder.mkdir()
    partial = folder / f"{OUTCOME}.part"
    partial.write_text(json.dumps(outcome) + "\n", encoding="utf-8")
    partial.replace(folder / OUTCOME)
    return outcome


def default_program() -> str:
    """Return `dynid` beside this Python, or on the path."""
    beside = Path(sys.executable).parent / "dynid"
    return str(beside) if beside.exists() else "dynid"


def _run(command: list[str], way: Way) -> tuple[int | None, str]:
    """Exit code (None: given up) and what was said on the standard error."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "RAYON_NUM_THREADS")
    environment = os.environ | dict.fromkeys(names, str(way.threads))
    try:
        done = subprocess.run(
            command, env=environment, timeout=way.timeout, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired:
        return None, f"given up after {way.timeout:g} s"
    return done.returncode, done.stderr


def _failure(code: int | None, told: str, result: dict[str, Any] | None) -> str | None:
    if code is None:
        return "timeout"
    if "Traceback (most recent call last)" in told or code < 0 or code > REFUSED:
        return "traceback"
    return "refused" if result is None or code == REFUSED else None


def _result(path: Path) -> dict[str, Any] | None:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
