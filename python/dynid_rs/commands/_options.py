"""Arguments and options that commands share: one meaning, one wording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ROBOTS = "URDF, robot.toml, MuJoCo model (.xml) or, with --xacro, xacro"
Robot = Annotated[Path, typer.Argument(metavar="ROBOT", help=f"The arm: {ROBOTS}")]
Runs = Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs to learn from")]
Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results", show_default=False)
]
Test = Annotated[
    list[Path] | None,
    typer.Option(metavar="RUN", help="Run to test on; repeat for more. Left out: the last run, or its last third"),
]
TestFrom = Annotated[float | None, typer.Option(help="With a lone run: test on what comes after this many seconds")]
Config = Annotated[Path | None, typer.Option(help="dynid.toml: column names, units, gears, signs")]
Gravity = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Free fall in the base frame [m/s^2]; the robot file's, or 0,0,-9.81"),
]
Base = Annotated[str | None, typer.Option(help="First link of the chain, where the URDF leaves a choice")]
Tip = Annotated[
    str | None, typer.Option(help="Last link of the chain, where the URDF branches; the end of the longest by default")
]
Xacro = Annotated[bool, typer.Option("--xacro", help="Expand ROBOT, a xacro source, which is a program: ask for it")]
DriveGain = Annotated[
    str | None,
    typer.Option(metavar="G[,G...]", help="Joint torque per motor current [N*m/A], one per joint or one for all"),
]
Weighting = Annotated[str, typer.Option(help="joint_variance, full_covariance or none")]
Prior = Annotated[
    str, typer.Option(help="The URDF's inertials beside the data: robot, none, or auto (a lone run that they help)")
]
PriorOfDiagnosis = Annotated[
    str, typer.Option(help="The URDF's inertials beside the data: auto (as far as the data bear them out) or robot")
]
Known = Annotated[
    Path | None, typer.Option(metavar="TERMS.toml", help="Effects whose coefficients you know; they are not fitted")
]
FrictionLaw = Annotated[
    str | None,
    typer.Option(
        help="smooth, paper, coulomb_viscous, stribeck, or auto: of the last three by a training run left out, joint "
        "by joint. Left out: smooth; paper with a friction experiment or without a prior"
    ),
]
Cutoff = Annotated[float | None, typer.Option(help="Band [Hz]; chosen from the motion if left out")]
Memory = Annotated[
    str,
    typer.Option(metavar="SIZE", help="Most memory to take; training runs that need more are streamed"),
]
Jobs = Annotated[int, typer.Option("--jobs", metavar="N", help="Processes for streamed runs; -1: one per core")]
Cache = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", help="Keep every streamed run's results here; the same command goes on where it broke off"
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the finished result that DIR holds")]
Json = Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")]
