"""Arms of the exam that are watched: 1 kHz, one or two encoders, nothing hidden, noise that lasts, warm friction."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from exam.draw import draw, log_uniform, stream
from exam.sensors import Sensors, make_sensors, shown_positions, stepped
from exam.world import States, World, make_run, make_world
from numpy.typing import NDArray
from scipy.signal import lfilter

import dynid_rs as dyn

FloatArray = NDArray[np.float64]

STEP, ROW = 1e-3, 0.2
"""Of a recording, and of what is averaged before it is judged [s]."""
MEMORY = (0.02, 0.5)
"""Time over which a joint's noise forgets [s]."""
WARM = 0.05
"""Friction of a joint warms up by as much as this, either way."""
RATED = 1 / 8
"""Rated payload over the mass of the arm that moves."""
TOLERATED_LOAD = 0.02
"""Of the rated payload."""
WELL = 3.0
"""A model whose rows leave more than this, over the channel's noise alone, is not identified well."""
MOTIONS = ("fourier", "pauses", "moves")
LEARNED = ("fourier",) * 3 + MOTIONS * 3
"""Motions of the runs that a model is identified from, each of as many seconds as:"""
LEARNED_SECONDS = 40.0


@dataclass(frozen=True)
class Change:
    """What is put into a run: each a torque (n, n_joints) [N m], from the states or from what the channel would show.

    `link` acts behind the gear, `friction` (n, n_joints) is a factor, `channel` is what is shown in the end, `position`
    (n, n_joints) [rad] what the encoder shows too much.
    """

    link: Callable[[World, States], FloatArray] | None = None
    friction: FloatArray | float = 1.0
    shown: Callable[[FloatArray], FloatArray] = lambda torque: torque
    channel: Callable[[FloatArray], FloatArray] = lambda torque: torque
    position: FloatArray | float = 0.0


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """An arm, what its channels are like, and by how much (n_joints,) its joints' friction warms up."""

    world: World
    sensors: Sensors
    memory: FloatArray
    warm: FloatArray

    @property
    def joints(self) -> tuple[str, ...]:
        """Names along the chain."""
        return tuple(joint.name for joint in self.world.arm.joints)

    @property
    def rated(self) -> float:
        """Rated payload [kg]."""
        return RATED * self.world.case.mass

    @property
    def noise_of_rows(self) -> FloatArray:
        """Deviation (n_joints,) [N m] of a row's mean by the channel's noise alone, in closed form."""
        m = self.memory / ROW
        coloured = self.sensors.noise**2 * 2 * m * (1 - m * (1 - np.exp(-1 / m)))
        return np.sqrt(coloured + self.sensors.quantum**2 / 12 * STEP / ROW)

    def noise(self, run: int, n: int) -> FloatArray:
        """Noise (n, n_joints) [N m] of the torque channels in a run."""
        rng = stream(self.world.case.seed, 40, run)
        keep = np.exp(-STEP / self.memory)
        first = rng.normal(size=len(keep))
        white = np.sqrt(1 - keep**2) * rng.normal(size=(n, len(keep)))
        columns = [lfilter([1.0], [1.0, -k], w, zi=[k * x])[0] for k, w, x in zip(keep, white.T, first, strict=True)]
        return self.sensors.noise * np.stack(columns, axis=1)

    def move(self, run: int, seconds: float, motion: str) -> States:
        """Let the arm move, gears still rigid; another run is another motion."""
        case = replace(self.world.case, motion=motion, durations=(seconds,) * (run + 1))
        return make_run(case, self.world.model, run)

    def record(
        self, run: int, seconds: float, motion: str, *, warmth: FloatArray | float = 0.5, change: Change | None = None
    ) -> dyn.Recording:
        """Return what is recorded; `warmth` (n,) is 0 cold and 1 in the end, the model is learned half-way."""
        change = change or Change()
        world, s = self.world, self.move(run, seconds, motion)
        link = s.tau_rigid if change.link is None else s.tau_rigid + change.link(world, s)
        s = world.with_gears(s, link)
        factor = 1 + self.warm * (2 * np.atleast_1d(warmth)[:, None] - 1)
        torque = world.motor_torque(s) + (factor * change.friction - 1) * world.friction(s.dq_motor)
        noisy = change.shown(torque) + self.noise(run, len(s.t))
        shown = change.channel(stepped(noisy, self.sensors.quantum))
        q, motor = shown_positions(world, self.sensors, s, change.position)
        return dyn.Recording(s.t, q, tau=shown, q_motor=motor, joints=self.joints, name=f"run_{run}")


def draw_watched(seed: int, *, warm: float = 0.0) -> DrawnArm:
    """Draw the arm of a seed; its numbers are the exam's, but for what would not be there on a well-kept arm."""
    case = replace(
        draw(seed), group="clean", wishes=(), motion="fourier", n_train=3, durations=(LEARNED_SECONDS,) * 3,
        rate=1 / STEP, jitter=0.0, missing=0.0, current=False, temperature=False, file_inertials="near",
    )  # fmt: skip
    world = make_world(case)
    rng = stream(seed, 41)
    if case.n_encoders == 2:  # gears yield, and the second encoder shows it
        world = replace(world, compliance=case.windup * rng.uniform(0.3, 1.0, case.n_joints) / world.torque_std)
    memory = log_uniform(rng, *MEMORY, case.n_joints)
    return DrawnArm(world, make_sensors(world), memory, warm * rng.uniform(-1.0, 1.0, case.n_joints))


@dataclass(frozen=True, eq=False)
class Ready:
    """An arm whose model was identified, and a watch that healthy runs have taught; `first` is the next run's number.

    `deviation` (n_joints,) [N m] is what rows usually leave, as healthy runs say; `error` (n_joints,) what the model
    leaves of a run that nothing else saw, as warm as those that it was learned from, over what the noise alone leaves.
    """

    arm: DrawnArm
    watch: dyn.Watch
    deviation: FloatArray
    error: FloatArray
    first: int


def prepare(arm: DrawnArm, *, warmths: Sequence[float], seconds: float, motions: Sequence[str] = LEARNED) -> Ready:
    """Identify from runs of these motions at medium warmth, and learn from others, one of each warmth, what is left."""
    learned = [arm.record(run, LEARNED_SECONDS, motion) for run, motion in enumerate(motions)]
    first = len(learned)
    healthy = [
        arm.record(first + k, seconds, MOTIONS[k % len(MOTIONS)], warmth=warmth) for k, warmth in enumerate(warmths)
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(arm.world.arm.urdf(), encoding="utf-8")
        robot = dyn.RobotModel.from_urdf(path)
    model = dyn.ThreeLoopIdentifier(robot).fit(learned).model_
    watch = dyn.Watch(model, row=ROW, tolerated=dyn.Tolerated(load=TOLERATED_LOAD * arm.rated)).fit(healthy)
    last = first + len(healthy)
    seen = watch.watch(arm.record(last, LEARNED_SECONDS, "fourier"))
    error = rms(seen.left, seen.watched) / arm.noise_of_rows
    return Ready(arm, watch, np.median(seen.deviation, axis=0), error, last + 1)


def rms(left: FloatArray, watched: NDArray[np.bool_]) -> FloatArray:
    """Root mean square (n_joints,) of the rows (n_rows, n_joints) that say something; of none 0."""
    return np.sqrt(np.sum(np.where(watched, left, 0.0) ** 2, axis=0) / np.maximum(watched.sum(axis=0), 1))
