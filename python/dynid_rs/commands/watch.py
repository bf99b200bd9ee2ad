"""`dynid watch`: what of a model no longer holds on runs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid_rs.base.findings import Finding, told_once
from dynid_rs.commands import _options
from dynid_rs.commands._run import EXIT_NO, print_json, run_command
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    from dynid_rs.model.watch import Tolerated, Watch, Watched
    from dynid_rs.runs.recording import Recording

USUAL = "1/day"
DAYS = {"hour": 1 / 24, "day": 1.0, "week": 7.0, "month": 30.0, "year": 365.0}


@run_command
def watch(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="What `dynid identify` or `diagnose` made")],
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN...", help="Runs to watch, each from its beginning")
    ] = None,
    healthy: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN",
            help="A run in which nothing had changed (repeat for more): it says how large the model's own error is, "
            "and how long it lasts. Without one, the model's deviation for two seconds",
        ),
    ] = None,
    false_alarms: Annotated[
        str, typer.Option(metavar="N/day", help="Alarms without a cause that you put up with (1/hour, 2/week, ...)")
    ] = USUAL,
    tolerate: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND=X",
            help="What is not a change yet: friction=0.1 and gain=0.05 (relative), offset=2 (deviations of the error), "
            "load=0.1 (kg), unknown=1 (growth of the error); repeat for more",
        ),
    ] = None,
    settings: Annotated[
        Path | None,
        typer.Option(
            metavar="WATCH.json",
            help="Watch as this file of --save says, instead of --healthy, --false-alarms and --tolerate",
        ),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="WATCH.json",
            help="Write what the healthy runs say, and what is tolerated, for --settings and "
            "`dynid-estimator --changes`",
        ),
    ] = None,
    remember: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Go on with what the watch knew when an earlier call, or `dynid-estimator --remember`, ended, which "
            "FILE holds, and keep it there; runs go on from one another, instead of each from its beginning",
        ),
    ] = None,
    config: _options.Config = None,
    drive_gain: _options.DriveGain = None,
    json_output: _options.Json = False,
) -> int:
    """Watch a model on recordings: say what has changed, friction, gain, offset, load, or something unknown.

    One test per change, with false alarms as rare as you say; a change is named once the data tell it from any other,
    and its size twenty seconds later. Ends with 1 if something has changed, with 2 if a file cannot be read.
    """
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._inputs import load_model, read_runs, read_settings
    from dynid_rs.model.watch import Watch

    per_day, tolerated = _per_day(false_alarms), _tolerated(tolerate or [])
    if settings is not None and (healthy or tolerate or save or false_alarms != USUAL):
        raise ValueError(
            "--settings says all that --healthy, --false-alarms and --tolerate do; leave those and --save out"
        )
    read = [path for path in (model, *(runs or []), *(healthy or []), config, settings) if path is not None]
    if not runs and save is None:
        raise ValueError("no run to watch; name one, or write settings with --save WATCH.json")
    _check_written([path for path in (save, remember) if path is not None], read)
    with progress(Step(1, "reading"), Step(1, "watching")) as say:
        say("reading")
        reference = load_model(model)
        rules = read_settings(config, drive_gain, reference.robot.n_joints)
        recordings, findings = read_runs(runs, reference.robot, rules) if runs else ([], [])
        watching = Watch(reference, false_alarms_per_day=per_day, tolerated=tolerated)
        if settings is not None:
            watching = Watch.load(settings, reference)
        if healthy:
            good, more = read_runs(healthy, reference.robot, rules)
            findings += more
            watching.fit(good)
        if save is not None:
            watching.save(save)
        say("watching")
        watched = _watched(watching, recordings, remember)
    joints = reference.robot.joint_names
    if json_output:
        print_json(_answer(watched, joints, findings))
    else:
        for line in _lines(watched, joints, findings):
            typer.echo(line)
        if save is not None and not runs:
            typer.echo(f"settings: {save}")
    return EXIT_NO if _changed(watched) else 0


def _check_written(written: Sequence[Path], read: Sequence[Path]) -> None:
    from dynid_rs.commands._output import check_file, check_not_read

    for path in written:
        check_file(path)
    check_not_read(written, read)


def _watched(watching: Watch, recordings: Sequence[Recording], remember: Path | None) -> list[Watched]:
    """Each run from its beginning; or, where it is remembered, one after the other."""
    from dynid_rs import FormatError
    from dynid_rs.base.files import write_text
    from dynid_rs.model.watch import read_remembered

    if remember is None:
        return [watching.watch(recording) for recording in recordings]
    known = read_remembered(remember) if remember.exists() else None
    found: list[Watched] = []
    for recording in recordings:
        try:
            found.append(watching.watch(recording, remembered=known))
        except FormatError as error:
            raise FormatError(f"{remember}: {error}, or remove the file") from None
        known = found[-1].remembered
    if known is not None:
        write_text(remember, known)
    return found


def _changed(watched: Sequence[Watched]) -> bool | None:
    """Whether something has; None where no joint of any run could be watched, or no run was named."""
    if not any(run.watched.any() for run in watched):
        return None
    return any(change.said != "withdrawn" for run in watched for change in run.changes)


def _per_day(text: str) -> float:
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*/\s*(\d*)\s*([a-z]+?)s?\s*", text)
    if found is None or found[3] not in DAYS or not float(found[1]) or found[2] == "0":
        raise ValueError(
            f"--false-alarms: expected a number per {', '.join(DAYS)}, as 1/day or 1/2weeks, got {text[:40]!r}"
        )
    return float(found[1]) / (float(found[2] or 1) * DAYS[found[3]])


def _tolerated(said: Sequence[str]) -> Tolerated:
    from dataclasses import asdict, replace

    from dynid_rs.model.watch import Tolerated

    tolerated = Tolerated()
    for text in said:
        kind, _, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            value = 0.0
        if kind not in asdict(tolerated) or not 0.0 < value < float("inf"):
            kinds = ", ".join(asdict(tolerated))
            raise ValueError(f"--tolerate: expected KIND=X, a kind of {kinds} and a number above 0, got {text[:40]!r}")
        tolerated = replace(tolerated, **{kind: value})
    return tolerated


def _answer(watched: Sequence[Watched], joints: Sequence[str], findings: Sequence[Finding]) -> dict[str, Any]:
    return {
        "format": "dynid-watch",
        "version": 1,
        "joints": list(joints),
        "changed": _changed(watched),
        "runs": [
            {
                "run": run.name,
                "changes": [change.to_json() for change in run.changes],
                "rows": len(run.t),
                "watched": run.watched.mean(axis=0).tolist() if len(run.t) else [0.0] * len(joints),
            }
            for run in watched
        ],
        "findings": [finding.to_json() for finding in findings],
    }


def _lines(watched: Sequence[Watched], joints: Sequence[str], findings: Sequence[Finding]) -> list[str]:
    """One line per change, and what was not seen."""
    from dynid_rs.base.numbers import percent
    from dynid_rs.base.quoting import shown

    lines = []
    for run in watched:
        nothing = "nothing has changed" if run.watched.any() else "could not be watched"
        lines.append(f"{shown(run.name)}:" if run.changes else f"{shown(run.name)}: {nothing}")
        lines += [f"  {change}" for change in run.changes]
        share = run.watched.mean(axis=0) if len(run.t) else [0.0] * len(joints)
        unseen = [shown(joint) for joint, part in zip(joints, share, strict=True) if part == 0]
        if unseen:
            lines.append(f"  not watched, for they never move as the model was trained to: {', '.join(unseen)}")
        elif min(share) < 0.5:
            lines.append(f"  watched in {percent(float(min(share)))} of the run only, of the joint that moves least")
    return [*lines, *(f"{one.severity}: {text}" for one, text in told_once(findings) if one.severity != "info")]
