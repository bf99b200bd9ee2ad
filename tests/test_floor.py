"""The floor under a residual that the band's noise tells."""

import numpy as np
import pytest

from dynid_rs.regression.evaluation import noise_floor
from dynid_rs.runs.preprocessing import Band, States


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
