"""How good a trajectory is, and what it uses of its limits: the figures beside the answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.excitation.bounds import STEP
from dynid_rs.excitation.limits import MOTIONS, ExcitationLimits
from dynid_rs.excitation.series import sufficient_bounds

if TYPE_CHECKING:
    from dynid_rs._core import BaseParameters, Excitation, RobotModel
    from dynid_rs.simulation import FourierTrajectory

FloatArray = NDArray[np.float64]
BLOCKS = ("acceleration", "velocity", "gravity")


@dataclass(frozen=True, eq=False)
class Merit:
    """Figures of merit of one trajectory.

    Parameters
    ----------
    condition_number : float
        s_1 / s_n of the base regressor over the samples, unweighted.
    whitened_condition_number : float, optional
        The same after whitening (Eq. 13), where the noise is given.
    block_condition_numbers : dict of str to float or None
        s_1 / s_r of the whitened blocks of Eq. 14 over their structural rank r; None for a block of rank zero.
    block_ranks : dict of str to int
        Their structural ranks.
    log_det : float
        log det(W'W) of the whitened base regressor: larger is better (D-optimality).
    variance_trace : float
        trace((W'W)^-1): smaller is better (A-optimality).
    lowest, highest : ndarray (3, n_joints)
        Extremes of position, velocity and acceleration on a 1 ms grid.
    sufficient : ndarray (3, n_joints)
        Eq. 17's bounds on their sizes, which the extremes cannot exceed.
    """

    condition_number: float
    whitened_condition_number: float | None
    block_condition_numbers: dict[str, float | None]
    block_ranks: dict[str, int]
    log_det: float
    variance_trace: float
    lowest: FloatArray
    highest: FloatArray
    sufficient: FloatArray

    def violations(self, limits: ExcitationLimits) -> int:
        """How many of the limits are exceeded on the 1 ms grid."""
        count = 0
        for name, low, high in zip(MOTIONS, self.lowest, self.highest, strict=True):
            lower, upper = getattr(limits, name)
            count += int(np.count_nonzero(low < lower) + np.count_nonzero(high > upper))
        return count

    def to_json(self, limits: ExcitationLimits) -> dict[str, Any]:
        """Return every figure, with the limits beside the extremes."""
        motions = {
            name: {
                "lowest": self.lowest[k].tolist(),
                "highest": self.highest[k].tolist(),
                "lower_limit": getattr(limits, name)[0].tolist(),
                "upper_limit": getattr(limits, name)[1].tolist(),
                "eq17_bound": self.sufficient[k].tolist(),
            }
            for k, name in enumerate(MOTIONS)
        }
        return {
            "condition_number": self.condition_number,
            "whitened_condition_number": self.whitened_condition_number,
            "block_condition_numbers": self.block_condition_numbers,
            "block_ranks": self.block_ranks,
            "log_det": self.log_det,
            "variance_trace": self.variance_trace,
            "grid_s": STEP,
            "violations": self.violations(limits),
            "motion": motions,
        }


def merit_of(
    trajectory: FourierTrajectory,
    robot: RobotModel,
    base: BaseParameters,
    excitation: Excitation,
    t: FloatArray,
    *,
    whitened: bool = False,
) -> Merit:
    """Figures of `trajectory` at the sampling instants `t` (n,) [s], extremes on a 1 ms grid.

    `whitened` says whether `excitation` whitens (Eq. 13).
    """
    motion = trajectory.evaluate(t)
    plain = base.reduce(robot.joint_torque_regressor(*motion)).reshape(-1, base.n_base)
    blocks = excitation.blocks(*motion)
    values = np.linalg.svd(sum(blocks), compute_uv=False)
    ranks = excitation.ranks
    conditions = [_condition(block, rank) for block, rank in zip(blocks, ranks[1:], strict=True)]
    fine = trajectory.evaluate(
        np.linspace(0.0, trajectory.duration, int(np.ceil(trajectory.duration / STEP - 1e-9)) + 1)
    )
    with np.errstate(divide="ignore"):
        return Merit(
            condition_number=float(np.linalg.cond(plain)),
            whitened_condition_number=float(values[0] / values[-1]) if whitened else None,
            block_condition_numbers=dict(zip(BLOCKS, conditions, strict=True)),
            block_ranks=dict(zip(BLOCKS, ranks[1:], strict=True)),
            log_det=float(2 * np.log(values).sum()),
            variance_trace=float((values**-2.0).sum()),
            lowest=np.array([signal.min(axis=0) for signal in fine]),
            highest=np.array([signal.max(axis=0) for signal in fine]),
            sufficient=sufficient_bounds(trajectory),
        )


def _condition(block: FloatArray, rank: int) -> float | None:
    if rank == 0:
        return None
    values = np.linalg.svd(block, compute_uv=False)
    return float(values[0] / values[rank - 1])
