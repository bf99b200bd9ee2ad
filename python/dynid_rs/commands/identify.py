"""`dynid identify`: measured runs and a robot in; a torque model, its errors on unseen runs, a report out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dynid_rs.commands._run import EXIT_NO, print_json, run_command

if TYPE_CHECKING:
    from collections.abc import Callable

    from dynid_rs.findings import Finding
    from dynid_rs.preprocessing import States
    from dynid_rs.recording import Recording

MODEL_FILE, RESULT_FILE, RESIDUALS_FILE = "model.json", "result.json", "residuals.parquet"
LEAST_TEST_ROWS = 20
"""Fewer rows of a test run say nothing."""


@run_command
def identify(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT", help="The arm: URDF or robot.toml")],
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs to learn from: Parquet, CSV or NPZ")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results", show_default=False)
    ],
    test: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN", help="Run to test on; repeat for more. Left out: the last run, or its last third"),
    ] = None,
    test_from: Annotated[
        float | None, typer.Option(help="With a lone run: test on what comes after this many seconds")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="dynid.toml: column names, units, gears, signs")] = None,
    gravity: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Free fall in the base frame [m/s^2]; the robot file's, or 0,0,-9.81"),
    ] = None,
    base: Annotated[str | None, typer.Option(help="First link of the chain, where the URDF leaves a choice")] = None,
    tip: Annotated[str | None, typer.Option(help="Last link of the chain, where the URDF branches")] = None,
    drive_gain: Annotated[
        str | None,
        typer.Option(metavar="G[,G...]", help="Joint torque per motor current [N*m/A], one per joint or one for all"),
    ] = None,
    weighting: Annotated[str, typer.Option(help="joint_variance, full_covariance or none")] = "joint_variance",
    prior: Annotated[
        str, typer.Option(help="The URDF's inertials beside the data: robot, none, or auto (a lone run that they help)")
    ] = "auto",
    known: Annotated[
        Path | None, typer.Option(metavar="TERMS.toml", help="Effects whose coefficients you know; they are not fitted")
    ] = None,
    friction: Annotated[
        list[Path] | None, typer.Option(metavar="RUN", help="Run of the friction experiment; repeat for more")
    ] = None,
    friction_law: Annotated[
        str, typer.Option(help="paper, coulomb_viscous, stribeck, or auto: by a training run left out, joint by joint")
    ] = "paper",
    residual: Annotated[
        str, typer.Option(help="Third loop on: auto, load_free_deflection, deflection, joint_state or none")
    ] = "auto",
    compensator: Annotated[str, typer.Option(help="Third loop by: mixture or rbf")] = "mixture",
    cutoff: Annotated[float | None, typer.Option(help="Band [Hz]; chosen from the motion if left out")] = None,
    physical: Annotated[
        bool, typer.Option("--physical", help="Also masses and inertias that bodies can have, for `dynid export`")
    ] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Identify friction, link dynamics and residual of an arm from measured runs.

    DIR then holds model.json (for `dynid estimate` and `dynid-estimator`), result.json, residuals.parquet
    and report.html. Ends with 1 if the data has an error in it or the model is no better than weighted least
    squares.
    """
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._inputs import (
        check_cutoff,
        read_friction,
        read_robot,
        read_settings,
        read_split,
        with_rotors,
    )
    from dynid_rs.commands._output import check_folder, check_not_read
    from dynid_rs.report import REPORT_FILE

    results = (MODEL_FILE, RESULT_FILE, RESIDUALS_FILE, REPORT_FILE)
    if physical:
        _check_physical()
    check_folder(output, results)
    read = [robot, *runs, *(test or []), *(friction or []), *(path for path in (config, known) if path)]
    check_not_read([output / name for name in results], read)
    with progress() as say:
        say("reading")
        model = read_robot(robot, base, tip, gravity)
        settings = read_settings(config, drive_gain, model.n_joints)
        model = with_rotors(model, settings, robot, base, tip)
        identifier = _identifier(model, weighting, prior, residual, compensator, cutoff, friction_law)
        identifier.known = _known(known, model)
        split, findings = read_split(runs, test or [], test_from, model, settings)
        check_cutoff(cutoff, [*split.train, *split.test])
        slow = read_friction(friction, model, settings) if friction else None
        if friction_law == "auto":
            say("comparing laws of friction")
            identifier.friction_law = _chosen_laws(identifier, split.train, slow)
        findings += _fit(identifier, split.train, slow, say)
        bodies = _physical(identifier, say) if physical else None
        say("testing")
        result = _write(identifier, split.train, split.test, findings, output, bodies)
    if json_output:
        print_json(result)
    else:
        from dynid_rs.commands._identify_view import show

        show(result, output)
    return _exit_code(result)


def _known(path: Path | None, robot: Any) -> list[Any]:
    if path is None:
        return []
    from dynid_rs.terms import read_terms

    return list(read_terms(path, robot))


