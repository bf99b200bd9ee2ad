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
from dynid_rs.regression.priors import LEAST_MASS, LENGTH, declares_inertia
from dynid_rs.sensors.rows import Moments

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
    own = slice(n_links, None)
    all_columns, all_cross = np.stack([run.columns for run in runs]), np.stack([run.cross[:, :, 0] for run in runs])
    all_power = np.stack([run.power[:, 0] for run in runs])
    counts = np.stack([run.count for run in runs])
    columns, cross, power = all_columns.sum(axis=0), all_cross.sum(axis=0), all_power.sum(axis=0)
    count = np.maximum(counts.sum(axis=0), 1.0)
    n_own = columns.shape[1] - n_links
    total = n_links + n_own * n
    mean, precision = np.zeros(total), np.zeros(total)
    mean[:n_links], precision[:n_links] = prior.mean, prior.std**-2.0
    # What friction, offset and rotor may be: as large as the torque.
    squares = np.diagonal(columns, axis1=1, axis2=2)[:, own]
    norms = np.sqrt(np.maximum(squares / count[:, None], 1e-300))
    precision[own] = (np.where(norms > 1e-100, norms / size[:, None], 1.0) ** 2).ravel()
    bounded = np.flatnonzero(np.arange(total) >= n_links).reshape(n, n_own)[:, 1:].ravel()
    floor = (LEAST_NOISE * size) ** 2
    variance = 0.01 * size**2
    for _ in range(N_ROUNDS):
        H, b = _weighted(columns, cross, 1 / variance / MEMORY, n_links)
        H[np.diag_indices(total)] += precision
        x = _bounded(H, b + precision * mean, bounded)
        at = np.concatenate([np.broadcast_to(x[:n_links], (n, n_links)), x[own].reshape(n, n_own)], axis=1)
        left = _left(columns, cross, power, at)
        variance = np.maximum(left / count, floor)
    price = float(np.sum(precision * (x - mean) ** 2))
    log = -0.5 * float(np.sum(count / MEMORY * np.log(variance))) - 0.5 * price
    per_run = _left(all_columns, all_cross, all_power, at)
    return ArmFit(x, left / count / size**2, variance, log, per_run / np.maximum(counts, 1.0) / size**2)


def _weighted(
    columns: FloatArray, cross: FloatArray, weight: FloatArray, n_links: int
) -> tuple[FloatArray, FloatArray]:
    """Normal equations of all joints: the links', then each joint's own."""
    n, own = len(weight), slice(n_links, None)
    n_own = columns.shape[1] - n_links
    total = n_links + n_own * n
    weighted, moments = columns * weight[:, None, None], cross * weight[:, None]
    H = np.zeros((total, total))
    H[:n_links, :n_links] = weighted[:, :n_links, :n_links].sum(axis=0)
    H[:n_links, own] = np.moveaxis(weighted[:, :n_links, own], 0, 1).reshape(n_links, n_own * n)
    H[own, :n_links] = H[:n_links, own].T
    at = n_links + np.arange(n_own * n).reshape(n, n_own)
    H[at[:, :, None], at[:, None, :]] = weighted[:, own, own]
    return H, np.concatenate([moments[:, :n_links].sum(axis=0), moments[:, own].ravel()])


def _left(A: FloatArray, b: FloatArray, power: FloatArray, x: FloatArray) -> FloatArray:
    """What coefficients x (n_joints, n) leave of every joint's power, (..., n_joints)."""
    taken = (A @ x[..., None])[..., 0]
    left: FloatArray = np.maximum(power + np.sum((taken - 2 * b) * x, axis=-1), 0.0)
    return left


def _bounded(H: FloatArray, b: FloatArray, bounded: NDArray[np.intp]) -> FloatArray:
    """Minimum of ``x'Hx/2 - b'x`` with some coefficients not negative: those that would be are set to zero."""
    scale = 1 / np.sqrt(np.diag(H))
    S, right = H * np.outer(scale, scale), scale * b
    S[np.diag_indices(len(b))] += 1e-12
    free = np.ones(len(b), dtype=bool)
    x = np.zeros(len(b))
    for _ in range(len(bounded)):
        x[:] = 0.0
        keep = np.flatnonzero(free)
        x[keep] = scale[keep] * np.linalg.solve(S if len(keep) == len(b) else S[np.ix_(keep, keep)], right[keep])
        negative = bounded[x[bounded] < 0]
        if not len(negative):
            break
        free[negative] = False
    return x
