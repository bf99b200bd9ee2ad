"""Standard errors that stay honest when residuals are correlated in time.

``cov x = B (sum_j C_j' Gamma_j C_j) B'`` with ``x = B sum_j C_j' e_j``: the sandwich, with Gamma_j the residual's own
autocovariance. It is estimated with a flat-top lag window (Politis 2003, Econometric Reviews 22) and applied in the
frequency domain, where a Toeplitz matrix is a product.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.columns import Observations
from dynid_rs.links import LinkDynamicsIdentifier, block_residuals
from dynid_rs.memory import flat_top
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

WIDTH_STEP = 0.02
"""Relative step of the width's derivative."""
NORMAL_95 = 1.959963984540054
"""Two-sided 95 % of the normal distribution."""


def parameter_covariance(
    observations: Observations, links: LinkDynamicsIdentifier, runs: Sequence[States], *, fitted_widths: bool = True
) -> FloatArray:
    """Covariance of all unknowns (n_columns, n_columns); zeros for those that were not estimated.

    Friction's transition widths count as fitted beside the coefficients, or as known without `fitted_widths`. Where
    a ridge was used, this is the covariance without it: wider, because the ridge's bias is not in it. Thresholds and
    torque scales count as known, residuals of different joints as uncorrelated.

    Under a prior P of the inertials the truth is as far from its mean as it says: ``B (sum_j C_j' Gamma_j C_j + P) B``
    with ``B = (sum_j w_j C_j' C_j + P)^-1``.
    """
    plan = observations.plan
    n = plan.robot.n_joints
    weights = links.weights_**2
    if links.weighting == "full_covariance":
        weights = np.diag(np.linalg.inv(links.covariance_)) * links.worth_
    used = plan.estimable()
    columns = [_columns(observations, links, runs, j, used, fitted_widths) for j in range(n)]
    pull = _prior_rows(links, used, int(used.sum()) + n * fitted_widths)
    bread = _bread(columns, np.sqrt(weights), pull)
    residuals = _on_grid(observations, runs, block_residuals(observations, links.x_, links.torque_scale_))
    masks = _on_grid(observations, runs, [np.ones((block.n_rows, 1)) for block in observations.blocks])
    meat = pull.T @ pull
    for j, (places, grids) in enumerate(columns):
        own = np.ix_(places, places)
        noise = NoiseSpectrum(
            [run[:, j] for run in residuals], [run[:, 0] for run in masks], grids, weights[j] * bread[own]
        )
        meat[own] += weights[j] ** 2 * sum(toeplitz_product(run, noise.spectrum) for run in grids)
    covariance = np.zeros((plan.n_columns, plan.n_columns))
    n_used = int(used.sum())
    covariance[np.ix_(used, used)] = (bread @ meat @ bread)[:n_used, :n_used]
    return covariance


def _columns(
    observations: Observations,
    links: LinkDynamicsIdentifier,
    runs: Sequence[States],
    j: int,
    used: NDArray[np.bool_],
    fitted_widths: bool,
) -> tuple[NDArray[np.intp], list[FloatArray]]:
    """Columns that joint j's torque knows, on every run's grid, and their places among those of the whole fit.

    The fit's are the unknowns in use, then the torque's change with each joint's log width.
    """
    plan = observations.plan
    known = used[plan.unknowns(j)]
    places = (np.cumsum(used) - 1)[plan.unknowns(j)[known]]
    factor = np.where(np.arange(len(known)) < plan.n_own, 1.0, links.torque_scale_[j])[known]
    grids = _on_grid(observations, runs, [block.rows[j][:, :-1][:, known] * factor for block in observations.blocks])
    if not fitted_widths:
        return places, grids
    friction, own = plan.friction
    shape = dict(friction.shape)
    threshold, width = shape["velocity_threshold"][j], shape["transition_width"][j]
    coefficients = links.own_[j, own]
    widened = []
    for states, grid in zip(runs, grids, strict=True):
        speed = np.ascontiguousarray(states.dq_motor[:, j])
        low, high = (
            _core.filtered_friction_basis(speed, threshold, width * factor, filter=states.filter, kept=states.kept)
            for factor in (1 - WIDTH_STEP, 1 + WIDTH_STEP)
        )
        change = np.zeros(len(grid))
        change[states.moving[states.grid]] = (high - low) @ coefficients / (2 * WIDTH_STEP)
        widened.append(np.column_stack([grid, change]))
    return np.append(places, int(used.sum()) + j), widened


def _prior_rows(links: LinkDynamicsIdentifier, used: NDArray[np.bool_], width: int) -> FloatArray:
    """Root of the prior's precision in the columns in use, (rank, width); no rows without one."""
    if links.posterior_ is None:
        return np.zeros((0, width))
    rows = links.posterior_.pull[:, :-1][:, used]
    return np.pad(rows, ((0, 0), (0, width - rows.shape[1])))


def _bread(
    columns: Sequence[tuple[NDArray[np.intp], list[FloatArray]]], root_weights: FloatArray, pull: FloatArray
) -> FloatArray:
    """``(sum_j w_j C_j' C_j + P)^-1`` (width, width) through a triangular factor; `pull` is a root of P."""
    factors = [pull]
    for root_weight, (places, grids) in zip(root_weights, columns, strict=True):
        own = _core.merge_factors([_core.triangular_factor(root_weight * run) for run in grids])
        wide = np.zeros((len(own), pull.shape[1]))
        wide[:, places] = own
        factors.append(wide)
    system = _core.triangular_factor(np.concatenate(factors))
    norms = np.linalg.norm(system, axis=0)
    norms[norms == 0] = 1.0
    _, s, vt = np.linalg.svd(system / norms, full_matrices=False)
    inverse = np.where(s > 1e-12 * s[0], 1 / np.maximum(s**2, 1e-300), 0.0)
    bread: FloatArray = (vt.T * inverse) @ vt / np.outer(norms, norms)
    return bread


