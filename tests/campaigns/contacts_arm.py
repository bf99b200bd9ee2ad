"""One arm of the exam that is pushed: clean runs for false alarms, pushes for delays, kinds of thresholds on both."""

from __future__ import annotations

import tempfile
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from exam.draw import stream
from exam.world import States
from numpy.typing import NDArray

import dynid_rs as dyn
from campaigns.watch_arm import STEP, Change, DrawnArm, draw_watched

FloatArray = NDArray[np.float64]

TIME_CONSTANT = 0.01
"""Of the observer [s]; chosen on seeds below 1000 (docs/measured/contacts.md says how)."""
KNOWN, LITTLE = "trained as it works", "trained little"
TRAINED = {KNOWN: ("fourier", "fourier", "fourier"), LITTLE: ("poor", "poor", "poor")}
"""Motions of the runs that the model is identified from: the whole range, or slow and in phase."""
HEALTHY = {KNOWN: ("fourier", "pauses", "moves") * 2, LITTLE: ("poor",) * 6}
"""Motions of the healthy runs that thresholds are set by."""
WORKS = ("fourier", "pauses", "moves")
TRAINED_SECONDS, SECONDS = 40.0, 60.0
AWAY = 500
"""Numbers of the runs that rated torque is told by, which are none of the others."""
PUSHED, CLEAN = 3, 12
"""Runs in which the arm is pushed, and in which nothing touches it."""
BEGIN, EVERY = 2.0, 2.0
"""First push of a run, and time between pushes, give or take a quarter [s]."""
RISE = 0.004
"""Time in which a step comes up: a hard contact through the arm's own compliance [s]."""
HELD = 0.3
"""How long a step lasts [s]."""
HALF_SINE = (0.05, 0.3)
AMPLITUDE = (0.02, 0.5)
"""Of the rated torque, on the joint that the push is greatest on."""
MARK = 0.1
"""Amplitude of every third push, a step: that of the mark."""
AFTER = 0.05
"""A push is found until so long after its end [s]."""
BEFORE = 0.1
"""A push that begins within so long of a false alarm is not found by it [s]."""
METHODS = ("identified", "identified, parameters known", "as before", "constant", "rated")
LEVELS = {
    "identified": np.geomspace(0.2, 30.0, 160),
    "identified, parameters known": np.geomspace(0.2, 300.0, 160),
    "as before": np.geomspace(0.05, 300.0, 160),
    "constant": np.geomspace(0.05, 300.0, 160),
    "rated": np.geomspace(1e-3, 10.0, 160),
}
"""Levels that are tried: factors on thresholds of one false contact per hour, on the greatest that healthy runs showed,
and on rated torque."""
PROMISED = (100.0, 10.0, 1.0)
"""False contacts per hour that thresholds are asked for."""


@dataclass(frozen=True)
class Push:
    """Samples from its beginning to its end, what it is, and torque per joint (length, n_joints) [N m]."""

    first: int
    last: int
    shape: str
    place: str
    amplitude: float
    torque: FloatArray


@dataclass(frozen=True, eq=False)
class Ready:
    """An arm with its observers; `greatest` (n_joints,) [N m] is what healthy runs showed, `rated` what motors can."""

    arm: DrawnArm | None
    observers: dict[str, dyn.MomentumObserver]
    greatest: FloatArray
    rated: FloatArray
    first: int

    def ratios(self, run: dyn.Recording) -> dict[str, FloatArray]:
        """What is said over its threshold, the joint that is furthest beyond (n_samples,), by method."""
        found = {}
        for name, observer in self.observers.items():
            seen = observer.observe(run)  # of all of them the same, but for the threshold
            found[name] = _furthest(seen.external / seen.threshold)
        found["constant"] = _furthest(seen.external / self.greatest)
        found["rated"] = _furthest(seen.external / self.rated)
        return found


def _furthest(ratios: FloatArray) -> FloatArray:
    furthest: FloatArray = np.abs(ratios).max(axis=1)
    return furthest


