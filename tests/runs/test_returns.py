"""Which rows of runs show the same motion again."""

import numpy as np
import pytest

from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.returns import phases

RATE, CUTOFF = 100.0, 5.0
ROWS = 20.0
"""Rows per second: four to a period of the band's edge."""


def states(duration, period=7.3, begins=0.0, seed=0, noise=0.0, rests=()):
    """Two joints in five harmonics of a period, less what rests."""
    t = np.arange(round(duration * RATE)) / RATE
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi / period * np.arange(1, 6)[:, None] * (t + begins) + rng.uniform(0, 2 * np.pi, (5, 1))
    share = rng.normal(size=(5, 3)) / np.arange(1, 6)[:, None]
    share[:, list(rests)] = 0.0
    q = np.sin(angle).T @ share + noise * np.random.default_rng(seed + 1).normal(size=(len(t), 3))
    return prepare(Recording(t, q, tau=q, name="run.csv"), Band(CUTOFF), RATE)


def assert_same_motion(phase, times, period):
    """Rows have the same phase where, and only where, they are whole periods apart."""
    apart = (times[:, None] - times + period / 2) % period - period / 2
    alike = phase[:, None] == phase
    assert np.abs(apart[alike]).max() < 1.6 / ROWS
    assert np.all(alike[np.abs(apart) < 0.4 / ROWS])


@pytest.mark.parametrize(("noise", "rests"), [(0.0, ()), (1e-4, (1,))])
def test_what_goes_round_is_there_again_each_time(noise, rests):
    run = states(31.0, noise=noise, rests=rests)
    phase = phases([run])
    assert len(np.unique(phase)) == pytest.approx(7.3 * ROWS, abs=2)
    assert_same_motion(phase, run.rows / RATE, 7.3)


@pytest.mark.parametrize("begins", [3.1, -2.4])
def test_a_run_that_another_one_shows_again(begins):
    """Neither goes round; the second begins later in the motion, or sooner."""
    first, second = states(25.0, period=40.0), states(25.0, period=40.0, begins=begins)
    phase = phases([first, second])
    times = np.concatenate([first.rows / RATE, second.rows / RATE + begins])
    assert_same_motion(phase, times, 1000.0)


def test_a_part_of_what_goes_round_is_a_part_of_each_time():
    first, second = states(25.0), states(9.0, begins=50.0)
    phase = phases([first, second])
    assert_same_motion(phase, np.concatenate([first.rows / RATE, second.rows / RATE + 50.0]), 7.3)


def test_what_does_not_return_is_in_the_order_of_time():
    """Motions of their own, and a slow one, which is near where it was without having left."""
    runs = [states(10.0, period=30.0), states(12.0, period=33.0, seed=5), states(20.0, period=200.0, seed=9)]
    phase = phases(runs)
    assert np.all(np.diff(phase) > 0)


def test_what_stands_still_has_no_phase():
    t = np.arange(1000) / RATE
    run = prepare(Recording(t, np.zeros((1000, 2)), tau=np.zeros((1000, 2)), name="run.csv"), Band(CUTOFF), RATE)
    assert len(phases([run])) == len(run.rows)


def test_a_long_run_is_compared_in_fewer_samples():
    run = states(900.0, period=41.0)
    phase = phases([run])
    assert len(np.unique(phase)) == pytest.approx(41.0 * ROWS, rel=0.02)
    assert_same_motion(phase[::50], (run.rows / RATE)[::50], 41.0)
