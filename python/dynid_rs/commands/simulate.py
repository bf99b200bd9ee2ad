"""`dynid simulate`: measured-looking runs of a simulated arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynid_rs.commands._run import goes_on, print_json, run_command
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid_rs._core import RobotModel
    from dynid_rs.simulation import SimulatedArm, Simulation, Tracking
    from dynid_rs.simulation.effects.wish import Wish

ALWAYS = ("joint_elasticity", "encoder_delay")
"""Effects that act where none is named."""

ENCODER_NOISE = 1e-6
N_RUNS = 4
DURATION = 20.0


def _list_effects(as_json: bool) -> None:
    """Print every kind with its place and its default size."""
    from dynid_rs.simulation.effects.catalogue import KINDS

    if as_json:
        kinds = [{"kind": kind.name, "default": kind.default, "where": kind.where} for kind in KINDS]
        print_json({"format": "dynid-effects", "version": 1, "effects": kinds})
        return
    for kind in KINDS:
        typer.echo(f"{kind.name}: {kind.default} ({kind.where})")


@run_command
def simulate(
    directory: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for the runs (required)", show_default=False),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Argument(metavar="[ROBOT]", help="A serial arm, URDF or robot.toml; the bundled one if left out"),
    ] = None,
    runs: Annotated[
        int | None, typer.Option(help=f"Number of runs: {N_RUNS}, or one per --trajectory", show_default=False)
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Length of a random run in s: 20 if left out", show_default=False)
    ] = None,
    trajectory: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="PLAN.csv", help="Play this plan (t, q_i, dq_i, ddq_i) instead of a random one; repeatable"
        ),
    ] = None,
    rate: Annotated[float, typer.Option(help="Samples per second")] = 250.0,
    tracking: Annotated[
        float | None, typer.Option(metavar="HZ", help="Bandwidth of the controller; 10 if left out", show_default=False)
    ] = None,
    ideal: Annotated[bool, typer.Option("--ideal", help="No controller: the links follow the plan exactly")] = False,
    disturbance: Annotated[
        float, typer.Option(help="Slow drive disturbance that the torque channel lacks, over the effort limits")
    ] = 0.0,
    reference: Annotated[bool, typer.Option("--reference", help="Add the plan as columns q_ref_i")] = False,
    noise: Annotated[float, typer.Option(help="Torque noise, 1 = 0.5 % of the effort limits; 0: exact signals")] = 1.0,
    encoder_noise: Annotated[
        float | None,
        typer.Option(help="Of both encoders in rad, beside their steps; 1e-6 times --noise if left out"),
    ] = None,
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
        typer.Option(
            metavar="KIND[:JOINT[:SIZE]]",
            help=f"Put this in; repeatable. Without any, {' and '.join(ALWAYS)} act; with some, only these. "
            "Joint by name or index, size 1 is the default; --list-effects names the kinds",
        ),
    ] = None,
    list_effects: Annotated[
        bool, typer.Option("--list-effects", help="List the kinds with their default sizes")
    ] = False,
    seed: Annotated[int, typer.Option(help="Repeats the experiment, number for number")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace the simulation that DIR holds")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> None:
    """Simulate measured runs of an arm with elastic gears and two encoders, moved by a controller.

    DIR then holds run_0.parquet, ..., the robot as robot.urdf or robot.toml, and truth.json with all that was put in.
    """
    if list_effects:
        _list_effects(json_output)
        return
    if directory is None:
        raise ValueError("--output (-o) is missing; name the folder for the runs")
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._inputs import read_robot
    from dynid_rs.commands._output import after_interrupt, check_folder, check_unfinished
    from dynid_rs.simulation import bundled_robot, read_plan, write_simulation
    from dynid_rs.simulation import simulate as measure
    from dynid_rs.simulation.folder import TRUTH_FILE, robot_name

    trajectory = trajectory or []
    if trajectory and duration is not None:
        raise ValueError("--trajectory and --duration contradict each other, a plan has its own length; leave one out")
    if runs is not None and 0 < runs < len(trajectory):
        raise ValueError(
            f"--runs {runs} would leave out {len(trajectory) - runs} of {len(trajectory)} --trajectory; "
            "leave --runs out for one run of each, or those that are not to be played"
        )
    check_folder(directory, [TRUTH_FILE])
    if not force:
        check_unfinished(directory, TRUTH_FILE)
    said = after_interrupt(directory / TRUTH_FILE, "the same command makes the same runs from the beginning")
    source = bundled_robot() if robot is None else robot
    if source.suffix.lower() in (".xml", ".mjcf", ".xacro"):
        raise ValueError(f"{source}: the folder keeps a copy of the robot; give it as a URDF or robot.toml")
    with goes_on(said), progress(Step(1, "reading"), Step(8, "run "), Step(1, "writing")) as say:
        say("reading")
        model = read_robot(source)
        plans = [read_plan(path, model) for path in trajectory]
        simulation = measure(
            _arm(model, noise, encoder_noise, stiffness, delay, _wishes(effect, rigid, stiffness, delay, model)),
            n_runs=runs if runs is not None else len(plans) or N_RUNS,
            duration=DURATION if duration is None else duration,
            rate=rate,
            seed=seed,
            derivatives=noise == 0 if derivatives is None else derivatives,
            stamp_jitter=jitter,
            trajectories=plans,
            tracking=_controller(tracking, ideal, disturbance),
            on_progress=say,
        )
        say("writing")
        paths = write_simulation(simulation, directory, source, reference=reference)
    if json_output:
        print_json(_answer(simulation, paths, robot_name(source)))
        return
    lengths = {f"{recording.duration:g} s" for recording in simulation.recordings}
    typer.echo(f"runs: {directory}/run_*.parquet ({len(paths)} of {', '.join(sorted(lengths))} at {rate:g} Hz)")
    typer.echo(f"robot: {directory / robot_name(source)}")
    typer.echo(f"what was put in: {directory / TRUTH_FILE}")


def _controller(bandwidth: float | None, ideal: bool, disturbance: float) -> Tracking | None:
    from dynid_rs.simulation import Tracking

    if ideal:
        if bandwidth is not None or disturbance:
            option = "--tracking" if bandwidth is not None else "--disturbance"
            raise ValueError(f"--ideal and {option} contradict each other; leave one out")
        return None
    return Tracking(disturbance=disturbance) if bandwidth is None else Tracking(bandwidth, disturbance=disturbance)


def _wishes(
    effect: list[str] | None, rigid: bool, stiffness: str | None, delay: float | None, robot: RobotModel
) -> list[Wish]:
    """Effects that act, from options that must not contradict each other; without any, those that the arm can have."""
    from dynid_rs.simulation import parse_wish

    if rigid and (effect or stiffness is not None or delay):
        option = "--effect" if effect else "--stiffness" if stiffness is not None else "--delay"
        raise ValueError(f"--rigid and {option} contradict each other; leave one out")
    turns = any(kind != "prismatic" for kind in robot.joint_kinds)
    usual = ALWAYS if turns else tuple(kind for kind in ALWAYS if kind != "joint_elasticity")
    wishes = [] if rigid else [parse_wish(text) for text in effect or usual]
    kinds = {wish.kind for wish in wishes}
    if stiffness is not None and not kinds & {"joint_elasticity", "nonlinear_elasticity"}:
        raise ValueError("--stiffness needs --effect joint_elasticity too")
    if delay and "encoder_delay" not in kinds:
        raise ValueError("--delay needs --effect encoder_delay too")
    return wishes


def _arm(
    robot: RobotModel,
    noise: float,
    encoder_noise: float | None,
    stiffness: str | None,
    delay: float | None,
    wishes: list[Wish],
) -> SimulatedArm:
    from dynid_rs.simulation import build_effects, equip, typical_arm
    from dynid_rs.simulation.typical import DELAY

    typical = typical_arm(
        robot,
        noise=noise,
        stiffness=_stiffness(stiffness, robot.n_joints),
        delay=DELAY if delay is None else delay,
        encoder_noise=ENCODER_NOISE * noise if encoder_noise is None else encoder_noise,
    )
    arm = equip(replace(typical.rigid(), delay=0.0), build_effects(wishes, typical))
    return arm if delay is None else replace(arm, delay=delay)


def _stiffness(text: str | None, n_joints: int) -> NDArray[np.float64] | None:
    if text is None:
        return None
    import numpy as np

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
        "tracking_hz": None if simulation.tracking is None else simulation.tracking.bandwidth,
        "effects": [effect.kind for effect in simulation.arm.effects],
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
