"""`dynid contact`: what pushes an arm, and where its thresholds are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._rates import per_day
from dynid_rs.commands._run import EXIT_NO, of_option, print_json, refused, run_command
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    from dynid_rs._core import TorqueModel
    from dynid_rs.base.findings import Finding
    from dynid_rs.identification.directions import ParameterDirections

USUAL, HOURS = "1/hour", 24.0
TIME_CONSTANT = 0.02


@run_command
def contact(
    model: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL.json",
            help="What `dynid identify` or `dynid diagnose` made; named by its folder, what its runs left unknown "
            "raises thresholds where the model knows little",
        ),
    ],
    runs: Annotated[list[Path] | None, typer.Argument(metavar="RUN...", help="Runs to look for contacts in")] = None,
    healthy: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN",
            help="A run in which nothing touches the arm, none that the model was fitted on (repeat for more; two "
            "minutes in all): thresholds are learned from it",
        ),
    ] = None,
    false_contacts: Annotated[
        str | None,
        typer.Option(
            metavar="N/hour",
            help="Contacts without a cause that you put up with (1/day, 2/week, ...); 1/hour, or what --settings says",
        ),
    ] = None,
    time_constant: Annotated[
        float | None, typer.Option(metavar="S", help="An external torque shows by 63 % after it; 0.02 if left out")
    ] = None,
    window: Annotated[
        int | None, typer.Option(metavar="N", help="Samples to differentiate over, where positions come alone")
    ] = None,
    settings: Annotated[
        Path | None,
        typer.Option(metavar="CONTACT.json", help="Thresholds as this file of --save says, instead of --healthy"),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="CONTACT.json",
            help="Write what was learned, for --settings and `dynid-estimator --observe --contacts`",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT.parquet",
            help="Of one run: external torque, threshold and guide per sample and joint, and whether it is a contact",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there already")] = False,
    config: _options.Config = None,
    drive_gain: _options.DriveGain = None,
    json_output: _options.Json = False,
) -> int:
    """Find contacts on recordings, and learn from runs without any from where on something is one.

    What pushes the arm is what the measured torque says beyond the model, by the generalised momentum. Thresholds
    follow, state by state, from what healthy runs leave and from how many false contacts you put up with. Ends with 1
    if something pushes, with 2 if a file cannot be read; what the other runs say is said all the same.
    """
    import numpy as np

    from dynid_rs.base.codes import OF_LEARNING
    from dynid_rs.base.files import write_table
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._contact_view import answer, columns, learned, lines, looked_at
    from dynid_rs.commands._inputs import load_model, read_runs, read_settings, read_undamaged, run_sources
    from dynid_rs.model.observer import MomentumObserver

    per_hour = per_day(USUAL if false_contacts is None else false_contacts, "--false-contacts") / HOURS
    if settings is not None and (time_constant is not None or window is not None):
        raise ValueError("--settings says which --time-constant and --window it was learned with; leave them out")
    _check(runs, healthy, settings, save, output, model, config, force=force)
    with progress(Step(1, "reading"), Step(1, "looking for contacts")) as say:
        say("reading")
        reference = load_model(model)
        rules = read_settings(config, drive_gain, reference.robot.n_joints)
        findings: list[Finding] = []
        if settings is not None:
            observer = MomentumObserver.load(settings, reference)
            if false_contacts is not None:
                observer.false_contacts_per_hour = per_hour
        else:
            directions = _directions(model, reference)
            observer = MomentumObserver(
                reference,
                time_constant=TIME_CONSTANT if time_constant is None else time_constant,
                false_contacts_per_hour=per_hour,
                window=window,
                directions=directions,
            )
        if healthy:
            good, findings = read_runs(healthy, reference.robot, rules)
            with of_option("--healthy"):
                observer.fit(good)
            if observer.uncertainty_ is None:
                seconds = sum(run.duration for run in good)
                without = ", or leave --healthy out: thresholds then follow from what the model expects"
                raise ValueError(
                    f"{seconds:.0f} s of healthy runs are too few to say how often a threshold is passed; name runs of "
                    f"two minutes in all{without if save is None else ''}"
                )
        if save is not None:
            observer.save(save)
        say("looking for contacts")
        observed, tables = [], []
        errors: list[ValueError | OSError] = []
        for source in run_sources(runs, reference.robot, rules) if runs else ():
            try:
                recording, found = read_undamaged(source)
                seen = observer.observe(recording)
            except (ValueError, OSError) as error:
                errors.append(error)
                continue
            observed.append(looked_at(recording.name, seen))
            findings += found
            if output is not None:
                tables.append(columns(seen))
        if not observed and len(errors) == 1:
            raise errors[0]
        findings = [finding for finding in findings if finding.code not in OF_LEARNING]
        if output is not None and not errors:
            # Where samples are missing a run is looked at in parts.
            write_table(output, {name: np.concatenate([one[name] for one in tables]) for name in tables[0]})
    said = learned(observer)
    if json_output:
        print_json(answer(observer, observed, said, findings, errors))
    else:
        for line in lines(observed, reference, said, findings):
            typer.echo(line)
        for words, path in (("settings", save), ("external torque", output)):
            if path is not None and not (errors and path == output):
                typer.echo(f"{words}: {path}")
    if errors:
        return refused(errors)
    return EXIT_NO if any(one.contacts for one in observed) else 0


def _check(
    runs: list[Path] | None,
    healthy: list[Path] | None,
    settings: Path | None,
    save: Path | None,
    output: Path | None,
    model: Path,
    config: Path | None,
    *,
    force: bool,
) -> None:
    """Refuse before any work is done what cannot be, or cannot be written."""
    from dynid_rs.commands._inputs import model_files
    from dynid_rs.commands._output import check_absent, check_file, check_not_read, check_suffix

    if settings is not None and (healthy or save is not None):
        raise ValueError("--settings holds what --healthy would teach, and is written already; leave those and --save")
    if save is not None and not healthy:
        raise ValueError("--save writes what runs without contact teach; name them with --healthy RUN")
    if not runs and save is None:
        raise ValueError("no run to look at; name one, or write thresholds with --healthy RUN --save CONTACT.json")
    if output is not None and len(runs or []) != 1:
        raise ValueError("--output is of one run; name it, and no other")
    if output is not None:
        check_suffix(output, ".parquet", "Parquet")
    for path in runs or []:
        if any(path.exists() and other.exists() and path.samefile(other) for other in healthy or []):
            raise ValueError(f"{path}: both looked at and said to be healthy (--healthy); name it once")
    written = [path for path in (save, output) if path is not None]
    for path in written:
        check_file(path)
    if len({path.resolve() for path in written}) < len(written):
        raise ValueError(f"{save}: --save and --output are to be two files; name another one")
    read = (*model_files(model), settings, config, *(runs or []), *(healthy or []))
    check_not_read(written, [path for path in read if path])
    if not force:
        check_absent(written)


def _directions(model: Path, reference: TorqueModel) -> ParameterDirections | None:
    """What the runs left unknown, by a diagnosis' open questions or by the result; None beside a lone model."""
    from dataclasses import replace

    import numpy as np

    from dynid_rs.commands._beside import doubt_of, result_beside
    from dynid_rs.commands._identifier import OPEN_FILE
    from dynid_rs.identification.directions import directions_of

    if not (model / OPEN_FILE).is_file():
        doubt = doubt_of(result_beside(model) if model.is_dir() else None, reference)
        if doubt is None:
            return None
        return directions_of(doubt.covariance, doubt.plan(reference), reference, np.asarray(reference.noise_std))
    from dynid_rs.diagnosis.open_file import read_open

    asked = read_open(model, reference.robot)
    plan = replace(asked.plan, robot=reference.robot)
    return directions_of(asked.covariance(), plan, reference, asked.noise)
