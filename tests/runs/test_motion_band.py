"""Where a position's motion ends and its encoder's noise begins, against signals whose parts are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dynid_rs import Recording
from dynid_rs.runs.motion_band import MARGIN, motion_band
from dynid_rs.runs.positions import through_ends
from dynid_rs.runs.preprocessing import Band, prepare

RATE, SECONDS = 500.0, 40.0
LEAST, MOST = 2.5, 10.0
T = np.arange(0, SECONDS, 1 / RATE)


def waves(*frequencies, seed=0):
    """Position and acceleration of waves [Hz] of some tenths of a radian that do not begin at rest."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * np.array(frequencies)
    angle = np.outer(T, w) + rng.uniform(0, 2 * np.pi, len(w))
    size = 0.3 / np.sqrt(np.arange(1, len(w) + 1))
    return np.sin(angle) @ size, -np.sin(angle) @ (size * w**2)


SLOW = (0.1, 0.2, 0.3, 0.4)


def in_steps(q, step):
    return np.round(q / step) * step


def test_the_noise_is_that_of_the_steps():
    """Steps much smaller than the way of a sample are white, step / sqrt(12)."""
    step = 1e-4
    band = motion_band(in_steps(waves(*SLOW)[0], step)[:, None], RATE, LEAST, MOST)
    assert_allclose(np.sqrt(band.noise * RATE / 2), step / np.sqrt(12), rtol=0.1)


@pytest.mark.parametrize("fastest", [2.0, 3.0, 4.0])
def test_motion_is_kept_up_to_its_last_wave(fastest):
    """A wave of a tenth of a millimetre at a metre, a hundred times the noise, in a motion that is slow."""
    q = in_steps(waves(*SLOW)[0] + 1e-4 * np.sin(2 * np.pi * fastest * T), 1e-4)
    cutoff = motion_band(q[:, None], RATE, LEAST, MOST).cutoff
    assert fastest * MARGIN <= cutoff[0] < (fastest + 1) * MARGIN


def test_what_one_second_of_the_run_shows_counts():
    q = waves(*SLOW)[0] + 2e-3 * np.sin(2 * np.pi * 4 * T) * ((T > 20) & (T < 21))
    assert motion_band(in_steps(q, 1e-4)[:, None], RATE, LEAST, MOST).cutoff[0] > 4 * MARGIN


def test_an_encoder_without_noise_keeps_its_band():
    """Rounding of a double is white too, and is no reason to take off anything of a motion that goes on for ever."""
    jerks = np.cumsum(np.cumsum(np.sign(np.sin(2 * np.pi * 0.37 * T)))) / RATE**2
    assert motion_band(jerks[:, None], RATE, LEAST, MOST).cutoff[0] == MOST


def test_a_joint_at_rest_and_a_rate_that_leaves_no_noise_alone_keep_the_band():
    """A last digit that flips is no slow motion: at rest no part of the speed tells the sign of friction."""
    rng = np.random.default_rng(0)
    rest = in_steps(0.5 + 5e-5 * rng.standard_normal((len(T), 1)), 1e-4)
    assert motion_band(rest, RATE, LEAST, MOST).rests[0]
    slow = in_steps(waves(*SLOW)[0], 1e-4)[:: int(RATE / 20), None]
    assert motion_band(slow, 20.0, LEAST, MOST).cutoff[0] == MOST


def test_noise_alone_shows_no_motion():
    """In a hundred draws of a slow motion under white noise, to which the window adds a hertz."""
    q = waves(*SLOW)[0][: int(10 * RATE), None]
    for k in range(100):
        noise = 3e-5 * np.random.default_rng(k).standard_normal(q.shape)
        assert motion_band(q + noise, RATE, LEAST, MOST).cutoff[0] < 2 * MARGIN


def test_a_polynomial_through_the_ends_takes_off_what_a_filter_would_have_to_guess():
    """Exact for a cubic; of waves it leaves ends at rest: an acceleration a hundred times smaller."""
    t = T[: int(7 * RATE)]
    cubic = 0.3 + 0.2 * t - 0.05 * t**2 + 0.01 * t**3
    assert_allclose(through_ends(cubic, RATE, 0.4), cubic, atol=1e-10)
    q, ddq = waves(0.3, seed=1)
    left = q - through_ends(q, RATE, 0.4)
    for end in (slice(0, 5), slice(-5, None)):
        assert np.abs(np.gradient(np.gradient(left, T), T)[end][2]) < 0.02 * np.abs(ddq).max()
        assert np.abs(left[end]).max() < 5e-5


def recording(q, q_motor=None):
    return Recording(T, q, tau=np.zeros_like(q), q_motor=q_motor, name="run")


def test_the_acceleration_of_a_coarse_encoder_is_as_good_as_its_motion_is_slow():
    """Noise of an acceleration grows with the power 5/2 of the band: from 10 to 2.5 Hz it falls 32 times."""
    q, ddq = (x[:, None] for x in waves(0.1, 0.2, 0.3))
    states = prepare(recording(in_steps(q, 1e-4)), Band(5.0), RATE)
    at = np.round(states.t[states.moving] * RATE).astype(int)
    error = np.sqrt(np.mean((states.ddq[states.moving] - ddq[at]) ** 2))
    white = 1e-4 / np.sqrt(12) * np.sqrt(2 / RATE / 5) * (2 * np.pi) ** 2 * MOST**2.5
    assert error < white / 10


def test_a_coarse_encoder_at_the_joint_has_the_motion_of_the_fine_one_at_the_motor():
    """What lies between them is slow, and is kept; what is fast is told by the fine one."""
    q, ddq = (x[:, None] for x in waves(*SLOW, 3.0))
    yields = 1e-3 * waves(0.15, seed=2)[0][:, None]
    states = prepare(recording(in_steps(q - yields, 2e-4), in_steps(q, 1e-7)), Band(5.0), RATE)
    at = np.round(states.t * RATE).astype(int)
    inside = states.moving
    between = (states.q_motor - states.q)[inside] - yields[at][inside]
    assert np.sqrt(np.mean(between**2)) < 1.5 * 2e-4 / np.sqrt(12) * np.sqrt(LEAST / (RATE / 2))
    error = np.sqrt(np.mean((states.ddq[inside] - ddq[at][inside]) ** 2))
    assert error < 0.02 * np.std(ddq)
