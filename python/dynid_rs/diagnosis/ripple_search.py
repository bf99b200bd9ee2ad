"""Lines in the angle domain, one after another: the strongest that nothing else explains, until none is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.angle_data import AngleRun
from dynid_rs.diagnosis.order_spectrum import (
    LEAST_ORDER,
    MOST_ORDER,
    OVERSAMPLING,
    OrderGrid,
    alias_distance,
    order_grid,
    over_background,
    power,
)
from dynid_rs.diagnosis.ripple_fit import LineFit, Order, fit_lines, line_columns

FloatArray = NDArray[np.float64]

FALSE_ALARM = 1e-3
"""Chance, over all orders of all joints, that noise alone makes a line."""
EVERYWHERE = 0.01
"""Chance that a line which most sweeps deny is taken for one: a vibration has its frequency in time, not in angle."""
LEAST_WAY = 0.1
"""A direction with a smaller part of the samples has no phase of its own."""
LEAST_SWEEPS = 4
"""Fewer sweeps cannot contradict each other."""
MOST_LINES = 16
"""Per joint."""
AT_ONCE = 4
"""Peaks that are taken in one round,"""
ALIKE = 0.1
"""if they have at least this part of the strongest one's significance (the logarithm of its chance)."""
APART = 3.0
"""Resolution cells around a line in which no other is sought: it would only say that the first one's size changes."""


@dataclass(frozen=True, eq=False)
class Peak:
    """An order that stands out of a spectrum, and how often noise alone has one as high (logarithm)."""

    order: Order
    log_p: float


def search_lines(runs: Sequence[AngleRun], n_joints: int = 1) -> tuple[LineFit, list[float]]:
    """All lines of one of `n_joints`, and the logarithm of each one's p-value, corrected for all orders and joints."""
    grid = order_grid(runs)
    lines = fit_lines(runs, [])
    refused: list[float] = []
    log_p: list[float] = []
    while len(lines.orders) < MOST_LINES and len(refused) < MOST_LINES:
        taken = [*refused, *(order.cycles for order in lines.orders)]
        corrected = [replace(peak, log_p=peak.log_p + np.log(n_joints)) for peak in peaks_of(runs, lines, grid, taken)]
        peaks = [peak for peak in corrected if peak.log_p < np.log(FALSE_ALARM)]
        if not peaks:
            break
        more = fit_lines(runs, [*lines.orders, *(peak.order for peak in peaks)], lines)
        n_old = len(lines.orders)
        sound = [consistency(runs, more, n_old + k) < EVERYWHERE for k in range(len(peaks))]
        refused += [peak.order.cycles for peak, good in zip(peaks, sound, strict=True) if not good]
        orders = [*more.orders[:n_old], *(o for o, good in zip(more.orders[n_old:], sound, strict=True) if good)]
        log_p += [peak.log_p for peak, good in zip(peaks, sound, strict=True) if good]
        lines = more if all(sound) else fit_lines(runs, orders, lines)
    if lines.orders:
        lines = fit_lines(runs, lines.orders, lines)  # once more, with the noise that all of them leave
        lines = unfold(runs, simplified(runs, lines))
    return lines, log_p


def simplified(runs: Sequence[AngleRun], lines: LineFit) -> LineFit:
    """Lines of which only those keep a phase per direction whose two phases differ beyond chance."""
    from scipy.stats import chi2

    first = np.cumsum([0, *(order.n_columns for order in lines.orders)])
    orders = list(lines.orders)
    for k, (order, c) in enumerate(zip(lines.orders, lines.coefficients, strict=True)):
        if order.per_way:
            odd = slice(int(first[k]) + 2, int(first[k]) + 4)
            level = float(c[2:] @ np.linalg.solve(lines.covariance[odd, odd], c[2:]))
            if chi2.sf(level, 2) > FALSE_ALARM:
                orders[k] = replace(order, per_way=False)
    return lines if orders == list(lines.orders) else fit_lines(runs, orders, lines)


def unfold(runs: Sequence[AngleRun], lines: LineFit) -> LineFit:
    """Lines with each order replaced by the one among its aliases that explains more."""
    apart = alias_distance(runs, lines.whitener)
    if apart is None:
        return lines
    for k, order in enumerate(lines.orders):
        for cycles in aliases(order.cycles, apart):
            others = [replace(o, cycles=cycles) if i == k else o for i, o in enumerate(lines.orders)]
            other = fit_lines(runs, others, lines)
            if other.left < lines.left:
                lines = other
    return lines


