"""`dynid export`: the identified model for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid_rs.commands._run import print_json, run_command


@run_command
def export(
    model: Annotated[Path, typer.Argument(metavar="MODEL", help="model.json of `dynid identify --physical`")],
    urdf: Annotated[
        Path, typer.Option(metavar="OUT.urdf", help="URDF with the identified inertials", show_default=False)
    ],
    robot: Annotated[
        Path | None,
        typer.Option(metavar="ORIGINAL.urdf", help="Edit this file's text: only <inertial> and <dynamics> change"),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Write the physically consistent inertials of a model as a URDF.

    With --robot everything else of the original stays byte for byte; without it the URDF holds links and joints alone.
    """
    from dynid_rs._core import TorqueModel
    from dynid_rs.commands._output import check_file, check_not_read
    from dynid_rs.export import urdf as urdf_of
    from dynid_rs.files import check_readable, write_bytes

    if robot is not None and robot.suffix.lower() == ".toml":
        raise ValueError(f"--robot {robot}: only a URDF can be edited; leave it out for a URDF of links and joints")
    check_file(urdf)
    check_not_read([urdf], [model, *([robot] if robot else [])])
    loaded = TorqueModel.load(check_readable(model))
    try:
        content = urdf_of(loaded, robot)
    except ValueError as error:
        if loaded.physical is None:
            raise ValueError(f"{model}: {error}") from None
        raise
    write_bytes(urdf, content)
    physical = loaded.physical
    assert physical is not None  # `urdf_of` has refused it
    if json_output:
        masses = physical.phi[::10].tolist()
        print_json(
            {
                "urdf": str(urdf),
                "links": dict(zip(loaded.robot.link_names, masses, strict=True)),
                "rotor_inertia": dict(zip(loaded.robot.joint_names, physical.rotor_inertia.tolist(), strict=True)),
            }
        )
    else:
        typer.echo(urdf)
        if robot is not None and physical.rotor_inertia.any():
            rotors = ", ".join(f"{inertia:.4g}" for inertia in physical.rotor_inertia)
            typer.echo(f"URDF has no place for rotor inertias; they are, joint by joint: {rotors} kg*m^2")
    return 0
