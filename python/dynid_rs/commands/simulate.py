"""`dynid simulate`: measured-looking runs of a simulated arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from dynid_rs.commands._run import print_json, run_command

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel
    from dynid_rs.simulation import SimulatedArm, Simulation

EFFECTS = ("joint_elasticity", "encoder_delay")
"""What can be switched on one by one; without `--effect`, all of them act."""


@run_command
def simulate(
    directory: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the runs", show_default=False)
    ],
    robot: Annotated[
        Path | None,
        typer.Argument(metavar="[ROBOT]", help="A serial arm, URDF or robot.toml; the bundled one if left out"),
    ] = None,
    runs: Annotated[int, typer.Option(help="Number of runs, each with its own trajectory")] = 4,
    duration: Annotated[float, typer.Option(help="Length of a run in s")] = 20.0,
    rate: Annotated[float, typer.Option(help="Samples per second")] = 250.0,
    noise: Annotated[float, typer.Option(help="Torque noise, 1 = 0.5 % of the effort limits; 0: exact signals")] = 1.0,
    stiffness: Annotated[
        str | None,
        typer.Option(metavar="K[,K...]", help="Of the gears in N m/rad: one for all, or one per joint"),
    ] = None,
    rigid: Annotated[bool, typer.Option("--rigid", help="Rigid gears, no delay: q_motor is q")] = False,
    delay: Annotated[
        float | None, typer.Option(help="How much later the link channel is, in s; 0.0028 if left out")
    ] = None,
    jitter: Annotated[float, typer.Option(help="Standard deviation of the time stamps in s")] = 0.0,
    derivatives: Annotated[
        bool | None,
        typer.Option("--derivatives/--no-derivatives", help="Exact dq, ddq, dq_motor; on only where noise is 0"),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND", help=f"Only these faults act: {', '.join(EFFECTS)}"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Repeats the experiment, number for number")] = 0,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> None:
    """Simulate measured runs of an arm with elastic gears and two encoders.

    DIR then holds run_0.parquet, ..., the robot as robot.urdf or robot.toml, and truth.json with all that was put in.
    """
    from dynid_rs.commands._inputs import read_robot
    from dynid_rs.simulation import bundled_robot, write_simulation
    from dynid_rs.simulation import simulate as measure
    from dynid_rs.simulation.folder import TRUTH_FILE, robot_name

    source = bundled_robot() if robot is None else robot
    model = read_robot(source)
    arm = _arm(model, noise, stiffness, delay, _active(effect, rigid, stiffness, delay))
    simulation = measure(
        arm,
        n_runs=runs,
        duration=duration,
        rate=rate,
        seed=seed,
        derivatives=noise == 0 if derivatives is None else derivatives,
        stamp_jitter=jitter,
    )
    paths = write_simulation(simulation, directory, source)
    if json_output:
        print_json(_answer(simulation, paths, robot_name(source)))
    else:
        typer.echo(f"runs: {directory}/run_*.parquet ({len(paths)} of {duration:g} s at {rate:g} Hz)")
        typer.echo(f"robot: {directory / robot_name(source)}")
        typer.echo(f"what was put in: {directory / TRUTH_FILE}")


def _active(effect: list[str] | None, rigid: bool, stiffness: str | None, delay: float | None) -> tuple[str, ...]:
    """Faults that act, from options that must not contradict each other."""
    unknown = [kind for kind in effect or () if kind not in EFFECTS]
    if unknown:
        raise ValueError(f"effect {unknown[0]!r} cannot be simulated; this release has {', '.join(EFFECTS)}")
    if rigid and (effect or stiffness is not None or delay):
        option = "--effect" if effect else "--stiffness" if stiffness is not None else "--delay"
        raise ValueError(f"--rigid and {option} contradict each other; leave one out")
    active = () if rigid else tuple(effect or EFFECTS)
    if stiffness is not None and "joint_elasticity" not in active:
        raise ValueError("--stiffness needs --effect joint_elasticity too")
    if delay and "encoder_delay" not in active:
        raise ValueError("--delay needs --effect encoder_delay too")
    return active


def _arm(
    robot: RobotModel, noise: float, stiffness: str | None, delay: float | None, active: tuple[str, ...]
) -> SimulatedArm:
    from dynid_rs.simulation import typical_arm

    arm = typical_arm(robot, noise=noise, stiffness=_stiffness(stiffness, robot.n_joints))
    if "joint_elasticity" not in active:
        arm = arm.rigid()
    if "encoder_delay" not in active:
        return replace(arm, delay=0.0)
    return arm if delay is None else replace(arm, delay=delay)


def _stiffness(text: str | None, n_joints: int) -> NDArray[np.float64] | None:
    if text is None:
        return None
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise ValueError(f"--stiffness must be one number or {n_joints} with commas between, got {text!r}") from None
    if values.size not in (1, n_joints):
        raise ValueError(f"--stiffness has {values.size} numbers, expected 1 or {n_joints}, one per joint")
    if not (values > 0).all():
        raise ValueError(f"--stiffness must be positive, got {text}; a rigid arm is --rigid")
    return np.broadcast_to(values, (n_joints,))


def _answer(simulation: Simulation, paths: list[Path], robot_file: str) -> dict[str, object]:
    from dynid_rs.simulation.folder import TRUTH_FILE

    directory = paths[0].parent
    return {
        "format": "dynid-simulation",
        "version": 1,
        "robot": simulation.arm.robot.name,
        "joints": list(simulation.arm.robot.joint_names),
        "robot_file": str(directory / robot_file),
        "truth": str(directory / TRUTH_FILE),
        "seed": simulation.seed,
        "runs": [
            {
                "path": str(path),
                "n_samples": recording.n_samples,
                "duration_s": recording.duration,
                "rate_hz": recording.rate,
                "tau_std": recording.tau.std(axis=0).tolist(),
            }
            for path, recording in zip(paths, simulation.recordings, strict=True)
        ],
    }