def examine(
    seed: int, knowledge: str, time_constant: float = TIME_CONSTANT, window: int | None = None
) -> dict[str, Any]:
    """Draw the arm of a seed, and find what every threshold says of its clean runs and of its pushes."""
    arm = draw_watched(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an identification that has not converged shows in what it leaves
        ready = prepare(arm, knowledge, time_constant, window)
    peaks: dict[str, list[FloatArray]] = {name: [] for name in METHODS}
    promised = dict.fromkeys(map(str, PROMISED), 0)
    asked = {per_hour: asking(ready.observers[METHODS[0]], per_hour) for per_hour in PROMISED}
    kept = 0
    for k in range(CLEAN):
        run = arm.record(ready.first + k, SECONDS, WORKS[k % 3])
        for name, ratio in ready.ratios(run).items():
            blocks = _blocks(ratio)
            peaks[name].append(blocks.max(axis=1))
        kept += len(blocks)
        for per_hour, observer in asked.items():
            contact = _blocks(observer.observe(run).contact)
            promised[str(per_hour)] += int(np.count_nonzero(contact.any(axis=1)))
    false = {
        name: [int(np.count_nonzero(np.concatenate(own) > x)) for x in LEVELS[name]] for name, own in peaks.items()
    }
    pushes = []
    for k in range(PUSHED):
        number, motion = ready.first + CLEAN + k, WORKS[k % 3]
        pushes += pushed(arm, ready, number, motion, stream(seed, 52, k))
    case = arm.world.case
    return {
        "seed": seed,
        "knowledge": knowledge,
        "joints": case.n_joints,
        "encoders": case.n_encoders,
        "noise": (arm.sensors.noise / ready.rated).tolist(),
        "seconds": kept,
        "false": false,
        "promised": promised,
        "pushes": pushes,
    }


def _blocks(values: NDArray[Any]) -> NDArray[Any]:
    """Values of whole seconds but for the first, in which the observer begins, (seconds, samples)."""
    second = round(1.0 / STEP)
    return values[second : len(values) // second * second].reshape(-1, second)


def asking(observer: dyn.MomentumObserver, per_hour: float) -> dyn.MomentumObserver:
    """Return the same observer with thresholds for so many false contacts per hour."""
    other = dyn.MomentumObserver(
        observer.model,
        time_constant=observer.time_constant,
        window=observer.window,
        false_contacts_per_hour=per_hour,
    )
    other.uncertainty_ = observer.uncertainty_
    return other


def prepare(arm: DrawnArm, knowledge: str, time_constant: float, window: int | None) -> Ready:
    """Identify the arm, and set every threshold by the same healthy runs."""
    trained = [arm.record(k, TRAINED_SECONDS, motion) for k, motion in enumerate(TRAINED[knowledge])]
    first = len(trained)
    healthy = [arm.record(first + k, SECONDS, motion) for k, motion in enumerate(HEALTHY[knowledge])]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(arm.world.arm.urdf(), encoding="utf-8")
        robot = dyn.RobotModel.from_urdf(path)
    identifier = dyn.ThreeLoopIdentifier(robot).fit(trained)
    ready = thresholds(identifier, healthy, time_constant, window)
    works = [arm.record(AWAY + k, TRAINED_SECONDS, motion) for k, motion in enumerate(WORKS)]
    rated = np.abs(np.concatenate([run.tau for run in works])).max(axis=0)
    return replace(ready, arm=arm, rated=rated, first=first + len(healthy))


def thresholds(
    identifier: dyn.ThreeLoopIdentifier, healthy: list[dyn.Recording], time_constant: float, window: int | None
) -> Ready:
    """Set every threshold by the same healthy runs."""
    settings = {"time_constant": time_constant, "window": window, "false_contacts_per_hour": 1.0}
    directions = dyn.parameter_directions(identifier)
    full = dyn.MomentumObserver(identifier.model_, directions=directions, **settings).fit(healthy)
    known = dyn.MomentumObserver(identifier.model_, **settings).fit(healthy)
    before = dyn.MomentumObserver(identifier.model_, correlation_time=known.correlation_time_, **settings)
    seen = [full.observe(run).external[round(1.0 / (run.t[1] - run.t[0])) :] for run in healthy]
    greatest = np.abs(np.concatenate(seen)).max(axis=0)
    observers = dict(zip(METHODS, (full, known, before), strict=False))
    return Ready(None, observers, greatest, greatest, 0)


def pushed(arm: DrawnArm, ready: Ready, number: int, motion: str, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Push the arm again and again in a run, and say after how long each threshold was passed at each level."""
    states = arm.move(number, SECONDS, motion)
    pushes = draw_pushes(rng, ready.rated, arm.world.model, states)
    torque = np.zeros_like(states.q)
    for push in pushes:
        torque[push.first : push.last] += push.torque
    change = Change(shown=lambda tau: tau + torque)
    return judge(ready.ratios(arm.record(number, SECONDS, motion, change=change)), pushes, STEP)


def judge(ratios: dict[str, FloatArray], pushes: list[Push], step: float) -> list[dict[str, Any]]:
    """Say of every push after how many samples each threshold was passed at each level; None if it was not."""
    found = []
    for push in pushes:
        window = slice(push.first, push.last + round(AFTER / step))
        delays = {}
        for name, ratio in ratios.items():
            highest = np.maximum.accumulate(ratio[window])
            at = np.searchsorted(highest, LEVELS[name], side="right")
            # Who is beyond already has not found this push.
            early = ratio[max(0, push.first - round(BEFORE / step)) : push.first].max()
            good = (at < len(highest)) & (LEVELS[name] >= early)
            delays[name] = [int(k) if there else None for k, there in zip(at, good, strict=True)]
        about = {"shape": push.shape, "place": push.place, "amplitude": push.amplitude}
        found.append(about | {"delays": delays})
    return found


def draw_pushes(rng: np.random.Generator, rated: FloatArray, model: pin.Model, states: States) -> list[Push]:
    """Draw pushes of a run: steps and half-sines, on a joint or by a force at the end of a link."""
    pushes: list[Push] = []
    begin = BEGIN
    while begin + HELD + AFTER < SECONDS:
        is_mark = len(pushes) % 3 == 0
        amplitude = MARK if is_mark else float(np.exp(rng.uniform(*np.log(AMPLITUDE))))
        is_step = is_mark or bool(rng.random() < 0.5)
        first = round(begin / STEP)
        if is_step:
            rise = np.minimum(np.arange(1, round(HELD / STEP) + 1) * STEP / RISE, 1.0)
            shape = 0.5 - 0.5 * np.cos(np.pi * rise)
        else:
            length = round(rng.uniform(*HALF_SINE) / STEP)
            shape = np.sin(np.pi * np.arange(1, length + 1) / (length + 1))
        place, torque = _place(rng, model, states.q[first])
        greatest = amplitude * torque / np.max(np.abs(torque) / rated)
        what = "step" if is_step else "half-sine"
        pushes.append(Push(first, first + len(shape), what, place, amplitude, np.outer(shape, greatest)))
        begin += EVERY * rng.uniform(0.75, 1.25)
    return pushes


def _place(rng: np.random.Generator, model: pin.Model, q: FloatArray) -> tuple[str, FloatArray]:
    """Where the arm is pushed, and torque (n_joints,) of a push there, in any unit."""
    n = len(q)
    if rng.random() < 0.5:
        j = int(rng.integers(n))
        return f"joint {j}", np.eye(n)[j] * rng.choice((-1.0, 1.0))
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    link = int(rng.integers(1, n))
    # The origin of the next joint moves with this link.
    jacobian = pin.getJointJacobian(model, data, link + 1, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
    force = rng.normal(size=3)
    torque = jacobian.T @ force
    if np.abs(torque).max() < 1e-3 * np.linalg.norm(force):
        return _place(rng, model, q)
    return f"link {link}", torque
