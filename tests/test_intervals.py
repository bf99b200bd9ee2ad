"""Intervals of an effect's numbers: a scale stays a scale, and what nothing tells is not known."""

import numpy as np
import pytest

from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.diagnosis.intervals import _ends, _is_scale

SCALES = np.array([False, True])


def test_a_scale_keeps_its_sign_and_is_as_far_up_as_down():
    values = np.array([2.0, 10.0])
    low, high = (_ends(values, change * values, SCALES) for change in (-1.5, 1.5))
    np.testing.assert_allclose([low[0], high[0]], [-1.0, 5.0])
    assert 0 < low[1] < 10 < high[1]
    assert low[1] * high[1] == pytest.approx(100.0)


def test_a_scale_that_is_known_well_has_the_interval_of_any_number():
    np.testing.assert_allclose(_ends(np.array([5.0, -5.0]), np.array([0.01, 0.01]), SCALES), [5.01, -4.99], rtol=1e-5)


def test_a_scale_that_may_be_a_hundred_times_as_large_is_not_known():
    ends = _ends(np.array([1.0, 1.0]), np.array([50.0, 50.0]), SCALES)
    assert ends[0] == 51.0
    assert np.isnan(ends[1])


def test_a_length_that_may_be_negative_is_no_scale():
    cylinder = Hypothesis("counterbalance", (0,), (("b", 0.3), ("gas_length", -1.5)))
    assert _is_scale(cylinder, "b")
    assert not _is_scale(cylinder, "gas_length")
    assert not _is_scale(cylinder, "phase")
