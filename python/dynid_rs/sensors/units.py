"""Torque in another unit, amperes among them: gains of the channels that the arm's model asks for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import MEMORY, ArmFit, fit_arms
from dynid_rs.sensors.rows import N_OWN

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

N_ROUNDS = 8
LEAST_SHARE = 0.01
"""Of the power of the links' torque: where less is left beside the joint's own columns, as on a lone upright axis, the
rotor could be all of it, and no gain is told."""


def unit_trials(bench: Bench) -> Iterator[tuple[Trial, FloatArray, bool]]:
    """Gains [N m per what was recorded] of every channel, in all runs or in one; with the gains (n_joints,).

    The last one says whether one joint at most tells a gain, which the others have got from it.
    """
    for runs in bench.places:
        [(fit, gains)], told = _gains([bench], runs)
        yield Trial("torque_unit", tuple(range(len(gains))), runs, fit), gains, bool(1 >= told.sum() < len(gains))


def unit_fits(benches: Sequence[Bench]) -> list[tuple[ArmFit, FloatArray]]:
    """Fits with gains [N m/A] of all channels (n_joints,), where every joint has one of its own for certain.

    The same runs on all benches.
    """
    return _gains(benches, range(len(benches[0].plain)))[0]


def _gains(benches: Sequence[Bench], runs: Sequence[int]) -> tuple[list[tuple[ArmFit, FloatArray]], BoolArray]:
    """Fit links and gains of several benches in turn, from what the robot file predicts.

    With the channels (n_benches, n_joints) that what is predicted told a gain of: what is fitted beside the gain of
    another joint tells the same one.
    """
    first = benches[0]
    n, n_runs = first.robot.n_joints, len(first.plain)
    gains = np.ones((len(benches), n))
    rest = [k for k in range(n_runs) if k not in runs]
    if rest:  # the other runs tell more than any file
        x = [bench.fitted([bench.plain[k] for k in rest]).x for bench in benches]
    elif not np.any(first.prior.mean):
        x = [bench.fit.x for bench in benches]
    else:
        x = [np.concatenate([bench.prior.mean, np.zeros(N_OWN * n)]) for bench in benches]
    columns = np.array([np.sum([bench.plain[k].columns for k in runs], axis=0) for bench in benches])
    cross = np.array([np.sum([bench.plain[k].cross[:, :, 0] for k in runs], axis=0) for bench in benches])
    best: list[tuple[ArmFit, FloatArray]] = []
    from_file: BoolArray | None = None
    for _ in range(N_ROUNDS):
        told = _told(columns, cross, np.array(x)[:, : len(first.prior.mean)])
        from_file = ~np.isnan(told) if from_file is None else from_file
        gains = np.where(np.isnan(told).all(axis=1, keepdims=True), gains, told)
        # A channel that says nothing is in the unit of the others.
        gains = np.where(np.isnan(gains), np.nanmedian(gains, axis=1, keepdims=True), gains)
        tried = [
            [bench.moments[k].picked(range(n), own) if k in runs else bench.plain[k] for k in range(n_runs)]
            for bench, own in zip(benches, gains, strict=True)
        ]
        fits = fit_arms(first.prior, tried, first.size * (1.0 if rest else gains))
        x = [fit.x for fit in fits]
        # Densities of what was recorded, not of what it would be in N m.
        stretched = np.log(gains) @ np.sum([first.plain[k].count for k in runs], axis=0) / MEMORY
        fits = [replace(fit, log=fit.log + float(more)) for fit, more in zip(fits, stretched, strict=True)]
        now = list(zip(fits, gains, strict=True))
        best = [max(pair, key=lambda one: one[0].log) for pair in zip(best or now, now, strict=True)]
    return best, np.asarray(from_file)


def _told(columns: FloatArray, cross: FloatArray, phi: FloatArray) -> FloatArray:
    """Power of the links' torque over its product with the channel, beside the joint's own columns; NaN: not told.

    columns (n_benches, n_joints, n, n), cross (n_benches, n_joints, n), phi (n_benches, n_base): gains (n_benches,
    n_joints).
    """
    n_links = phi.shape[1]
    links, own = slice(n_links), slice(n_links, None)
    # Regress the links' torque and the channel on the own columns, and compare what is left.
    A = columns[:, :, own, own].copy()
    at = np.arange(A.shape[-1])
    A[..., at, at] += 1e-9 * np.maximum(A[..., at, at], 1e-300)
    load, beside = np.split(columns[..., links] @ phi[:, None, :, None], [n_links], axis=2)
    whole = (phi[:, None, None] @ load)[..., 0, 0]
    explained = np.linalg.solve(A, beside)[..., 0]
    power = whole - np.sum(explained * beside[..., 0], axis=-1)
    common = np.sum(phi[:, None] * cross[..., links], axis=-1) - np.sum(explained * cross[..., own], axis=-1)
    is_told = (power > LEAST_SHARE * whole) & (common > 0)
    gains: FloatArray = np.where(is_told, np.clip(power / np.where(is_told, common, 1.0), 1e-6, 1e6), np.nan)
    return gains
