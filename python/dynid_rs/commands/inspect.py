"""`dynid inspect`: what run files hold, and what is wrong with it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from dynid_rs.commands._inputs import read_robot
from dynid_rs.commands._inspection import Inspection, compared, inspect_run
from dynid_rs.commands._run import EXIT_NO, EXIT_UNUSABLE, error_object, print_json, run_command, sentence
from dynid_rs.model.inertials import inertial_findings
from dynid_rs.runs.checks import relative_jitter
from dynid_rs.runs.readers import Config, read_config
from dynid_rs.runs.recording import Recording, gaps


def exit_code(inspections: list[Inspection]) -> int:
    """2 when a file is unreadable, 1 when one has errors in it, else 0."""
    if any(inspection.error is not None for inspection in inspections):
        return EXIT_UNUSABLE
    return EXIT_NO if any(f.severity == "error" for item in inspections for f in item.findings) else 0


def to_json(inspection: Inspection) -> dict[str, object]:
    """Return everything `inspect` knows about one file, for programs."""
    if inspection.run is None:
        error = inspection.error or ValueError("not read")
        return {"path": str(inspection.path), "error": error_object(error)}
    rec, columns = inspection.run.recording, inspection.run.columns
    return {
        "path": str(inspection.path),
        "kind": inspection.run.kind,
        "n_samples": rec.n_samples,
        "duration_s": rec.duration,
        "rate_hz": rec.rate,
        "jitter": relative_jitter(rec),
        "n_gaps": len(gaps(rec)),
        "torque_unit": rec.torque_unit,
        "encoders": 2 if rec.has_motor_encoder else 1,
        "columns": {
            "t": columns.time,
            **{signal: list(names) for signal, names in columns.signals.items()},
            "ignored": list(columns.ignored),
        },
        "joints": [_joint(rec, joint) for joint in range(rec.n_joints)],
        "findings": [finding.to_json() for finding in inspection.findings],
    }


def _joint(rec: Recording, joint: int) -> dict[str, object]:
    velocity = rec.dq[:, joint] if rec.dq is not None else np.gradient(rec.q[:, joint], rec.t)
    tau = rec.tau[:, joint]
    return {
        "name": rec.joints[joint],
        "q": [float(rec.q[:, joint].min()), float(rec.q[:, joint].max())],
        "speed_p99": float(np.percentile(np.abs(velocity), 99)),
        "tau": [float(tau.min()), float(tau.max())],
        "tau_std": float(tau.std()),
    }


@run_command
def inspect(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run files: .parquet, .csv, .npz")],
    robot: Annotated[
        Path | None, typer.Option("--robot", metavar="R", help="URDF or robot.toml: joint names, kinds and limits")
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option("--config", metavar="dynid.toml", help="Column names, units, gears, gains, signs"),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Show what run files hold, and what is wrong with it.

    Exit code 0: nothing wrong; 1: a finding says "error"; 2: a file cannot be read.
    """
    rules = Config() if config is None else read_config(config)
    model = None if robot is None else read_robot(robot)
    of_robot = [] if model is None or robot is None else inertial_findings(model, robot.name)
    inspections = compared([inspect_run(path, model, rules) for path in runs], model)
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
            sys.stderr.write(f"error: {sentence(inspection.error)}{_hint(inspection, config)}\n")
    return code


def _hint(inspection: Inspection, config: Path | None) -> str:
    """Point at a config that lies beside the run and was not given."""
    beside = inspection.path.parent / "dynid.toml"
    missing = getattr(inspection.error, "code", "") == "missing_column"
    return f" (there is {beside}: give it with --config)" if config is None and missing and beside.is_file() else ""
