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
from dynid_rs.base.memory import flat_top
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.regression.fitted import FittedLinks
from dynid_rs.regression.kept_columns import effect_rows
from dynid_rs.regression.scales import SCALE_SPREAD, Gains
from dynid_rs.regression.systems import block_residuals
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WIDTH_STEP = 0.02
"""Relative step of the width's derivative."""
NORMAL_95 = 1.959963984540054
"""Two-sided 95 % of the normal distribution."""


def parameter_covariance(
    observations: Observations,
    links: FittedLinks,
    runs: Sequence[States],
    *,
    fitted_widths: bool = True,
    gains: Gains | None = None,
) -> FloatArray:
    """Covariance of all unknowns (n_columns, n_columns); zeros for those that were not estimated.

    Friction's transition widths count as fitted beside the coefficients, or as known without `fitted_widths`; so do the
    torque channels' `gains`, whose logarithms (n_joints,) come last then, or as known without. Where a ridge was used,
    this is the covariance without it: wider, because the ridge's bias is not in it. Thresholds count as known,
    residuals of different joints as uncorrelated.

    Rows that stood beside the runs' are as noisy as the fit leaves them, and remember as long as the joint's noise.

    Under a prior P of the inertials the truth is as far from its mean as it says: ``B (sum_j C_j' Gamma_j C_j + P) B``
    with ``B = (sum_j w_j C_j' C_j + P)^-1``.
    """
    fit = _Weighed(observations, links, runs, fitted_widths, gains)
    meat, noises = fit.pull.T @ fit.pull, [fit.noise(j) for j in range(observations.plan.robot.n_joints)]
    for j, ((places, grids), noise) in enumerate(zip(fit.columns, noises, strict=True)):
        products = sum(toeplitz_product(run, noise.spectrum) for run in grids)
        meat[np.ix_(places, places)] += fit.weights[j] ** 2 * products
    meat += _noise_beside(fit.beside, noises)
    return _of_all_unknowns(fit.bread @ meat @ fit.bread, fit.used, gains)


def noise_spectra(
    observations: Observations, links: FittedLinks, runs: Sequence[States], gains: Gains | None = None
) -> list[NoiseSpectrum]:
    """Spectrum of every joint's noise, as `parameter_covariance` takes it."""
    fit = _Weighed(observations, links, runs, fitted_widths=True, gains=gains)
    return [fit.noise(j) for j in range(observations.plan.robot.n_joints)]


def covariance_of_products(
    plan: Plan,
    links: FittedLinks,
    factors: Sequence[FloatArray],
    products: Sequence[FloatArray],
    *,
    noises: Sequence[NoiseSpectrum],
    gains: Gains | None = None,
) -> FloatArray:
    """`parameter_covariance` without the rows: from every joint's factor and its ``C_j' Gamma_j C_j`` (k, k).

    Both in the columns ``[own | base | width_slope]`` of the joint, k of them, torque scales not applied; `noises` are
    what Gamma_j is of.
    """
    used, weights = plan.estimable(), row_weights(links)
    n, n_used = plan.robot.n_joints, int(used.sum())
    pull = prior_rows(links, used, n_used + n, gains)
    stacked, meat = [pull], pull.T @ pull
    for j, (R, product) in enumerate(zip(factors, products, strict=True)):
        known, at, factor = _known_columns(plan, links, j, used)
        kept, places = np.append(known, True), np.append(at, n_used + j)
        across = np.diag(np.append(factor, 1.0))
        if gains is not None and gains.joints[j]:
            places = np.append(places, n_used + n + j)
            across = np.column_stack([across, across @ np.append(_load(plan, links, j, known), 0.0)])
        wide = np.zeros((len(R), pull.shape[1]))
        wide[:, places] = np.sqrt(weights[j]) * R[:, kept] @ across
        stacked.append(wide)
        meat[np.ix_(places, places)] += weights[j] ** 2 * (across.T @ product[np.ix_(kept, kept)] @ across)
    beside = _rows_beside(plan, links, used, n_used + n, pull.shape[1], gains)
    meat += _noise_beside(beside, noises)
    bread = _inverse(np.concatenate([*stacked, *(rows for rows, _, _ in beside)]))
    return _of_all_unknowns(bread @ meat @ bread, used, gains)


