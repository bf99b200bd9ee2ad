"""numpy's masked arrays: what they hide is missing, and `numpy.asarray` hands it out."""

from __future__ import annotations

from typing import Any

import numpy as np


def unmasked(values: Any) -> Any:
    """`values` with NaN, or NaT, for what is masked; itself where it is no masked array."""
    if not hasattr(values, "filled"):  # whose class is imported where there is one
        return values
    given = values if values.dtype.kind in "mM" else values.astype(np.float64)
    missing = np.array("NaT" if values.dtype.kind in "mM" else np.nan, dtype=given.dtype)
    return np.where(np.ma.getmaskarray(given), missing, np.ma.getdata(given))
