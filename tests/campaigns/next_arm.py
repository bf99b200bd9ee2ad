"""Arms of the exam with one effect, a minute of ordinary motion, and whatever motion somebody designs for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from exam.case import ROBOT, truth_of
from exam.catalogue import MAKERS
from exam.draw import Wish, draw, log_uniform, stream
from exam.hidden import Exam, encoder_error, hide, shown_torque, worked
from exam.sensors import table_of_run
from exam.world import States, inverse_dynamics, make_run
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Motion = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Instants (n,) [s] to q, dq, ddq (n, n_joints)."""

SECONDS = (30.0, 30.0, 20.0)
"""Two training runs and one that only errors see."""
MOTIONS = ("fourier", "moves", "pauses", "poor")
SIZES = (0.3, 0.5)
"""What the declared model leaves of the effect, over the noise; drawn between these on a logarithmic scale."""
LEFT_OUT = ("thermal_friction", "torque_delay", "torque_ripple", "backlash", "joint_elasticity")
"""Kinds that no motion of seconds is designed for: they take half an hour, no motion, or both encoders' records."""
KINDS = tuple(sorted(set(MAKERS) - set(LEFT_OUT)))


@dataclass(eq=False)
class Arm:
    """A case on the disk, and the arm behind it, which can be moved once more."""

    exam: Exam
    folder: Path
    truth: dict[str, Any]
    runs: list[Path]
    test: Path
    played: dict[Path, States] = field(default_factory=dict)

    @property
    def robot(self) -> Path:
        """The robot file."""
        return self.folder / ROBOT

    @property
    def limits(self) -> dict[str, FloatArray]:
        """What the ordinary motion used: middle (n_joints,) and size of positions, speeds, accelerations."""
        q, dq, ddq = (np.vstack([getattr(s, name) for s in self.exam.world.train]) for name in ("q", "dq", "ddq"))
        middle = (q.min(axis=0) + q.max(axis=0)) / 2
        return {
            "middle": middle,
            "position": np.abs(q - middle).max(axis=0),
            "velocity": np.abs(dq).max(axis=0),
            "acceleration": np.abs(ddq).max(axis=0),
        }

    def record(self, motion: Motion, seconds: float, name: str, number: int = 0) -> Path:
        """Let the arm move and write what is recorded; every number has its own noise."""
        s = _moved(self.exam, motion, seconds, number)
        path = self.folder / f"{name}.parquet"
        self.played[path] = s
        pq.write_table(pa.table(_table(self.exam, s)), path)
        return path


def draw_arm(seed: int, folder: Path) -> Arm:
    """Draw the case of a seed and record its minute of ordinary motion."""
    case, rng = draw(seed), stream(seed, 60)
    wish = Wish(str(rng.choice(KINDS)), float(log_uniform(rng, *SIZES)))
    case = replace(
        case, group="single", wishes=(wish,), motion=str(rng.choice(MOTIONS)), n_train=2, durations=SECONDS,
        file_inertials="near", temperature=False, elastic_gears=False,
    )  # fmt: skip
    return written(hide(case), folder)


def written(exam: Exam, folder: Path) -> Arm:
    """Write the robot file and the recordings of an exam; its last run is the test."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ROBOT).write_text(exam.world.arm.urdf(), encoding="utf-8")
    paths = []
    for s in exam.world.runs:
        paths.append(folder / f"run_{s.run}.parquet")
        pq.write_table(pa.table(_table(exam, s)), paths[-1])
    truth = truth_of(exam, [path.name for path in paths])
    return Arm(exam, folder, truth, paths[:-1], paths[-1])


def _table(exam: Exam, s: States) -> dict[str, FloatArray]:
    return table_of_run(
        exam.world, exam.sensors, s.recorded, shown_torque(exam, s)[:: s.every], encoder_error(exam, s.recorded)
    )


def _moved(exam: Exam, motion: Motion, seconds: float, number: int) -> States:
    """Return one run more, of this motion; noise and stamps are drawn by its number."""
    world = exam.world
    run = len(world.runs) + number
    case = replace(world.case, durations=(*world.case.durations, *(1 + number) * [seconds]))
    s = make_run(case, world.model, run)
    q, dq, ddq = motion(s.t - s.t[0])
    tau = inverse_dynamics(world.model, q, dq, ddq)
    s = replace(s, q=q, dq=dq, ddq=ddq, tau_rigid=tau, tau_link=tau, q_motor=q, dq_motor=dq, ddq_motor=ddq)
    chosen = [(hidden.effect, hidden.size) for hidden in exam.hidden]
    (s,) = worked(replace(world, case=case, runs=(s,)), chosen).runs
    return s
