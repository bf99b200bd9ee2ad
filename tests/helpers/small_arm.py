"""A small arm whose runs are simulated and fitted in seconds, and the command line to do it with."""

from __future__ import annotations

import functools
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner, Result

from dynid_rs import RobotModel
from dynid_rs.cli import app
from dynid_rs.simulation import simulate, typical_arm
from dynid_rs.simulation.folder import run_columns
from helpers.run_files import Columns, write

JOINTS = ("shoulder", "elbow", "wrist")
N_RUNS = 3
URDF = """<robot name="small_arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.05"/><mass value="8"/>
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


@functools.cache
def _columns(encoders: int, rate: float, duration: float) -> tuple[Columns, ...]:
    arm = typical_arm(RobotModel.from_urdf_string(URDF))
    arm = arm if encoders == 2 else arm.rigid()
    simulation = simulate(arm, n_runs=N_RUNS, duration=duration, rate=rate, derivatives=True)
    dropped = () if encoders == 2 else ("q_motor", "dq_motor")
    return tuple(
        {name: values for name, values in run_columns(recording).items() if not name.startswith(("ddq_", *dropped))}
        for recording in simulation.recordings
    )


def run(k: int, *, encoders: int = 1, rate: float = 200.0, duration: float = 8.0, velocity: bool = False) -> Columns:
    """Columns of run `k`: t, q_i, tau_i, with `velocity` also dq_i; with two encoders q_motor_i too."""
    columns = _columns(encoders, rate, duration)[k]
    kept = columns if velocity else {name: x for name, x in columns.items() if not name.startswith("dq_")}
    return {name: values.copy() for name, values in kept.items()}


def with_derivatives(columns: Columns) -> Columns:
    """The same run with dq_i and ddq_i as a careful logger would write them."""
    rate = 1 / np.median(np.diff(columns["t"]))
    for j in range(len(JOINTS)):
        columns[f"dq_{j}"] = np.gradient(columns[f"q_{j}"], 1 / rate)
        columns[f"ddq_{j}"] = np.gradient(columns[f"dq_{j}"], 1 / rate)
    return columns


def as_current(columns: Columns, gain: tuple[float, ...] = (20.0, 15.0, 6.0)) -> Columns:
    """The same run with motor currents [A] instead of torques."""
    currents = {f"current_{j}": columns[f"tau_{j}"] / gain[j] for j in range(len(JOINTS))}
    return {name: x for name, x in columns.items() if not name.startswith("tau_")} | currents


def write_robot(folder: Path) -> Path:
    """robot.urdf of the small arm."""
    path = folder / "robot.urdf"
    path.write_text(URDF)
    return path


def write_runs(folder: Path, suffix: str = ".parquet", n_runs: int = N_RUNS, **kind: Any) -> list[Path]:
    """run_0, run_1, ... in `folder`; `kind` as in `run`."""
    return [write(folder / f"run_{k}{suffix}", run(k, **kind)) for k in range(n_runs)]


def dynid(*arguments: object) -> Result:
    """Run `dynid` in this process; our own bugs fail the test."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def refusal(result: Result) -> str:
    """Check that a command refused as it should, and return its sentence."""
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("error: ")
    return lines[0].removeprefix("error: ")


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Everything below `folder`, byte for byte; None for folders."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@dataclass(frozen=True)
class Study:
    """What one identification read and wrote."""

    robot: Path
    runs: list[Path]
    output: Path
    printed: Result

    @property
    def model(self) -> Path:
        return self.output / "model.json"

    @property
    def result(self) -> dict[str, Any]:
        return json.loads((self.output / "result.json").read_text(), parse_constant=_no_constant)


def _no_constant(word: str) -> None:
    raise AssertionError(f"{word} in result.json")


def study(encoders: int = 1) -> Study:
    """Identify the small arm once per session, from two runs, tested on the third."""
    return _study(encoders)


@functools.cache
def _study(encoders: int) -> Study:
    folder = Path(_keep().name) / f"encoders_{encoders}"
    folder.mkdir()
    robot, runs = write_robot(folder), write_runs(folder, encoders=encoders)
    printed = dynid("identify", robot, *runs[:2], "--test", runs[2], "-o", folder / "out")
    return Study(robot, runs, folder / "out", printed)


@functools.cache
def _keep() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="dynid-tests-", ignore_cleanup_errors=True)
