"""Several measured-looking runs of one simulated arm, and the truth behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.recording import Recording
from dynid_rs.simulation.arm import SimulatedArm
from dynid_rs.simulation.limits import motion_limits, plausible_effort
from dynid_rs.simulation.trajectory import FourierTrajectory, random_trajectory

FloatArray = NDArray[np.float64]

MAX_DURATION = 600.0
MAX_RATE = 10_000.0
MIN_RATE = 25.0
MAX_RUNS = 1000

_EFFORT_SHARE = 0.9
_SHRINK = 0.85
_MAX_SHRINKS = 12


@dataclass(frozen=True, eq=False)
class Simulation:
    """What `simulate` made.

    Parameters
    ----------
    arm : SimulatedArm
        The truth.
    trajectories : tuple of FourierTrajectory
        The motion of each run, exactly.
    recordings : tuple of Recording
        What was measured.
    seed : int
        Repeats it all.
    """

    arm: SimulatedArm
    trajectories: tuple[FourierTrajectory, ...]
    recordings: tuple[Recording, ...]
    seed: int

    def truth(self) -> dict[str, object]:
        """Return everything that identification must not know, for `truth.json`."""
        robot = self.arm.robot
        return {
            "format": "dynid-truth",
            "version": 1,
            "robot": robot.name,
            "joints": list(robot.joint_names),
            "gravity": np.asarray(robot.gravity).tolist(),
            "seed": self.seed,
            "arm": self.arm.to_json(),
            "runs": [
                {"file": recording.name, "trajectory": trajectory.to_json()}
                for recording, trajectory in zip(self.recordings, self.trajectories, strict=True)
            ],
        }


def simulate(
    arm: SimulatedArm,
    *,
    n_runs: int = 4,
    duration: float = 20.0,
    rate: float = 250.0,
    seed: int = 0,
    derivatives: bool = False,
    stamp_jitter: float = 0.0,
) -> Simulation:
    """Measure several runs with different trajectories.

    Run i depends on `seed` and i alone: asking for more runs does not change the first ones.

    Parameters
    ----------
    arm : SimulatedArm
        What is measured.
    n_runs : int
        How many.
    duration : float
        Of each run, with a rest at both ends [s].
    rate : float
        Samples per second [Hz].
    seed : int
        Not negative.
    derivatives : bool
        Add exact velocities and accelerations.
    stamp_jitter : float
        Standard deviation of the time stamps [s].

    Raises
    ------
    ValueError
        A number out of its range, in one sentence.
    """
    _check_plan(n_runs, duration, rate, seed, stamp_jitter)
    limits, effort = motion_limits(arm.robot), plausible_effort(arm.robot)
    trajectories, recordings = [], []
    for run in range(n_runs):
        rng = np.random.default_rng([seed, run])
        trajectory = _within_effort(arm, random_trajectory(limits, duration, rng), effort)
        trajectories.append(trajectory)
        recordings.append(
            arm.record(
                trajectory,
                rate,
                rng,
                f"run_{run}.parquet",
                derivatives=derivatives,
                stamp_jitter=stamp_jitter,
            )
        )
    return Simulation(arm, tuple(trajectories), tuple(recordings), seed)


def _within_effort(arm: SimulatedArm, trajectory: FourierTrajectory, effort: FloatArray) -> FourierTrajectory:
    """Shrink a motion until the motors can drive it; a pose that is itself too heavy stays as it is."""
    t = np.arange(0.0, trajectory.duration, 1e-2)
    rigid = arm.rigid()
    for _ in range(_MAX_SHRINKS):
        if (np.abs(rigid.motion(trajectory, t).tau) <= _EFFORT_SHARE * effort).all():
            break
        trajectory = trajectory.scaled(_SHRINK)
    return trajectory


def _check_plan(n_runs: int, duration: float, rate: float, seed: int, stamp_jitter: float) -> None:
    if not 1 <= n_runs <= MAX_RUNS:
        raise ValueError(f"the number of runs must lie between 1 and {MAX_RUNS}, got {n_runs}")
    if not MIN_RATE <= rate <= MAX_RATE:
        raise ValueError(f"the rate must lie between {MIN_RATE:g} and {MAX_RATE:g} Hz, got {rate:g} Hz")
    # `random_trajectory` refuses what is too short.
    if duration > MAX_DURATION:
        raise ValueError(f"a duration of {duration:g} s is too long, at most {MAX_DURATION:g} s; take more runs")
    if seed < 0:
        raise ValueError(f"the seed must not be negative, got {seed}")
    if not 0 <= stamp_jitter <= 0.4 / rate:
        raise ValueError(f"the jitter must lie between 0 and 0.4 steps ({0.4 / rate:g} s), got {stamp_jitter:g} s")
