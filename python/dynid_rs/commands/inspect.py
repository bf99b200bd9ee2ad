"""`dynid inspect`: what run files hold, and what is wrong with it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import print_json, run_command, sentence


@run_command
def inspect(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run files, or folders of bags")],
    robot: Annotated[
        Path | None,
        typer.Option("--robot", metavar="ROBOT", help=f"{_options.ROBOTS}: joint names, kinds and limits"),
    ] = None,
    base: _options.Base = None,
    tip: _options.Tip = None,
    gravity: _options.Gravity = None,
    xacro: _options.Xacro = False,
    config: Annotated[
        Path | None,
        typer.Option("--config", metavar="dynid.toml", help="Column names, units, gears, gains, signs"),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Show what run files hold, and what is wrong with it.

    Exit code 0: nothing wrong; 1: a finding says "error"; 2: a file cannot be read.
    """
    from dynid_rs.commands._inputs import read_robot, read_rules, run_names
    from dynid_rs.commands._inspection import compared, exit_code, hint, inspect_run, to_json
    from dynid_rs.model.inertials import inertial_findings

    if robot is None and (base is not None or tip is not None or gravity is not None or xacro):
        raise ValueError("--base, --tip, --gravity and --xacro are about the robot file; name it by --robot")
    rules = read_rules(config)
    model = None if robot is None else read_robot(robot, base, tip, gravity, rules, xacro=xacro)
    of_robot = [] if model is None or robot is None else inertial_findings(model, robot.name)
    named = zip(runs, run_names(runs), strict=True)
    inspections = compared(
        [one for path, name in named for one in inspect_run(path, model, rules, name, config)], model
    )
    code = exit_code(inspections)
    if json_output:
        print_json(
            {
                "format": "dynid-inspect",
                "version": 1,
                "robot": None if model is None else model.name,
                "robot_findings": [finding.to_json() for finding in of_robot],
                "ok": code == 0,
                "runs": [to_json(inspection) for inspection in inspections],
            }
        )
    else:
        from dynid_rs.commands._inspect_view import show

        show(inspections, of_robot)
    for inspection in inspections:
        if inspection.error is not None:
            sys.stderr.write(f"error: {sentence(inspection.error)}{hint(inspection.path, inspection.error, config)}\n")
    return code
