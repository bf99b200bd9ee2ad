"""The folder of a simulation: runs, robot and truth, and nobody else's files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.files import check_replaceable, filled_together, write_bytes, write_json, write_table
from dynid_rs.runs.recording import Recording
from dynid_rs.simulation.experiment import Simulation

FloatArray = NDArray[np.float64]

TRUTH_FILE = "truth.json"
ROBOT_FILE = "robot.urdf"
ROBOT_TABLE = "robot.toml"


def robot_name(robot_file: Path) -> str:
    """Name of the robot's copy: its suffix says how it is read."""
    return ROBOT_TABLE if robot_file.suffix.lower() == ".toml" else ROBOT_FILE


def write_simulation(
    simulation: Simulation, directory: Path, robot_file: Path, *, reference: bool = False
) -> list[Path]:
    """Write `truth.json`, `robot.urdf` (or `.toml`), `run_0.parquet`, ... to `directory`, which is created.

    An older simulation in the folder is replaced; anything else of the same name is left alone.

    Parameters
    ----------
    simulation : Simulation
        What to write.
    directory : Path
        Where.
    robot_file : Path
        The URDF or robot.toml that was simulated; its copy makes the folder complete. Effects do not change it.
    reference : bool
        Add what the controller was told as columns `q_ref_i`.

    Returns
    -------
    list of Path
        The runs.

    Raises
    ------
    ValueError
        The folder holds runs or a robot that this simulation would mix with or replace.
    OSError
        The folder cannot be written, or holds a link, a device or the like by a name that is to be written.
    """
    robot, own_name = robot_file.read_bytes(), robot_name(robot_file)
    names = [recording.name for recording in simulation.recordings]
    _prepare(directory, names, own_name, robot)
    with filled_together(directory) as stage:
        write_json(stage / TRUTH_FILE, simulation.truth())
        write_bytes(stage / own_name, robot)
        for run, recording in enumerate(simulation.recordings):
            columns = run_columns(recording)
            if reference:
                q_ref = simulation.reference(run)
                columns |= {f"q_ref_{joint}": q_ref[:, joint] for joint in range(recording.n_joints)}
            write_table(stage / recording.name, columns)
    return [directory / name for name in names]


def run_columns(recording: Recording) -> dict[str, FloatArray]:
    """Columns of the table of one run: `t`, then `q_0`, ..., signal by signal, joints by index."""
    columns: dict[str, FloatArray] = {"t": recording.t}
    for signal in ("q", "dq", "ddq", "q_motor", "dq_motor", "tau", "temperature"):
        values = getattr(recording, signal)
        if values is not None:
            columns |= {f"{signal}_{joint}": values[:, joint] for joint in range(recording.n_joints)}
    return columns


def _prepare(directory: Path, names: list[str], own_name: str, robot: bytes) -> None:
    for name in (TRUTH_FILE, own_name, *names):
        check_replaceable(directory / name)
    try:
        found = sorted(path.name for path in directory.iterdir()) if directory.exists() else []
        own = (directory / own_name).read_bytes() if own_name in found else robot
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise type(error)(f"{directory}: cannot use this folder: {reason}") from None
    runs = [name for name in found if re.fullmatch(r"run_\d+\.parquet", name)]
    if TRUTH_FILE in found:
        strangers = [name for name in runs if name not in names]
        what = "of an older simulation, which would mix with the new runs"
    else:
        strangers = [*runs, *([] if own == robot else [own_name])]
        what = "that no simulation wrote"
    if strangers:
        raise ValueError(f"{directory} holds {strangers[0]} {what}; choose another folder or remove it first")
