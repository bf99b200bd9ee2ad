"""Processor time of a million samples to base parameters, and what the process grew by; one line of JSON."""

from __future__ import annotations

import json
import statistics
import sys

import numpy as np
from measure import ROOT, processor_seconds

import dynid_rs as dyn
from dynid_rs.simulation import bundled_robot

sys.path.insert(0, str(ROOT / "tests"))

from helpers.processes import peak_bytes


def peak() -> float:
    """Most memory that this process ever had [MB]."""
    return peak_bytes() / 2**20


def main():
    robot = dyn.RobotModel.from_urdf(bundled_robot())
    offset = dyn.Effect.torque_offset()
    rng = np.random.default_rng(0)
    signals = [rng.uniform(-2, 2, (1_000_000, robot.n_joints)) for _ in range(4)]
    before = peak()
    dyn.fit_base_parameters(robot, *(signal[:2000] for signal in signals), effects=[offset])
    started = peak()
    times = [processor_seconds(lambda: dyn.fit_base_parameters(robot, *signals, effects=[offset]), 1) for _ in range(3)]
    print(json.dumps({"seconds": statistics.median(times), "megabytes": peak() - before, "growth": peak() - started}))


if __name__ == "__main__":
    main()
