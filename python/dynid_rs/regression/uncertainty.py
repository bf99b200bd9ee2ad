"""Standard errors that stay honest when residuals are correlated in time.

``cov x = B (sum_j C_j' Gamma_j C_j) B'`` with ``x = B sum_j C_j' e_j``: the sandwich, with Gamma_j the residual's own
autocovariance (`noise_spectrum.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.regression.fitted import FittedLinks
from dynid_rs.regression.kept_columns import effect_rows
from dynid_rs.regression.noise_spectrum import NoiseSpectrum, counted_rows, on_grid, toeplitz_product
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
        self._residuals = on_grid(observations, runs, block_residuals(observations, links.x_, links.torque_scale_))
        self._masks = on_grid(observations, runs, counted_rows(observations))

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
    grids = on_grid(observations, runs, [block.rows[j][:, :-1][:, known] * factor for block in observations.blocks])
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
