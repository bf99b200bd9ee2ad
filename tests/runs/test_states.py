"""Velocities and accelerations of a recording, against those of the motion that it was made of."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

from dynid_rs.runs.preprocessing import Band, common_rate, prepare
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.slope import slope

BAND = Band(5.0)
INSIDE = slice(200, -200)
"""Away from the ends, where filters have nothing to go by."""


def wave(t, order):
    """A sum of three waves of up to 2 Hz and its derivatives, (n, 2)."""
    parts = [(0.5, 2 * np.pi * 0.4, 0.1), (0.2, 2 * np.pi * 1.1, 1.0), (0.05, 2 * np.pi * 2.0, 2.0)]
    q = sum(size * w**order * np.sin(w * t + phase + order * np.pi / 2) for size, w, phase in parts)
    return np.stack([q, -0.5 * q], axis=1)


def recording(rate, **more):
    t = np.arange(round(60 * rate)) / rate
    return Recording(t, wave(t, 0), tau=wave(t, 2), name="run.csv", **{name: of(t) for name, of in more.items()})


def bent(t, order=0):
    """What lies between motor and link."""
    return 0.01 * wave(t + 0.3, order + 2) / 10


@pytest.mark.parametrize("n", [4, 5, 6, 50])
def test_slopes_are_nearly_those_of_a_cubic_spline(n):
    x = np.cumsum(np.random.default_rng(n).normal(size=(n, 2, 3)), axis=0)
    ours = slope(x, 20.0)
    t = np.arange(n) / 20.0
    # The spline whose first and last slopes are ours has our other slopes too.
    spline = CubicSpline(t, x, bc_type=((1, ours[0]), (1, ours[-1])))
    assert_allclose(spline(t, 1), ours, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("rate", "off"), [(24.0, 2e-3), (50.0, 1e-4), (125.0, 1e-4), (1000.0, 1e-4)])
def test_states_at_low_rates_are_those_of_the_motion(rate, off):
    run = recording(rate)
    states = prepare(run, BAND, rate)
    for order, name in ((1, "dq"), (2, "ddq")):
        true = wave(states.t, order)[INSIDE]
        assert np.abs(getattr(states, name)[INSIDE] - true).max() < off * np.abs(true).max()


def test_runs_of_different_rates_share_the_grid_of_the_fastest_in_any_order():
    slow, fast = recording(50.0), recording(250.0)
    assert common_rate([slow, fast]) == common_rate([fast, slow]) == 250.0


@pytest.mark.parametrize("exact", [False, True])
def test_a_run_that_is_thinned_out_keeps_the_noise_of_its_band_alone(exact):
    """Of 250 samples a second every fifth would have all the noise above the band in it."""
    t = np.arange(60 * 250) / 250.0
    noise = np.random.default_rng(1).standard_normal((len(t), 2))
    more = {"dq": wave(t, 1), "ddq": wave(t, 2)} if exact else {}
    fast = Recording(t, wave(t, 0), tau=noise, name="run.csv", **more)
    own, thinned = prepare(fast, BAND, 250.0), prepare(fast, BAND, 50.0)
    assert (own.rate, thinned.rate) == (250.0, 50.0)
    left = [states.in_band(states.tau).std(axis=0) for states in (own, thinned)]
    assert_allclose(left[1], left[0], rtol=0.05)
    assert_allclose(thinned.dq[INSIDE], wave(thinned.t, 1)[INSIDE], atol=1e-3)


def test_a_recorded_velocity_is_used():
    rate = 100.0
    noise = np.random.default_rng(0).normal(size=(6000, 2))
    run = recording(rate, dq=lambda t: wave(t, 1) + 0.02 * noise)
    states, derived = prepare(run, BAND, rate), prepare(recording(rate), BAND, rate)
    assert states.notes == ()
    assert_allclose(states.dq[INSIDE], BAND.apply(run.dq, rate, 10.0)[INSIDE], atol=1e-9)
    assert not np.allclose(states.dq, derived.dq, atol=1e-4)


@pytest.mark.parametrize(
    ("dq", "said"),
    [
        (lambda t: wave(t - 0.02, 1), "lags by 20 ms"),
        (lambda t: 1.2 * wave(t, 1), "is not the derivative"),
        (lambda t: wave(t, 1) + bent(t, 1), "is not the derivative"),
    ],
    ids=["late", "too large", "of the motor"],
)
def test_a_velocity_that_is_not_the_links_is_not_taken_for_it(dq, said):
    """Drives give the speed of their motors: between it and the link's is what the gears yield."""
    rate = 100.0
    states = prepare(recording(rate, dq=dq, q_motor=lambda t: wave(t, 0) + bent(t)), BAND, rate)
    assert [said in note for note in states.notes] == [True, True]
    true = wave(states.t, 1)[INSIDE]
    assert np.abs(states.dq[INSIDE] - true).max() < 1e-4 * np.abs(true).max()


def test_with_one_encoder_a_velocity_cannot_be_anothers():
    rate = 100.0
    run = recording(rate, dq=lambda t: wave(t, 1) + bent(t, 1))
    assert prepare(run, BAND, rate).notes == ()


@pytest.mark.parametrize(("seconds", "rests"), [(0.7, False), (4.0, True)])
def test_a_joint_that_hardly_moves_is_told_by_its_rests_too(seconds, rests):
    """Fewer than twenty rows of motion tell no friction; then what the joint holds at rest is all there is."""
    rate = 100.0
    run = recording(rate)
    t, q = run.t, run.q.copy()
    q[:, 1] = 0.3 * np.sin(np.pi * np.clip((t - 20.0) / seconds, 0.0, 1.0)) ** 2
    states = prepare(Recording(t, q, tau=run.tau, name="run.csv"), BAND, rate)
    assert bool(states.resting[:, 1].any()) == rests
    assert not states.resting[:, 0].any()
    assert states.moving[500:-500].all()
