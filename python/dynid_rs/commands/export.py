"""`dynid export`: the identified model for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from dynid_rs.commands._run import print_json, run_command


@run_command
def export(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="model.json of `dynid identify`")],
    urdf: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.urdf", help="URDF with the inertials of `dynid identify --physical`", show_default=False
        ),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(metavar="ORIGINAL.urdf", help="Edit this file's text: only <inertial> and <dynamics> change"),
    ] = None,
    mjcf: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.xml", help="MuJoCo model of `dynid identify --physical`, with motors", show_default=False
        ),
    ] = None,
    c_header: Annotated[
        bool, typer.Option("--c-header", help="The whole model as one C99 file: no allocation, no library but math.h")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="OUT.h", help="Where the C header goes", show_default=False)
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="What the header's names begin with; the file's name by default"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Write a model as a URDF (--urdf) or MuJoCo model (--mjcf) with inertials that bodies can have, or as C.

    With --robot everything else of the original URDF stays byte for byte; without it the URDF holds links and joints
    alone. The C header gives the numbers of dynid-estimator for controllers that can have no library.
    """
    if (urdf is not None) + (mjcf is not None) + c_header != 1:
        raise ValueError(
            "say what to write: --urdf OUT.urdf, --mjcf OUT.xml, or --c-header with -o OUT.h, one at a time"
        )
    if not c_header and (output is not None or name is not None):
        raise ValueError("-o and --name belong to --c-header; --urdf and --mjcf name their own file")
    if urdf is not None:
        answer, text = _write_urdf(model, urdf, robot, force=force)
    elif mjcf is not None:
        if robot is not None:
            raise ValueError("--robot belongs to --urdf; a MuJoCo model is made of the model alone")
        answer, text = _write_mjcf(model, mjcf, force=force)
    else:
        if robot is not None:
            raise ValueError("--robot belongs to --urdf; a C header is made of the model alone")
        if output is None:
            raise ValueError("--c-header needs -o OUT.h, the file to write")
        answer, text = _write_header(model, output, name, force=force)
    if json_output:
        print_json(answer)
    else:
        typer.echo(text)
    return 0


Answer = tuple[dict[str, Any], str]
"""For programs, for people."""


def _check_place(target: Path, inputs: list[Path], *, force: bool) -> None:
    from dynid_rs.commands._output import check_absent, check_file, check_not_read

    check_file(target)
    check_not_read([target], inputs)
    if not force:
        check_absent([target])


def _write_urdf(model: Path, target: Path, robot: Path | None, *, force: bool) -> Answer:
    from dynid_rs.base.files import write_bytes
    from dynid_rs.commands._inputs import load_model, model_files
    from dynid_rs.model.export import urdf
    from dynid_rs.model.units import own_unit

    if robot is not None and robot.suffix.lower() == ".toml":
        raise ValueError(f"--robot {robot}: only a URDF can be edited; leave it out for a URDF of links and joints")
    _check_place(target, [*model_files(model), *([robot] if robot else [])], force=force)
    loaded = load_model(model)
    try:
        content = urdf(loaded, robot)
    except ValueError as error:
        if loaded.physical is None:
            raise ValueError(f"{model}: {error}") from None
        raise
    write_bytes(target, content)
    physical = loaded.physical
    assert physical is not None  # `urdf` has refused it
    answer = {
        "urdf": str(target),
        "links": dict(zip(loaded.robot.link_names, physical.phi[::10].tolist(), strict=True)),
        "rotor_inertia": dict(zip(loaded.robot.joint_names, physical.rotor_inertia.tolist(), strict=True)),
    }
    text = str(target)
    if robot is not None and physical.rotor_inertia.any():
        told = zip(physical.rotor_inertia, loaded.robot.joint_kinds, strict=True)
        rotors = ", ".join(f"{inertia:.4g} {own_unit('rotor_inertia', 'N*m', kind)}" for inertia, kind in told)
        text += f"\nURDF has no place for rotor inertias; they are, joint by joint: {rotors}"
    return answer, text


def _write_mjcf(model: Path, target: Path, *, force: bool) -> Answer:
    from dynid_rs.base.files import write_bytes
    from dynid_rs.commands._inputs import load_model, model_files
    from dynid_rs.model.export import mjcf

    _check_place(target, [*model_files(model)], force=force)
    loaded = load_model(model)
    try:
        content = mjcf(loaded)
    except ValueError as error:
        raise ValueError(f"{model}: {error}") from None
    write_bytes(target, content.encode())
    unit = "A" if loaded.torque_unit == "A" else "N*m (N)"
    kinds = [effect.kind for effect, _ in loaded.effects]
    text = f"{target}\neach joint has a motor, whose ctrl is in {unit}"
    if kinds:
        text += f"\nof friction it holds the Coulomb and the viscous part; the model's effects are: {', '.join(kinds)}"
    return {"mjcf": str(target), "ctrl_unit": unit, "effects": kinds}, text


def _write_header(model: Path, target: Path, name: str | None, *, force: bool) -> Answer:
    from dynid_rs.base.files import write_bytes
    from dynid_rs.base.quoting import as_text
    from dynid_rs.commands._inputs import load_model, model_files
    from dynid_rs.model.export import c_header, c_prefix

    _check_place(target, [*model_files(model)], force=force)
    prefix = c_prefix(as_text(target.stem)) if name is None else name
    content = c_header(load_model(model), prefix)
    write_bytes(target, content.encode("ascii"))
    answer = {"c_header": str(target), "name": prefix}
    return answer, f"{target}\n{prefix}_init prepares an estimator, {prefix}_estimate is one step"
