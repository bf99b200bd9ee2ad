"""Lines of given orders fitted together, beside the declared model's columns, to a whitened residual."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.angle_data import AngleRun
from dynid_rs.diagnosis.whitening import Whitener, fit_whitener

FloatArray = NDArray[np.float64]

NEGLIGIBLE = 1e-10
"""Directions of the declared columns with less of the power than this are numerical dirt."""
REFINEMENTS = 3
"""Gauss-Newton steps on the orders; each begins within a quarter of a resolution cell."""


@dataclass(frozen=True)
class Order:
    """An order and whether its phase may differ between the two directions of motion."""

    cycles: float
    per_way: bool = False

    @property
    def n_columns(self) -> int:
        """Coefficients: cosine and sine, and both once more with the sign of the motion."""
        return 4 if self.per_way else 2


@dataclass(frozen=True, eq=False)
class LineFit:
    """Lines fitted to all runs at once.

    `coefficients` one (n_columns,) per order; `covariance` of all of them in sequence; `cycles_std` (n_orders,) of the
    orders; `white` one (n,) per run, whitened, with declared columns and lines taken out; `own` one (n,) per run, the
    lines' torque.
    """

    orders: tuple[Order, ...]
    coefficients: list[FloatArray]
    covariance: FloatArray
    cycles_std: FloatArray
    whitener: Whitener
    white: list[FloatArray]
    basis: FloatArray = field(repr=False)

    @property
    def left(self) -> float:
        """Sum of squares that is left of the whitened residual."""
        return float(sum(run @ run for run in self.white))


def line_columns(run: AngleRun, order: Order) -> FloatArray:
    """Torque per unit coefficient (n, n_columns), by the compiled core's ripple."""
    ripple = _core.Effect.of("torque_ripple", cycles=[order.cycles])
    at_rest = np.zeros((len(run.angle), 1))
    columns = _core.effect_columns(ripple, run.angle[:, None], at_rest, at_rest)[:, 0, :2]
    if not order.per_way:
        return np.ascontiguousarray(columns)
    return np.column_stack([columns, np.sign(run.speed)[:, None] * columns])


def _slope(run: AngleRun, order: Order, coefficients: FloatArray) -> FloatArray:
    """Change of a line's torque with its order, (n,)."""
    columns = line_columns(run, order)
    turned = columns[:, [1, 0, 3, 2][: order.n_columns]] * np.array([-1.0, 1.0, -1.0, 1.0])[: order.n_columns]
    return np.asarray(run.angle * (turned @ coefficients))


def declared_basis(runs: Sequence[AngleRun], whitener: Whitener) -> FloatArray:
    """Orthonormal basis (n_all, rank) of what the declared model can take, whitened."""
    columns = np.concatenate([whitener.apply(run.beside, k) for k, run in enumerate(runs)])
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0] / norms[norms > 0]
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > NEGLIGIBLE * values[-1]
    basis: FloatArray = columns @ (vectors[:, kept] / np.sqrt(values[kept]))
    return basis


def fit_lines(
    runs: Sequence[AngleRun], orders: Sequence[Order], guess: LineFit | None = None, *, refine: bool = True
) -> LineFit:
    """Least squares over amplitudes, phases and orders.

    Parameters
    ----------
    orders : sequence of Order
        Where to begin; each is refined.
    guess : LineFit, optional
        Lines so far: the noise is what they leave. Nothing is left out of it by default.
    refine : bool
        Whether orders are fitted too.
    """
    left = [run.residual - _torque(run, guess) for run in runs]
    used = [run.used for run in runs]
    whitener = fit_whitener(left, used, runs[0].rate)
    basis = declared_basis(runs, whitener)
    target = _out_of(basis, np.concatenate([whitener.apply(run.residual, k) for k, run in enumerate(runs)]))
    cuts = np.cumsum([len(run.angle) for run in runs])[:-1]
    found = list(orders)
    if not found:
        return LineFit((), [], np.zeros((0, 0)), np.zeros(0), whitener, np.split(target, cuts), basis)

    def whitened(columns: Sequence[FloatArray]) -> FloatArray:
        return _out_of(basis, np.concatenate([whitener.apply(x, k) for k, x in enumerate(columns)]))

    half_cell = np.pi / max(run.span for run in runs)
    edges = np.cumsum([0, *(order.n_columns for order in found)])
    n_steps = REFINEMENTS if refine else 0
    for step in range(n_steps + 1):
        columns = np.column_stack([whitened([line_columns(run, order) for run in runs]) for order in found])
        x = _solve(columns, target)
        parts = [x[a:b] for a, b in itertools.pairwise(edges)]
        slopes = np.column_stack(
            [whitened([_slope(run, o, c) for run in runs]) for o, c in zip(found, parts, strict=True)]
        )
        whole = np.column_stack([columns, slopes])
        if step == n_steps:
            break
        change = _solve(whole, target)[edges[-1] :]
        change = np.clip(change, -half_cell / 2, half_cell / 2)
        found = [replace(o, cycles=o.cycles + float(c)) for o, c in zip(found, change, strict=True)]
    residual = target - columns @ x
    n_free = np.sum(np.concatenate(whitener.weights) > 0) - basis.shape[1] - whole.shape[1]
    covariance = np.linalg.pinv(whole.T @ whole, rcond=1e-12) * float(residual @ residual) / max(float(n_free), 1.0)
    std = np.sqrt(np.maximum(np.diag(covariance)[edges[-1] :], 0.0)).astype(np.float64)
    inner = covariance[: edges[-1], : edges[-1]].astype(np.float64)
    return LineFit(tuple(found), parts, inner, std, whitener, np.split(residual, cuts), basis)


def _torque(run: AngleRun, lines: LineFit | None) -> FloatArray:
    total = np.zeros(len(run.angle))
    if lines is not None:
        for order, coefficients in zip(lines.orders, lines.coefficients, strict=True):
            total += line_columns(run, order) @ coefficients
    return total


def _solve(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Least squares by normal equations: columns of sines and whitened noise are well conditioned."""
    from scipy.linalg import lstsq

    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0] = 1.0
    scaled = columns / norms
    x: FloatArray = lstsq(scaled.T @ scaled, scaled.T @ target, cond=1e-12)[0] / norms
    return x


def _out_of(basis: FloatArray, x: FloatArray) -> FloatArray:
    rest: FloatArray = x - basis @ (basis.T @ x)
    return rest
