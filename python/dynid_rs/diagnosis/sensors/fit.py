"""How probable recordings are under an arm's model, whatever its parameters: by one fit with a prior and few bounds.

The links' ten numbers are near the robot file's, as far as it says any; friction and rotors are not negative. What is
compared is the best fit's likelihood with a variance of its own for every joint, and the prior's price:

    L = -1/2 sum_j n_j log s_j^2 - 1/2 (phi - phi_file)' P^-1 (phi - phi_file)

`n_j` counts rows that are independent (`MEMORY`), so that L is in nats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.sensors.rows import N_OWN, Moments
from dynid_rs.regression.priors import LEAST_MASS, LENGTH, declares_inertia

FloatArray = NDArray[np.float64]

SPREAD = 0.5
"""Standard deviation of what a robot file says of a link, over its size: files are off by some tens of percent."""
OPEN = 10.0
"""The same, of the size of a usual link, where the file says nothing."""
BODY = 0.2
"""Mass of what an arm carries over what its links' masses may be wrong by, all together."""
MEMORY = 5.0
"""Rows, four to a period of the band's edge, that one independent value of a model's error is worth."""
LEAST_NOISE = 1e-3
"""Of a channel's standard deviation: no channel is told better."""
N_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class ArmPrior:
    """Mean and standard deviation of the links' numbers, (10 n_links,)."""

    mean: FloatArray
    std: FloatArray

    @staticmethod
    def of(robot: _core.RobotModel) -> ArmPrior:
        """What the robot file says."""
        phi = np.asarray(robot.phi, dtype=np.float64)
        declared = declares_inertia(robot)
        std = np.concatenate([_spread(link, declared=declared) for link in phi.reshape(-1, 10)])
        return ArmPrior(phi if declared else np.zeros_like(phi), std)

    def with_body(self) -> ArmPrior:
        """The prior with a body on the last link, which may weigh a tenth of the arm or take as much off it."""
        links = self.std.reshape(-1, 10)
        mass = BODY * float(links[:, 0].sum())
        reach = float(np.sqrt(np.max(links[:, 4:] / links[:, :1])))
        std = mass * np.array([1.0, *[reach] * 3, *[reach**2] * 6])
        return ArmPrior(np.concatenate([self.mean, np.zeros(10)]), np.concatenate([self.std, std]))


def _spread(link: FloatArray, *, declared: bool) -> FloatArray:
    if not declared:
        return OPEN * max(float(link[0]), LEAST_MASS) * np.array([1.0, *[LENGTH] * 3, *[LENGTH**2] * 6])
    mass = max(float(link[0]), 1e-3 * LEAST_MASS)
    # Radius of gyration about the link's frame: how far from it the mass is.
    reach = np.sqrt(max(float(link[4] + link[6] + link[9]), 1e-12) / (2 * mass))
    return SPREAD * mass * np.array([1.0, *[reach] * 3, *[reach**2] * 6])


@dataclass(frozen=True, eq=False)
class ArmFit:
    """`x` all coefficients; `share` (n_joints,) residual power over the torque's; `variance` (n_joints,); `log` L."""

    x: FloatArray
    share: FloatArray
    variance: FloatArray
    log: float
    run_shares: FloatArray
    """Shares run by run, (n_runs, n_joints)."""


def fit_arm(prior: ArmPrior, runs: Sequence[Moments], size: FloatArray) -> ArmFit:
    """Fit runs, one channel per joint each.

    Parameters
    ----------
    prior : ArmPrior
        Of the links.
    runs : sequence of Moments
        As `Moments.picked` gives them.
    size : ndarray (n_joints,)
        Standard deviation of every torque channel: the scale of noise and of what friction may be.
    """
    n = len(size)
    n_links = len(prior.mean)
    total = n_links + N_OWN * n
    at = [np.r_[np.arange(n_links), n_links + N_OWN * j + np.arange(N_OWN)] for j in range(n)]
    columns = np.sum([run.columns for run in runs], axis=0)
    cross = np.sum([run.cross[:, :, 0] for run in runs], axis=0)
    power = np.sum([run.power[:, 0] for run in runs], axis=0)
    count = np.maximum(np.sum([run.count for run in runs], axis=0), 1.0)
    mean, precision = np.zeros(total), np.zeros(total)
    mean[:n_links], precision[:n_links] = prior.mean, prior.std**-2.0
    for j in range(n):  # what friction, offset and rotor may be: as large as the torque
        norms = np.sqrt(np.maximum(np.diag(columns[j])[n_links:] / count[j], 1e-300))
        precision[at[j][n_links:]] = np.where(norms > 1e-100, norms / size[j], 1.0) ** 2
    bounded = np.concatenate([n_links + N_OWN * j + np.arange(1, N_OWN) for j in range(n)])
    floor = (LEAST_NOISE * size) ** 2
    variance = 0.01 * size**2
    for _ in range(N_ROUNDS):
        weight = 1 / variance / MEMORY
        H, b = np.diag(precision), precision * mean
        for j in range(n):
            H[np.ix_(at[j], at[j])] += weight[j] * columns[j]
            b[at[j]] += weight[j] * cross[j]
        x = _bounded(H, b, bounded)
        left = np.array([_left(columns[j], cross[j], power[j], x[at[j]]) for j in range(n)])
        variance = np.maximum(left / count, floor)
    price = float(np.sum(precision * (x - mean) ** 2))
    log = -0.5 * float(np.sum(count / MEMORY * np.log(variance))) - 0.5 * price
    per_run = np.array(
        [[_left(r.columns[j], r.cross[j, :, 0], r.power[j, 0], x[at[j]]) for j in range(n)] for r in runs]
    )
    counts = np.array([np.maximum(r.count, 1.0) for r in runs])
    return ArmFit(x, left / count / size**2, variance, log, per_run / counts / size**2)


def _left(A: FloatArray, b: FloatArray, power: float, x: FloatArray) -> float:
    return max(float(power - 2 * b @ x + x @ A @ x), 0.0)


def _bounded(H: FloatArray, b: FloatArray, bounded: NDArray[np.intp]) -> FloatArray:
    """Minimum of ``x'Hx/2 - b'x`` with some coefficients not negative: those that would be are set to zero."""
    scale = 1 / np.sqrt(np.diag(H))
    free = np.ones(len(b), dtype=bool)
    x = np.zeros(len(b))
    for _ in range(len(bounded)):
        x[:] = 0.0
        keep = np.flatnonzero(free)
        S = H[np.ix_(keep, keep)] * np.outer(scale[keep], scale[keep])
        x[keep] = scale[keep] * np.linalg.solve(S + 1e-12 * np.eye(len(keep)), scale[keep] * b[keep])
        negative = bounded[x[bounded] < 0]
        if not len(negative):
            break
        free[negative] = False
    return x
