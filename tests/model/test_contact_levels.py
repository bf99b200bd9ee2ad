"""Thresholds from state to state: what healthy runs teach, what the file keeps, what the covariance adds."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import small_arm
from helpers.watched_arm import STEP, model, recorded

import dynid_rs as dyn
from dynid_rs.identification.directions import WIDER
from dynid_rs.model.contact_levels import Seen, fit_tails, fit_variances
from dynid_rs.model.detection import detection_curve

SECONDS = 70.0
SLOW = 0.3
"""Joint 1 is noisier below this speed [rad/s]."""


def restless(seed, seconds=SECONDS):
    """A run whose second joint leaves ten times as much while it is slow, and whose fourth leaves 5 % of its torque."""
    run = recorded(seconds, seed)
    rng = np.random.default_rng(seed)
    tau = run.tau.copy()
    slow = np.abs(run.dq[:, 1]) < SLOW
    tau[:, 1] += np.where(slow, 5.0 * np.repeat(rng.normal(size=len(tau) // 25 + 1), 25)[: len(tau)], 0.0)
    tau[:, 3] *= 1 + 0.05 * np.sin(0.7 * run.t)
    return replace(run, tau=tau)


@cache
def fitted(**settings):
    return dyn.MomentumObserver(model(), **settings).fit([restless(seed) for seed in (1, 2, 3)])


def test_a_joint_is_judged_by_what_it_does():
    observer = fitted()
    learned = observer.uncertainty_
    # The friction of this arm is steep below 0.05 rad/s, where joints count as slow; beyond, noise is there till 0.3.
    assert learned["turning"][1] > 3 * learned["moving"][1]
    for j in (0, 2):
        assert learned["turning"][j] < 1.5 * learned["moving"][j]
    run = restless(9)
    torque = np.sqrt(learned["torque"][3])
    assert torque == pytest.approx(0.05 / np.sqrt(2), rel=0.3)
    assert learned["turns_known"] == [True] * 6
    assert not any(learned["stops_known"][:5]), "they never stand"
    seen = observer.observe(run)
    fast = np.abs(run.dq[:, 1]) > 2 * SLOW
    turning = seen.threshold[:, 1] > 1.5 * np.median(seen.threshold[fast, 1])
    assert not turning[fast & (run.t > 1)].any()
    assert turning[np.abs(run.dq[:, 1]) < 0.02].mean() > 0.9


def test_promised_false_contacts_are_held_on_runs_that_nobody_saw():
    promised, hours, alarms = 200.0, 0.0, 0
    observer = fitted(false_contacts_per_hour=promised)
    for seed in range(20, 28):
        contact = observer.observe(restless(seed)).contact
        alarms += int(np.count_nonzero(contact[1:] & ~contact[:-1]))
        hours += SECONDS / 3600
    # 31 are promised; a Poisson number of that mean is beyond 50 once in a thousand times.
    assert alarms <= 50
    assert alarms >= 5, "thresholds that are never passed are too high"


def test_a_joint_that_shows_nothing_at_all_has_a_threshold_too():
    """As a locked one does whose drive is off, in a simulation without noise."""
    external, doing = np.random.default_rng(0).normal(size=(5000, 2)), np.zeros((5000, 2))
    external[:, 1] = 0.0
    found = fit_variances([Seen(external, doing, external, 0.004)], 0.02, "run")
    variances = np.array([found[name] for name in ("moving", "standing", "turning")])
    assert np.isfinite(variances).all()
    assert (variances >= np.finfo(float).tiny).all()
    assert found["torque"][1] == 0.0


def test_a_file_keeps_it(tmp_path):
    observer = fitted(false_contacts_per_hour=2.0)
    observer.save(tmp_path / "contact.json")
    loaded = dyn.MomentumObserver.load(tmp_path / "contact.json", model())
    run = restless(9, 5.0)
    ours, theirs = observer.observe(run), loaded.observe(run)
    for name in ("external", "threshold", "guide", "status"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    text = (tmp_path / "contact.json").read_text()
    for wrong, said in (
        (text.replace("dynid-contact", "dynid-watch-settings"), "not an observer's uncertainty"),
        (text.replace('"version": 2', '"version": 3'), "of version 3, this program reads version 2"),
        (text.replace("joint_1", "another"), "of an arm with other joints"),
        (text.replace('"stops_known": [', '"stops_known": [true, '), "7 values of stops_known for 6 joints"),
    ):
        assert wrong != text, said
        (tmp_path / "wrong.json").write_text(wrong)
        with pytest.raises(dyn.FormatError, match=said):
            dyn.MomentumObserver.load(tmp_path / "wrong.json", model())
    with pytest.raises(FileNotFoundError):
        dyn.MomentumObserver.load(tmp_path / "nowhere.json", model())


def test_short_runs_teach_less_and_say_so(tmp_path):
    observer = dyn.MomentumObserver(model()).fit(recorded(30.0, 1))
    assert observer.uncertainty_ is None
    with pytest.raises(ValueError, match="nothing was learned; fit on at least two minutes"):
        observer.save(tmp_path / "contact.json")
    with pytest.raises(ValueError, match="has learned nothing"):
        detection_curve(observer, recorded(30.0, 2), 5.0)
    slower = recorded(60.0, 4)
    slower = dyn.Recording(slower.t[::2], slower.q[::2], slower.dq[::2], ddq=slower.ddq[::2], tau=slower.tau[::2])
    with pytest.raises(ValueError, match=r"^recording, recording: recorded at different rates"):
        dyn.MomentumObserver(model()).fit([recorded(60.0, 1), slower])


def test_tails_are_those_of_normal_noise():
    rng = np.random.default_rng(4)
    runs = [np.abs(rng.normal(size=(60_000, 2))) for _ in range(5)]
    found = fit_tails(runs, 0.01)
    for level, per_hour, growth in zip(*found.values(), strict=True):
        # P(a block's greatest > k) = 0.2 at 2 (1 - Phi(k)) = 0.2 / 100
        assert np.sqrt(level) == pytest.approx(3.09, abs=0.05)
        assert per_hour == pytest.approx(0.2 * 3600, rel=0.02)
        # -d log P / d k^2 is a little above a half here, so the growth is a little below 2, times the margin.
        assert 1.5 < growth < 2.2
    assert fit_tails([runs[0][:9000]], 0.01) is None


@cache
def identified(law=None):
    robot = dyn.RobotModel.from_urdf_string(small_arm.URDF)
    runs = []
    for k in range(small_arm.N_RUNS):
        columns = small_arm.run(k)
        q, tau = (np.stack([columns[f"{name}_{j}"] for j in range(3)], axis=1) for name in ("q", "tau"))
        runs.append(dyn.Recording(columns["t"], q, tau=tau, joints=small_arm.JOINTS))
    return dyn.ThreeLoopIdentifier(robot, friction_law=law).fit(runs), runs


def test_directions_tell_the_covariance_of_the_torque():
    identifier, _ = identified("paper")  # friction without a memory, which is taken as known
    directions = dyn.parameter_directions(identifier)
    assert np.all(directions.kept > 0.98)
    plan, covariance = identifier.observations_.plan, identifier.parameter_covariance()
    rng = np.random.default_rng(6)
    q, dq, ddq = (rng.uniform(-size, size, (400, 3)) for size in (3.1, 4.0, 15.0))
    rows = [plan.robot.joint_torque_regressor(q, dq, ddq)[:, :, plan.pivots]]
    own = np.concatenate([dyn._core.effect_columns(effect, q, dq, ddq) for effect in plan.effects], axis=2)
    for j in range(3):
        y = np.zeros((len(q), len(covariance)))
        y[:, : plan.n_base] = rows[0][:, j]
        y[:, plan.n_base + j * plan.n_own : plan.n_base + (j + 1) * plan.n_own] = own[:, j]
        exact = np.einsum("ka,ab,kb->k", y, covariance, y)
        torque = plan.robot.joint_torque_regressor(q, dq, ddq)[:, j] @ directions.phi.T
        first = 0
        for effect, values in zip(plan.effects, directions.effects, strict=False):
            torque += own[:, j, first : first + effect.n_columns] @ values[:, j].T
            first += effect.n_columns
        told = np.sum(torque**2, axis=1) / WIDER**2
        assert np.all(told <= exact * (1 + 1e-9))
        assert np.mean(told) > 0.97 * np.mean(exact)


def test_what_is_not_known_raises_thresholds_outside_of_the_training():
    identifier, runs = identified()
    directions = dyn.parameter_directions(identifier)
    longer = runs * 6
    known = dyn.MomentumObserver(identifier.model_).fit(longer)
    unsure = dyn.MomentumObserver(identifier.model_, directions=directions).fit(longer)

    def ratio(run):
        a, b = (observer.observe(run).threshold[200:] for observer in (unsure, known))
        return np.median(a / b)

    trained = runs[0]
    t = trained.t
    fast = np.stack([1.5 * np.sin(9.0 * t + j) for j in range(3)], axis=1)
    outside = dyn.Recording(t, fast, tau=trained.tau, joints=small_arm.JOINTS)
    assert ratio(trained) < 1.5
    assert ratio(outside) > 2 * ratio(trained)


def test_the_curve_finds_large_steps_and_misses_small_ones():
    clean = [restless(seed) for seed in (30, 31)]
    large, small = (detection_curve(fitted(), clean, size) for size in (60.0, 0.2))
    for kind in ("identified", "constant"):
        assert np.all(np.diff(large.false_per_hour[kind]) <= 0)
        k = int(np.argmax(large.false_per_hour[kind] == 0))
        assert np.all(np.diff(large.missed[kind][k:]) >= 0)
        assert large.missed[kind][k] < 0.05
        assert 0 <= large.delay[kind][k] < 0.1
        assert small.missed[kind][k] > 0.9
        assert small.to_json()["delay"][kind][k] is None
    quiet = [int(np.argmax(large.false_per_hour[kind] == 0)) for kind in ("identified", "constant")]
    assert large.delay["identified"][quiet[0]] <= large.delay["constant"][quiet[1]] + STEP
    axes = large.plot()
    assert axes.shape == (1, 2)
    with pytest.raises(ValueError, match="size of a step is not positive"):
        detection_curve(fitted(), clean, 0.0)
    with pytest.raises(ValueError, match="give longer runs"):
        detection_curve(fitted(), recorded(2.5, 1), 5.0)


def test_what_guides_is_what_lies_beyond():
    run = restless(9, 20.0)
    tau = run.tau.copy()
    tau[(run.t > 10) & (run.t < 11), 2] -= 40.0
    seen = fitted().observe(replace(run, tau=tau))
    pushed = (run.t > 10.3) & (run.t < 11)
    assert np.all(seen.guide[pushed, 2] > 0)
    beyond = np.maximum(np.abs(seen.external) - seen.threshold, 0.0)
    assert np.all(np.abs(seen.guide) <= beyond + 1e-12)
    assert np.all((seen.guide != 0) == (beyond > 0))
    free = (run.t > 1) & ((run.t < 10) | (run.t > 11.5))
    assert not seen.guide[free].any()
