"""A leftover against its signals: the partial residual in bins, and what was fitted to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.dependence import Dependence
from dynid_rs.diagnosis.products import RidgePath, product_columns
from dynid_rs.diagnosis.rows_beside import JointRows
from dynid_rs.diagnosis.signals import Candidates, Signal

FloatArray = NDArray[np.float64]

N_BINS = {1: 30, 2: 12}
"""Bins along each signal, for one and two of them."""


@dataclass(frozen=True, eq=False)
class Picture:
    """Means over bins of one or two signals; bins without rows are NaN.

    Parameters
    ----------
    signals : tuple of Signal
        The strongest one or two.
    edges : tuple of ndarray
        Of the bins, in the signal's unit, one array per signal.
    partial : ndarray (n_bins,) or (n_bins, n_bins)
        What is left, with what was fitted put back [torque unit].
    fitted : ndarray
        What was fitted, of the same shape.
    spread : ndarray
        Standard deviation of the partial residual in the bin.
    count : ndarray
        Rows in the bin.
    """

    signals: tuple[Signal, ...]
    edges: tuple[FloatArray, ...]
    partial: FloatArray
    fitted: FloatArray
    spread: FloatArray
    count: FloatArray


def picture_of(depends: Dependence, rows: JointRows, candidates: Candidates) -> Picture:
    """Picture of a dependence on the training rows."""
    columns = product_columns(depends.score.signals, candidates, rows.rows, reach=depends.score.reach)
    taken = rows.whole.taken.T @ columns
    beta = RidgePath(columns, taken, rows.residual[:, None]).at(depends.score.ridge)[:, 0]
    fitted = columns @ beta
    fitted = fitted - fitted.mean()  # an offset is declared
    partial = fitted + rows.residual - (columns @ beta - rows.whole.taken @ (taken @ beta))
    shown = depends.signals[:2]
    values = [candidates.values[signal][rows.rows] for signal in shown]
    edges = tuple(np.linspace(x.min(), x.max(), N_BINS[len(shown)] + 1) for x in values)
    count = np.histogramdd(values, edges)[0]
    full = np.where(count > 0, count, np.nan)
    mean, fit, square = (np.histogramdd(values, edges, weights=w)[0] / full for w in (partial, fitted, partial**2))
    return Picture(shown, edges, mean, fit, np.sqrt(np.maximum(square - mean**2, 0.0)), count)
