"""The same on measured robots, where their data is at hand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from errors import LAW, Outcome, outcome_of

from dynid_rs import LinkDynamicsIdentifier, Recording, RobotModel, ThreeLoopIdentifier, _core, read_recording
from dynid_rs.model.known import KnownTerm
from dynid_rs.runs.checks import check_recording, refused_sources

UR10E, KUKA = "ur10e_innopolis", "kuka_kr300_weigand"
"""Folders; each holds robot.urdf and Parquet runs."""
UR10E_TRAIN = ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec")
UR10E_TEST = "20_02_12_40sec_12harm"
KUKA_TRAIN, KUKA_TEST = ("traj_A",), "traj_B"

KUKA_GEAR = np.array([1798 / 7, 1872 / 7, 757 / 3, 221, 5032 / 21, 206793 / 1340])
KUKA_ROTOR = np.array([0.00923, 0.0118, 0.0118, 0.00173, 0.00173, 0.00173])
"""Rotors of the authors' model before the gears [kg m^2]."""
AXIS_2 = 1


@dataclass(frozen=True, eq=False)
class Measured:
    """One robot's identification, what was done, and in which unit its torque is."""

    robot: str
    note: str
    unit: str
    outcome: Outcome


def counterbalance() -> KnownTerm:
    """The KUKA authors' hydraulic counterbalance of axis 2 as a term of the catalogue.

    Two accumulators of nitrogen behind a piston of 55 mm with a rod of 30 mm: gas length V / A, force Z R T m over
    the length of the gas. The authors measure the angle from the other end of the rod, 95 degrees on.
    """
    area = np.pi / 4 * (0.055**2 - 0.030**2)
    shape = {"a": 0.8, "b": 0.2, "phase": np.deg2rad(95) - np.pi, "gas_length": 2 * 0.48e-3 / area}
    coefficients = np.zeros((6, 1))
    coefficients[AXIS_2] = 1.01 * 296.8 * 328.0 * 2 * 0.0795
    # A joint without a counterbalance has a zero coefficient, whatever its shape.
    return _core.Effect.of("counterbalance", **{name: [value] * 6 for name, value in shape.items()}), coefficients


def measured_robots(data: Path | None) -> list[Measured]:
    """Identify whatever robots the folder holds; none without a folder."""
    found: list[Measured] = []
    if data is None:
        return found
    if (folder := data / UR10E).is_dir():
        robot = RobotModel.from_urdf(folder / "robot.urdf")
        found.append(_identify(folder, UR10E_TRAIN, UR10E_TEST, ThreeLoopIdentifier(robot, friction_law=LAW), "as is"))
    if (folder := data / KUKA).is_dir():
        file = folder / "robot.urdf"
        plain = ThreeLoopIdentifier(RobotModel.from_urdf(file), friction_law=LAW)
        found.append(_identify(folder, KUKA_TRAIN, KUKA_TEST, plain, "as is"))
        robot = RobotModel.from_urdf(file, rotor_inertia=(KUKA_ROTOR * KUKA_GEAR**2).tolist())
        links = LinkDynamicsIdentifier(prior="robot")
        informed = ThreeLoopIdentifier(robot, links=links, known=[counterbalance()], friction_law=LAW)
        note = "the file's inertials as a prior, the authors' counterbalance as a known term"
        found.append(_identify(folder, KUKA_TRAIN, KUKA_TEST, informed, note))
    return found


def _identify(folder: Path, train: tuple[str, ...], test: str, identifier: ThreeLoopIdentifier, note: str) -> Measured:
    runs = [_read(folder / f"{name}.parquet", identifier.robot) for name in train]
    identifier.fit(runs)
    outcome = outcome_of(identifier, {test: [_read(folder / f"{test}.parquet", identifier.robot)]})
    return Measured(folder.name, note, identifier.torque_unit_.replace("*", " "), outcome)


def _read(path: Path, robot: RobotModel) -> Recording:
    recording = read_recording(path, robot)
    return recording.without(*refused_sources(check_recording(recording, robot)))
