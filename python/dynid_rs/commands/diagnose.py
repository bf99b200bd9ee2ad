"""`dynid diagnose`: measured runs and a robot in; what the model lacks, added, before and after on unseen runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._beside import doubt_of, not_known, result_beside
from dynid_rs.commands._run import EXIT_NO, goes_on, print_json, run_command
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    from dynid_rs.base.findings import Finding
    from dynid_rs.diagnosis.results import Outcome
    from dynid_rs.runs.recording import Recording
    from dynid_rs.runs.splitting import Split

N_STATES, OTHER_ROBOT = 8, 0.1
"""Random states at which two robots are compared, and the part of their links' torque by which they may differ."""
STEPS = (
    Step(3, "reading"),
    Step(4, "channels"),
    Step(4, "contacts"),
    Step(2, "mounting", "comparing with the reference"),
    Step(13, "looking for effects"),
    Step(6, "ripple"),
    Step(3, "what is left"),
    Step(2, "testing"),
)
"""With their usual shares of the time, measured on a run of `dynid demo`."""


@run_command
def diagnose(
    robot: _options.Robot,
    runs: _options.Runs,
    output: _options.Output,
    test: _options.Test = None,
    test_from: _options.TestFrom = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL", help="model.json that is trusted: tell what has changed since, and leave nothing open"
        ),
    ] = None,
    after: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULT", help="Go on from the diagnosis in this folder: only what it left open is asked again"
        ),
    ] = None,
    config: _options.Config = None,
    gravity: _options.Gravity = None,
    base: _options.Base = None,
    tip: _options.Tip = None,
    xacro: _options.Xacro = False,
    drive_gain: _options.DriveGain = None,
    prior: _options.PriorOfDiagnosis = "auto",
    known: _options.Known = None,
    cutoff: _options.Cutoff = None,
    force: _options.Force = False,
    json_output: _options.Json = False,
) -> int:
    """Find the physical effects that an arm's model lacks, add them, and report the error before and after.

    DIR then holds model.json with the effects in it, result.json, residuals.parquet, report.html, and, without
    --reference, open.json, from which `dynid excite --after DIR` designs the next experiment. "Nothing to add" is an
    answer. Ends with 1 if the data has an error in it or the model is no better than weighted least squares.
    """
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._identifier import (
        OPEN_FILE,
        RESULT_FILE,
        check_places,
        convergence_findings,
        identifier_options,
        known_terms,
    )
    from dynid_rs.commands._inputs import (
        read_robot,
        read_rules,
        read_settings,
        read_split,
        with_rotors,
    )
    from dynid_rs.commands._output import after_interrupt
    from dynid_rs.runs.facts import check_torque

    check_places(output, [robot, *runs, *(test or []), config, known, reference], force=force, more=[OPEN_FILE])
    if reference is not None and after is not None:
        raise ValueError("--reference asks what has changed, --after what was left open; give one of them")
    said = after_interrupt(output / RESULT_FILE)
    with goes_on(said), progress(*STEPS) as say:
        say("reading")
        model = read_robot(robot, base, tip, gravity, read_rules(config), xacro=xacro)
        settings = read_settings(config, drive_gain, model.n_joints)
        model = with_rotors(model, settings, robot, base, tip, xacro=xacro)
        if prior not in ("auto", "robot"):
            raise ValueError(f"--prior must be auto or robot, found {prior!r}; a diagnosis needs one")
        options = identifier_options("joint_variance", prior, cutoff, "smooth")
        options["known"] = known_terms(known, model)
        split, findings = read_split(runs, test or [], test_from, model, settings, cutoff)
        check_torque(split.test)
        more = {} if reference is None else _reference(reference, model, split.train[0])
        unknown = [] if reference is None else not_known(more["doubt"], "the training runs")
        if after is not None:
            more["after"] = _left_open(after, model, split.train[0])

        from dynid_rs.diagnosis.availability import missing_signals
        from dynid_rs.diagnosis.loop import diagnose as find_effects
        from dynid_rs.diagnosis.setup import Setup
        from dynid_rs.model.inertials import inertial_findings

        setup = Setup(model, options=options)
        findings = [*inertial_findings(model, robot.name), *findings, *missing_signals(split.train)]
        with convergence_findings() as unsettled:
            outcome = find_effects(setup, split.train, split.test, on_progress=say, **more)
        say("testing")
        result = _write(outcome, split, [*findings, *unknown, *unsettled()], output, force=force)
    if json_output:
        print_json(result)
    else:
        from dynid_rs.commands._diagnose_view import show

        show(result, output)
    return _exit_code(result)


