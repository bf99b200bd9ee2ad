"""Derivatives of evenly sampled signals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]


def slope(x: FloatArray, rate: float) -> FloatArray:
    """Derivative of x (n, ...) sampled at `rate` [Hz], right to .1 % up to a tenth of that."""
    return np.asarray(_core.slope(x.reshape(len(x), -1), rate)).reshape(x.shape)
