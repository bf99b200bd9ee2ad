"""The arms of the blind suite: 4, 6 and 7 joints, each with rigid gears, friction and noise of a typical arm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

from dynid_rs import RobotModel
from dynid_rs.simulation import SimulatedArm, bundled_robot, typical_arm

HERE = Path(__file__).parent
ROBOT_FILES = {
    "four_axis": HERE / "four_axis.urdf",
    "six_axis": bundled_robot(),
    "seven_axis": HERE / "seven_axis.urdf",
}


@cache
def declared_robot(name: str) -> RobotModel:
    """What the examined program is told about an arm."""
    return RobotModel.from_urdf(ROBOT_FILES[name])


@cache
def typical(name: str) -> SimulatedArm:
    """The arm with all its gears and its noise: what effects are sized for."""
    return typical_arm(declared_robot(name))


@cache
def bare(name: str) -> SimulatedArm:
    """The arm that the declared model describes: what effects are put into."""
    return replace(typical(name).rigid(), delay=0.0)
