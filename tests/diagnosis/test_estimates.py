"""Intervals: of coefficients that have a sign, and of those that are other in every part of the data."""

from __future__ import annotations

import numpy as np
import pytest

from dynid_rs.diagnosis.estimates import Estimate, _interval, _scatter, is_told
from dynid_rs.diagnosis.gear_model import Flat
from dynid_rs.regression.linear_model import Choice, LinearModel

N = 800
NOISE = 0.1


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


@pytest.mark.parametrize("seed", range(5))
def test_a_coefficient_that_changes_from_part_to_part_is_known_no_better_than_that(seed):
    rng = np.random.default_rng(seed)
    column, noise = rng.standard_normal(N), NOISE * rng.standard_normal(N)
    spreads = {}
    for change in (0.0, 0.5):
        coefficient = 1.0 + change * np.repeat(rng.standard_normal(8), N // 8)
        rows = np.column_stack([column, coefficient * column + noise])
        model = LinearModel([rows], [np.array([0])], Flat(1), np.array([float(N)]), np.array([1e-9]), N)
        fit = model.fit(Choice(), np.array([NOISE]))
        spreads[change] = float(np.sqrt(fit.covariance[0, 0])), float(_scatter(model, fit)[0])
    assert spreads[0.0][1] == pytest.approx(spreads[0.0][0], rel=0.8)  # 7 degrees of freedom
    known, scattered = spreads[0.5]
    # Eight coefficients of spread 0.5 have a mean that is known to 0.5 / sqrt(8) = 0.18.
    assert known < 0.03
    assert 0.07 < scattered < 0.4


def number(name, *interval):
    return Estimate(name, 0, 0.5, interval or None, "1")


@pytest.mark.parametrize(
    ("kind", "numbers", "told"),
    [
        ("stribeck", [number("stribeck_pos", 0.0, 1.0), number("stribeck_neg", 0.2, 1.0)], True),  # one will do
        ("stribeck", [number("stribeck_pos", 0.0, 1.0), number("stribeck_neg", 0.0, 1.0)], False),
        ("stribeck", [number("stribeck_pos", 0.0, 1.0), number("stribeck_velocity", 0.1, 1.0)], False),  # a shape
        ("joint_spring", [number("spring_stiffness", -1.0, 1.0)], False),
        ("joint_spring", [number("spring_stiffness", -1.0, -0.1)], True),
        ("joint_spring", [number("spring_stiffness")], False),
        ("torque_delay", [number("delay", -1e-4, 1e-5)], False),
        ("torque_delay", [number("delay", 1e-5, 1e-4)], True),
        ("gravity_tilt", [number("roll", -1.0, 1.0), number("pitch", 0.1, 1.0)], True),
    ],
)
def test_an_effect_has_a_size_where_one_of_its_sizes_is_not_zero(kind, numbers, told):
    assert is_told(kind, numbers) is told
