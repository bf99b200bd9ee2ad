"""`dynid identify`: measured runs and a robot in; a torque model, its errors on unseen runs, a report out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import EXIT_NO, print_json, run_command

if TYPE_CHECKING:
    from collections.abc import Callable

    from dynid_rs.commands._given import Given
    from dynid_rs.findings import Finding
    from dynid_rs.recording import Recording
    from dynid_rs.results import LearnedFrom


@run_command
def identify(
    robot: _options.Robot,
    runs: _options.Runs,
    output: _options.Output,
    test: _options.Test = None,
    test_from: _options.TestFrom = None,
    config: _options.Config = None,
    gravity: _options.Gravity = None,
    base: _options.Base = None,
    tip: _options.Tip = None,
    drive_gain: _options.DriveGain = None,
    weighting: _options.Weighting = "joint_variance",
    prior: _options.Prior = "auto",
    known: _options.Known = None,
    friction: Annotated[
        list[Path] | None, typer.Option(metavar="RUN", help="Run of the friction experiment; repeat for more")
    ] = None,
    friction_law: _options.FrictionLaw = "paper",
    residual: Annotated[
        str, typer.Option(help="Third loop on: auto, load_free_deflection, deflection, joint_state or none")
    ] = "auto",
    compensator: Annotated[str, typer.Option(help="Third loop by: mixture or rbf")] = "mixture",
    cutoff: _options.Cutoff = None,
    physical: Annotated[
        bool, typer.Option("--physical", help="Also masses and inertias that bodies can have, for `dynid export`")
    ] = False,
    memory: _options.Memory = "4GB",
    cache: _options.Cache = None,
    jobs: _options.Jobs = 1,
    json_output: _options.Json = False,
) -> int:
    """Identify friction, link dynamics and residual of an arm from measured runs.

    DIR then holds model.json (for `dynid estimate` and `dynid-estimator`), result.json, residuals.parquet
    and report.html. Ends with 1 if the data has an error in it or the model is no better than weighted least
    squares.
    """
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._given import opened_work, read_given
    from dynid_rs.commands._identifier import check_places, chosen_laws, known_terms
    from dynid_rs.commands._inputs import read_friction, read_robot, read_settings, size_in_bytes, with_rotors

    if physical:
        _check_physical()
    limit = size_in_bytes("--memory", memory)
    check_places(output, [robot, *runs, *(test or []), *(friction or []), config, known])
    work = opened_work(cache, jobs)
    with progress() as say:
        say("reading")
        model = read_robot(robot, base, tip, gravity)
        settings = read_settings(config, drive_gain, model.n_joints)
        model = with_rotors(model, settings, robot, base, tip)
        identifier = _identifier(model, weighting, prior, residual, compensator, cutoff, friction_law)
        identifier.known = known_terms(known, model)
        given = read_given(
            runs, test or [], test_from, model, settings, memory=limit, cutoff=cutoff, say=say, work=work
        )
        slow = read_friction(friction, model, settings) if friction else None
        if friction_law == "auto":
            say("comparing laws of friction")
            identifier.friction_law = chosen_laws(identifier, given.train, slow)
        identifier, learned_from, findings = _fit(identifier, given, slow, say)
        bodies = _physical(identifier, say) if physical else None
        say("testing")
        result = _write(identifier, given, [*given.findings, *findings], output, bodies, learned_from)
    if json_output:
        print_json(result)
    else:
        from dynid_rs.commands._identify_view import show

        show(result, output)
    return _exit_code(result)


def _identifier(
    model: Any,
    weighting: str,
    prior: str,
    residual: str,
    compensator: str,
    cutoff: float | None,
    friction_law: str,
) -> Any:
    from dynid_rs.commands._identifier import identifier_options
    from dynid_rs.identification import ThreeLoopIdentifier
    from dynid_rs.residual import METHODS, ResidualCompensator

    options = identifier_options(weighting, prior, cutoff, friction_law)
    inputs = ("auto", "load_free_deflection", "deflection", "joint_state")
    if residual not in (*inputs, "none"):
        raise ValueError(f"--residual must be {', '.join(inputs)} or none, found {residual!r}")
    if compensator not in METHODS:
        raise ValueError(f"--compensator must be {' or '.join(METHODS)}, found {compensator!r}")
    third = None if residual == "none" else ResidualCompensator(method=compensator, inputs=residual)  # type: ignore[arg-type]
    return ThreeLoopIdentifier(model, residual=third, **options)


def _fit(
    identifier: Any, given: Given, slow: list[Recording] | None, say: Callable[[str], None]
) -> tuple[Any, LearnedFrom | None, list[Finding]]:
    from dynid_rs.commands._identifier import convergence_findings

    with convergence_findings() as findings:
        fitted, learned_from = given.fit(identifier, slow, say)
    return fitted, learned_from, findings()


def _check_physical() -> None:
    """Refuse before any work is done where the solver is not installed."""
    from dynid_rs.bodies import import_cvxpy

    import_cvxpy()


def _physical(identifier: Any, say: Callable[[str], None]) -> Any:
    from dynid_rs.physical import PhysicalIdentifier

    say("physically consistent parameters")
    return PhysicalIdentifier().fit(identifier.observations_, identifier.links_, torque_unit=identifier.torque_unit_)


def _write(
    identifier: Any,
    given: Given,
    findings: list[Finding],
    output: Path,
    physical: Any = None,
    learned_from: LearnedFrom | None = None,
) -> dict[str, Any]:
    from dynid_rs.commands._identifier import scored_states, write_results
    from dynid_rs.encoders import with_fitted_delay
    from dynid_rs.results import evaluate_runs, residual_table, summarise

    model = identifier.model_
    tested = evaluate_runs(model, given.test, scored_states(identifier, given.test))
    trained = evaluate_runs(model, given.train, identifier.raw_runs_)
    findings = with_fitted_delay(findings, identifier.encoder_delay_)
    result = summarise(identifier, trained, tested, findings, physical, learned_from)
    if physical is not None:
        model = model.with_physical(physical.physical_set(model))
    table = residual_table(model, trained, tested)
    write_results(output, model, result, table)
    return result


def _exit_code(result: dict[str, Any]) -> int:
    from dynid_rs.wording import is_better

    errors = any(finding["severity"] == "error" for finding in result["data"]["findings"])
    return EXIT_NO if errors or not is_better(result) else 0