class NoiseSpectrum:
    """Spectrum of one joint's noise, from its residual and from what the fit took away with it.

    The fit takes noise away where the columns have their power (at low frequencies): of a line's power, the leverage
    ``h(f) = w a(f)* B a(f)``, a(f) the transform of the columns. Residual and leverage are smoothed alike, then
    ``S = S_residual / (1 - h / n)^2``: once is unbiased, twice is what leaving samples out would give (the
    jackknife, HC3 of MacKinnon and White 1985), and makes up for shapes and weights that were fitted too. `max_lag`
    keeps the spectrum smooth where many columns share a narrow band, which would have taken all of its noise away.
    """

    def __init__(
        self,
        residuals: Sequence[FloatArray],
        masks: Sequence[FloatArray],
        columns: Sequence[FloatArray],
        weighted_bread: FloatArray,
        power: int = 2,
        max_lag: int | None = None,
    ) -> None:
        from scipy.fft import irfft, next_fast_len, rfft

        longest = max(map(len, residuals))
        sums, pairs, taken = np.zeros(longest), np.zeros(longest), np.zeros(longest)
        for residual, mask, column in zip(residuals, masks, columns, strict=True):
            n = len(residual)
            size = next_fast_len(2 * n)
            sums[:n] += irfft(np.abs(rfft(residual, size)) ** 2, size)[:n]
            pairs[:n] += irfft(np.abs(rfft(mask, size)) ** 2, size)[:n]
            lines = rfft(column, size, axis=0)
            leverage = np.sum((lines.real @ weighted_bread) * lines.real, axis=1)
            leverage += np.sum((lines.imag @ weighted_bread) * lines.imag, axis=1)
            taken[:n] += irfft(leverage, size)[:n]
        covariances = sums / np.maximum(np.round(pairs), 1.0)
        taper = flat_top(covariances[:max_lag], float(pairs[0]))
        self._power = power
        self._covariances = covariances[: len(taper)] * taper
        self._taken = taken[: len(taper)] * taper / pairs[0]

    def spectrum(self, size: int) -> FloatArray:
        """Power per line of a real transform of length `size`."""
        from scipy.fft import rfft

        residual = 2 * rfft(self._covariances, size).real - self._covariances[0]
        taken = 2 * rfft(self._taken, size).real - self._taken[0]
        spectrum: FloatArray = np.maximum(residual, 0.0) / np.maximum(1 - taken, 0.1) ** self._power
        return spectrum


def toeplitz_product(columns: FloatArray, spectrum: Callable[[int], FloatArray]) -> FloatArray:
    """``C' Gamma C`` for C (n, p) and the Toeplitz matrix with this spectrum."""
    from scipy.fft import next_fast_len, rfft

    size = next_fast_len(2 * len(columns))
    # rfft holds each inner line once for its pair.
    twice = np.full(size // 2 + 1, 2.0)
    twice[0] = 1.0
    if size % 2 == 0:
        twice[-1] = 1.0
    transformed = rfft(columns, size, axis=0)
    scaled = transformed * (spectrum(size) * twice / size)[:, None]
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


def noise_products(
    observations: Observations,
    runs: Sequence[States],
    residuals: Sequence[FloatArray],
    columns: Sequence[Sequence[FloatArray]],
    weighted_breads: Sequence[FloatArray],
    *,
    power: int = 1,
) -> list[FloatArray]:
    """``C_j' Gamma_j C_j`` (k, k) of every joint, Gamma_j its noise's own autocovariance, estimated without bias.

    Parameters
    ----------
    residuals : per block (n_rows, n_joints)
        What a fit leaves.
    columns : per joint and block (n_rows, k)
        C_j. The first of them are those of the fit.
    weighted_breads : per joint
        ``w_j (sum w C' C)^-1`` of the fit, in the places of its columns.
    power : int
        As for `grid_noise_products`.
    """
    left = _on_grid(observations, runs, residuals)
    masks = [mask[:, 0] for mask in _on_grid(observations, runs, [np.ones((len(part), 1)) for part in residuals])]
    grids = [_on_grid(observations, runs, parts) for parts in columns]
    return grid_noise_products(left, masks, grids, weighted_breads, power=power)


def grid_noise_products(
    residuals: Sequence[FloatArray],
    masks: Sequence[FloatArray],
    columns: Sequence[Sequence[FloatArray]],
    weighted_breads: Sequence[FloatArray],
    *,
    power: int = 1,
) -> list[FloatArray]:
    """As `noise_products`, on every run's full grid: zeros where `masks` (n_grid,) is zero.

    `power` 2 makes up for shapes and weights that were fitted too (`NoiseSpectrum`).

    Parameters
    ----------
    residuals : per run (n_grid, n_joints)
        What a fit leaves.
    columns : per joint and run (n_grid, k)
        C_j.
    """
    products = []
    for j, bread in enumerate(weighted_breads):
        fitted = [grid[:, : len(bread)] for grid in columns[j]]
        noise = NoiseSpectrum([run[:, j] for run in residuals], masks, fitted, bread, power=power)
        products.append(np.sum([toeplitz_product(run, noise.spectrum) for run in columns[j]], axis=0))
    return products
