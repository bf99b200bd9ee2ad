"""The floor under a residual that the band's noise tells."""

import numpy as np
import pytest

from dynid_rs.regression.evaluation import noise_floor
from dynid_rs.runs.preprocessing import Band, States, prepare
from dynid_rs.runs.recording import Recording


@pytest.mark.parametrize("seed", [0, 1])
def test_wide_band_noise_is_bounded_from_below(seed):
    rng = np.random.default_rng(seed)
    band, n = Band(5.0), 5000
    still = np.zeros((n, 3))
    tau = rng.standard_normal((n, 3))
    moving = np.ones(n, dtype=bool)
    states = States("white", np.arange(n) / 250, *[still] * 6, tau, 250.0, band, moving, two_encoders=False)
    impulse = np.zeros(n)
    impulse[n // 2] = 1.0
    ratio = noise_floor([states]) / np.sqrt(np.sum(band.apply(impulse, 250.0) ** 2))
    # A bound from below: the quietest of eight stretches is taken, which lies somewhat under their mean.
    assert np.all((ratio > 0.8) & (ratio < 1.02)), ratio


def white(name, size, seed, rows_per=1.0, rate=250.0, n=5000):
    """Run of white torque noise of `size`, scored on its first part only."""
    still = np.zeros((n, 1))
    tau = size * np.random.default_rng(seed).standard_normal((n, 1))
    moving = np.arange(n) < rows_per * n
    return States(name, np.arange(n) / rate, *[still] * 6, tau, rate, Band(5.0), moving, two_encoders=False)


def test_runs_count_by_their_scored_rows():
    quiet, loud = noise_floor([white("a", 1.0, 0)]), noise_floor([white("b", 3.0, 1)])
    runs = [white("a", 1.0, 0, rows_per=0.8), white("b", 3.0, 1, rows_per=0.2)]
    share = len(runs[0].rows) / sum(len(run.rows) for run in runs)
    assert 0.75 < share < 0.85
    np.testing.assert_allclose(noise_floor(runs), np.sqrt(share * quiet**2 + (1 - share) * loud**2), rtol=1e-12)


def test_one_run_whose_noise_is_not_seen_leaves_no_floor():
    hidden = white("hidden", 1.0, 0, rate=20.0)  # nothing lies above twice the band
    assert np.isnan(noise_floor([hidden])).all()
    assert np.isnan(noise_floor([white("seen", 1.0, 0), hidden])).all()


def test_on_a_finer_grid_a_slow_run_has_its_own_floor():
    """Between its samples are straight lines, in which there is no noise above half of its rate."""
    t = np.arange(4000) / 50.0
    wave = np.stack([np.sin(2 * t)], axis=1)
    slow = Recording(t, wave, tau=np.random.default_rng(3).standard_normal((len(t), 1)), name="slow")
    own, fine = (noise_floor([prepare(slow, Band(5.0), rate)]) for rate in (50.0, 250.0))
    assert 0.75 < fine / own < 1.2
