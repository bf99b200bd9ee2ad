"""The arm is not what its file says: a payload, a base that is not level, geometry that is a little off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.effects.base import LabEffect

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Payload(LabEffect):
    """`parameters` (10,) are added to the last link's, in the order of `LINK_PARAMETER_NAMES`."""

    parameters: FloatArray = None  # type: ignore[assignment]

    def mount(self, arm: SimulatedArm) -> SimulatedArm:
        """Add it to the last link."""
        phi = np.array(arm.phi)
        phi[-10:] += self.parameters
        return replace(arm, phi=phi)


@dataclass(frozen=True, eq=False)
class GravityTilt(LabEffect):
    """The base is turned by Ry(pitch) Rx(roll) [rad] against the level frame of the file."""

    roll: float = 0.0
    pitch: float = 0.0

    def mount(self, arm: SimulatedArm) -> SimulatedArm:
        """Turn gravity the other way."""
        from scipy.spatial.transform import Rotation

        base = Rotation.from_euler("xyz", [self.roll, self.pitch, 0.0])
        return replace(arm, robot=arm.robot.with_gravity(base.inv().apply(arm.robot.gravity).tolist()))


@dataclass(frozen=True, eq=False)
class KinematicError(LabEffect):
    """Joint frames sit `offset` (3,) [m] and `turn` (3,) [rad] (rotation vector) away from the file's place."""

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def mount(self, arm: SimulatedArm) -> SimulatedArm:
        """Move the joint frames."""
        robot = arm.robot
        for joint in self.joints:
            robot = robot.with_joint_moved(joint, self.offset, self.turn)
        return replace(arm, robot=robot)


def box_parameters(mass: float, centre: FloatArray, sides: FloatArray) -> FloatArray:
    """Ten inertial parameters of a homogeneous box [kg, m], about the origin of the frame."""
    about_centre = mass / 12 * (np.sum(sides**2) * np.eye(3) - np.diag(sides**2))
    inertia = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    xx, xy, xz, _, yy, yz, _, _, zz = inertia.ravel()
    # m, h, then Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    return np.array([mass, *(mass * centre), xx, xy, yy, xz, yz, zz])
