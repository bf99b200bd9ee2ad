"""`dynid estimate`: the torque of every term for every sample of a run, by the code that runs online."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from dynid_rs.commands._run import print_json, run_command

if TYPE_CHECKING:
    from dynid_rs.recording import FloatArray, Recording

SIGNALS = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")


@run_command
def estimate(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="What `dynid identify` wrote")],
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Parquet, CSV or NPZ")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="OUT.parquet", help="Torques per sample, joint and term")
    ] = None,
    states: Annotated[
        Path | None,
        typer.Option(metavar="STATES.csv", help="Also write the states, ready for `dynid-estimator MODEL < STATES.csv`"),
    ] = None,
    config: Annotated[Path | None, typer.Option(help="dynid.toml: column names, units, gears, signs")] = None,
    cutoff: Annotated[
        float | None, typer.Option(help="Band [Hz] for differentiating positions, where dq and ddq are not recorded")
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> None:
    """Estimate torques along a run.

    A run with recorded dq and ddq is taken as it is, sample by sample, as `dynid-estimator` takes it. Otherwise positions
    are filtered without phase and differentiated, as in `dynid identify`.
    """
    from dynid_rs import _core
    from dynid_rs.evaluation import rmse
    from dynid_rs.files import write_table
    from dynid_rs.readers import Config, read_config, read_recording

    torque_model = _core.TorqueModel.load(model)
    settings = Config() if config is None else read_config(config)
    recording = read_recording(run, torque_model.robot, settings)
    t, signals, tau = states_of(recording, cutoff)
    total, terms, status = torque_model.evaluate(*signals)
    n = recording.n_joints
    columns: dict[str, Any] = {"t": t}
    columns |= {f"tau_{j}": total[:, j] for j in range(n)}
    for k, name in enumerate(torque_model.term_names):
        columns |= {f"{name}_{j}": terms[:, k, j] for j in range(n)}
    columns |= {f"measured_{j}": tau[:, j] for j in range(n)}
    columns["status"] = status
    if output is not None:
        write_table(output, columns)
    if states is not None:
        write_states(states, t, signals)
    errors = rmse([tau - total])
    unusual = int(np.count_nonzero(status))
    if json_output:
        print_json(
            {
                "n_samples": len(t),
                "joints": list(torque_model.robot.joint_names),
                "terms": torque_model.term_names,
                "torque_unit": torque_model.torque_unit,
                "rmse": errors.tolist(),
                "n_unusual": unusual,
                "output": None if output is None else str(output),
            }
        )
        return
    for joint, error in zip(torque_model.robot.joint_names, errors, strict=True):
        typer.echo(f"{joint}: RMSE {error:.4g} {torque_model.torque_unit} (as recorded, all samples)")
    if unusual:
        typer.echo(f"{unusual} of {len(t)} samples lie outside of what the model was trained on")
    if output is not None:
        typer.echo(f"torques: {output}")


def states_of(recording: Recording, cutoff: float | None) -> tuple[FloatArray, tuple[FloatArray, ...], FloatArray]:
    """Time (n,), the six signals of the states and the measured torque, (n, n_joints) each."""
    from dynid_rs.preprocessing import Band, choose_band, common_rate, prepare

    if recording.dq is not None and recording.ddq is not None and cutoff is None:
        link = (recording.q, recording.dq, recording.ddq)
        motor = (
            recording.q if recording.q_motor is None else recording.q_motor,
            recording.dq if recording.dq_motor is None else recording.dq_motor,
            recording.ddq,
        )
        return recording.t, (*link, *motor), recording.tau
    band = choose_band([recording]) if cutoff is None else Band(cutoff)
    states = prepare(recording, band, common_rate([recording]))
    return states.t, states.signals(), states.tau


def write_states(path: Path, t: FloatArray, signals: tuple[FloatArray, ...]) -> None:
    """Write states as CSV; every number in the shortest form that reads back to the same bits."""
    from dynid_rs.files import write_text

    n = signals[0].shape[1]
    header = ["t", *(f"{name}_{j}" for name in SIGNALS for j in range(n))]
    rows = np.concatenate([t[:, None], *signals], axis=1).tolist()
    lines = [",".join(header), *(",".join(map(repr, row)) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")
