"""A measured UR10e: synthetic pushes on runs in which nothing touches it, and a run in which a hand did push it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from exam.draw import stream
from helpers import data
from numpy.typing import NDArray

import dynid_rs as dyn
from campaigns.contacts_arm import AFTER, AMPLITUDE, HALF_SINE, HELD, LEVELS, MARK, METHODS, Push, judge, thresholds

FloatArray = NDArray[np.float64]

FOLDER = "ur10e_innopolis"
TRAINED = ("20_02_10_30sec_12harm", "20_02_05_20sec_8harm")
HEALTHY = ("20_02_12_40sec_12harm", "20_02_05_20sec_12harm", "20_02_06_20sec_10harm", "20_01_31_unload")
CLEAN = ("20_02_12_50sec_12harm", "20_02_06_20sec_5harm", "20_02_10_20sec_7harm", "20_02_19_14harm50sec")
STANDING = tuple(f"20_01_17_p{k}" for k in range(1, 10))
"""At rest, and nobody touches it."""
PUSHED = "20_01_22_push_pose_1"
"""At rest, and pushed by hand now and then; nobody wrote down when."""
TIME_CONSTANT = 0.05
"""Of the observer [s]: five samples at 95 Hz."""
EVERY = 1.5
DRAWS = 4
"""Times that pushes are drawn for every run."""


def examine_measured(seed: int) -> dict[str, Any]:
    """What `contacts_arm.examine` says, of the measured arm."""
    folder = data.place() / FOLDER

    def read(name: str) -> dyn.Recording:
        return dyn.read_recording(folder / f"{name}.parquet", robot=robot)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # stamps that jitter
        robot = dyn.RobotModel.from_urdf(folder / "robot.urdf")
        trained, healthy, clean, standing = (list(map(read, names)) for names in (TRAINED, HEALTHY, CLEAN, STANDING))
        hand = read(PUSHED)
        identifier = dyn.ThreeLoopIdentifier(robot).fit(trained)
        ready = thresholds(identifier, healthy, TIME_CONSTANT, None)
        rated = np.abs(np.concatenate([run.tau for run in trained + healthy])).max(axis=0)
        ready = replace(ready, rated=rated)
        peaks = {name: [] for name in METHODS}
        for run in clean:
            for name, ratio in ready.ratios(run).items():
                peaks[name].append(seconds(ratio, run))
        together = {name: np.concatenate(own) for name, own in peaks.items()}
        false = {name: [int(np.count_nonzero(own > x)) for x in LEVELS[name]] for name, own in together.items()}
        pushes = []
        for k, run in enumerate(clean * DRAWS):
            pushes += pushed(ready, run, stream(seed, 57, k))
        at_rest = {}
        for name in METHODS:
            still = np.concatenate([seconds(ready.ratios(run)[name], run) for run in standing])
            at_rest[name] = {"still": still.tolist(), "hand": seconds(ready.ratios(hand)[name], hand).tolist()}
    rate = float(np.mean([run.rate for run in clean]))
    about = {"seed": seed, "rate": rate, "knowledge": "measured", "joints": robot.n_joints, "noise": []}
    return about | {"seconds": len(together[METHODS[0]]), "false": false, "pushes": pushes, "at_rest": at_rest}


def seconds(ratio: FloatArray, run: dyn.Recording) -> FloatArray:
    """Greatest of every second but for the first, (seconds,)."""
    size = round(run.rate)
    greatest: FloatArray = ratio[size : len(ratio) // size * size].reshape(-1, size).max(axis=1)
    return greatest


def pushed(ready: Any, run: dyn.Recording, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Add pushes of one joint to the torque of a run, the drawn ones of the exam, and judge them."""
    step, n = 1 / run.rate, run.n_joints
    pushes, begin = [], 2.0 + rng.uniform(0.0, EVERY)
    tau = run.tau.copy()
    while (begin + HELD + AFTER + 1.0) / step < len(run.t):
        is_mark = len(pushes) % 3 == 0
        amplitude = MARK if is_mark else float(np.exp(rng.uniform(*np.log(AMPLITUDE))))
        is_step = is_mark or bool(rng.random() < 0.5)
        length = max(2, round((HELD if is_step else rng.uniform(*HALF_SINE)) / step))
        shape = np.ones(length) if is_step else np.sin(np.pi * np.arange(1, length + 1) / (length + 1))
        j = int(rng.integers(n))
        torque = np.outer(shape, np.eye(n)[j] * amplitude * ready.rated[j] * rng.choice((-1.0, 1.0)))
        first = round(begin / step)
        tau[first : first + length] += torque
        what = "step" if is_step else "half-sine"
        pushes.append(Push(first, first + length, what, f"joint {j}", amplitude, torque))
        begin += EVERY * rng.uniform(0.75, 1.25)
    return judge(ready.ratios(replace(run, tau=tau)), pushes, step)
