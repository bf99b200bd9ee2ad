"""One quantity of many arms: closed forms where there are some, promises by drawing where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom
from scipy.stats import t as student

from dynid_rs.pooling.hierarchy import FAR, MOST_LEFT_OUT, WIDE, judge, least_arms, share, shrunken

MEAN, DEVIATION = 12.0, 1.1


def drawn(seed, n, s=0.0):
    """Estimates and standard errors of arms of which none is odd."""
    rng = np.random.default_rng([seed, n])
    spread = np.full(n, s) * rng.uniform(0.5, 1.5, n)
    return MEAN + DEVIATION * rng.standard_normal(n) + spread * rng.standard_normal(n), spread


def test_without_standard_errors_it_is_the_sample_s_mean_and_variance():
    """Restricted maximum likelihood has n - 1 below, and no arm is left outside."""
    y, s = drawn(1, 200)
    found = share(y, s)
    assert found.usual.all()
    np.testing.assert_allclose(found.mean, y.mean(), rtol=1e-9)
    np.testing.assert_allclose(found.deviation, y.std(ddof=1), rtol=1e-6)
    np.testing.assert_allclose(found.mean_std_error, found.deviation / np.sqrt(200), rtol=1e-9)


def test_arms_that_do_not_differ_are_no_surer_than_their_estimates():
    """A lone arm, and three of one recording; what no arm has is zero for sure."""
    for n in (1, 3):
        found = share(np.full(n, MEAN), np.full(n, 0.5))
        np.testing.assert_allclose([found.mean, found.mean_std_error], [MEAN, 0.5 / np.sqrt(n)])
        best, error = shrunken(np.full(n, MEAN), np.full(n, 0.5), found)
        np.testing.assert_allclose(best, MEAN)
        np.testing.assert_allclose(error, 0.5 / np.sqrt(n))
    assert share(np.zeros(4), np.zeros(4)).mean_std_error == 0


@pytest.mark.parametrize("n", [8, 30])
@pytest.mark.parametrize("s", [0.0, 0.5, 2.0])
def test_mean_and_variance_are_unbiased(n, s):
    """Over 400 fleets; T may not be negative, which lifts its mean where the standard errors hide it."""
    found = [share(*drawn(seed, n, s)) for seed in range(400)]
    means = np.array([one.mean for one in found])
    powers = np.array([one.deviation**2 for one in found])
    assert abs(means.mean() - MEAN) < 4 * means.std() / 20
    lifted = 1.2 if s == 2.0 else 0.05
    assert abs(powers.mean() / DEVIATION**2 - 1) < lifted + 4 * powers.std() / 20 / DEVIATION**2
    errors = np.array([one.mean_std_error for one in found])
    np.testing.assert_allclose(np.sqrt(np.mean(errors**2)), means.std(), rtol=0.15)


@pytest.mark.parametrize("far", [6.0, 30.0, 1e6])
@pytest.mark.parametrize("n", [10, 100])
def test_an_odd_arm_does_not_hide_in_the_deviation_that_it_causes(n, far):
    y, s = drawn(2, n, 0.3)
    before = share(y[1:], s[1:])
    y[0] = MEAN + far * DEVIATION
    after = share(y, s)
    assert not after.usual[0] or far < 10
    if far > 10:
        np.testing.assert_allclose(after.deviation, before.deviation, rtol=1e-3)
    assert judge(y, s).p_value[0] < 0.002


def test_several_odd_arms_do_not_hide_each_other():
    y, s = drawn(3, 40, 0.3)
    y[:8] += 9 * DEVIATION
    found = judge(y, s)
    assert np.all(found.p_value[:8] < 1e-5)
    assert found.p_value[8:].min() > 1e-4


def test_without_standard_errors_an_arm_is_judged_as_a_studentised_residual():
    """Closed form: distance from the others' mean over their deviation times sqrt(1 + 1/(n-1)), n - 2 degrees."""
    y, s = drawn(4, 25)
    found = judge(y, s)
    for i in range(len(y)):
        others = np.delete(y, i)
        closed = (y[i] - others.mean()) / (others.std(ddof=1) * np.sqrt(1 + 1 / len(others)))
        assert found.deviations[i] == pytest.approx(closed, rel=1e-6)
        assert found.p_value[i] == pytest.approx(2 * student.sf(abs(closed), len(y) - 2), rel=1e-5)


@pytest.mark.parametrize("s", [0.0, 1.0])
@pytest.mark.parametrize("n", [8, 25, 80])
def test_p_values_are_what_they_say(n, s):
    """Of usual arms a share p has a p-value below p, or less (never more, by more than chance)."""
    fleets = 300 if n < 80 else 60
    p = np.concatenate([judge(*drawn(1000 + seed, n, s)).p_value for seed in range(fleets)])
    for level in (0.05, 0.005):
        assert np.sum(p < level) <= binom.isf(1e-3, len(p), 1.15 * level)
    if s == 0.0:
        assert np.sum(p < 0.05) >= binom.isf(1 - 1e-3, len(p), 0.04)


def test_in_a_large_fleet_leaving_out_changes_nothing_that_is_near():
    """What `MOST_LEFT_OUT` saves: the same answers as the loop over all arms."""
    y, s = drawn(5, MOST_LEFT_OUT + 20, 0.5)
    y[0] += 10 * DEVIATION
    quick = judge(y, s)
    for i in range(0, len(y), 7):
        without = share(np.delete(y, i), np.delete(s, i))
        spread = np.sqrt(without.deviation**2 + s[i] ** 2 + without.mean_std_error**2)
        exact = (y[i] - without.mean) / spread
        assert quick.deviations[i] == pytest.approx(exact, rel=0.1, abs=0.1)
        assert abs(exact) < FAR + 0.5 or quick.deviations[i] == pytest.approx(exact, rel=1e-3)


def test_fewest_arms():
    """One less, and an arm that is ten deviations off would not be named."""
    for limit in (1e-2, 1e-4, 1e-6):
        n = least_arms(limit)
        assert 2 * student.sf(WIDE, n - 2) <= limit
        assert n == 3 or 2 * student.sf(WIDE, n - 3) > limit


def test_shrunken_estimates_are_nearer_and_their_intervals_hold():
    alone, pooled, held = [], [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        truth = MEAN + DEVIATION * rng.standard_normal(30)
        s = np.full(30, 1.5)
        y = truth + s * rng.standard_normal(30)
        best, error = shrunken(y, s, share(y, s))
        alone.append(np.mean((y - truth) ** 2))
        pooled.append(np.mean((best - truth) ** 2))
        held.append(np.mean(np.abs(best - truth) < 1.96 * error))
    # The best that is possible knows mu and T: T s^2 / (T + s^2) of s^2.
    best_possible = DEVIATION**2 / (DEVIATION**2 + 1.5**2)
    assert np.mean(pooled) / np.mean(alone) < best_possible * 1.25  # T of 30 arms is not known well
    assert 0.93 < np.mean(held) < 0.97, np.mean(held)


def test_an_odd_arm_is_not_drawn_to_the_mean():
    y, s = drawn(6, 30, 1.0)
    s[:] = 1.0
    y[0] = MEAN + 15.0
    best, _ = shrunken(y, s, share(y, s))
    assert best[0] == pytest.approx(y[0], abs=0.5)
    assert np.all(np.abs(best[1:] - MEAN) < np.abs(y[1:] - MEAN) + 0.5)


def test_arms_that_are_all_the_same():
    found = judge(np.full(9, 3.0), np.zeros(9))
    assert (found.shared.mean, found.shared.deviation) == (3.0, 0.0)
    assert np.all(found.p_value == 1.0)
