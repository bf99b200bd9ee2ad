"""Write the tutorial's robot and its logs into a folder, as the RTDE recorder of Universal Robots would.

python make_logs.py [FOLDER]

The arm is simulated: six joints with one encoder each, motor currents, and one thing that its maker did not declare.
"""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid_rs import read_robot
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm

GAIN = np.array([14.9, 14.9, 12.5, 8.2, 8.2, 8.2])
"""Torque at each joint per ampere of its motor [N m/A]."""
HIDDEN = "friction_hysteresis:joint_3"
RATE, DURATION, N_LOGS = 125.0, 15.0, 4


def main(folder: Path) -> None:
    """Write robot.urdf, log_1.csv to log_4.csv and truth.txt."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(bundled_robot(), folder / "robot.urdf")
    typical = typical_arm(read_robot(bundled_robot()))
    (effect,) = build_effects([parse_wish(HIDDEN)], typical)
    arm = equip(replace(typical.rigid(), delay=0.0), [effect])
    for k, run in enumerate(simulate(arm, n_runs=N_LOGS, duration=DURATION, rate=RATE, derivatives=True).recordings, 1):
        signals = {"actual_q": run.q, "actual_qd": run.dq, "actual_current": run.tau / GAIN}
        names = [f"{name}_{joint}" for name in signals for joint in range(run.n_joints)]
        rows = np.column_stack([4000.0 * k + run.t, *signals.values()])
        header = " ".join(["timestamp", *names])
        formats = ["%.3f", *["%.6f"] * (len(names))]
        np.savetxt(folder / f"log_{k}.csv", rows, fmt=formats, header=header, comments="")
    said = ", ".join(f"{value.name} {value.value[0]:.3g} {value.unit}" for value in effect.values)
    (folder / "truth.txt").write_text(f"{effect.kind} on joint_{effect.joints[0] + 1}: {said}\n", encoding="utf-8")
    print(f"{folder}/robot.urdf, {folder}/log_1.csv to log_{N_LOGS}.csv")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
