"""A hand guides an arm of the exam, which follows what its observer says beyond a dead zone; the model is not right.

Joints go at the speed that they are asked for, guide / damping, through the drives' lag; a hand on them is a torque
beside the motors'. `dynid-estimator --observe --contacts --guide` runs in the loop: what it says of a sample decides
the next one.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from exam.draw import stream
from exam.sensors import stepped
from helpers.binaries import find_estimator
from numpy.typing import NDArray

from campaigns.contacts_arm import LITTLE, STEP, TIME_CONSTANT, Ready, prepare
from campaigns.watch_arm import draw_watched

FloatArray = NDArray[np.float64]
Rule = Callable[[FloatArray, FloatArray], FloatArray]
"""What moves the arm (n_joints,) [N m], from the external torque and from what lies beyond the thresholds."""

LAG = 0.02
"""Of the drives' speed [s]."""
FELT, SPEED = 0.1, 0.5
"""A joint moves at this speed [rad/s] where so much of its rated torque is felt beyond the dead zone."""
BEGIN, LEFT, RAMP = 1.0, 4.0, 3.0
"""Seconds in which the arm is held, is left to itself, and in which a hand pushes more and more, up to rated torque."""
POSES = 3
REACH = 1.5
"""Poses are drawn within this of zero [rad]: most are far from the training runs, which reach 0.7 about one middle."""
DRIFT = 0.01
"""A joint that goes further without a hand has drifted [rad]."""
FOLLOWS = 0.002
"""A joint that goes as far with the hand follows it [rad]."""
FACTORS = (1.0, 2.0, 4.0, 8.0)
"""Constant dead zones, of the greatest that healthy runs showed."""


def guide(seed: int) -> dict[str, Any]:
    """Leave an arm alone in poses, then push it, and say by rule how far it drifted and what hand it needed."""
    ready = prepare(draw_watched(seed), LITTLE, TIME_CONSTANT, None)
    n = ready.arm.world.case.n_joints
    rng = stream(seed, 55)
    poses = rng.uniform(-REACH, REACH, (POSES, n))
    joints, signs = rng.integers(n, size=POSES), rng.choice((-1.0, 1.0), POSES)
    rules: dict[str, Rule] = {"identified": lambda external, said: said}
    for factor in FACTORS:
        zone = factor * ready.greatest
        rules[f"constant, {factor:g} times"] = lambda external, said, zone=zone: beyond(external, zone)
    found: dict[str, Any] = {name: {"drift": [], "needed": []} for name in rules}
    with tempfile.TemporaryDirectory() as folder:
        observer = ready.observers["identified"]
        observer.model.save(Path(folder) / "model.json")
        observer.save(Path(folder) / "contact.json")
        for k in range(POSES):
            for name, rule in rules.items():
                drift, needed = follow(ready, Path(folder), rule, poses[k], int(joints[k]), float(signs[k]), k)
                found[name]["drift"].append(drift)
                found[name]["needed"].append(needed)
    return {"seed": seed, "joints": n, "rules": found}


def beyond(external: FloatArray, zone: FloatArray) -> FloatArray:
    """External torque beyond a constant dead zone, its edge as smooth as the estimator's: over a fifth of it."""
    x = np.maximum(np.abs(external) - zone, 0.0)
    out: FloatArray = np.sign(external) * x * x / (x + zone / 5)
    return out


def follow(
    ready: Ready, folder: Path, rule: Rule, pose: FloatArray, joint: int, sign: float, number: int
) -> tuple[float, float | None]:
    """Hold the arm in a pose, leave it alone, push a joint.

    The way that it drifted [rad], and the share of rated torque that moved it; None if none does.
    """
    arm, world = ready.arm, ready.arm.world
    model, data = world.model, world.model.createData()
    n, steps = len(pose), round((BEGIN + LEFT + RAMP) / STEP)
    noise = arm.noise(1000 + number, steps)
    damping = FELT * ready.rated / SPEED
    q, speed, asked = pose.copy(), np.zeros(n), np.zeros(n)
    drift, needed, before = 0.0, None, pose
    two = world.case.n_encoders == 2
    command = [find_estimator(), folder / "model.json", "--observe", "--contacts", folder / "contact.json", "--guide"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, text=True, **pipes) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for k in range(steps):
            t = k * STEP
            push = (asked - speed) * (1 - np.exp(-STEP / LAG)) / STEP
            speed = speed + STEP * push
            q = q + STEP * speed
            hand = np.zeros(n)
            if t >= BEGIN + LEFT:
                if t < BEGIN + LEFT + STEP / 2:
                    before = q.copy()
                hand[joint] = sign * (t - BEGIN - LEFT) / RAMP * ready.rated[joint]
            rigid = pin.rnea(model, data, q, speed, push).copy()
            torque = rigid + world.rotor * push + world.friction(speed[None])[0] + world.offset - hand + noise[k]
            state = {"t": t, "q": stepped(q, arm.sensors.link_step).tolist()}
            if two:
                state["q_motor"] = stepped(q + world.compliance * rigid, arm.sensors.motor_step).tolist()
            state["tau"] = stepped(torque, arm.sensors.quantum).tolist()
            process.stdin.write(json.dumps(state) + "\n")
            process.stdin.flush()
            answer = json.loads(process.stdout.readline())
            said = rule(np.array(answer["external"]), np.array(answer["guide"]))
            asked = said / damping if t >= BEGIN else np.zeros(n)
            if t < BEGIN + LEFT:
                drift = max(drift, float(np.abs(q - pose).max()))
            elif sign * (q - before)[joint] > FOLLOWS:
                needed = float(abs(hand[joint]) / ready.rated[joint])
                break
        process.stdin.close()
    return drift, needed
