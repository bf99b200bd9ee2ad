"""How probable recordings are under an arm's model, whatever its parameters: by one fit with a prior and few bounds.

The links' ten numbers are near the robot file's, as far as it says any; friction and rotors are not negative. What is
compared is the best fit's likelihood with a variance of its own for every joint, and the prior's price:

    L = -1/2 sum_j n_j log s_j^2 - 1/2 (phi - phi_file)' P^-1 (phi - phi_file)

`n_j` counts rows that are independent (`MEMORY`), so that L is in nats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.regression.priors import LEAST_MASS, LENGTH, declares_inertia
from dynid_rs.sensors.arm import Arm
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
    """What is fitted of the links is `mean + root z`, z of variance one: no root is too thin, as an inverse would be.

    `mean` (n,), `root` (n, n); `std` (10 n_links,) of the links' own numbers.
    """

    mean: FloatArray
    root: FloatArray
    std: FloatArray
    arm: Arm

    @staticmethod
    def of(arm: Arm) -> ArmPrior:
        """What the robot file says."""
        phi = np.asarray(arm.robot.phi, dtype=np.float64)
        declared = declares_inertia(arm.robot)
        std = np.concatenate([_spread(link, declared=declared) for link in phi.reshape(-1, 10)])
        return ArmPrior(arm.regroup @ phi if declared else np.zeros(len(arm.pivots)), _root(arm, std), std, arm)

    def with_body(self) -> ArmPrior:
        """The prior with a body on the last link, which may weigh a tenth of the arm or take as much off it."""
        n, body = len(self.mean), self._body()
        root = np.zeros((n + len(body), n + len(body)))
        root[:n, :n], root[n:, n:] = self.root, np.diag(body)
        return replace(self, mean=np.concatenate([self.mean, np.zeros_like(body)]), root=root)

    def carrying(self) -> ArmPrior:
        """The prior of an arm whose last link may hold such a body all the time, with room for another one."""
        std, body = self.std.copy(), self._body()
        std[-10:] = np.hypot(std[-10:], body)
        return replace(self, root=_root(self.arm, std)).with_body()

    def _body(self) -> FloatArray:
        links = self.std.reshape(-1, 10)
        mass = BODY * float(links[:, 0].sum())
        reach = float(np.sqrt(np.max(links[:, 4:] / links[:, :1])))
        body: FloatArray = mass * np.array([1.0, *[reach] * 3, *[reach**2] * 6])
        return body


def _root(arm: Arm, std: FloatArray) -> FloatArray:
    """Root of the covariance of base parameters of links whose numbers are known to `std` (10 n_links,), each apart."""
    _, R = np.linalg.qr((arm.regroup * std).T)
    return R.T


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
    return fit_arms(prior, [runs], size)[0]


def fit_arms(prior: ArmPrior, tried: Sequence[Sequence[Moments]], size: FloatArray) -> list[ArmFit]:
    """`fit_arm` of the same runs as several changes have them, side by side: systems this small are mostly overhead.

    `size` (n_joints,) of all of them, or (n_tried, n_joints).
    """
    n = size.shape[-1]
    n_links = len(prior.mean)
    size = np.broadcast_to(size, (len(tried), n))
    columns = np.array([np.sum([run.columns for run in runs], axis=0) for runs in tried])
    cross = np.array([np.sum([run.cross[:, :, 0] for run in runs], axis=0) for runs in tried])
    power = np.array([np.sum([run.power[:, 0] for run in runs], axis=0) for runs in tried])
    counts = np.array([[run.count for run in runs] for runs in tried])
    count = np.maximum(counts.sum(axis=1), 1.0)
    n_tried, n_own = len(tried), columns.shape[2] - n_links
    total = n_links + n_own * n
    diagonal = np.arange(total)
    precision = np.ones((n_tried, total))
    # What friction, offset and rotor may be: as large as the torque.
    squares = np.diagonal(columns, axis1=2, axis2=3)[:, :, n_links:]
    norms = np.sqrt(np.maximum(squares / count[:, :, None], 1e-300))
    precision[:, n_links:] = (np.where(norms > 1e-100, norms / size[:, :, None], 1.0) ** 2).reshape(n_tried, -1)
    bounded = np.flatnonzero(diagonal >= n_links).reshape(n, n_own)[:, 1:].ravel()
    floor = (LEAST_NOISE * size) ** 2
    variance = 0.01 * size**2
    for _ in range(N_ROUNDS):
        H, b = _weighted(columns, cross, 1 / variance / MEMORY, n_links)
        b -= H[:, :, :n_links] @ prior.mean
        b[:, :n_links] = b[:, :n_links] @ prior.root
        H[:, :, :n_links] = H[:, :, :n_links] @ prior.root
        H[:, :n_links] = prior.root.T @ H[:, :n_links]
        H[:, diagonal, diagonal] += precision
        z = _bounded(H, b, bounded)
        x = np.concatenate([prior.mean + z[:, :n_links] @ prior.root.T, z[:, n_links:]], axis=1)
        at = np.empty((n_tried, n, n_links + n_own))
        at[:, :, :n_links], at[:, :, n_links:] = x[:, None, :n_links], x[:, n_links:].reshape(n_tried, n, n_own)
        left = _left(columns, cross, power, at)
        variance = np.maximum(left / count, floor)
    price = np.sum(precision * z**2, axis=1)
    log = -0.5 * np.sum(count / MEMORY * np.log(variance), axis=1) - 0.5 * price
    per_run = np.empty(counts.shape)
    for k in range(counts.shape[1]):  # one after the other: together they would be all that there is in memory
        A, b = (np.array([getattr(runs[k], name) for runs in tried]) for name in ("columns", "cross"))
        own_power = np.array([runs[k].power[:, 0] for runs in tried])
        per_run[:, k] = _left(A, b[..., 0], own_power, at) / np.maximum(counts[:, k], 1.0) / size**2
    share = left / count / size**2
    return [ArmFit(*found) for found in zip(x, share, variance, log.tolist(), per_run, strict=True)]


def _weighted(
    columns: FloatArray, cross: FloatArray, weight: FloatArray, n_links: int
) -> tuple[FloatArray, FloatArray]:
    """Normal equations of all joints: the links', then each joint's own."""
    (n_tried, n), own = weight.shape, slice(n_links, None)
    n_own = columns.shape[2] - n_links
    total = n_links + n_own * n
    weighted, moments = columns * weight[:, :, None, None], cross * weight[:, :, None]
    H = np.zeros((n_tried, total, total))
    H[:, :n_links, :n_links] = weighted[:, :, :n_links, :n_links].sum(axis=1)
    H[:, :n_links, own] = np.moveaxis(weighted[:, :, :n_links, own], 1, 2).reshape(n_tried, n_links, n_own * n)
    H[:, own, :n_links] = np.swapaxes(H[:, :n_links, own], 1, 2)
    at = n_links + np.arange(n_own * n).reshape(n, n_own)
    H[:, at[:, :, None], at[:, None, :]] = weighted[:, :, own, own]
    own_moments = moments[:, :, own].reshape(n_tried, -1)
    return H, np.concatenate([moments[:, :, :n_links].sum(axis=1), own_moments], axis=1)


def _left(A: FloatArray, b: FloatArray, power: FloatArray, x: FloatArray) -> FloatArray:
    """What coefficients x (..., n_joints, n) leave of every joint's power, (..., n_joints)."""
    taken = (A @ x[..., None])[..., 0]
    left: FloatArray = np.maximum(power + np.sum((taken - 2 * b) * x, axis=-1), 0.0)
    return left