def aliases(cycles: float, apart: float) -> list[float]:
    """Orders that make nearly the same samples as `cycles`, two that are `apart` being alike."""
    return [other for other in (abs(apart - cycles), apart + cycles) if LEAST_ORDER < other < MOST_ORDER]


def peaks_of(runs: Sequence[AngleRun], lines: LineFit, grid: OrderGrid, taken: Sequence[float]) -> list[Peak]:
    """Up to `AT_ONCE` most significant orders, apart from each other and from those that are `taken`."""
    orders = grid.orders
    apart = APART * OVERSAMPLING * grid.step
    free = np.ones(len(orders), dtype=bool)
    for cycles in taken:
        free &= np.abs(orders - cycles) > apart
    spread = float(np.concatenate([run.angle[run.used] for run in runs]).std())
    best = np.full(len(orders), np.inf)
    per_way = np.zeros(len(orders), dtype=bool)
    spectra = _spectra(runs, lines, grid)
    for freedom, spectrum in spectra.items():
        log_p = np.log(len(spectra)) + log_highest(spectrum, freedom, float(np.ptp(orders)), spread)
        per_way = np.where(log_p < best, freedom == 4, per_way)
        best = np.minimum(best, log_p)
    found: list[Peak] = []
    while len(found) < AT_ONCE and free.any():
        at = int(np.argmin(np.where(free, best, np.inf)))
        if found and best[at] > ALIKE * found[0].log_p:
            break
        found.append(Peak(Order(float(orders[at]), bool(per_way[at])), float(best[at])))
        free &= np.abs(orders - orders[at]) > apart
    return found


def _spectra(runs: Sequence[AngleRun], lines: LineFit, grid: OrderGrid) -> dict[int, FloatArray]:
    """Spectra by their degrees of freedom: 2 with one phase for all, 4 with one per direction of motion."""

    def of(masks: list[FloatArray]) -> FloatArray:
        return over_background(power(runs, lines.whitener, lines.white, masks, grid))

    found = {2: of([np.ones(len(run.angle)) for run in runs])}
    ways = [[(way * run.speed > 0).astype(np.float64) for run in runs] for way in (1.0, -1.0)]
    counts = [sum(mask[run.used].sum() for mask, run in zip(way, runs, strict=True)) for way in ways]
    if min(counts) > LEAST_WAY * sum(counts):
        found[4] = of(ways[0]) + of(ways[1])
    return found


def log_highest(level: FloatArray, freedom: int, width: float, spread: float) -> FloatArray:
    """Logarithm of the chance that noise reaches `level` anywhere over `width` orders.

    At one order the power is chi-square; over orders it is a smooth process whose rate of upcrossings is known (Davies
    1987, Biometrika 74; for spectra Baluev 2008, MNRAS 385). `spread` is the standard deviation of the angle.
    """
    from scipy.stats import chi, chi2

    level = np.maximum(level, freedom)  # the bound on upcrossings holds above the process's usual height
    upcrossings = np.log(width * spread / np.sqrt(2 * np.pi)) + chi.logpdf(np.sqrt(level), freedom)
    result: FloatArray = np.minimum(0.0, np.logaddexp(chi2.logsf(level, freedom), upcrossings))
    return result


def consistency(runs: Sequence[AngleRun], lines: LineFit, which: int) -> float:
    """P-value of a line on sweeps that were left out, each against the amplitude that the others give.

    A sharp line in angle helps at every speed; a resonance of the arm helps in the few sweeps whose speed excites it.
    """
    from scipy.stats import t

    order, coefficients = lines.orders[which], lines.coefficients[which]
    grams, moments = [], []
    for k, run in enumerate(runs):
        columns = lines.whitener.apply(line_columns(run, order), k)
        target = lines.white[k] + columns @ coefficients
        for sweep in run.sweeps():
            grams.append(columns[sweep].T @ columns[sweep])
            moments.append(columns[sweep].T @ target[sweep])
    n = len(grams)
    if n < LEAST_SWEEPS:
        return 0.0
    gram, moment = np.sum(grams, axis=0), np.sum(moments, axis=0)
    gains = np.array(
        [m @ np.linalg.lstsq(gram - g, moment - m, rcond=1e-8)[0] for g, m in zip(grams, moments, strict=True)]
    )
    size = np.linalg.norm(gains)
    if size == 0:
        return 1.0
    ratio = float(gains.sum() / size)
    statistic = ratio * np.sqrt((n - 1) / max(n - ratio**2, 1e-12))  # Student's t of the mean gain
    return float(t.sf(statistic, n - 1))
