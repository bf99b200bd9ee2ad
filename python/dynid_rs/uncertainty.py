"""Standard errors that stay honest when residuals are correlated in time.

``cov x = B (sum_j C_j' Gamma_j C_j) B'`` with ``x = B sum_j C_j' e_j``: the sandwich, with Gamma_j the residual's own
autocovariance. It is estimated with a flat-top lag window (Politis 2003, Econometric Reviews 22) and applied in the
frequency domain, where a Toeplitz matrix is a product.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.columns import Observations
from dynid_rs.links import LinkDynamicsIdentifier, block_residuals, stack, stack_one
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
"""Two-sided 95 % of the normal distribution."""


def parameter_covariance(
    observations: Observations, links: LinkDynamicsIdentifier, runs: Sequence[States]
) -> FloatArray:
    """Covariance of all unknowns (n_columns, n_columns); zeros for those that were not estimated.

    Ridge and torque scales count as known. Residuals of different joints count as uncorrelated.
    """
    plan = observations.plan
    n = plan.robot.n_joints
    weights = np.diag(np.linalg.inv(links.covariance_)) if links.weighting == "full_covariance" else links.weights_**2
    used = plan.estimable()
    bread = _bread(observations, links, np.sqrt(weights), used)
    residuals = _on_grid(observations, runs, block_residuals(observations, links.x_, links.torque_scale_))
    masks = _on_grid(observations, runs, [np.ones((block.n_rows, 1)) for block in observations.blocks])
    meat = np.zeros_like(bread)
    for j in range(n):
        wide = [stack_one(plan, j, block.rows[j], links.torque_scale_)[:, :-1][:, used] for block in observations.blocks]
        columns = _on_grid(observations, runs, wide)
        covariances = autocovariance([run[:, j] for run in residuals], [run[:, 0] for run in masks])
        part = sum(_toeplitz_product(run, covariances) for run in columns)
        # Fitting took this share of the residual's power with it.
        n_rows = sum(run.sum() for run in masks)
        taken = weights[j] * np.trace(bread @ part) / (n_rows * covariances[0]) if covariances[0] > 0 else 0.0
        meat += weights[j] ** 2 * part / (1 - min(taken, 0.9))
    covariance = np.zeros((plan.n_columns, plan.n_columns))
    covariance[np.ix_(used, used)] = bread @ meat @ bread
    return covariance


def _bread(
    observations: Observations, links: LinkDynamicsIdentifier, root_weights: FloatArray, used: NDArray[np.bool_]
) -> FloatArray:
    plan = observations.plan
    system = stack(plan, observations.factors(), root_weights, links.torque_scale_)[:, :-1][:, used]
    norms = np.linalg.norm(system, axis=0)
    norms[norms == 0] = 1.0
    _, s, vt = np.linalg.svd(system / norms, full_matrices=False)
    inverse = np.where(s > 1e-12 * s[0], 1 / (s**2 + (links.ridge_ * s[0]) ** 2 + 1e-300), 0.0)
    bread: FloatArray = (vt.T * inverse) @ vt / np.outer(norms, norms)
    return bread


def autocovariance(series: Sequence[FloatArray], masks: Sequence[FloatArray]) -> FloatArray:
    """Windowed autocovariances at lags 0, 1, ..., pooled over runs; gaps are zeros in `series` and in `masks`."""
    from scipy.fft import irfft, next_fast_len, rfft

    longest = max(map(len, series))
    sums, pairs = np.zeros(longest), np.zeros(longest)
    for x, mask in zip(series, masks, strict=True):
        size = next_fast_len(2 * len(x))
        sums[: len(x)] += irfft(np.abs(rfft(x, size)) ** 2, size)[: len(x)]
        pairs[: len(x)] += irfft(np.abs(rfft(mask, size)) ** 2, size)[: len(x)]
    gamma = sums / np.maximum(np.round(pairs), 1.0)
    if gamma[0] <= 0:
        return gamma[:1]
    return _flat_top(gamma, float(pairs[0]))


def _flat_top(gamma: FloatArray, n_samples: float) -> FloatArray:
    """Lags up to twice the last one whose correlation is not noise, the farther half tapered."""
    bound = 2 * np.sqrt(np.log10(n_samples) / n_samples)
    small = np.abs(gamma / gamma[0]) < bound
    quiet = 5
    last = next((k for k in range(1, len(gamma) - quiet) if small[k : k + quiet].all()), 1) - 1
    window = max(2 * last, 1)
    window = min(window, len(gamma) - 1, int(n_samples / 4))
    lags = np.arange(window + 1)
    taper = np.clip(2 * (1 - lags / (window + 1)), 0, 1)
    return gamma[: window + 1] * taper


def _toeplitz_product(columns: FloatArray, covariances: FloatArray) -> FloatArray:
    """``C' Gamma C`` for C (n, p) and the Toeplitz matrix of `covariances`; negative spectral lines count as none."""
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(len(columns) + len(covariances))
    spectrum = 2 * rfft(covariances, size).real - covariances[0]
    spectrum = np.maximum(spectrum, 0.0)
    # rfft holds each inner line once for its pair.
    twice = np.full(len(spectrum), 2.0)
    twice[0] = 1.0
    if size % 2 == 0:
        twice[-1] = 1.0
    transformed = rfft(columns, size, axis=0)
    scaled = transformed * (spectrum * twice / size)[:, None]
    product: FloatArray = scaled.real.T @ transformed.real + scaled.imag.T @ transformed.imag
    return product


def _on_grid(observations: Observations, runs: Sequence[States], parts: Sequence[FloatArray]) -> list[FloatArray]:
    """Rows of every block back on the run's full grid, zeros where standstill was left out."""
    grids = []
    for k, states in enumerate(runs):
        rows = np.concatenate([part for block, part in zip(observations.blocks, parts, strict=True) if block.run == k])
        grid = np.zeros((len(states.grid), rows.shape[1]))
        grid[states.moving[states.grid]] = rows
        grids.append(grid)
    return grids
