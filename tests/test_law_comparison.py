"""Laws of friction side by side: the same stretches of a run for all of them, and errors that are root mean squares."""

import numpy as np
import pytest

from dynid_rs.identification.law_comparison import _compared
from dynid_rs.regression.error_interval import interval_of


def compared(*errors, length=20):
    """Laws of one joint on one run each (n_rows,), the simplest first."""
    names = ("simple", "rich")[: len(errors)]
    return _compared(("joint",), names, [[error[:, None]] for error in errors], [length], {})


@pytest.mark.parametrize("seed", range(3))
def test_what_the_laws_share_does_not_count(seed):
    """5 % more everywhere is beyond noise, however uneven the run: resampled one by one it would drown in that."""
    rng = np.random.default_rng(seed)
    size = np.repeat(rng.uniform(0.1, 3.0, 30), 20)
    shared = size * rng.standard_normal(600)
    worse = compared(1.05 * shared, shared)
    assert worse.best == ("rich",)
    assert worse.beyond_noise.tolist() == [[True], [False]]
    assert worse.chosen == ("rich",)
    # Two draws of the same noise differ by as much, and say nothing.
    other = size * rng.standard_normal(600)
    other *= 0.95 * np.sqrt(np.mean(shared**2) / np.mean(other**2))
    assert compared(shared, other).chosen == ("simple",)


def test_errors_are_root_mean_squares_and_intervals_are_theirs():
    error = 2.0 + np.random.default_rng(0).standard_normal(800)
    found = compared(error, 3 * error)
    rms = np.sqrt(np.mean(error**2))
    np.testing.assert_allclose(found.rmse[:, 0], [rms, 3 * rms], rtol=1e-12)
    np.testing.assert_allclose(found.interval[:, 0], [interval_of(error), interval_of(3 * error)], rtol=1e-12)
    assert np.all(found.interval[:, 0, 0] < found.rmse[:, 0])
    assert np.all(found.rmse[:, 0] < found.interval[:, 0, 1])
    assert np.all(np.isnan(compared(error[:50]).interval))
