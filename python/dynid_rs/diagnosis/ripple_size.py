"""Sizes of lines that serve a prediction: the whitened fit's, unless slow and fast ripple are answered differently.

The whitened fit is the most precise where one amplitude and one phase hold at every speed. A position loop that fights
the ripple, or a resonance, gives each speed its own; the whitened fit then describes the speeds with the least noise
and may add to the error it should take off. Plain least squares on the torque itself is less precise and never does
that. The two agree within what their covariances allow if the line is one (Hausman 1978, Econometrica 46).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.angle_data import AngleRun
from dynid_rs.diagnosis.ripple_fit import LineFit, line_columns

FloatArray = NDArray[np.float64]

DISAGREEMENT = 1e-3
"""Chance that the two fits of one line are as far apart as that."""


def sized(runs: Sequence[AngleRun], lines: LineFit) -> LineFit:
    """Lines with plain least squares' coefficients and covariance, if some line's whitened ones disagree with them."""
    from scipy.stats import chi2

    if not lines.orders:
        return lines
    x, covariance = _plain(runs, lines)
    edges = np.cumsum([0, *(order.n_columns for order in lines.orders)])
    parts = [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
    for part, whitened in zip(parts, lines.coefficients, strict=True):
        apart = x[part] - whitened
        spread = covariance[part, part] + lines.covariance[part, part]
        distance = float(apart @ np.linalg.lstsq(spread, apart, rcond=1e-9)[0])
        if chi2.sf(distance, len(apart)) < DISAGREEMENT:
            return replace(lines, coefficients=[x[part] for part in parts], covariance=covariance)
    return lines


def _plain(runs: Sequence[AngleRun], lines: LineFit) -> tuple[FloatArray, FloatArray]:
    """Coefficients (n_columns,) on used samples alone, and their covariance under the noise's memory."""
    from scipy.signal import lfilter

    whole = [
        np.column_stack([run.beside, *(line_columns(run, order) for order in lines.orders)]) * run.used[:, None]
        for run in runs
    ]
    n_lines = sum(order.n_columns for order in lines.orders)
    stacked = np.concatenate(whole)
    norms = np.linalg.norm(stacked, axis=0)
    norms[norms == 0] = 1.0
    inverse = np.linalg.pinv((stacked / norms).T @ (stacked / norms), rcond=1e-10, hermitian=True)
    moments = sum((columns / norms).T @ run.residual for columns, run in zip(whole, runs, strict=True))
    x = (inverse @ moments / norms)[-n_lines:]
    taps = lines.whitener.taps
    spread = np.zeros_like(inverse)
    for columns, weight in zip(whole, lines.whitener.weights, strict=True):
        coloured = lfilter([1.0], taps, (columns / norms)[::-1], axis=0)[::-1]
        size = np.where(weight > 0, 1 / np.where(weight > 0, weight, 1.0), 0.0)
        spread += (coloured * size[:, None]).T @ (coloured * size[:, None])
    covariance = inverse @ spread @ inverse / np.outer(norms, norms)
    return x, covariance[-n_lines:, -n_lines:]
