"""`dynid watch`: what of a model no longer holds on runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynid_rs.base.changes import FROZEN
from dynid_rs.commands import _options
from dynid_rs.commands._rates import per_day
from dynid_rs.commands._run import EXIT_NO, of_option, print_json, refused, run_command
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    from dynid_rs.base.findings import Finding
    from dynid_rs.model.watch import Tolerated, Watch, Watched
    from dynid_rs.runs.recording import Recording

USUAL = "1/day"
_NAMED = {("stuck", "tau"): FROZEN, ("position_jump", "q"): "slip", ("position_jump", "q_motor"): "slip"}
"""Damage by its code and signal, which a watch may have a name for: a run with it is refused only where it has none."""


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
            "load=0.1 (kg; of a model in ampere kg A/(N m)), delay=0.004 (s), slip=0.005 (rad, m), unknown=1 (growth "
            "of the error); repeat for more",
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
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="HEALTH.html", help="Write a page: what has changed and when, a trend per joint, what to do"
        ),
    ] = None,
    prometheus: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.prom",
            help="Write the state at the end of the last run as text for Prometheus (node_exporter)",
        ),
    ] = None,
    ros: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="Write it as JSON in the fields of ROS 2, diagnostic_msgs/msg/DiagnosticArray"
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files that are there and that no earlier watch has written")
    ] = False,
    config: _options.Config = None,
    drive_gain: _options.DriveGain = None,
    json_output: _options.Json = False,
) -> int:
    """Watch a model on recordings: say what has changed, friction, gain, offset, load, or something unknown.

    One test per change, with false alarms as rare as you say; a change is named once the data tell it from any other,
    and its size twenty seconds later. Ends with 1 if something has changed, with 2 if a file cannot be read: what the
    runs before it say is said, and no file is written.
    """
    from dynid_rs.base.codes import OF_LEARNING
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._inputs import (
        load_model,
        model_files,
        read_runs,
        read_settings,
        read_undamaged,
        refuse_damage,
        run_sources,
    )
    from dynid_rs.commands._watch_files import WatchFiles
    from dynid_rs.commands._watch_view import answer, has_changed, lines
    from dynid_rs.model.watch import Watch

    often, tolerated = per_day(false_alarms, "--false-alarms"), _tolerated(tolerate or [])
    if settings is not None and (healthy or tolerate or save or false_alarms != USUAL):
        raise ValueError(
            "--settings says all that --healthy, --false-alarms and --tolerate do; leave those and --save out"
        )
    files = WatchFiles(save, remember, report, prometheus, ros)
    read = (*model_files(model), settings, config, *(runs or []), *(healthy or []))
    files.check(runs, [path for path in read if path], force=force)
    with progress(Step(1, "reading"), Step(1, "watching")) as say:
        say("reading")
        reference = load_model(model)
        rules = read_settings(config, drive_gain, reference.robot.n_joints)
        watching = Watch(reference, false_alarms_per_day=often, tolerated=tolerated)
        if settings is not None:
            watching = Watch.load(settings, reference)
        good, findings = read_runs(healthy, reference.robot, rules) if healthy else ([], [])
        if healthy:
            with of_option("--healthy"):
                watching.fit(good)
        say("watching")
        watched, known = [], files.remembered()
        errors: list[ValueError | OSError] = []
        for source in run_sources(runs, reference.robot, rules) if runs else ():
            try:
                recording, found = read_undamaged(source, but=lambda finding: _kind_of(finding) is not None)
                told = _watched(watching, recording, known, remember)
                found = _unsaid(found, told, recording)
                refuse_damage(found)
                watched.append(told)
            except (ValueError, OSError) as error:
                errors.append(error)  # what comes later stands on it
                break
            known = watched[-1].remembered if remember is not None else None
            findings += found
        if errors and not watched:
            raise errors[0]
        findings = [finding for finding in findings if finding.code not in OF_LEARNING]
        if not errors:
            files.write(watching, watched, findings)
    joints = reference.robot.joint_names
    if json_output:
        print_json(answer(watched, joints, findings, errors))
    else:
        for line in [*lines(watched, joints, findings), *(() if errors else files.lines())]:
            typer.echo(line)
    if errors:
        return refused(errors)
    if watched:
        files.keep(watched)
    return EXIT_NO if has_changed(watched) else 0


def _watched(watching: Watch, recording: Recording, known: str | None, remember: Path | None) -> Watched:
    from dynid_rs._core import FormatError
    from dynid_rs.model.watch import ANEW

    try:
        return watching.watch(recording, remembered=known)
    except FormatError as error:  # of what is known, which only the file can be to blame for
        words = str(error).removeprefix("remembered: ").removesuffix(f"; {ANEW}").removesuffix("; begin anew")
        raise FormatError(f"{remember}: {words}; {ANEW}") from None


def _kind_of(finding: Finding) -> str | None:
    """Kind that a watch may call the damage by."""
    return _NAMED.get((finding.code, (finding.column or "").rpartition("_")[0]))


def _unsaid(findings: list[Finding], told: Watched, recording: Recording) -> list[Finding]:
    """Findings less those that the watch has named: what it said before the damage is of something else."""
    named = [*told.before, *(one for one in told.changes if one.said == "named")]
    said = [(one.kind, str(recording.joints.index(one.joint)), one.t) for one in named]

    def is_said(finding: Finding) -> bool:
        begun = recording.t[0 if finding.rows is None else finding.rows[0]]
        kind, joint = _kind_of(finding), (finding.column or "").rpartition("_")[2]
        return any((kind, joint) == (one, where) and t >= begun for one, where, t in said)

    return [finding for finding in findings if not is_said(finding)]


def _tolerated(said: Sequence[str]) -> Tolerated:
    from dataclasses import asdict, replace

    from dynid_rs.model.watch import Tolerated

    tolerated, seen = Tolerated(), set()
    for text in said:
        kind, _, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            value = 0.0
        if kind not in asdict(tolerated) or not 0.0 < value < float("inf"):
            kinds = ", ".join(asdict(tolerated))
            raise ValueError(f"--tolerate: expected KIND=X, a kind of {kinds} and a number above 0, got {text[:40]!r}")
        if kind in seen:
            raise ValueError(f"--tolerate {kind} is given twice; give it once")
        seen.add(kind)
        tolerated = replace(tolerated, **{kind: value})
    return tolerated
