"""Symmetric matrices on the disk: their scale, and the upper triangle of what is left when that is divided out.

Numbers of one size, whatever the units, so that few digits are enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

DIGITS = 9
"""Of what is left: unknowns together may be known far better than each of them."""


def packed(matrix: FloatArray) -> tuple[list[float], list[float]]:
    """Roots of the diagonal (n,), and the triangle from the diagonal on, row by row (n (n + 1) / 2,)."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    alike = matrix / np.outer(unit, unit)
    upper = [float(f"{x:.{DIGITS}g}") for x in alike[np.triu_indices(len(alike))].tolist()]
    return scale.tolist(), upper


def unpacked(scale: FloatArray, upper: FloatArray) -> FloatArray:
    """The matrix (n, n) of what `packed` has made of it."""
    n = len(scale)
    alike = np.zeros((n, n))
    alike[np.triu_indices(n)] = upper
    matrix: FloatArray = (alike + np.triu(alike, 1).T) * np.outer(scale, scale)
    return matrix
