"""Moments of a run under any gravity, of one pass over it: torque is linear in gravity, moments are quadratic.

    columns(g) = still + sum_a g_a weight_a        columns'columns = sum_ab c_a c_b part_a'part_b,  c = (1, g)

Weight has no part in a link's moments of inertia: four columns a link.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.sensors.rows import N_OWN, ArmRows, Moments

FloatArray = NDArray[np.float64]

HEAVY = 4
"""Numbers of a link, of its ten, that have a weight: mass and first moments."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """Products of a run's columns without gravity, and of those of the weight under 1 m/s^2 along x, y and z.

    `still` without gravity; `mixed` (n_joints, n, 3, k) of all its columns with those of the weight, `weight`
    (n_joints, 3, k, 3, k) of these with each other; `cross` (n_joints, 3, k, n_channels) of these with the torque.
    """

    still: Moments
    mixed: FloatArray
    weight: FloatArray
    cross: FloatArray

    @staticmethod
    def of(robot: _core.RobotModel, rows: ArmRows) -> Weighed:
        """Products of a run."""
        rows = replace(rows)  # its regressor of a robot without weight is nobody else's
        n, at_rest = rows.n_joints, np.zeros_like(rows.q)
        floating = robot.with_gravity([0.0, 0.0, 0.0])
        pulls = []
        for axis in np.eye(3):
            regressor = robot.with_gravity(axis.tolist()).joint_torque_regressor(rows.q, at_rest, at_rest)
            pulls.append(regressor.reshape(len(rows.q), n, -1, 10)[..., :HEAVY])
        pull = np.stack(pulls, axis=2)  # (n_rows, n_joints, 3, n_links, HEAVY)
        n_links = pull.shape[3]
        still = Moments.of(floating, rows)
        mixed = np.zeros((n, still.columns.shape[1], 3, n_links, HEAVY))
        weight = np.zeros((n, 3, n_links, HEAVY, 3, n_links, HEAVY))
        cross = np.zeros((n, 3, n_links, HEAVY, n))
        for j in range(n):
            told = rows.told[:, j]
            # A joint does not feel the links before it.
            own = pull[told, j, :, j:]
            shape = own.shape[1:]
            flat = own.reshape(len(own), int(np.prod(shape)))
            mixed[j, 10 * j :, :, j:] = (rows.columns(floating, j)[told].T @ flat).reshape(-1, *shape)
            weight[j, :, j:, :, :, j:] = (flat.T @ flat).reshape(*shape, *shape)
            cross[j, :, j:] = (flat.T @ rows.tau[told]).reshape(*shape, n)
        k = n_links * HEAVY
        return Weighed(still, mixed.reshape(n, -1, 3, k), weight.reshape(n, 3, k, 3, k), cross.reshape(n, 3, k, n))

    def moments(self, gravity: FloatArray) -> Moments:
        """Moments under a gravity (3,) [m/s^2]."""
        columns, cross = self.still.columns.copy(), self.still.cross.copy()
        links = np.arange(columns.shape[1] - N_OWN).reshape(-1, 10)
        heavy = links[:, :HEAVY].ravel()
        mixed = np.einsum("a,jnak->jnk", gravity, self.mixed)
        columns[:, :, heavy] += mixed
        columns[:, heavy] += mixed.swapaxes(1, 2)
        columns[:, heavy[:, None], heavy] += np.einsum("a,b,jakbl->jkl", gravity, gravity, self.weight, optimize=True)
        cross[:, heavy] += np.einsum("a,jakc->jkc", gravity, self.cross)
        return Moments(columns, cross, self.still.power, self.still.count)
