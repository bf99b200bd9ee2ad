"""Joints that leave more than their torque channel's noise, and how well any signals predict what they leave."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.dependence import Search, search
from dynid_rs.diagnosis.products import LeftOutRows
from dynid_rs.diagnosis.rows_beside import Beside, JointRows
from dynid_rs.diagnosis.signals import Candidates, candidate_signals
from dynid_rs.diagnosis.surrogates import surrogates, upper_tail
from dynid_rs.evaluation import noise_floor
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.systems import block_residuals

FloatArray = NDArray[np.float64]

N_SURROGATES = 24
"""Surrogates of each joint's residual."""
NOTABLE = 1.1
"""A residual within this factor of what is known of its floor is at it: floors are not known better."""
NOTICED = 0.1
"""Less of the residual's power (in its logarithm) than this is not spoken of, however significant."""
N_WORKERS = 2
"""Joints that are searched at a time."""


@dataclass(frozen=True, eq=False)
class Leftover:
    """What one joint leaves, searched.

    `rows` with their splits; `found` every single signal and pair; `p_value` the chance of predicting rows left out so
    well from some signals if the residual depended on none; 1 where it is too little to speak of.
    """

    joint: int
    rows: JointRows
    found: Search
    p_value: float


@dataclass(frozen=True, eq=False)
class Leftovers:
    """Those of a fit: of the joints that are not at the noise of their torque channel.

    `noise` (n_joints,) [torque unit], NaN where it cannot be seen; `candidates` None where no joint leaves anything.
    """

    noise: FloatArray
    joints: dict[int, Leftover]
    candidates: Candidates | None


def run_residuals(fit: ThreeLoopIdentifier) -> list[FloatArray]:
    """Residuals of both loops at the rows of every training run, (n_rows, n_joints) each."""
    links = fit.links_
    return list(fit.observations_.by_run(block_residuals(fit.observations_, links.x_, links.torque_scale_)))


def search_leftovers(fit: ThreeLoopIdentifier, *, random_state: int = 0) -> Leftovers:
    """Search the residual of every joint that leaves more than noise; the costly part of floor and unknown.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Without a third loop.
    random_state : int
        Seed of the surrogates.
    """
    from threadpoolctl import threadpool_limits

    noise = noise_floor(fit.runs_)
    rms = np.sqrt(np.mean(np.concatenate(run_residuals(fit)) ** 2, axis=0))
    joints = [j for j in range(len(noise)) if not rms[j] <= NOTABLE * noise[j]]
    if not joints:
        return Leftovers(noise, {}, None)

    with threadpool_limits(limits=1, user_api="blas"), ThreadPoolExecutor(N_WORKERS) as pool:
        beside, candidates = Beside(fit), candidate_signals(fit)
        found = pool.map(lambda j: _look(j, beside.of_joint(j), candidates, float(noise[j]), random_state + j), joints)
        return Leftovers(noise, dict(zip(joints, found, strict=True)), candidates)


def _look(j: int, rows: JointRows, candidates: Candidates, noise: float, random_state: int) -> Leftover:
    least = len(rows.rows) * noise**2 if np.isfinite(noise) else 0.0
    found = search(
        LeftOutRows(rows, candidates, surrogates(rows, N_SURROGATES, random_state)), candidates.of_joint(j), least
    )
    gain = float(found.gain[0])
    return Leftover(j, rows, found, upper_tail(gain, found.gain[1:]) if gain > NOTICED else 1.0)
