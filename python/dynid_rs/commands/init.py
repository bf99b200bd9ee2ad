"""`dynid init`: looks at runs, asks where a person sits at a terminal, and writes their `dynid.toml`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import EXIT_NO, print_json, run_command

if TYPE_CHECKING:
    from dynid_rs.commands._init_look import Look
    from dynid_rs.commands._init_proposal import Proposal


@run_command
def init(
    robot: _options.Robot,
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs that one dynid.toml is for")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="dynid.toml", help="Where to write it")] = Path(
        "dynid.toml"
    ),
    config: Annotated[
        Path | None, typer.Option(metavar="dynid.toml", help="What is known already; it stays as it is")
    ] = None,
    gravity: _options.Gravity = None,
    base: _options.Base = None,
    tip: _options.Tip = None,
    xacro: _options.Xacro = False,
    drive_gain: _options.DriveGain = None,
    accept: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CODE",
            help="Yes to a question: torque_flipped, position_flipped, joint_flipped or mounting; repeat for more",
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: take what the runs say, and say so")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a dynid.toml that is there")] = False,
    json_output: _options.Json = False,
) -> int:
    """Write a commented dynid.toml for runs of a robot: columns, units, gears, gains, signs.

    Nothing is put right in silence: each unit that differs from the usual one stands with its evidence, and what only
    a person can answer (columns that seem swapped or inverted) stands as a question. Ends with 1 if such errors
    remain. At a terminal what is open is asked, and Enter takes what the runs say; --tip, --drive-gain, --accept and
    --yes are the same answers for scripts.
    """
    from dynid_rs.base.files import check_replaceable, write_text
    from dynid_rs.commands._init_answers import ANSWERABLE
    from dynid_rs.commands._init_look import look
    from dynid_rs.commands._init_write import config_text
    from dynid_rs.commands._inputs import chain_ends, read_robot, read_rules, read_settings
    from dynid_rs.commands._output import check_file, check_not_read

    check_not_read([output], (robot, *runs))
    check_file(check_replaceable(output))
    if output.exists() and not force:
        raise ValueError(f"{output}: there is one already; give --force to replace it, or -o another place")
    accepted = set(accept or ())
    if unknown := sorted(accepted - set(ANSWERABLE)):
        raise ValueError(f"--accept must be one of {', '.join(ANSWERABLE)}, found {unknown[0]!r}")
    asks = not yes and not json_output and sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()
    rules = read_rules(config)
    base, tip = chain_ends(base, tip, rules)
    model = read_robot(robot, base, tip, gravity, rules, xacro=xacro)
    if asks and model.choice is not None and base is None and tip is None:
        model, tip = _chain(model, lambda named: read_robot(robot, None, named, gravity, rules, xacro=xacro))
    if drive_gain is not None:
        rules = read_settings(config, drive_gain, model.n_joints)
    rules = replace(rules, base=base, tip=tip, gravity=tuple(map(float, model.gravity)))

    def answer(code: str, proposal: Proposal) -> bool:
        return code in accepted or (asks and _ask(proposal))

    found = look(model, runs, rules, _ask if asks else lambda proposal: True, answer)
    if asks and _is_in_amperes(found):
        found.rules = replace(found.rules, drive_gain=_gains(model.n_joints))
    write_text(output, config_text(model, robot, runs, found))
    errors = [one for one in found.questions if one.severity == "error"]
    if json_output:
        print_json(_to_json(output, found))
    else:
        _show(output, found, asked=asks)
    return EXIT_NO if errors else 0


def _chain(model: Any, read: Callable[[str], Any]) -> tuple[Any, str | None]:
    """The robot with the chain that a person names, and its last link; what was chosen has been said already."""
    while True:
        named = typer.prompt("  last link of the chain (Enter: the one above)", default="", show_default=False).strip()
        if not named:
            return model, None
        try:
            return read(named), named
        except ValueError as error:
            typer.echo(f"  {error}")


def _is_in_amperes(found: Look) -> bool:
    signals = found.runs[0].columns.signals
    return "current" in signals and "tau" not in signals and found.rules.drive_gain is None


def _gains(n_joints: int) -> tuple[float, ...] | None:
    """Drive gains [N m/A] that a person knows; None: torque stays in amperes."""
    from dynid_rs.commands._inputs import numbers

    typer.echo("The runs hold currents; with the drives' gains the model is in N m, without them in A.")
    while True:
        text = typer.prompt(
            "  torque at the joint per ampere [N m/A], G or G1,G2,... (Enter: not known)",
            default="",
            show_default=False,
        )
        if not text.strip():
            return None
        try:
            gains = numbers("the gain", text, n_joints, or_one=True)
            if min(gains) > 0:
                return gains
            typer.echo("  a gain is positive; a direction belongs in [signs] tau")
        except ValueError as error:
            typer.echo(f"  {error}")


def _ask(proposal: Proposal) -> bool:
    typer.echo(proposal.evidence)
    return typer.confirm(f"  write {proposal.key} = {proposal.value!r}?", default=True)


def _to_json(output: Path, found: Look) -> dict[str, object]:
    columns = found.runs[0].columns
    return {
        "format": "dynid-init",
        "version": 1,
        "config": str(output),
        "kind": found.runs[0].kind,
        "columns": {"t": columns.time, **{signal: list(names) for signal, names in columns.signals.items()}},
        "guessed": found.guessed is not None,
        "taken": [{"key": one.key, "value": one.value, "evidence": one.evidence} for one in found.taken],
        "questions": [one.to_json() for one in found.questions],
        "notes": found.notes,
    }


def _show(output: Path, found: Look, *, asked: bool) -> None:
    columns = found.runs[0].columns
    typer.echo(f"{found.runs[0].kind}: t = {columns.time}")
    for signal, names in columns.signals.items():
        typer.echo(f"  {signal}: {names[0]}" + (f" ... {names[-1]}" if len(names) > 1 else ""))
    if found.guessed is not None:
        typer.echo("  found by their names alone; look whether they are what they seem")
        for doubt in found.guessed.doubts:
            typer.echo(f"  in doubt: {doubt}")
        for form, why in found.guessed.others.items():
            typer.echo(f"  not read: {form}: {why}")
    for note in found.notes:
        typer.echo(f"note: {note}")
    for one in found.taken if not asked else ():
        typer.echo(f"taken: {one.key} = {one.value!r}, because {one.evidence}")
    for question in found.questions:
        typer.echo(f"{question.severity}: {question.file}: {question.message}")
    typer.echo(f"written: {output}")
