"""Write robot.urdf, fleet.toml and the runs of sixteen simulated arms of one type into a folder; two of them are odd.

python make_fleet.py [FOLDER]

From arm to arm friction deviates by 8 % and masses by 2 %. The elbow of cell_05 has twice the friction that it was
drawn with, and cell_11 carries 0.6 kg that nobody told us of.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid_rs import RobotModel
from dynid_rs.simulation import simulate, typical_arm

URDF = """<robot name="picker">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.02 0 0.05"/><mass value="8"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.08"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="3" effort="80"/></joint>
  <link name="fore"><inertial><origin xyz="0.2 0 0.02"/><mass value="5"/>
    <inertia ixx="0.02" ixy="0" ixz="0.003" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="60"/></joint>
  <link name="hand"><inertial><origin xyz="0.1 0.01 0"/><mass value="2"/>
    <inertia ixx="0.005" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="4" effort="25"/></joint>
</robot>
"""
N_ARMS = 16
WORN, LOADED = 5, 11
LOAD = 0.6 * np.array([1.0, 0.12, 0.02, 0.0, 0.0004, -0.0024, 0.0144, 0.0, 0.0, 0.0148])
"""Of a point 0.12 m along the hand and 0.02 m beside it: mass, first moments, inertia about the link's origin."""


def main(folder: Path) -> None:
    """Write everything."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(URDF)
    robot = RobotModel.from_urdf_string(URDF)
    typical = typical_arm(robot).rigid()
    lines = ["[defaults]", 'robot = "robot.urdf"', 'residual = "none"']
    for k in range(N_ARMS):
        rng = np.random.default_rng(k)
        friction = typical.friction * (1 + 0.08 * rng.standard_normal((robot.n_joints, 1)))
        phi = robot.phi.reshape(-1, 10) * (1 + 0.02 * rng.standard_normal((robot.n_links, 1)))
        if k == WORN:
            friction[1] *= 2.0
        if k == LOADED:
            phi[-1] += LOAD
        arm = replace(typical, friction=friction, phi=phi.ravel())
        cell = folder / f"cell_{k:02d}"
        cell.mkdir(exist_ok=True)
        for number, run in enumerate(simulate(arm, n_runs=4, duration=8.0, rate=100.0, seed=k).recordings):
            names = [f"{signal}_{j}" for signal in ("q", "tau") for j in range(robot.n_joints)]
            rows = np.column_stack([run.t, run.q, run.tau])
            np.savetxt(cell / f"run_{number}.csv", rows, "%.9g", ",", header=",".join(["t", *names]), comments="")
        lines += ["", "[[robot]]", f'name = "{cell.name}"']
        lines += [f'runs = "{cell.name}/run_[01].csv"', f'test = "{cell.name}/run_2.csv"']
    (folder / "fleet.toml").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
