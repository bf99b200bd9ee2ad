"""Intervals of coefficients that have a sign."""

from __future__ import annotations

import numpy as np
import pytest

from dynid_rs.diagnosis.estimates import _interval


@pytest.mark.parametrize(
    ("value", "half", "bounds", "expected"),
    [
        (2.0, 1.0, (0.0, np.inf), (2 * np.exp(-0.5), 2 * np.exp(0.5))),  # a scale, known in its logarithm
        (-2.0, 1.0, (-np.inf, 0.0), (-2 * np.exp(0.5), -2 * np.exp(-0.5))),
        (1.0, 2.0, (0.0, np.inf), (0.0, 3.0)),
        (2.0, 1.0, (-np.inf, np.inf), (1.0, 3.0)),
        (-5.0, 1.0, (0.0, np.inf), (0.0, 0.0)),  # clearly of the sign that physics does not allow
    ],
)
def test_an_interval_lies_where_its_coefficient_may_be(value, half, bounds, expected):
    assert _interval(value, half, *bounds) == pytest.approx(expected)
