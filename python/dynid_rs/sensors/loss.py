"""What gears lose by the way that their load takes: beside it a delay is a delay.

The teeth of elastic gears rub, and the motor feels a torque that turns round with the load (`gear_hysteresis` of the
catalogue). For small waves of the load that is a lead of the torque before the positions: a model without it finds
positions late that are not, and torques in time that are late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.model.gear_loss import gear_losses
from dynid_rs.sensors.arm import Arm
from dynid_rs.sensors.changes import Bench
from dynid_rs.sensors.fit import ArmFit
from dynid_rs.sensors.rows import ArmRows, Moments

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LossyRows:
    """A run's rows and the torque per unit of every gear's loss, (n_rows, n_joints)."""

    rows: ArmRows
    loss: FloatArray

    def columns(self, arm: Arm, j: int) -> FloatArray:
        """Columns of joint j, (n_rows, n): its loss, which is not negative, is the last."""
        return np.column_stack([self.rows.columns(arm, j), self.loss[:, j]])

    def moments(self, arm: Arm, seen: Callable[[int], FloatArray] | None = None) -> Moments:
        """Moments of the run, every joint with its own channel."""
        own = (lambda j: self.columns(arm, j)) if seen is None else seen
        return Moments.of(arm, self.rows, own).picked(range(self.rows.n_joints))

    def channels(self, arm: Arm, moments: Moments, tau: FloatArray) -> Moments:
        """`moments` of the run with other channels, k of each joint's own: `tau` (n_rows, n_joints, k)."""
        cross = np.zeros((*moments.columns.shape[:2], tau.shape[2]))
        power = np.empty((len(cross), tau.shape[2]))
        for j in range(len(cross)):
            told = self.rows.told[:, j]
            own = tau[told, j]
            cross[j, arm.first(j) :] = self.columns(arm, j)[told].T @ own
            power[j] = np.sum(own**2, axis=0)
        return replace(moments, cross=cross, power=power)


@dataclass(frozen=True, eq=False)
class LossyArm:
    """Runs of an arm whose gears lose torque, if they do: rows, their moments and the fit."""

    rows: tuple[LossyRows, ...]
    moments: tuple[Moments, ...]
    fit: ArmFit


def lossy_arm(bench: Bench) -> LossyArm:
    """Give every gear a loss, over the way of the catalogue's grid under which the runs are most probable."""
    phi = bench.fit.x[: len(bench.prior.mean)]
    loads = [np.einsum("njp,p->nj", rows.regressor(bench.arm), phi) for rows in bench.rows]
    arms = []
    for effect in gear_losses(loads):
        lossy = tuple(
            LossyRows(rows, _core.effect_columns(effect, rows.q, rows.dq, rows.ddq, tau_link=load)[:, :, 0])
            for rows, load in zip(bench.rows, loads, strict=True)
        )
        moments = tuple(rows.moments(bench.arm) for rows in lossy)
        arms.append(LossyArm(lossy, moments, bench.fitted(moments)))
    return max(arms, key=lambda arm: arm.fit.log)
