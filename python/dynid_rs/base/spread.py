"""How far numbers lie from zero by themselves, though a few of them lie further."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def spread(sizes: FloatArray, quantiles: Sequence[float]) -> float:
    """Standard deviation of a Gaussian variable whose sizes (n,) have a quantile as large: the greatest of several.

    One quantile may be small though the others are not: half of a channel of coarse steps is where its neighbours are,
    and a model that is wrong in a tenth of the samples is right in the rest.
    """
    from scipy.special import ndtri

    at = np.quantile(sizes, quantiles)
    return float(np.max(at / ndtri(0.5 + np.array(quantiles) / 2)))
