"""Several measured-looking runs of one simulated arm, and the truth behind them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.recording import Recording
from dynid_rs.simulation.arm import SimulatedArm
from dynid_rs.simulation.limits import motion_limits, plausible_effort
from dynid_rs.simulation.plan import PlayedTrajectory
from dynid_rs.simulation.tracking import Tracking, track
from dynid_rs.simulation.trajectory import FourierTrajectory, Trajectory, random_trajectory

FloatArray = NDArray[np.float64]

Plan = FourierTrajectory | PlayedTrajectory

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
    trajectories : tuple of FourierTrajectory or PlayedTrajectory
        The plan of each run.
    recordings : tuple of Recording
        What was measured.
    seed : int
        Repeats it all.
    motions : tuple of Trajectory
        What the links really did, exactly; the plan itself without a controller.
    arms : tuple of SimulatedArm
        The arm of each run: effects that differ from run to run are there as they acted.
    tracking : Tracking, optional
        The controller.
    rate : float
        Samples per second [Hz].
    """

    arm: SimulatedArm
    trajectories: tuple[Plan, ...]
    recordings: tuple[Recording, ...]
    seed: int
    motions: tuple[Trajectory, ...]
    arms: tuple[SimulatedArm, ...]
    tracking: Tracking | None = None
    rate: float = 250.0

    def truth(self) -> dict[str, object]:
        """Return everything that identification must not know, for `truth.json`."""
        robot = self.arm.robot
        names = list(robot.joint_names)
        runs = []
        for recording, trajectory, arm in zip(self.recordings, self.trajectories, self.arms, strict=True):
            run: dict[str, object] = {"file": recording.name, "trajectory": trajectory.to_json()}
            own = [
                effect.to_json(names)
                for effect, common in zip(arm.effects, self.arm.effects, strict=True)
                if effect is not common
            ]
            runs.append(run | ({"effects": own} if own else {}))
        return {
            "format": "dynid-truth",
            "version": 1,
            "robot": robot.name,
            "joints": names,
            "gravity": np.asarray(robot.gravity).tolist(),
            "seed": self.seed,
            "arm": self.arm.to_json(),
            "effects": [effect.to_json(names) for effect in self.arm.effects],
            "tracking": None if self.tracking is None else self.tracking.to_json(),
            "runs": runs,
        }

    def reference(self, run: int) -> FloatArray:
        """Return what the controller of a run was told at its true sampling instants: q_ref (n, n_joints)."""
        recording = self.recordings[run]
        plan = self.trajectories[run]
        # Not the stamps, which may jitter.
        t = np.arange(recording.n_samples) / self.rate
        return plan.evaluate(t)[0]


def simulate(
    arm: SimulatedArm,
    *,
    n_runs: int = 4,
    duration: float = 20.0,
    rate: float = 250.0,
    seed: int = 0,
    derivatives: bool = False,
    stamp_jitter: float = 0.0,
    trajectories: Sequence[Plan] = (),
    tracking: Tracking | None = None,
    on_progress: Callable[[str], None] = lambda step: None,
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
        Of each random run, with a rest at both ends [s].
    rate : float
        Samples per second [Hz].
    seed : int
        Not negative.
    derivatives : bool
        Add exact velocities and accelerations.
    stamp_jitter : float
        Standard deviation of the time stamps [s].
    trajectories : sequence of PlayedTrajectory or FourierTrajectory
        Plans to play as they are, run i plays number i modulo their count; random ones of `duration` by default.
    tracking : Tracking, optional
        The controller that follows the plans; without one the links follow them exactly.

    on_progress : callable
        Called with a few words before every run.

    Raises
    ------
    ValueError
        A number out of its range, in one sentence.
    """
    _check_plan(n_runs, duration, rate, seed, stamp_jitter)
    limits, effort = motion_limits(arm.robot), plausible_effort(arm.robot)
    plans: list[Plan] = []
    recordings, motions, arms = [], [], []
    for run in range(n_runs):
        on_progress(f"run {run} of {n_runs} made")
        rng = np.random.default_rng([seed, run])
        plan: Plan = (
            trajectories[run % len(trajectories)]
            if trajectories
            else _within_effort(arm, random_trajectory(limits, duration, rng), effort)
        )
        # Streams of their own: a controller or an effect does not change the plans and the noise of a seed.
        own = arm.of_run(run, plan.duration, np.random.default_rng([seed, run, 1]))
        motion = plan if tracking is None else track(own, plan, tracking, np.random.default_rng([seed, run, 2]))
        plans.append(plan)
        arms.append(own)
        motions.append(motion)
        recordings.append(
            own.record(
                motion,
                rate,
                rng,
                f"run_{run}.parquet",
                derivatives=derivatives,
                stamp_jitter=stamp_jitter,
            )
        )
    return Simulation(
        arm, tuple(plans), tuple(recordings), seed, tuple(motions), tuple(arms), tracking=tracking, rate=rate
    )


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
