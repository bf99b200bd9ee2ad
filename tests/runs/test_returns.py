"""Which rows of runs show the same motion again."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from dynid_rs.runs import returns
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


def assert_same_motion(phase, times, period, within=0.25):
    """Rows of one phase are whole periods apart, but for a row or two, and there are as many phases as such rows."""
    apart = (times[:, None] - times + period / 2) % period - period / 2
    assert np.abs(apart[phase[:, None] == phase]).max() < within
    places = np.unique(np.floor(times % period * ROWS + 1e-6))
    assert len(np.unique(phase)) == pytest.approx(len(places), abs=max(3, 0.03 * len(places)))


@pytest.mark.parametrize(
    ("period", "noise", "rests"), [(7.3, 0.0, ()), (7.3, 1e-4, (1,)), (7.325, 0.0, ()), (4.0125, 0.0, ())]
)
def test_what_goes_round_is_there_again_each_time(period, noise, rests):
    run = states(31.0, period=period, noise=noise, rests=rests)
    assert_same_motion(phases([run]), run.rows / RATE, period)


@pytest.mark.parametrize("begins", [3.1, -2.4])
def test_a_run_that_another_one_shows_again(begins):
    """Neither goes round; the second begins later in the motion, or sooner."""
    first, second = states(25.0, period=40.0), states(25.0, period=40.0, begins=begins)
    phase = phases([first, second])
    times = np.concatenate([first.rows / RATE, second.rows / RATE + begins])
    assert_same_motion(phase, times, 1000.0, within=0.5)


@pytest.mark.parametrize("order", [1, -1])
def test_a_part_of_what_goes_round_is_a_part_of_each_time(order):
    begins, runs = [0.0, 50.0][::order], [states(25.0), states(6.0, begins=50.0)][::order]
    times = np.concatenate([run.rows / RATE + begin for run, begin in zip(runs, begins, strict=True)])
    assert_same_motion(phases(runs), times, 7.3)


def test_a_run_that_begins_where_another_one_ends():
    """It goes on from there: less than half of it was shown before."""
    first, second = states(12.0, period=60.0), states(12.0, period=60.0, begins=11.4)
    phase = phases([first, second])
    assert_same_motion(phase, np.concatenate([first.rows / RATE, second.rows / RATE + 11.4]), 1000.0, within=0.8)


@pytest.mark.parametrize("rest", [0.5, 2.0, 4.0])
@pytest.mark.parametrize("rounds", [2, 3, 5])
def test_pauses_hide_nothing(rest, rounds):
    """Rest, several times round from rest to rest, rest."""
    period = 10.0
    t = np.arange(round((rounds * period + 2 * rest) * RATE)) / RATE
    turn = 2 * np.pi * np.clip(t - rest, 0.0, rounds * period) / period
    share = np.random.default_rng(3).normal(size=(3, 3))
    q = (1 - np.cos(np.arange(1, 4)[:, None] * turn)).T @ share
    run = prepare(Recording(t, q, tau=q, name="run.csv"), Band(CUTOFF), RATE)
    phase, times = phases([run]), run.rows / RATE
    assert_same_motion(phase, times - rest, period)


def test_rests_are_no_return_and_draw_no_other_motion_along():
    """Two runs begin and end at rest at home, and the longer one goes on with motions of its own."""

    def there_and_back(seed, duration):
        t = np.arange(round(duration * RATE)) / RATE
        shares = np.random.default_rng(seed).normal(size=(5, 3))
        angle = np.arange(1, 6)[:, None] * np.pi * np.clip(t - 2.0, 0.0, duration - 4.0) / (duration - 4.0)
        return (np.sin(angle) ** 2).T @ shares

    parts = [there_and_back(seed, 15.0) for seed in (1, 2, 3)]
    runs = []
    for q in (parts[0], np.concatenate(parts)):
        runs.append(prepare(Recording(np.arange(len(q)) / RATE, q, tau=q, name="run.csv"), Band(CUTOFF), RATE))
    for order in (runs, runs[::-1]):
        assert len(np.unique(phases(order))) >= 0.95 * len(runs[1].rows)


def test_a_joint_that_moves_another_way_is_another_motion():
    first, second = (states(25.0, period=40.0) for _ in range(2))
    second.q[:, 2] *= -1.0
    second.dq[:, 2] *= -1.0
    assert np.mean(np.diff(np.sort(phases([first, second]))) > 0) > 0.95
    assert len(np.unique(phases([first, states(25.0, period=40.0)]))) == len(first.rows)


def test_what_does_not_return_is_in_the_order_of_time():
    """Motions of their own, and a slow one, which is near where it was without having left."""
    runs = [states(10.0, period=30.0), states(12.0, period=33.0, seed=5), states(20.0, period=200.0, seed=9)]
    phase = phases(runs)
    assert np.all(np.diff(phase) > 0)


def test_runs_of_few_rows():
    still = Recording(np.arange(1000) / RATE, np.zeros((1000, 3)), tau=np.zeros((1000, 3)), name="run.csv")
    nothing = prepare(still, Band(CUTOFF), RATE)
    assert len(nothing.rows) == len(phases([nothing])) == len(phases([])) == 0
    short = states(1.5)
    assert_array_equal(np.diff(phases([nothing, short, nothing])), np.ones(len(short.rows) - 1))


@pytest.mark.parametrize("period", [10.1, 10.13, 41.0])
def test_a_long_run_goes_round_often(period):
    run = states(900.0, period=period)
    phase = phases([run])
    assert len(np.unique(phase)) == pytest.approx(period * ROWS, rel=0.02)
    assert_same_motion(phase[::7], (run.rows / RATE)[::7], period)


def test_of_a_longer_one_fewer_samples_are_compared(monkeypatch):
    monkeypatch.setattr(returns, "MOST", 1000)
    run = states(120.0, period=20.0)
    assert len(run.rows) > 2 * returns.MOST
    assert_same_motion(phases([run]), run.rows / RATE, 20.0)


def test_what_was_asked_last_is_kept():
    run = states(12.0, period=5.0)
    assert phases([run]) is phases([run])
    for seed in range(returns.MOST_KEPT):
        phases([states(3.0, seed=seed)])
    assert len(returns._KEPT) == returns.MOST_KEPT
