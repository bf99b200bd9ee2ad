"""Effects that no catalogue has, on an arm that is otherwise as declared."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynid_rs import Recording, RobotModel
from dynid_rs.simulation import LabEffect, bundled_robot, equip, simulate, typical_arm, unabsorbed


@dataclass(frozen=True, eq=False)
class Nameless(LabEffect):
    """Torque `size * torque(signals)` on the first of its joints."""

    torque: Callable = None

    def motor_torque(self, arm, signals):
        out = np.zeros_like(signals.q)
        out[:, self.joints[0]] = self.size * self.torque(signals)
        return out


def plain_arm():
    """Rigid, on one clock: the declared model reaches the torque noise."""
    robot = RobotModel.from_urdf(bundled_robot())
    return replace(typical_arm(robot).rigid(), delay=0.0)


def measured(arm, **options):
    """Runs with one encoder."""
    runs = simulate(arm, rate=250, **options)
    return [Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints) for r in runs.recordings]


def with_nameless(arm, joint, torque, ratio, trajectories):
    """The arm with an effect of which the declared model leaves `ratio` times the torque noise."""
    effect = Nameless("nameless", (joint,), 1.0, torque=torque)
    left = unabsorbed(arm, [effect], trajectories)[joint]
    return equip(arm, [replace(effect, size=ratio * arm.noise_std[joint] / left)])
