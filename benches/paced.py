"""The binary at 1 kHz: what a cycle takes, beside a thread that only sleeps. `python benches/paced.py --duration 600`.

Six joints, rigid body, friction and a mixture of ten components per joint; states come through shared memory. Options
after `--` go to dynid-estimator, such as `-- --mlock --fifo 80 --core 1`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from dynid_rs import TorqueModel, _core
from dynid_rs.simulation import bundled_robot

ROOT = Path(__file__).resolve().parents[1]
N, COMPONENTS = 6, 10


def model() -> TorqueModel:
    """The estimate of the performance goals."""
    rng = np.random.default_rng(0)
    robot = _core.RobotModel.from_urdf(str(bundled_robot()))

    def mixture() -> _core.GaussianMixtureRegression:
        half = 0.4 * rng.normal(size=(COMPONENTS, 3, 3)) + 0.5 * np.eye(3)
        weights = rng.dirichlet(np.full(COMPONENTS, 5.0))
        return _core.GaussianMixtureRegression(
            weights, rng.normal(size=(COMPONENTS, 3)), half @ half.transpose(0, 2, 1)
        )

    friction = _core.Effect.friction([0.0] * N, [0.01] * N)
    effects = [
        (_core.Effect.rotor_inertia(), np.ones((N, 1))),
        (_core.Effect.torque_offset(), rng.normal(size=(N, 1))),
        (friction, rng.uniform(0, 5, (N, 8))),
    ]
    return TorqueModel(
        robot,
        robot.phi,
        effects,
        residual=("joint_state", [mixture() for _ in range(N)]),
        encoder_delay=[0.0] * N,
        noise_std=[0.5] * N,
        domain=([[-3.0, 3.0]] * N, [3.0] * N, [9.0] * N),
        step=0.001,
    )


def main() -> int:
    """Run, and print what the binary says."""
    sys.path[:0] = [str(ROOT / "examples" / "online"), str(ROOT / "tests")]
    from helpers.binaries import find_estimator
    from shm_client import Slots
    from udp_client import state

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="seconds")
    parser.add_argument("--rate", type=float, default=1000.0, help="cycles per second")
    parser.add_argument("rest", nargs="*", help="options of dynid-estimator")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        model().save(path)
        # A name in memory: writing back a file on a disk costs a page fault every time.
        slot = Path("/dev/shm") / f"dynid-bench-{os.getpid()}"
        options = ["--shm", slot, "--rate", arguments.rate, "--duration", arguments.duration]
        command = [find_estimator(), path, *options, "--histogram", "--jitter", *arguments.rest]
        process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert process.stdout is not None
        assert process.stderr is not None
        if not (said := process.stderr.readline()).startswith("note: sharing"):
            print(said, end="")
            return process.wait()
        slots, k = Slots(slot), 0
        slot.unlink()  # the mappings stay
        phase, begin = 0.3 * np.arange(N), time.monotonic()
        while process.poll() is None:
            t = k / arguments.rate
            slots.send(state(k, t, np.sin(t + phase), np.cos(t + phase), -np.sin(t + phase)))
            k += 1
            time.sleep(max(0.0, begin + k / arguments.rate - time.monotonic()))
        print(process.stdout.read() + process.stderr.read(), end="")
        return process.returncode


if __name__ == "__main__":
    raise SystemExit(main())
