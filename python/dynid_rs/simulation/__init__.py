"""Simulated experiments: an arm with elastic gears and two encoders, moved exactly and measured badly."""

from __future__ import annotations

from pathlib import Path

from dynid_rs.simulation.arm import SimulatedArm
from dynid_rs.simulation.effects.base import LabEffect, equip
from dynid_rs.simulation.effects.catalogue import kind_names
from dynid_rs.simulation.effects.scale import scale_to, unabsorbed
from dynid_rs.simulation.effects.wish import Wish, build_effect, build_effects, parse_wish
from dynid_rs.simulation.experiment import Simulation, simulate
from dynid_rs.simulation.folder import write_simulation
from dynid_rs.simulation.limits import MotionLimits, motion_limits
from dynid_rs.simulation.motion import ArmMotion
from dynid_rs.simulation.plan import PlayedTrajectory, read_plan
from dynid_rs.simulation.tracking import TrackedMotion, Tracking, track
from dynid_rs.simulation.trajectory import FourierTrajectory, Trajectory, random_trajectory
from dynid_rs.simulation.typical import typical_arm

__all__ = [
    "ArmMotion",
    "FourierTrajectory",
    "LabEffect",
    "MotionLimits",
    "PlayedTrajectory",
    "SimulatedArm",
    "Simulation",
    "TrackedMotion",
    "Tracking",
    "Trajectory",
    "Wish",
    "build_effect",
    "build_effects",
    "bundled_robot",
    "equip",
    "kind_names",
    "motion_limits",
    "parse_wish",
    "random_trajectory",
    "read_plan",
    "scale_to",
    "simulate",
    "track",
    "typical_arm",
    "unabsorbed",
    "write_simulation",
]


def bundled_robot() -> Path:
    """Path of the six-axis arm that comes with the package."""
    return Path(__file__).parent.parent / "robots" / "six_axis.urdf"
