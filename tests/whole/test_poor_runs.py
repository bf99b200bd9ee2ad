"""Runs that tell little: a sentence or an answer, no traceback, no name that is not there, and no joint worse."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, errors, found_in, measured, names, recorded, rigid, with_effects
from helpers.small_arm import JOINTS

import dynid_rs as dyn
from dynid_rs.base.errors import DataError
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.runs.splitting import split_runs
from dynid_rs.simulation import simulate, typical_arm

NO_HARM = 1.02
RATE = 200.0


def moved(*motions, duration=12.0, seed=0):
    """One run per motion, `motion(t)` in rad (n, n_joints), of the clean arm with its noise."""
    arm, rng = rigid(), np.random.default_rng(seed)
    t = np.arange(int(duration * RATE)) / RATE
    runs = []
    for k, motion in enumerate(motions):
        q = motion(t)
        dq = np.gradient(q, t, axis=0)
        ddq = np.gradient(dq, t, axis=0)
        tau = ROBOT.inverse_dynamics(q, dq, ddq) + arm.rotor_inertia * ddq
        tau += 0.04 * np.array([80.0, 60.0, 25.0]) * np.tanh(dq / 0.02) + np.array([2.0, 1.5, 0.5]) * dq
        tau += arm.noise_std * rng.standard_normal(q.shape)
        shown = np.round(q / 6e-6) * 6e-6
        runs.append(dyn.Recording(t, shown, tau=tau, name=f"run_{k}", joints=JOINTS))
    return runs


def waves(size, hertz, phase):
    size, hertz, phase = (np.broadcast_to(x, 3) for x in (size, hertz, phase))
    return lambda t: size * np.sin(2 * np.pi * hertz * t[:, None] + phase)


def rich(k):
    return lambda t: (
        waves(0.6, (0.23, 0.31, 0.37), (k, 2 * k, 3 * k))(t) + waves(0.2, (0.71, 0.53, 0.83), (3 * k, k, 0))(t)
    )


def resting(motion, joint):
    """The motion, and one joint that hardly moves."""
    return lambda t: np.where(np.arange(3) == joint, 2e-3 * np.sin(2 * np.pi * 0.4 * t[:, None]), motion(t))


def with_rests(motion):
    """The motion with a stop of three seconds in its middle, a rest at both ends."""

    def paused(t):
        start, end = t[0] + 1.0, t[-1] - 1.0
        middle = (start + end) / 2
        inside = np.clip(t, start, end)
        own = np.where(inside < middle - 1.5, inside, np.where(inside > middle + 1.5, inside - 3.0, middle - 1.5))
        # Speed comes and goes over half a second.
        smooth = np.convolve(np.pad(own, 50, mode="edge"), np.hanning(101) / np.hanning(101).sum(), mode="valid")
        return motion(smooth)

    return paused


SLOW_IN_PHASE = (waves(0.3, 0.08, (0.0, 0.1, 0.15)), waves(0.25, 0.07, (0.5, 0.55, 0.6)), waves(0.3, 0.09, 1.0))
POOR = {
    "a joint that hardly moves in one run": (rich(1), resting(rich(2), 1), rich(3)),
    "slow motion nearly in phase": SLOW_IN_PHASE,
    "rests and pauses": (with_rests(rich(1)), with_rests(rich(2)), with_rests(rich(3))),
}


@pytest.mark.parametrize("name", POOR)
def test_poor_runs_of_a_clean_arm_give_no_name_and_do_no_harm(name):
    runs = moved(*POOR[name])
    found = found_in(runs)
    assert names(found) == set()
    before, after = errors(found, runs[2:])
    assert np.all(np.isfinite(after))
    assert np.all(after <= NO_HARM * before)


def test_a_lone_short_run_keeps_a_part_aside_and_gives_no_name():
    (run,) = measured(n_runs=1, duration=9.0)
    split = split_runs([run], [], None)
    found = found_in([*split.train, *split.test])
    assert names(found) == set()


def test_every_joint_alone_in_its_own_run():
    """Friction runs: one joint moves in each, the others stand."""
    motions = [
        lambda t, j=j: np.where(np.arange(3) == j, rich(j + 1)(t), np.array([0.3, -0.4, 0.5])) for j in (0, 1, 2)
    ]
    runs = [*moved(*motions), *moved(rich(2), seed=3)]
    found = found_in(runs)
    assert names(found) == set()
    before, after = errors(found, runs[3:])
    assert np.all(after <= NO_HARM * before)


def test_amperes_have_names_too():
    gains = np.array([20.0, 15.0, 6.0])
    for wishes, truth in (((), set()), (("friction_hysteresis:elbow:2",), {("friction_hysteresis", ("elbow",))})):
        runs = [replace(run, tau=run.tau / gains, torque_unit="A") for run in measured(*wishes)]
        found = found_in(runs)
        assert names(found) == truth
        units = {p["unit"] for entry in found.entries for p in entry["parameters"]}
        assert units <= {"A", "rad", "1"}


def test_fast_and_slow_sampling_and_two_rates():
    for rate in (50.0, 1000.0):
        assert names(found_in(measured(rate=rate, duration=10.0))) == set()


def test_one_encoder_on_elastic_gears_does_no_harm():
    """Gears yield by what no test with one encoder can see; whatever is named, no joint gets worse."""
    runs = recorded(replace(typical_arm(ROBOT), delay=0.0), encoders=1)
    found = found_in(runs)
    before, after = errors(found, runs[2:])
    assert np.all(after <= NO_HARM * before)
    assert all(math.isfinite(p["value"]) for entry in found.entries for p in entry["parameters"])


def test_a_joint_that_moves_in_no_run_is_refused_with_a_sentence():
    runs = moved(*(resting(rich(k), 2) for k in (1, 2, 3)))
    with pytest.raises(DataError, match="wrist never moves"):
        found_in(runs)


def test_pauses_are_rows_only_on_request():
    (run,) = measured(n_runs=1)
    halt = run.n_samples // 2
    q = np.concatenate([run.q[:halt], np.repeat(run.q[halt : halt + 1], 500, axis=0), run.q[halt:]])
    tau = np.concatenate([run.tau[:halt], np.repeat(run.tau[halt : halt + 1], 500, axis=0), run.tau[halt:]])
    paused = dyn.Recording(np.arange(len(q)) / RATE, q, tau=tau)
    without, with_pause = (prepare(paused, Band(5.0), RATE, standstill=standstill) for standstill in (False, True))
    assert np.sum(~without.moving) - np.sum(~with_pause.moving) >= 500
    assert not without.moving[halt + 100 : halt + 400].any()
    assert with_pause.moving[halt + 100 : halt + 400].all()


def test_runs_that_differ_in_length_and_rate_are_one_set():
    arm = with_effects(rigid(), "friction_hysteresis:elbow:2")
    long, short = (
        simulate(arm, n_runs=1, duration=d, rate=r, seed=s).recordings[0] for d, r, s in ((14, 200, 0), (8, 100, 1))
    )
    runs = [replace(run, q_motor=None, name=name) for run, name in ((long, "a"), (short, "b"))]
    found = found_in([*runs, *measured("friction_hysteresis:elbow:2", n_runs=1, seed=5)])
    assert names(found) == {("friction_hysteresis", ("elbow",))}