def row_weights(links: FittedLinks) -> FloatArray:
    """Weight of every joint's squared residual, (n_joints,)."""
    if links.weighting == "full_covariance":
        weights: FloatArray = np.diag(np.linalg.inv(links.covariance_)) * links.worth_
        return weights
    return links.weights_**2


def _of_all_unknowns(covariance: FloatArray, used: BoolArray, gains: Gains | None) -> FloatArray:
    """Covariance among all unknowns from that of the ones in use, which come first; zeros for the others.

    With `gains` it ends with their logarithms (n_joints,) and the unit's, which is left out.
    """
    kept = np.arange(int(used.sum()))
    if gains is not None:
        first = len(covariance) - 1 - len(gains.joints)
        used, kept = np.append(used, gains.joints), np.append(kept, first + np.flatnonzero(gains.joints))
    whole = np.zeros((len(used), len(used)))
    whole[np.ix_(used, used)] = covariance[np.ix_(kept, kept)]
    return whole


class _Weighed:
    """A fit's columns on every run's grid, their weights, and the inverse of their weighted sum of squares."""

    def __init__(
        self,
        observations: Observations,
        links: FittedLinks,
        runs: Sequence[States],
        fitted_widths: bool,
        gains: Gains | None = None,
    ) -> None:
        plan = observations.plan
        n = plan.robot.n_joints
        self.weights = row_weights(links)
        self.used = plan.estimable()
        shapes = int(self.used.sum()) + n * fitted_widths
        self.columns = [_columns(observations, links, runs, j, self.used, fitted_widths) for j in range(n)]
        for j in [] if gains is None else np.flatnonzero(gains.joints).tolist():
            self.columns[j] = _with_gain(plan, links, j, self.used, self.columns[j], shapes + j)
        self.pull = prior_rows(links, self.used, shapes, gains)
        self.beside = _rows_beside(plan, links, self.used, shapes, self.pull.shape[1], gains)
        held = np.concatenate([self.pull, *(rows for rows, _, _ in self.beside)])
        self.bread = _bread(self.columns, np.sqrt(self.weights), held)
        self._residuals = _on_grid(observations, runs, block_residuals(observations, links.x_, links.torque_scale_))
        self._masks = _on_grid(observations, runs, _counted(observations))

    def noise(self, j: int) -> NoiseSpectrum:
        """Spectrum of joint j's noise."""
        places, grids = self.columns[j]
        bread = self.weights[j] * self.bread[np.ix_(places, places)]
        return NoiseSpectrum([run[:, j] for run in self._residuals], [run[:, j] for run in self._masks], grids, bread)


def _columns(
    observations: Observations,
    links: FittedLinks,
    runs: Sequence[States],
    j: int,
    used: NDArray[np.bool_],
    fitted_widths: bool,
) -> tuple[NDArray[np.intp], list[FloatArray]]:
    """Columns that joint j's torque knows, on every run's grid, and their places among those of the whole fit.

    The fit's are the unknowns in use, then the torque's change with each joint's log width.
    """
    plan = observations.plan
    known, places, factor = _known_columns(plan, links, j, used)
    grids = _on_grid(observations, runs, [block.rows[j][:, :-1][:, known] * factor for block in observations.blocks])
    if not fitted_widths:
        return places, grids
    coefficients = links.own_[j, plan.friction[1]]
    widened = []
    for states, grid in zip(runs, grids, strict=True):
        change = np.zeros(len(grid))
        change[states.moving[states.grid]] = width_slope(plan, states, j, coefficients)
        widened.append(np.column_stack([grid, change]))
    return np.append(places, int(used.sum()) + j), widened