def _reference(path: Path, robot: Any, run: Recording) -> dict[str, Any]:
    """Read the trusted model, and how well it is known; it must be of this robot, in the unit of the runs."""
    from dynid_rs.commands._inputs import load_model

    model = load_model(path)
    if list(model.robot.joint_names) != list(robot.joint_names):
        raise ValueError(
            f"{path}: is a model of {model.robot.name} with the joints {', '.join(model.robot.joint_names)}, and the "
            f"robot file has {', '.join(robot.joint_names)}; give a model of the same robot"
        )
    if _moves_otherwise(model.robot, robot):
        raise ValueError(
            f"{path}: is a model of {model.robot.name} with other joint frames, axes or gravity than the robot file "
            "has; give a model of the same robot, or the robot file that it was made with"
        )
    if model.torque_unit != run.torque_unit:
        raise ValueError(
            f"{path}: is a model in {model.torque_unit}, and the runs hold torque in {run.torque_unit}; "
            "give a model in the same unit, or --drive-gain"
        )
    return {"reference": model, "doubt": doubt_of(result_beside(path), model)}


def _left_open(path: Path, robot: Any, run: Recording) -> Any:
    """Read what an earlier diagnosis left open; it must be of this robot, in the unit of the runs."""
    from dynid_rs.diagnosis.open_file import read_open

    asked = read_open(path, robot)
    if asked.torque_unit != run.torque_unit:
        raise ValueError(
            f"{path}: is of runs in {asked.torque_unit}, and these hold torque in {run.torque_unit}; give runs in the "
            "same unit, or --drive-gain"
        )
    return asked


def _moves_otherwise(trusted: Any, robot: Any) -> bool:
    """Whether two robots are more than a correction of frames and gravity apart, by the torque of their links."""
    import numpy as np

    rng = np.random.default_rng(0)
    motion = [rng.uniform(-1.0, 1.0, (N_STATES, robot.n_joints)) for _ in range(3)]
    ours, theirs = (np.asarray(r.joint_torque_regressor(*motion)) for r in (robot, trusted))
    return bool(np.linalg.norm(ours - theirs) > OTHER_ROBOT * np.linalg.norm(ours))


def _write(outcome: Outcome, split: Split, findings: list[Finding], output: Path, *, force: bool) -> dict[str, Any]:
    from dynid_rs.commands._identifier import OPEN_FILE, write_results
    from dynid_rs.diagnosis.open_file import to_json
    from dynid_rs.diagnosis.results import evaluated, residual_table, summarise_diagnosis
    from dynid_rs.identification.training import check_motion

    runs = evaluated(outcome, split.train, split.test)
    check_motion([run.states for run in runs.test_after])  # what counts as standstill follows the fitted friction
    result = summarise_diagnosis(outcome, runs, findings)
    table = residual_table(outcome, runs)
    left_open = {} if outcome.asked is None else {OPEN_FILE: to_json(outcome.asked)}
    write_results(output, outcome.after.model_, result, table, left_open, force=force)
    return result


def _exit_code(result: dict[str, Any]) -> int:
    from dynid_rs.diagnosis.wording import not_worse

    errors = any(finding["severity"] == "error" for finding in result["data"]["findings"])
    return EXIT_NO if errors or not not_worse(result) else 0
