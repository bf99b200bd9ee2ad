"""Torque in another unit, amperes among them: gains of the channels that the arm's model asks for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import MEMORY, ArmFit
from dynid_rs.sensors.rows import N_OWN

FloatArray = NDArray[np.float64]

N_ROUNDS = 8
LEAST_SHARE = 0.01
"""Of the power of the links' torque: where less is left beside the joint's own columns, as on a lone upright axis, the
rotor could be all of it, and no gain is told."""


def unit_trials(bench: Bench) -> Iterator[tuple[Trial, FloatArray]]:
    """Gains [N m per what was recorded] of every channel, in all runs or in one; with the gains (n_joints,)."""
    for runs in bench.places:
        fit, gains = _gains(bench, runs)
        yield Trial("torque_unit", tuple(range(len(gains))), runs, fit), gains


def unit_fit(bench: Bench) -> tuple[ArmFit, FloatArray]:
    """Fit with gains [N m/A] of all channels (n_joints,), where every joint has one of its own for certain."""
    return _gains(bench, range(len(bench.plain)))


def _gains(bench: Bench, runs: Sequence[int]) -> tuple[ArmFit, FloatArray]:
    """Fit links and gains in turn, from what the robot file predicts."""
    n = bench.robot.n_joints
    gains = np.ones(n)
    x = np.concatenate([bench.prior.mean, np.zeros(N_OWN * n)])
    rest = [k for k in range(len(bench.plain)) if k not in runs]
    if rest:  # the other runs tell more than any file
        x = bench.fitted([bench.plain[k] for k in rest]).x
    elif not np.any(bench.prior.mean):
        x = bench.fit.x
    best: tuple[ArmFit, FloatArray] | None = None
    for _ in range(N_ROUNDS):
        told = np.array([_gain(bench, runs, x, j) for j in range(n)])
        if np.isnan(told).all():
            told = gains
        # A channel that says nothing is in the unit of the others.
        gains = np.where(np.isnan(told), np.nanmedian(told), told)
        tried = [
            bench.moments[k].picked(range(n), gains) if k in runs else plain for k, plain in enumerate(bench.plain)
        ]
        scale = gains if not rest else np.ones(n)
        fit = bench.fitted(tried, bench.size * scale)
        x = fit.x
        # Densities of what was recorded, not of what it would be in N m.
        stretched = sum(bench.plain[k].count @ np.log(gains) for k in runs) / MEMORY
        fit = ArmFit(fit.x, fit.share, fit.variance, fit.log + float(stretched), fit.run_shares)
        if best is None or fit.log > best[0].log:
            best = fit, gains
    assert best is not None
    return best


def _gain(bench: Bench, runs: Sequence[int], x: FloatArray, j: int) -> float:
    """Power of the links' torque over its product with the channel, beside the joint's own columns; NaN: not told."""
    n_links = len(bench.prior.mean)
    columns = np.sum([bench.plain[k].columns[j] for k in runs], axis=0)
    cross = np.sum([bench.plain[k].cross[j, :, 0] for k in runs], axis=0)
    phi = x[:n_links]
    own = np.arange(n_links, n_links + N_OWN)
    # Regress the links' torque and the channel on the own columns, and compare what is left.
    A = columns[np.ix_(own, own)]
    A = A + 1e-9 * np.diag(np.maximum(np.diag(A), 1e-300))
    load = columns[:n_links, :n_links] @ phi
    beside = columns[own][:, :n_links] @ phi
    whole = float(phi @ load)
    power = whole - float(beside @ np.linalg.solve(A, beside))
    common = float(phi @ cross[:n_links] - beside @ np.linalg.solve(A, cross[own]))
    if power <= LEAST_SHARE * whole or common <= 0:
        return np.nan
    return float(np.clip(power / common, 1e-6, 1e6))
