"""Intervals: of coefficients that have a sign, and of those that are other in every part of the data."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, found_in, measured

from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.estimates import _interval, _scatter, may_be_nothing, sized_torques
from dynid_rs.diagnosis.gear_model import Flat
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.standing import without_nothing
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
        (0.5, 1.0, (-np.inf, 0.0), (-0.5, 1.5)),  # of the sign that physics does not allow, and yet the model's
        (-5.0, 1.0, (0.0, np.inf), (-6.0, -4.0)),
    ],
)
def test_an_interval_lies_where_its_coefficient_may_be_and_holds_it(value, half, bounds, expected):
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


def test_a_torque_that_is_there_has_a_size_and_one_that_is_not_has_none():
    belief = Belief.in_declared(Setup(ROBOT), measured("joint_spring:elbow:2", n_runs=2))
    there, not_there = (Shaped("joint_spring", (j,), (("rest_position", 0.0),)) for j in (1, 2))
    belief.accept([Named(h, 20.0) for h in belief.catalogue.of([there, not_there])])
    assert [effect in sized_torques(belief) for effect in belief.setup.effects] == [True, False]
    assert may_be_nothing(belief) == [belief.setup.effects[1]]
    assert without_nothing(belief)
    assert list(belief.named) == [("joint_spring", (1,))]
    assert not without_nothing(belief)


def test_a_peak_has_a_size_though_nobody_knows_how_high_it_is():
    found = found_in(measured("stribeck:elbow"))
    (entry,) = found.entries
    heights = [p["interval"] for p in entry["parameters"] if p["name"].startswith("stribeck_p")]
    assert entry["kind"] == "stribeck"
    assert all(low == 0.0 for low, _ in heights)
