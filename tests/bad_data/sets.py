"""A set: an arm's file and its runs as columns, clean, by the exam's physics; and how to let the arm move otherwise."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np
from exam.draw import Case, draw, log_uniform, stream
from exam.sensors import Sensors, make_sensors, table_of_run
from exam.world import States, World, gravity_difference, inverse_dynamics, make_world
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Columns = dict[str, NDArray]

GOOD_MOTIONS = ("fourier", "moves", "pauses")
PART = 77
"""Part of a seed's random numbers that is ours; the exam has those below."""


@dataclass(eq=False)
class RunSet:
    """Runs of one arm: `columns` per run, `robot` the text of its file; the last run is the one to test on."""

    seed: int
    case: Case
    world: World
    sensors: Sensors
    robot: str
    columns: list[Columns] = field(default_factory=list)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.case.n_joints

    @property
    def n_runs(self) -> int:
        """Number of runs."""
        return len(self.columns)

    def rng(self, *part: int) -> np.random.Generator:
        """Random numbers of a part of this set."""
        return stream(self.seed, PART, *part)

    def copied(self) -> RunSet:
        """The same set, to be spoiled."""
        return replace(self, columns=[{name: x.copy() for name, x in run.items()} for run in self.columns])


def good_case(seed: int, n_joints: int) -> Case:
    """A case with enough in it that a fault can be told from the arm: three runs of ten to twenty seconds and more."""
    rng = stream(seed, PART, 0)
    case = draw(seed)
    return replace(
        case,
        group="clean",
        wishes=(),
        elastic_gears=False,
        n_joints=n_joints,
        file_inertials="near",
        motion=str(rng.choice(GOOD_MOTIONS)),
        n_train=2,
        durations=tuple(float(d) for d in rng.uniform(12.0, 24.0, 3)),
        jitter=0.0,
        missing=0.0,
        current=False,
    )


def clean_case(seed: int) -> Case:
    """The exam's case of a seed with nothing hidden in it, as it is drawn otherwise; low rates come to it."""
    case = replace(draw(seed), group="clean", wishes=(), elastic_gears=False)
    rng = stream(seed, PART, 1)
    if rng.random() < 0.15:
        case = replace(case, rate=float(np.round(rng.uniform(20.0, 50.0))))
    return case


def make_set(case: Case) -> RunSet:
    """Let the arm of a case move, and record it; half of the sets have a speed channel."""
    world = make_world(case)
    sensors = make_sensors(world)
    if case.windup and case.n_encoders == 2:
        share = stream(case.seed, 11).uniform(0.3, 1.0, case.n_joints)
        world = replace(world, compliance=case.windup * share / world.torque_std)
        world = replace(world, runs=tuple(world.with_gears(s, s.tau_link) for s in world.runs))
    made = RunSet(case.seed, case, world, sensors, "")
    made.robot = _with_efforts(world.arm.urdf(), made)
    made.columns = [recorded(made, s) for s in world.runs]
    return made


def recorded(made: RunSet, s: States, torque: FloatArray | None = None) -> Columns:
    """Columns of one run; `torque` (n, n_joints) [N m] at the dense instants, the arm's own by default."""
    torque = made.world.motor_torque(s) if torque is None else torque
    columns = table_of_run(made.world, made.sensors, s.recorded, torque[:: s.every], 0.0)
    if has_speed(made):
        _add_speed(made, s.recorded, columns)
    return columns


def has_speed(made: RunSet) -> bool:
    """Whether recordings of a set have a speed channel."""
    return bool(made.rng(2).random() < 0.5)


def _add_speed(made: RunSet, s: States, columns: Columns) -> None:
    """Speed as a drive has it: that of the motor, with a little noise, on the rows that were kept."""
    rng = made.rng(3, s.run)
    top = np.abs(s.dq_motor).max(axis=0)
    speed = s.dq_motor + rng.normal(0.0, 1e-3, s.dq_motor.shape) * top
    kept = np.searchsorted(s.t, columns["t"])
    for j in range(made.n_joints):
        columns[f"dq_{j}"] = speed[kept, j]


def with_speed(made: RunSet) -> RunSet:
    """A set whose recordings have a speed channel for certain."""
    result = made.copied()
    if not has_speed(made):
        for s, columns in zip(made.world.runs, result.columns, strict=True):
            _add_speed(made, s.recorded, columns)
    return result


def moved(made: RunSet, run: int, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> Columns:
    """Record run `run` anew with another motion at its dense instants."""
    world, s = made.world, made.world.runs[run]
    tau = inverse_dynamics(world.model, q, dq, ddq)
    s = world.with_gears(replace(s, q=q, dq=dq, ddq=ddq, tau_rigid=tau), tau)
    columns = recorded(made, s)
    if "dq_0" in made.columns[run] and "dq_0" not in columns:
        _add_speed(made, s.recorded, columns)
    return columns


def loaded(made: RunSet, run: int, extra: FloatArray) -> Columns:
    """Record run `run` anew with a torque (n, n_joints) [N m] more on its links."""
    s = made.world.runs[run]
    s = made.world.with_gears(s, s.tau_link + extra)
    return recorded(made, s)


def turned_gravity(made: RunSet, run: int, gravity: FloatArray) -> FloatArray:
    """Torque (n, n_joints) [N m] that another gravity (3,) [m/s^2] of the base brings to a run."""
    world = made.world
    return gravity_difference(world.model, gravity - world.model.gravity.linear, world.runs[run].q)


def _with_efforts(urdf: str, made: RunSet) -> str:
    """Effort limits of a robot file: what its maker allows, or (in four of ten files) a number filled in."""
    rng = made.rng(4)
    if rng.random() < 0.4:
        return urdf
    peak = np.max([np.abs(made.world.motor_torque(s)).max(axis=0) for s in made.world.runs], axis=0)
    efforts = iter(peak * log_uniform(rng, 1.2, 3.0, made.n_joints))
    return re.sub(r'effort="[^"]*"', lambda found: f'effort="{next(efforts):.3g}"', urdf)
