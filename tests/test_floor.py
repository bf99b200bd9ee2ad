"""The floor under a residual: repetitions, noise above the band, and what other runs predict."""

from dataclasses import replace

import numpy as np
import pytest
from nameless import in_band_noise, measured, plain_arm, with_nameless

from dynid_rs.diagnosis.floor import floor, nothing_left
from dynid_rs.diagnosis.leftovers import run_residuals
from dynid_rs.diagnosis.repeats import find_repeats
from dynid_rs.evaluation import noise_floor
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import Band, States, prepare
from dynid_rs.simulation import simulate

JOINT = 2


def odd(signals):
    return np.sin(3 * signals.q[:, JOINT]) * np.sin(signals.q[:, 0])


@pytest.fixture(scope="module")
def arm():
    return plain_arm()


@pytest.fixture(scope="module")
def plans(arm):
    return simulate(arm, n_runs=4, duration=20, rate=50, seed=5).trajectories


@pytest.fixture(scope="module")
def clean(arm, plans):
    return ThreeLoopIdentifier(arm.robot, residual=None).fit(measured(arm, n_runs=3, trajectories=plans[:3], seed=1))


@pytest.fixture(scope="module")
def spoiled(arm, plans):
    """An effect that the model lacks, once with motions of their own and once with every motion played twice."""
    full = with_nameless(arm, JOINT, odd, 1.0, plans[:2])
    chosen = {"once": plans[:3], "twice": plans[:2]}
    return {
        name: ThreeLoopIdentifier(arm.robot, residual=None).fit(
            measured(full, n_runs=3 if name == "once" else 4, trajectories=trajectories, seed=2)
        )
        for name, trajectories in chosen.items()
    }


def test_wide_band_noise_is_bounded_from_below():
    rng = np.random.default_rng(0)
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


def test_at_the_floor_there_is_nothing_left(clean, arm):
    found = floor(clean, clean.runs_, run_residuals(clean))
    assert nothing_left(found).all()
    noise = in_band_noise(arm, clean.band_, 250.0)
    assert np.all(found.interval[:, 0] <= 1.05 * noise)
    np.testing.assert_allclose(found.value, noise, rtol=0.12)


def test_runs_that_repeat_give_the_noise_however_wrong_the_model_is(spoiled, arm):
    fit = spoiled["twice"]
    found = floor(fit, fit.runs_, run_residuals(fit))
    assert set(found.method) == {"repetition"}
    noise = in_band_noise(arm, fit.band_, 250.0)
    np.testing.assert_allclose(found.value, noise, rtol=0.12)
    covered = (found.interval[:, 0] <= noise) & (noise <= found.interval[:, 1])
    assert covered.sum() >= len(noise) - 1
    assert np.flatnonzero(~nothing_left(found)).tolist() == [JOINT]


def test_without_repetition_other_runs_tell_the_floor(spoiled, arm):
    fit = spoiled["once"]
    residuals = run_residuals(fit)
    found = floor(fit, fit.runs_, residuals)
    assert np.flatnonzero(~nothing_left(found)).tolist() == [JOINT]
    assert found.method[JOINT] == "left_out"
    noise = in_band_noise(arm, fit.band_, 250.0)[JOINT]
    rms = np.sqrt(np.mean(np.concatenate(residuals)[:, JOINT] ** 2))
    assert 0.9 * noise < found.value[JOINT] < 0.6 * rms
    assert found.interval[JOINT, 0] <= found.value[JOINT] <= found.interval[JOINT, 1]


def test_a_period_is_found_within_a_run(arm):
    run = simulate(arm, n_runs=1, duration=33, rate=100, seed=3)
    period = 2 * np.pi / run.trajectories[0].fundamental
    assert run.trajectories[0].n_periods == 2
    states = prepare(run.recordings[0].without("q_motor"), Band(5.0), 100.0)
    (repeat,) = find_repeats([states])
    assert repeat.shift == pytest.approx(period, abs=2e-4)


def test_a_run_recorded_twice_is_aligned_between_samples(arm, plans):
    one, other = (
        prepare(recording, Band(5.0), 250.0) for recording in measured(arm, n_runs=2, trajectories=plans[:1], seed=4)
    )
    late = 0.3137
    t = other.t[:-100] + late
    moved = {
        name: np.stack([np.interp(t, other.t, column) for column in getattr(other, name).T], axis=1)
        for name in ("q", "dq", "tau")
    }
    shorter = {name: getattr(other, name)[:-100] for name in ("ddq", "q_motor", "dq_motor", "ddq_motor", "moving")}
    early = replace(other, t=other.t[:-100], **moved, **shorter)
    (repeat,) = find_repeats([one, early])
    assert (repeat.first, repeat.second) == (0, 1)
    assert repeat.shift == pytest.approx(-late, abs=2e-4)


def test_different_motions_are_no_repetition(clean):
    assert find_repeats(clean.runs_) == []


def test_slow_motion_does_not_repeat_itself_two_seconds_later(clean):
    states = clean.runs_[0]
    t = states.t
    q = np.tile(np.sin(0.05 * t)[:, None], (1, states.q.shape[1]))
    dq = np.tile((0.05 * np.cos(0.05 * t))[:, None], (1, states.q.shape[1]))
    assert find_repeats([replace(states, q=q, dq=dq)]) == []
