"""Filters and spectra against scipy.signal, which is not imported at run time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from dynid_rs.runs.low_pass import butterworth, gain_at, power_density, steady_state


@pytest.mark.parametrize("cutoff", [0.002, 0.03, 0.2, 0.5, 0.9])
@pytest.mark.parametrize("order", [2, 4, 8])
def test_sections_are_those_of_scipy(order: int, cutoff: float) -> None:
    expected = signal.butter(order, cutoff, output="sos")
    sections = butterworth(order, cutoff)
    assert_allclose(sections[:, 3:], expected[:, 3:], rtol=1e-10, atol=1e-14)
    assert_allclose(np.sort(sections[:, :3], axis=0), np.sort(expected[:, :3], axis=0), rtol=1e-7)
    assert_allclose(steady_state(expected), signal.sosfilt_zi(expected), rtol=1e-9)
    # Roots of a polynomial of this order are known to fewer digits than its coefficients: the gain is what counts.
    frequency = np.linspace(0.0, 0.499, 50)
    _, response = signal.freqz_sos(expected, worN=frequency, fs=1.0)
    assert_allclose(gain_at(sections, frequency), np.abs(response), rtol=1e-8, atol=1e-14)


@pytest.mark.parametrize("length", [256, 255, 1000])
def test_power_density_is_that_of_scipy(length: int) -> None:
    x = np.cumsum(np.random.default_rng(0).normal(size=(1000, 3)), axis=0)
    frequency, density = signal.welch(x, 50.0, nperseg=length, axis=0)
    ours, own = power_density(x, 50.0, length)
    assert_allclose(ours, frequency, rtol=1e-12)
    assert_allclose(own, density, rtol=1e-9, atol=1e-12 * density.max())
