"""`dynid payload`: what the arm carries, as load data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid_rs.base.findings import Finding, told_once
from dynid_rs.commands import _options
from dynid_rs.commands._beside import doubt_of, not_known, result_beside
from dynid_rs.commands._run import EXIT_NO, print_json, run_command
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynid_rs.reference import Load

SURE = 0.01
"""A load is seen where none would look like it less often than this."""
MAKERS = {"ur": "Universal Robots", "kuka": "KUKA", "abb": "ABB", "fanuc": "Fanuc"}


@run_command
def payload(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL.json", help="What `dynid identify` made of the arm without the load")
    ],
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs with the load")],
    flange: Annotated[
        str | None,
        typer.Option(metavar="LINK", help="Frame of the answer, a link of --robot; the last by default"),
    ] = None,
    robot: Annotated[
        Path | None, typer.Option(metavar="ROBOT", help="The arm, for --flange: where that link stands")
    ] = None,
    config: _options.Config = None,
    drive_gain: _options.DriveGain = None,
    cutoff: _options.Cutoff = None,
    json_output: _options.Json = False,
) -> int:
    """Weigh the tool or workpiece that an arm carries: mass, centre and inertia with 95 % intervals.

    The answer is a body that can exist, told as the load data of UR, KUKA, ABB and Fanuc. Friction and offsets may
    differ a little from the model's, as from day to day. Ends with 1 if no load is seen or if the model was learned
    from runs with an error in them (by the result.json beside it), with 2 if the data is damaged.
    """
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._inputs import check_cutoff, load_model, read_runs, read_settings

    with progress(Step(1, "reading"), Step(3, "weighing")) as say:
        say("reading")
        reference = load_model(model)
        frame = _frame(reference.robot, robot, flange)
        settings = read_settings(config, drive_gain, reference.robot.n_joints)
        recordings, findings = read_runs(runs, reference.robot, settings)
        check_cutoff(cutoff, recordings)
        say("weighing")
        from dynid_rs.reference import weigh_load

        result = result_beside(model)
        doubt = doubt_of(result, reference)
        load = weigh_load(reference, recordings, cutoff=cutoff, frame=frame, doubt=doubt)
    name = flange or reference.robot.link_names[-1]
    findings += [*load.findings, *_of_the_model(result), *not_known(doubt, "these runs")]
    answer = _answer(load, name, reference.robot.joint_names, findings)
    if json_output:
        print_json(answer)
    else:
        from dynid_rs.base.units import torques_said
        from dynid_rs.model.units import torque_units

        for line in _lines(answer, findings, torques_said(torque_units(reference))):
            typer.echo(line)
    wrong = any(finding.severity == "error" for finding in findings)
    return 0 if answer["seen"] and not wrong else EXIT_NO


def _of_the_model(result: dict[str, Any] | None) -> list[Finding]:
    """Errors in the data that a model was learned from, where its result lies beside it: the load is as wrong as they.

    A torque that is wrong by a factor in all runs fits as well as one that is right.
    """
    findings = [] if result is None else result["data"].get("findings", [])
    errors = [one for one in findings if one["severity"] == "error"]
    return [
        Finding(
            "reference_in_error",
            "error",
            f"the model was learned from runs with an error in them, and the load may be as wrong as they are; mend it "
            f"and identify again: {f'{file}: ' if (file := one.get('file')) else ''}{one['message']}",
        )
        for one in errors[:1]
    ]


def _frame(model: Any, robot: Path | None, flange: str | None) -> Any:
    """Rotation and translation of the flange in the model's last link; None for that link's own frame."""
    from dynid_rs.model.robot_file import XACRO, read_robot

    if flange is None and robot is None:
        return None
    if flange is None or robot is None:
        raise ValueError("--flange and --robot belong together: a link, and the robot file that says where it stands")
    last = model.link_names[-1]
    if robot.suffix.lower() == ".toml":
        raise ValueError(
            f"{robot}: a robot.toml names no link that is fixed to {last}; leave --flange and --robot out, and the "
            "answer is in that link's frame"
        )
    if robot.suffix.lower() == XACRO:
        raise ValueError(f"{robot}: is a xacro source; expand it first: xacro in.xacro > out.urdf, and name that file")
    chain = read_robot(robot, tip=last)
    # Whoever identified a chain that begins further on chose a base.
    if chain.joint_names[-model.n_joints :] != model.joint_names:
        raise ValueError(
            f"{robot}: the chain to {last} is not the model's; give the robot file that it was learned with"
        )
    joint, rotation, translation = chain.link_frame(flange)
    if joint is None or joint != chain.n_joints - 1:
        raise ValueError(
            f"{robot}: the link {flange} does not move with {last}, the model's last link; name one that is fixed to it"
        )
    return rotation, translation


def _answer(load: Load, frame: str, joints: list[str], findings: list[Finding]) -> dict[str, Any]:
    import numpy as np

    from dynid_rs.reference.load_data import quantities, vendor_words

    seen = load.p_value < SURE and load.mass > 0
    return {
        "format": "dynid-payload",
        "version": 1,
        "frame": frame,
        "seen": bool(seen),
        "p_value": load.p_value,
        "load": quantities(load),
        # A controller would take a mass that no torque shows.
        "words": vendor_words(load) if seen and np.isfinite(load.intervals[0]).all() else {},
        "joints": list(joints),
        "rmse": {"before": load.rmse_before.tolist(), "after": load.rmse_after.tolist()},
        "findings": [finding.to_json() for finding in findings],
    }


def _lines(answer: dict[str, Any], findings: Sequence[Finding], unit: str) -> list[str]:
    from dynid_rs.reference.load_data import MOMENTS

    mass, said = answer["load"][0], [f"{finding.severity}: {text}" for finding, text in told_once(findings)]
    if not answer["seen"]:
        most = None if mass["interval"] is None else mass["interval"][1]
        if most is not None and most < 0:
            return ["no load is seen: the arm carries less than the model's arm does", *said]
        weighs = "" if most is None else f"; what it carries weighs less than {most:.3g} kg"
        return [f"no load is seen: the arm carries nothing that the noise would not look like{weighs}", *said]
    lines = [f"load in the frame of {answer['frame']}, inertia about its centre (95 % interval)"]
    for entry in answer["load"]:
        lines.append(f"  {entry['name']:<5}{entry['value']:>10.4g}  ({_bounds(entry)}) {entry['unit']}")
    lines += [f"{MAKERS[maker]}: {words}" for maker, words in answer["words"].items()]
    loose = [entry for entry in answer["load"] if entry["name"] in MOMENTS and _may_be_none(entry)]
    if loose:
        names = ", ".join(entry["name"] for entry in loose)
        # Of what no torque shows a finding says what to do.
        faster = (
            "" if any(entry["interval"] is None for entry in loose) else "; runs in which the wrist turns faster do"
        )
        lines.append(f"note: these runs do not determine {names}, which may as well be zero{faster}")
    errors = zip(answer["joints"], answer["rmse"]["before"], answer["rmse"]["after"], strict=True)
    lines.append(
        f"error [{unit}] " + ", ".join(f"{joint} {before:.3g} -> {after:.3g}" for joint, before, after in errors)
    )
    return lines + said


def _may_be_none(entry: dict[str, Any]) -> bool:
    return entry["interval"] is None or bool(entry["interval"][0] <= 0)


def _bounds(entry: dict[str, Any]) -> str:
    if entry["interval"] is None:
        return "not seen"
    low, high = entry["interval"]
    return f"{low:.4g} to {high:.4g}"
