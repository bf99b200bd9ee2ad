"""Laws of friction side by side: the same stretches of a run for all of them, and errors that are root mean squares."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from dynid_rs.identification.law_comparison import _compared
from dynid_rs.regression.error_interval import rmse_interval
from dynid_rs.regression.evaluation import Comparison

ROWS = 20.0
"""Rows of a fit per second."""


def comparison(error):
    """One run of one joint with this error (n_rows,)."""
    column = error[:, None]
    states = SimpleNamespace(counted=np.ones(column.shape, dtype=bool))
    return Comparison(states, column, np.zeros_like(column), column)


def compared(*errors):
    """Laws of one joint on one run each (n_rows,), the simplest first."""
    names = ("simple", "rich")[: len(errors)]
    return _compared(("joint",), names, [[comparison(error)] for error in errors], {})


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


@pytest.mark.parametrize("memory", [0.5, 2.0])
def test_errors_that_remember_each_other_say_less(memory):
    """Of two laws that are equally good one is called worse in about a twentieth of all runs, whatever the memory.

    Blocks of a second, as if the errors forgot in between, call one worse in 57 (0.5 s) and 104 (2 s) of these 300.
    """
    keep = np.exp(-1 / (memory * ROWS))
    wrong, n = 0, 300
    for seed in range(n):
        noise = np.random.default_rng(seed).standard_normal((2, 1600))
        simple, rich = lfilter([1.0], [1.0, -keep], noise, axis=1)[:, 400:]
        wrong += bool(compared(simple, rich).beyond_noise.any())
    assert wrong <= 0.08 * n, wrong


def test_a_difference_is_still_found_through_the_memory():
    keep = np.exp(-1 / (0.5 * ROWS))
    noise = np.random.default_rng(1).standard_normal((2, 3000))
    simple, rich = lfilter([1.0], [1.0, -keep], noise, axis=1)[:, 400:]
    assert compared(2.0 * simple, rich).chosen == ("rich",)


def test_errors_are_root_mean_squares_and_intervals_are_theirs():
    error = 2.0 + np.random.default_rng(0).standard_normal(800)
    found = compared(error, 3 * error)
    rms = np.sqrt(np.mean(error**2))
    np.testing.assert_allclose(found.rmse[:, 0], [rms, 3 * rms], rtol=1e-12)
    expected = [rmse_interval([comparison(each)])[0] for each in (error, 3 * error)]
    np.testing.assert_allclose(found.interval[:, 0], expected, rtol=1e-12)
    assert np.all(found.interval[:, 0, 0] < found.rmse[:, 0])
    assert np.all(found.rmse[:, 0] < found.interval[:, 0, 1])
    assert np.all(np.isnan(compared(error[:50]).interval))
