"""Moments of a run under any gravity, of one pass over it: torque is linear in gravity, moments are quadratic.

    columns(g) = still + sum_a g_a weight_a        columns'columns = sum_ab c_a c_b part_a'part_b,  c = (1, g)

Weight has no part in a link's moments of inertia: it is in the columns of masses and first moments alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.sensors.arm import Arm
from dynid_rs.sensors.rows import ArmRows, Moments

FloatArray = NDArray[np.float64]

HEAVY = 4
"""The first numbers of a link's ten have a weight: mass and first moments."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """Products of a run's columns without gravity, and of those of the weight under 1 m/s^2 along x, y and z.

    `still` without gravity; `heavy` (k,) columns that have a weight; `mixed` (n_joints, n, 3, k) of all its columns
    with those of the weight, `weight` (n_joints, 3, k, 3, k) of these with each other; `cross` (n_joints, 3, k,
    n_channels) of these with the torque.
    """

    still: Moments
    heavy: NDArray[np.intp]
    mixed: FloatArray
    weight: FloatArray
    cross: FloatArray

    @staticmethod
    def of(arm: Arm, rows: ArmRows) -> Weighed:
        """Products of a run."""
        rows = replace(rows)  # its regressor of a robot without weight is nobody else's
        n, at_rest = rows.n_joints, np.zeros_like(rows.q)
        floating = arm.with_gravity(np.zeros(3))
        heavy = np.flatnonzero(arm.pivots % 10 < HEAVY)
        pull = np.stack(
            [arm.with_gravity(axis).regressor(rows.q, at_rest, at_rest)[:, :, heavy] for axis in np.eye(3)], axis=2
        )
        k = len(heavy)
        still = Moments.of(floating, rows)
        mixed, weight = np.zeros((n, still.columns.shape[1], 3, k)), np.zeros((n, 3, k, 3, k))
        cross = np.zeros((n, 3, k, n))
        for j in range(n):
            told, first = rows.told[:, j], arm.first(j)
            felt = int(np.searchsorted(heavy, first))
            own = pull[told, j, :, felt:]
            shape = own.shape[1:]
            flat = own.reshape(len(own), int(np.prod(shape)))
            mixed[j, first:, :, felt:] = (rows.columns(floating, j)[told].T @ flat).reshape(-1, *shape)
            weight[j, :, felt:, :, felt:] = (flat.T @ flat).reshape(*shape, *shape)
            cross[j, :, felt:] = (flat.T @ rows.tau[told]).reshape(*shape, n)
        return Weighed(still, heavy, mixed, weight, cross)

    def moments(self, gravity: FloatArray) -> Moments:
        """Moments under a gravity (3,) [m/s^2]."""
        columns, cross, heavy = self.still.columns.copy(), self.still.cross.copy(), self.heavy
        mixed = np.einsum("a,jnak->jnk", gravity, self.mixed)
        columns[:, :, heavy] += mixed
        columns[:, heavy] += mixed.swapaxes(1, 2)
        columns[:, heavy[:, None], heavy] += np.einsum("a,b,jakbl->jkl", gravity, gravity, self.weight, optimize=True)
        cross[:, heavy] += np.einsum("a,jakc->jkc", gravity, self.cross)
        return Moments(columns, cross, self.still.power, self.still.count)
