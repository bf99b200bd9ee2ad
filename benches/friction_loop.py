"""Time of the first loop: the search for friction's shape on 20 s of 1 kHz data of six joints.

`python benches/friction_loop.py` prints the least wall-clock and processor time of seven fits.
"""

from __future__ import annotations

import time
from dataclasses import replace

from dynid_rs import RobotModel, ThreeLoopIdentifier
from dynid_rs.simulation import SimulatedArm, bundled_robot, simulate, typical_arm


def measure(arm: SimulatedArm) -> tuple[float, float]:
    """Wall-clock and processor time [s]."""
    recording = simulate(arm, n_runs=1, duration=20.0, rate=1000.0, seed=0).recordings[0]
    identifier = ThreeLoopIdentifier(arm.robot)
    friction = identifier._estimators()[0]
    data = identifier._prepare([recording], [], lambda step: None)
    rows = data.observations.rows_with([states.in_band(states.tau) for states in data.runs])
    wall, processor = [], []
    for _ in range(7):
        started, worked = time.perf_counter(), time.process_time()
        friction.fit(data.plan, data.runs, rows)
        wall.append(time.perf_counter() - started)
        processor.append(time.process_time() - worked)
    return min(wall), min(processor)


if __name__ == "__main__":
    robot = RobotModel.from_urdf(bundled_robot())
    arms = {
        "elastic gears, two encoders": typical_arm(robot),
        "rigid gears, one encoder": replace(typical_arm(robot).rigid(), delay=0.0),
    }
    for name, arm in arms.items():
        wall, processor = measure(arm)
        print(f"{name}: {1e3 * wall:.0f} ms, {1e3 * processor:.0f} ms of processor time", flush=True)