def _with_gain(
    plan: Plan,
    links: FittedLinks,
    j: int,
    used: BoolArray,
    columns: tuple[NDArray[np.intp], list[FloatArray]],
    place: int,
) -> tuple[NDArray[np.intp], list[FloatArray]]:
    """`_columns` of joint j, and the torque's change with the logarithm of its channel's gain at `place`."""
    places, grids = columns
    known, at, _ = _known_columns(plan, links, j, used)
    load = _load(plan, links, j, known)
    return np.append(places, place), [np.column_stack([grid, grid[:, : len(at)] @ load]) for grid in grids]


def _rows_beside(
    plan: Plan, links: FittedLinks, used: BoolArray, first_gain: int, width: int, gains: Gains | None
) -> list[tuple[FloatArray, int, float]]:
    """Rows (n, width) that stood beside the training runs' in the fit, with their joint and what is left of one."""
    found = []
    for group in links.beside_:
        for j, (R, power) in enumerate(zip(group.rows, group.power.tolist(), strict=True)):
            known, at, factor = _known_columns(plan, links, j, used)
            rows = np.zeros((len(R), width))
            rows[:, at] = R[:, :-1][:, known] * factor
            if gains is not None and gains.joints[j]:
                rows[:, first_gain + j] = rows[:, at] @ _load(plan, links, j, known)
            found.append((rows, j, power))
    return found


def _noise_beside(beside: Sequence[tuple[FloatArray, int, float]], noises: Sequence[NoiseSpectrum]) -> FloatArray:
    """``C' Gamma C`` of `_rows_beside`: of their own size, remembering as long as the joint's noise does."""
    products = [power * noises[j].memory * (rows.T @ rows) for rows, j, power in beside]
    total: FloatArray = np.sum(products, axis=0)
    return total


def _load(plan: Plan, links: FittedLinks, j: int, known: BoolArray) -> FloatArray:
    """Coefficients of joint j's known columns that make its links' torque, (n_known,): zero for its own."""
    x = np.where(np.arange(len(known)) < plan.n_own, 0.0, links.x_[plan.unknowns(j)])
    load: FloatArray = x[known]
    return load


def _known_columns(
    plan: Plan, links: FittedLinks, j: int, used: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.intp], FloatArray]:
    """Which of joint j's columns ``[own | base]`` are in use, their places among those in use, their scale."""
    known = used[plan.unknowns(j)]
    places = (np.cumsum(used) - 1)[plan.unknowns(j)[known]]
    factor = np.where(np.arange(len(known)) < plan.n_own, 1.0, links.torque_scale_[j])[known]
    return known, places, factor


def width_slope(plan: Plan, states: States, j: int, coefficients: FloatArray) -> FloatArray:
    """Change of joint j's filtered friction with the logarithm of its width, (n_rows,)."""
    slope: FloatArray = law_slopes(plan.friction[0], states, j, coefficients)[:, 0]
    return slope


def law_slopes(friction: _core.Effect, states: States, j: int, coefficients: FloatArray) -> FloatArray:
    """Change of a law's filtered torque on joint j with the logarithm of each shape parameter, (n_rows, k).

    Width first, then the sharpness where it has one; of the paper's law by a central difference. Zero where the joint
    rests.
    """
    shape = {name: np.array(values, dtype=np.float64) for name, values in friction.shape}
    width = shape["transition_width"]
    if "sharpness" in shape:
        own = float(width[j]), float(shape["sharpness"][j])
        speed = np.ascontiguousarray(states.dq_motor[:, j])
        sign = _core.sign_slopes(speed, *own, filter=states.filter, kept=states.kept)
        slopes = sign.reshape(-1, 2, 2) @ coefficients[:2]  # of s and |s|, which the first two are the sizes of
    else:
        wider, narrower = (
            effect_rows(_core.Effect.of(friction.kind, **shape | {"transition_width": width * factor}), states, j)
            for factor in (1 + WIDTH_STEP, 1 - WIDTH_STEP)
        )
        slopes = ((wider - narrower) @ coefficients / (2 * WIDTH_STEP))[:, None]
    result: FloatArray = slopes * states.counted[:, [j]]
    return result


