"""The program, asked what it says of a folder of runs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

COMMANDS = ("inspect", "identify", "diagnose")


def answer(command: str, robot: Path, runs: Sequence[Path], output: Path) -> dict[str, Any]:
    """What a command says of runs, the last of which is to test on, as JSON; tracebacks are raised."""
    from typer.testing import CliRunner

    from dynid_rs.cli import app

    if command == "inspect":
        arguments = ["inspect", *runs, "--robot", robot, "--json"]
    else:
        arguments = [command, robot, *runs[:-1], "--test", runs[-1], "-o", output, "--json"]
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return json.loads(result.stdout)