def _identifier(
    model: Any,
    weighting: str,
    prior: str,
    residual: str,
    compensator: str,
    cutoff: float | None,
    friction_law: str,
) -> Any:
    from dynid_rs.friction_laws import LAWS
    from dynid_rs.identification import ThreeLoopIdentifier
    from dynid_rs.links import ASYMMETRY, LinkDynamicsIdentifier
    from dynid_rs.residual import METHODS, ResidualCompensator

    choices: dict[str, Literal["joint_variance", "full_covariance"] | None] = {
        "joint_variance": "joint_variance",
        "full_covariance": "full_covariance",
        "none": None,
    }
    if weighting not in choices:
        raise ValueError(f"--weighting must be one of {', '.join(choices)}, found {weighting!r}")
    priors: dict[str, Literal["auto", "robot"] | None] = {"auto": "auto", "robot": "robot", "none": None}
    if prior not in priors:
        raise ValueError(f"--prior must be auto, robot or none, found {prior!r}")
    if prior == "robot" and choices[weighting] is None:
        raise ValueError(
            "--prior robot is weighed against the noise, which --weighting none leaves out; choose another"
        )
    if friction_law not in (*LAWS, "auto"):
        raise ValueError(f"--friction-law must be {', '.join(LAWS)} or auto, found {friction_law!r}")
    inputs = ("auto", "load_free_deflection", "deflection", "joint_state")
    if residual not in (*inputs, "none"):
        raise ValueError(f"--residual must be {', '.join(inputs)} or none, found {residual!r}")
    if compensator not in METHODS:
        raise ValueError(f"--compensator must be {' or '.join(METHODS)}, found {compensator!r}")
    return ThreeLoopIdentifier(
        model,
        friction_law="paper" if friction_law == "auto" else friction_law,
        links=LinkDynamicsIdentifier(choices[weighting], prior=priors[prior], asymmetry=ASYMMETRY),
        residual=None if residual == "none" else ResidualCompensator(method=compensator, inputs=residual),  # type: ignore[arg-type]
        cutoff=cutoff,
    )


def _chosen_laws(identifier: Any, train: list[Recording], slow: list[Recording] | None) -> tuple[str, ...]:
    """Law of every joint, by a training run that is left out for it; the test runs stay untouched."""
    from threadpoolctl import threadpool_limits

    from dynid_rs.friction_laws import choose_friction_laws

    options = {"links": identifier.links, "cutoff": identifier.cutoff, "friction_recording": slow}
    with threadpool_limits(limits=1, user_api="blas"):
        return choose_friction_laws(identifier.robot, train, **options)


def _fit(
    identifier: Any, train: list[Recording], slow: list[Recording] | None, say: Callable[[str], None]
) -> list[Finding]:
    """Fit; what did not converge is a finding, as everything else that the user should know."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning

    from dynid_rs.findings import Finding

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ConvergenceWarning)
        identifier.fit(train, slow, on_progress=say)
    for warning in caught:
        if not issubclass(warning.category, ConvergenceWarning):
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    messages = dict.fromkeys(
        str(warning.message) for warning in caught if issubclass(warning.category, ConvergenceWarning)
    )
    return [Finding("not_converged", "warning", message) for message in messages]


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
    train: list[Recording],
    test: list[Recording],
    findings: list[Finding],
    output: Path,
    physical: Any = None,
) -> dict[str, Any]:
    from dynid_rs.commands._output import filled_together
    from dynid_rs.encoders import with_fitted_delay
    from dynid_rs.files import write_json, write_table
    from dynid_rs.report import write_report
    from dynid_rs.report.source import source_of
    from dynid_rs.results import evaluate_runs, residual_table, summarise

    model = identifier.model_
    tested = evaluate_runs(model, test, _test_states(identifier, test))
    trained = evaluate_runs(model, train, identifier.raw_runs_)
    findings = with_fitted_delay(findings, identifier.encoder_delay_)
    result = summarise(identifier, trained, tested, findings, physical)
    if physical is not None:
        model = model.with_physical(physical.physical_set(model))
    table = residual_table(model, trained, tested)
    with filled_together(output) as folder:
        model.save(folder / MODEL_FILE)
        write_table(folder / RESIDUALS_FILE, table)
        write_json(folder / RESULT_FILE, result)
        write_report(folder, source_of(result, table))
    return result


def _test_states(identifier: Any, test: list[Recording]) -> list[States]:
    """States of the test runs; refuses one that stands still or whose torque does: there would be nothing to score."""
    from dynid_rs.errors import DataError
    from dynid_rs.training import check_torque

    check_torque(test)
    runs: list[States] = [identifier.states(recording) for recording in test]
    for recording, states in zip(test, runs, strict=True):
        if len(states.rows) < LEAST_TEST_ROWS:
            seconds = len(states.rows) * states.step / states.rate
            raise DataError(
                f"{recording.name}: only {seconds:.2f} s of motion are left to test on after standstill is taken "
                "out; test on a longer motion",
                code="too_little_motion",
                file=recording.name,
            )
    return runs


def _exit_code(result: dict[str, Any]) -> int:
    from dynid_rs.wording import is_better

    errors = any(finding["severity"] == "error" for finding in result["data"]["findings"])
    return EXIT_NO if errors or not is_better(result) else 0
