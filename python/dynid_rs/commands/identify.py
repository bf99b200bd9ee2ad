"""`dynid identify`: measured runs and a robot in; a torque model, its errors on unseen runs and a report out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dynid_rs.commands._run import EXIT_NO, print_json, run_command

if TYPE_CHECKING:
    from dynid_rs.findings import Finding
    from dynid_rs.readers import Config
    from dynid_rs.recording import Recording

MODEL_FILE, RESULT_FILE, RESIDUALS_FILE = "model.json", "result.json", "residuals.parquet"


@run_command
def identify(
    robot: Annotated[Path, typer.Argument(metavar="ROBOT.urdf", help="The arm, as URDF")],
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
    gravity: Annotated[str, typer.Option(metavar="X,Y,Z", help="Free fall in the base frame [m/s^2]")] = "0,0,-9.81",
    base: Annotated[str | None, typer.Option(help="First link of the chain, where the URDF leaves a choice")] = None,
    tip: Annotated[str | None, typer.Option(help="Last link of the chain, where the URDF branches")] = None,
    drive_gain: Annotated[
        str | None, typer.Option(metavar="G[,G...]", help="Joint torque per motor current [N*m/A], one per joint")
    ] = None,
    weighting: Annotated[
        str, typer.Option(help="joint_variance, full_covariance or none")
    ] = "joint_variance",
    residual: Annotated[str, typer.Option(help="Third loop on: auto, deflection, joint_state or none")] = "auto",
    cutoff: Annotated[float | None, typer.Option(help="Band [Hz]; chosen from the motion if left out")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Identify friction, link dynamics and residual of an arm from measured runs.

    DIR then holds model.json (for `dynid estimate` and `dynid-estimator`), result.json, residuals.parquet and
    report.html. Ends with 1 if the data has an error in it or the model is no better than plain least squares.
    """
    from rich.console import Console

    from dynid_rs import _core
    from dynid_rs.splitting import split_runs

    _check_output(output)
    if cutoff is not None and not cutoff > 0:
        raise ValueError(f"--cutoff must be a positive frequency in Hz, found {cutoff:g}")
    console = Console(stderr=True)
    with console.status("reading") as status:
        model = _core.RobotModel.from_urdf(robot, base=base, tip=tip, gravity=_numbers("--gravity", gravity, 3))
        settings = _settings(config, drive_gain, model.n_joints)
        train, found = _read(runs, model, settings)
        held, more = _read(test or [], model, settings)
        split = split_runs(train, held, test_from)
        findings = found + more + ([split.finding] if split.finding else [])
        identifier = _identifier(model, weighting, residual, cutoff)
        identifier.fit(split.train, on_progress=status.update)
        status.update("testing")
        result = _write(identifier, split.train, split.test, findings, output)
    if json_output:
        print_json(result)
    else:
        from dynid_rs.commands._identify_view import show

        show(result, output)
    return _exit_code(result)


def _identifier(model: Any, weighting: str, residual: str, cutoff: float | None) -> Any:
    from dynid_rs.identification import ThreeLoopIdentifier
    from dynid_rs.links import LinkDynamicsIdentifier
    from dynid_rs.residual import ResidualCompensator

    choices: dict[str, Literal["joint_variance", "full_covariance"] | None] = {
        "joint_variance": "joint_variance",
        "full_covariance": "full_covariance",
        "none": None,
    }
    if weighting not in choices:
        raise ValueError(f"--weighting must be one of {', '.join(choices)}, found {weighting!r}")
    if residual not in ("auto", "deflection", "joint_state", "none"):
        raise ValueError(f"--residual must be auto, deflection, joint_state or none, found {residual!r}")
    return ThreeLoopIdentifier(
        model,
        links=LinkDynamicsIdentifier(choices[weighting]),
        residual=None if residual == "none" else ResidualCompensator(inputs=residual),  # type: ignore[arg-type]
        cutoff=cutoff,
    )


def _write(
    identifier: Any, train: list[Recording], test: list[Recording], findings: list[Finding], output: Path
) -> dict[str, Any]:
    from dynid_rs.files import write_json, write_table
    from dynid_rs.report import write_report
    from dynid_rs.results import residual_table, summarise

    result = summarise(identifier, train, test, findings)
    output.mkdir(parents=True, exist_ok=True)
    identifier.model_.save(output / MODEL_FILE)
    write_table(output / RESIDUALS_FILE, residual_table(identifier, train, test))
    write_json(output / RESULT_FILE, result)
    write_report(output)
    return result


def _read(paths: list[Path], model: Any, config: Config) -> tuple[list[Recording], list[Finding]]:
    """Recordings without the signals that contradict their positions, and what was found in them."""
    from dynid_rs.checks import check_recording, refused_sources
    from dynid_rs.readers import read_recording

    recordings: list[Recording] = []
    findings: list[Finding] = []
    for path in paths:
        recording = read_recording(path, model, config)
        found = check_recording(recording, model)
        recordings.append(recording.without(*refused_sources(found)))
        findings += found
    return recordings, findings


def _settings(config: Path | None, drive_gain: str | None, n_joints: int) -> Config:
    from dynid_rs.readers import Config, read_config

    settings = Config() if config is None else read_config(config)
    if drive_gain is None:
        return settings
    return replace(settings, drive_gain=tuple(_numbers("--drive-gain", drive_gain, n_joints)))


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"{option} must be {count} numbers with commas between, found {text!r}") from None
    if len(numbers) != count:
        raise ValueError(f"{option} has {len(numbers)} numbers, expected {count}")
    return numbers


def _check_output(output: Path) -> None:
    """Refuse a folder that cannot be written before any work is done."""
    import os

    place = output
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise NotADirectoryError(f"{output}: {place} is a file; name a folder with -o")
    if not os.access(place, os.W_OK | os.X_OK):
        raise PermissionError(f"{output}: the folder {place} cannot be written; choose another with -o")


def _exit_code(result: dict[str, Any]) -> int:
    from dynid_rs.wording import is_better

    errors = any(finding["severity"] == "error" for finding in result["data"]["findings"])
    return EXIT_NO if errors or not is_better(result) else 0