def _bounded(H: FloatArray, b: FloatArray, bounded: NDArray[np.intp]) -> FloatArray:
    """Minima of ``x'Hx/2 - b'x`` with some coefficients not negative: those that would be are set to zero.

    H (n_tried, n, n), b (n_tried, n).
    """
    n = b.shape[1]
    scale = 1 / np.sqrt(np.diagonal(H, axis1=1, axis2=2))
    S, right = H * (scale[:, :, None] * scale[:, None, :]), scale * b
    S[:, np.arange(n), np.arange(n)] += 1e-12
    x = np.empty_like(b)
    open_ = np.arange(len(b))
    for _ in range(len(bounded)):
        x[open_] = scale[open_] * np.linalg.solve(S[open_], right[open_][:, :, None])[:, :, 0]
        negative = np.zeros((len(open_), n), dtype=bool)
        negative[:, bounded] = x[open_][:, bounded] < 0
        moved = negative.any(axis=1)
        open_, negative = open_[moved], negative[moved]
        if not len(open_):
            break
        # An unknown of its own, with nothing to explain.
        held, where = np.nonzero(negative)
        S[open_[held], where], S[open_[held], :, where], right[open_[held], where] = 0.0, 0.0, 0.0
        S[open_[held], where, where] = 1.0
    return x
