"""Asks the program under examination. It is given a folder of runs and a robot file, and nothing else."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from cases import N_TEST, N_TRAIN

UNUSABLE = 2
"""Exit code of a command that refused its input; 0 and 1 are answers."""


class Refused(RuntimeError):
    """The program did not answer."""


def examine(seen: Path, output: Path) -> tuple[dict[str, Any], float]:
    """Diagnose the runs of a folder.

    Parameters
    ----------
    seen : Path
        `robot.urdf`, `run_0.parquet`, ...; in `reference/` clean runs of the same arm, where there are some.
    output : Path
        Where results go.

    Returns
    -------
    dict
        Content of `result.json`.
    float
        Seconds that the diagnosis took.
    """
    arguments = ["diagnose", *_runs(seen, seen / "robot.urdf"), "-o", str(output)]
    if (seen / "reference").is_dir():
        trusted = output.with_name(f"{output.name}_reference")
        _dynid(["identify", *_runs(seen / "reference", seen / "robot.urdf"), "--residual", "none", "-o", str(trusted)])
        arguments += ["--reference", str(trusted / "model.json")]
    start = time.perf_counter()
    _dynid(arguments)
    seconds = time.perf_counter() - start
    result: dict[str, Any] = json.loads((output / "result.json").read_text(encoding="utf-8"))
    return result, seconds


def _runs(folder: Path, robot: Path) -> list[str]:
    """Robot, training runs, test runs: as a command takes them."""
    paths = [str(folder / f"run_{k}.parquet") for k in range(N_TRAIN + N_TEST)]
    return [str(robot), *paths[:N_TRAIN], *(part for path in paths[N_TRAIN:] for part in ("--test", path))]


def _dynid(arguments: list[str]) -> None:
    """One command in this process, which saves the imports."""
    from typer.testing import CliRunner

    from dynid_rs.cli import app

    answer = CliRunner().invoke(app, arguments)
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    if answer.exit_code >= UNUSABLE:
        raise Refused(answer.stderr.strip() or f"exit code {answer.exit_code}")