def prior_rows(links: FittedLinks, used: NDArray[np.bool_], width: int, gains: Gains | None = None) -> FloatArray:
    """Root of the prior's precision in the columns in use, (rank, width); no rows without one.

    Behind them, where `gains` were fitted, stand the logarithms of all joints' and of the unit: of the former is known
    what the fit takes for known, of the latter nothing.
    """
    rows = np.zeros((0, width))
    if links.posterior_ is not None:
        rows = links.posterior_.pull[:, :-1][:, used]
        rows = np.pad(rows, ((0, 0), (0, width - rows.shape[1])))
    if gains is None:
        return rows
    n, unit = len(gains.joints), np.zeros((len(rows), 1))
    if links.posterior_ is not None and gains.unit:
        unit = -links.posterior_.pull[:, -1:]
    held = np.pad(np.diag(gains.joints / SCALE_SPREAD), ((0, 0), (width, 1)))
    return np.concatenate([np.column_stack([rows, np.zeros((len(rows), n)), unit]), held])


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
    return _inverse(np.concatenate(factors))


def _inverse(rows: FloatArray) -> FloatArray:
    """``(A' A)^-1`` of rows A; directions that they do not hold stay zero."""
    system = _core.triangular_factor(rows)
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
    jackknife, HC3 of MacKinnon and White 1985), and makes up for shapes and weights that were fitted too.
    """

    def __init__(
        self,
        residuals: Sequence[FloatArray],
        masks: Sequence[FloatArray],
        columns: Sequence[FloatArray],
        weighted_bread: FloatArray,
        power: int = 2,
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
        n_counted = max(float(pairs[0]), 1.0)  # a joint that rests has none
        taper = flat_top(covariances, n_counted)
        self._power = power
        self._covariances = covariances[: len(taper)] * taper
        self._taken = taken[: len(taper)] * taper / n_counted

    @property
    def memory(self) -> float:
        """Rows that an independent one is worth: power at frequency zero over the mean; at least one."""
        left = self._covariances
        return max(1.0, float(2 * left.sum() / left[0] - 1)) if left[0] > 0 else 1.0

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


def _counted(observations: Observations) -> list[FloatArray]:
    """Ones where a joint moves, zeros where it rests, per block (n_rows, n_joints)."""
    return [block.counted.astype(np.float64) for block in observations.blocks]


def noise_products(
    observations: Observations,
    runs: Sequence[States],
    residuals: Sequence[FloatArray],
    columns: Sequence[Sequence[FloatArray]],
    weighted_breads: Sequence[FloatArray],
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
    """
    left = _on_grid(observations, runs, residuals)
    masks = _on_grid(observations, runs, _counted(observations))
    grids = [_on_grid(observations, runs, parts) for parts in columns]
    return grid_noise_products(left, masks, grids, weighted_breads)


def grid_noise_products(
    residuals: Sequence[FloatArray],
    masks: Sequence[FloatArray],
    columns: Sequence[Sequence[FloatArray]],
    weighted_breads: Sequence[FloatArray],
    *,
    power: int = 1,
) -> list[FloatArray]:
    """As `noise_products`, on every run's full grid: zeros where `masks` (n_grid, n_joints) is zero.

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
        noise = NoiseSpectrum([run[:, j] for run in residuals], [m[:, j] for m in masks], fitted, bread, power=power)
        products.append(np.sum([toeplitz_product(run, noise.spectrum) for run in columns[j]], axis=0))
    return products
