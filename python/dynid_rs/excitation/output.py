"""The designed trajectory for others: a CSV that a controller can play, a JSON of all figures, a page of plots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.files import atomic_path
from dynid_rs.base.units import angle_units

if TYPE_CHECKING:
    from dynid_rs._core import RobotModel
    from dynid_rs.excitation.fourier import FourierExcitation

FloatArray = NDArray[np.float64]

MAX_ROWS = 10_000_000
SIGNALS = ("q", "dq", "ddq")


class Playable(Protocol):
    """Any planned motion: an exciting trajectory, a friction experiment."""

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""

    def evaluate(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration at times `t` (n,) [s], each (n, n_joints)."""


def n_steps_of(duration: float, rate: float) -> int:
    """Steps of a table of `duration` [s] at `rate` [Hz].

    Raises
    ------
    ValueError
        Duration or rate is not positive, or they give too many rows.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise ValueError(f"the rate of the trajectory must be a positive number of samples per second, got {rate}")
    if not (np.isfinite(duration) and duration > 0):
        raise ValueError(f"duration must be a positive number, got {duration}")
    n_steps = duration * rate
    if not n_steps < MAX_ROWS:
        raise ValueError(f"{duration:g} s at {rate:g} Hz are {n_steps:.0f} rows, expected fewer than {MAX_ROWS}")
    return int(np.ceil(n_steps - 1e-6))


def sampled(trajectory: Playable, rate: float) -> dict[str, FloatArray]:
    """Columns t, q_i, dq_i, ddq_i at `rate` [Hz], first and last instant among them."""
    n_steps = n_steps_of(trajectory.duration, rate)
    # The last step may be shorter: the motion ends where it ends.
    t = np.minimum(np.arange(n_steps + 1) / rate, trajectory.duration)
    columns = {"t": t}
    for name, signal in zip(SIGNALS, trajectory.evaluate(t), strict=True):
        columns |= {f"{name}_{joint}": np.ascontiguousarray(column) for joint, column in enumerate(signal.T)}
    return columns


def write_csv(path: Path, trajectory: Playable, rate: float) -> int:
    """Write the trajectory, whole or not at all; numbers to their last bit. Returns the number of rows."""
    import pyarrow as pa
    import pyarrow.csv

    columns = sampled(trajectory, rate)
    with atomic_path(path) as temporary:
        options = pyarrow.csv.WriteOptions(include_header=False)
        with temporary.open("wb") as file:
            file.write((",".join(columns) + "\n").encode())  # pyarrow would quote the names
            pyarrow.csv.write_csv(pa.table(columns), file, options)
    return len(columns["t"])


def answer(design: FourierExcitation, robot: RobotModel) -> dict[str, Any]:
    """Return everything that was designed and found out, for programs."""
    return {
        "format": "dynid-trajectory",
        "version": 1,
        "robot": robot.name,
        "joints": list(robot.joint_names),
        "units": angle_units(robot.joint_kinds),
        "criterion": design.criterion,
        "n_harmonics": design.n_harmonics,
        "duration_s": design.duration,
        "rate_hz": design.rate,
        "seed": design.seed_,
        "start": design.start_.tolist(),
        "trajectory": design.trajectory_.to_json(),
        "objective": design.objective_,
        "block_weights": None if design.block_weights_ is None else list(design.block_weights_),
        **design.merit_.to_json(design.limits_),
        "constraints": design.constraint_report_,
        "restarts": [
            {
                "index": restart.index,
                "start_objective": restart.start_objective,
                "objective": restart.objective,
                "n_iter": restart.n_iter,
                "n_evaluations": restart.n_evaluations,
                "converged": restart.converged,
                "cpu_s": restart.cpu_s,
            }
            for restart in design.history_
        ],
        "notes": list(design.notes_),
    }
