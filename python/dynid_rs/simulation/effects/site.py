"""The arm that effects are sized for: what its joints can do, carry and feel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.simulation.effects.outside import force_torque
from dynid_rs.simulation.limits import MotionLimits, motion_limits, plausible_effort, random_poses, typical_inertia

if TYPE_CHECKING:
    from dynid_rs.simulation.arm import SimulatedArm

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Site:
    """What default sizes are made from; each is computed once, when it is asked for.

    Parameters
    ----------
    arm : SimulatedArm
        The arm with all its gears: joints that a kind makes elastic take theirs from it.
    """

    arm: SimulatedArm

    @property
    def n_joints(self) -> int:
        """Joints of the arm."""
        return self.arm.robot.n_joints

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """Which joints turn (n_joints,)."""
        return np.array([kind == "revolute" for kind in self.arm.robot.joint_kinds])

    @cached_property
    def limits(self) -> MotionLimits:
        """What the joints may do."""
        return motion_limits(self.arm.robot)

    @cached_property
    def effort(self) -> FloatArray:
        """Effort limits (n_joints,) [N m]."""
        return plausible_effort(self.arm.robot)

    @cached_property
    def inertia(self) -> FloatArray:
        """Link inertia at typical poses (n_joints,) [kg m^2]."""
        return typical_inertia(self.arm.robot)

    @cached_property
    def holding(self) -> FloatArray:
        """Spread over poses of the torque of gravity (n_joints,) [N m]."""
        still = np.zeros_like(self.poses)
        torque = self.arm.robot.inverse_dynamics(self.poses, still, still, self.arm.phi)
        return np.asarray(torque.std(axis=0))

    @cached_property
    def poses(self) -> FloatArray:
        """Poses within the limits (n, n_joints), always the same."""
        return random_poses(self.limits)

    @cached_property
    def reach(self) -> FloatArray:
        """Greatest torque of a force of 1 N on the last link (n_joints,) [m]."""
        directions = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        torques = np.stack([force_torque(self.arm, self.poses, force) for force in directions])
        return np.asarray(np.linalg.norm(torques, axis=0).max(axis=0))

    def force_for(self, share: float) -> float:
        """Force [N] on the last link that takes at most `share` of any joint's effort limit.

        Raises
        ------
        ValueError
            No joint feels a force there.
        """
        felt = self.reach > 1e-6 * self.reach.max()
        if not felt.any():
            raise ValueError(
                "a payload or a contact needs a joint that feels a force on the last link's frame, and all of this "
                "robot's axes go through it; take a robot with another joint before"
            )
        return float(share * np.min(self.effort[felt] / self.reach[felt]))
