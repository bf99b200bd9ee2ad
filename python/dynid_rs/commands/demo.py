"""`dynid demo`: the whole road on runs that the package carries, by commands that a person could type."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._identifier import MODEL_FILE, RESULT_FILE
from dynid_rs.commands._run import EXIT_INTERRUPTED, EXIT_NO, print_json, run_command
from dynid_rs.commands.diagnose import diagnose
from dynid_rs.commands.estimate import estimate
from dynid_rs.commands.identify import identify
from dynid_rs.commands.inspect import inspect

CARRIED = Path(__file__).parents[1] / "demo"
"""Runs and what was put in, written by examples/demo/record.py."""
ROBOT, TRUTH, REPORT = "robot.urdf", "truth.json", "report.html"
IDENTIFIED, DIAGNOSED, TORQUES = "identified", "diagnosed", "torques.parquet"


@dataclass(frozen=True)
class Road:
    """Commands of the demonstration: what each one is for, and its words."""

    folder: Path
    runs: tuple[str, ...]
    force: bool

    def steps(self) -> list[tuple[str, list[str]]]:
        """In order."""
        robot, *runs = (str(self.folder / name) for name in (ROBOT, *self.runs))
        model = str(self.folder / DIAGNOSED / MODEL_FILE)
        learned = [robot, *runs[:-1], "--test", runs[-1]]
        force = ["--force"] if self.force else []
        return [
            ("What does a run hold, and is anything wrong with it?", ["inspect", runs[0], "--robot", robot]),
            (
                f"Friction and link dynamics, learned from {len(runs) - 1} runs and tested on another one.",
                ["identify", *learned, "-o", str(self.folder / IDENTIFIED), *force],
            ),
            (
                "Which physical effect does a model of links and friction lack? The search takes a smooth friction "
                "law, so\nthat its `before` is another fit than `three loops` above.",
                ["diagnose", *learned, "-o", str(self.folder / DIAGNOSED), *force],
            ),
            (
                "The torque along a run, by the code that runs in the control loop.",
                ["estimate", model, runs[-1], "-o", str(self.folder / TORQUES), *force],
            ),
        ]


@run_command
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for runs and results")] = Path(
        "dynid-demo"
    ),
    force: _options.Force = False,
    json_output: _options.Json = False,
) -> int:
    """Show the whole road on three recorded runs of a simulated arm: inspect, identify, diagnose, estimate.

    Each command is printed as one would type it, and DIR holds the files that it names. Ends with 1 if what was put
    into the arm was not found.
    """
    road = Road(output, tuple(sorted(path.name for path in CARRIED.glob("run_*"))), force)
    _lay_out(road)
    truth = json.loads((CARRIED / TRUTH).read_text(encoding="utf-8"))
    if not json_output:
        typer.echo(_opening(output, truth))
    steps: list[dict[str, Any]] = []
    for number, (purpose, words) in enumerate(road.steps(), 1):
        if not json_output:
            typer.echo(f"\n{number} of {len(road.steps())}. {purpose}\n$ {shlex.join(['dynid', *words])}")
        code = _run(words, silent=json_output)
        steps.append({"command": ["dynid", *words], "exit_code": code})
        if code not in (0, EXIT_NO):
            if code == EXIT_INTERRUPTED:
                typer.echo(f"dynid demo -o {shlex.quote(str(output))} --force begins again", err=True)
            return code
    put_in = [{"kind": effect["kind"], "joints": effect["joints"]} for effect in truth["effects"]]
    found = _found(output)
    report = output / DIAGNOSED / REPORT
    if json_output:
        told = {"steps": steps, "put_in": put_in, "found": found, "report": str(report)}
        print_json({"format": "dynid-demo", "version": 1, "folder": str(output), **told})
    else:
        typer.echo(_closing(put_in, found, report))
    done = found == put_in and not any(step["exit_code"] for step in steps)
    return 0 if done else EXIT_NO


def _lay_out(road: Road) -> None:
    """Copy robot, runs and truth to the folder, which may hold them already, and nothing else of these names."""
    from dynid_rs.base.files import filled_together, write_bytes
    from dynid_rs.commands._output import check_absent, check_folder, check_unfinished
    from dynid_rs.simulation import bundled_robot

    content = {name: (CARRIED / name).read_bytes() for name in (*road.runs, TRUTH)}
    content[ROBOT] = bundled_robot().read_bytes()
    check_folder(road.folder, [*content, TORQUES])
    if not road.force:
        for part in (IDENTIFIED, DIAGNOSED):
            check_unfinished(road.folder / part, RESULT_FILE)
        check_absent(road.folder / name for name in content if not _is_same(road.folder / name, content[name]))
        check_absent([road.folder / TORQUES])
    with filled_together(road.folder) as stage:
        for name, data in content.items():
            write_bytes(stage / name, data)


def _is_same(path: Path, content: bytes) -> bool:
    return path.is_file() and path.read_bytes() == content


def _run(words: Sequence[str], *, silent: bool) -> int:
    """Do what `dynid` does with these words; its exit code."""
    inner = typer.Typer(pretty_exceptions_enable=False)
    for command in (inspect, identify, diagnose, estimate):
        inner.command()(command)
    where = contextlib.redirect_stdout(io.StringIO()) if silent else contextlib.nullcontext()
    with where:
        return int(typer.main.get_command(inner).main(list(words), prog_name="dynid", standalone_mode=False) or 0)


def _found(folder: Path) -> list[dict[str, Any]]:
    result = json.loads((folder / DIAGNOSED / RESULT_FILE).read_text(encoding="utf-8"))
    return [{"kind": effect["kind"], "joints": effect["joints"]} for effect in result["effects"]]


def _named(effects: Sequence[dict[str, Any]]) -> str:
    told = [f"{effect['kind'].replace('_', ' ')} on {', '.join(effect['joints'])}" for effect in effects]
    return "; ".join(told) or "nothing"


def _opening(folder: Path, truth: dict[str, Any]) -> str:
    return (
        f"An arm of {len(truth['joints'])} joints was recorded in {len(truth['runs'])} runs by the laboratory of "
        f"dynid simulate, which hid an effect in it.\nThe files are in {folder}; a line that begins with $ can be "
        "typed as it stands."
    )


def _closing(put_in: Sequence[dict[str, Any]], found: Sequence[dict[str, Any]], report: Path) -> str:
    return (
        f"\nHidden: {_named(put_in)}. Found: {_named(found)}.\n"
        f"Open {report} in a browser: what was found, with its curve, and the error before and after.\n"
        "With an arm of your own: dynid init ROBOT RUN... looks at the logs and writes dynid.toml where one is needed; "
        "then\ndynid diagnose ROBOT RUN... -o DIR, with --config dynid.toml if there is one."
    )
