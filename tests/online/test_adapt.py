"""Friction and payload that follow a run, against weighted least squares in numpy and against what was put in."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.data import ROOT
from helpers.watched_arm import CHANGES, LOAD, NOISE, STEP, model, recorded, watching

import dynid_rs as dyn
from dynid_rs.model.adapt import Adaptation

ROW, FIRST = 0.2, (2.0 - 0.5) / 4
"""Seconds of a row, and the deviation of a factor beforehand: limits are two of them away."""
SEEDS = range(4100, 4103)


def growing(terms, _load):
    """All friction grows by a fifth in ten minutes."""
    t = STEP * np.arange(len(terms))
    return (0.2 * t / 600)[:, None] * terms[:, 2]


@cache
def warmed(seed):
    """A run of ten minutes in which friction grows, and what followed it."""
    run = recorded(600.0, seed, change=growing)
    return run, Adaptation(model(), watch=watching()).adapt(run)


def by_numpy(run, watch, memory):
    """Factors less one after every row (n_rows, n_joints), each from one weighted sum over all rows before."""
    _, terms, _ = model().evaluate(run.q, run.dq, run.ddq)
    length = round(ROW / STEP)
    n_rows = run.n_samples // length
    left, friction = (
        signal[: n_rows * length].reshape(n_rows, length, -1).mean(axis=1)
        for signal in (run.tau - terms.sum(axis=1), terms[:, 2])
    )
    moves = dyn.Watch(model(), tolerated=dyn.Tolerated(*[1e12] * 7)).watch(run).watched
    variance = NOISE**2 * watch.inflation_ * watch.memory_
    keep = np.exp(-ROW / memory)
    found = np.zeros((len(moves), run.n_joints))
    for j in range(run.n_joints):
        seen = np.flatnonzero(moves[:, j])
        f, e = friction[seen, j], left[seen, j]
        for k in range(len(seen)):
            weights = keep ** np.arange(k, -1, -1.0) / variance[j]
            information = weights @ f[: k + 1] ** 2 + keep**k / FIRST**2
            found[seen[k] :, j] = weights @ (f[: k + 1] * e[: k + 1]) / information
    return found


def test_it_is_least_squares_that_forgets():
    run = recorded(60.0, 4001, change=CHANGES["friction grown"][0])
    followed = Adaptation(model(), watch=watching(), memory=20.0).adapt(run)
    expected = by_numpy(run, watching(), 20.0)
    n = min(len(expected), len(followed.estimates))
    assert n > 290
    np.testing.assert_allclose(followed.estimates[:n] - 1.0, expected[:n], rtol=1e-7, atol=1e-9)


def test_friction_that_grows_is_followed_within_its_interval():
    """Of 18 joints in all, because what one of them says within a memory is one number, and ten minutes have nine."""
    inside = []
    for seed in SEEDS:
        _, followed = warmed(seed)
        late = followed.t > 60
        away = np.abs(followed.estimates - (1.0 + 0.2 * followed.t[:, None] / 600))[late]
        inside.append((away <= 1.96 * followed.std[late]).mean(axis=0))
        assert np.abs(followed.factors - (1.0 + 0.2 * followed.t[:, None] / 600))[late].max() < 0.1
        assert followed.std[late].max() < 0.06
    print(f"{np.mean(inside):.3f} inside, {np.min(inside):.3f} of the worst joint")
    assert np.mean(inside) >= 0.95
    assert np.min(inside) >= 0.8


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_predicted_before_it_is_learnt_has_a_smaller_error(seed):
    run, followed = warmed(seed)
    late = run.t > 300
    without, with_it = (
        np.sqrt(np.mean((run.tau - tau)[late] ** 2, axis=0)) for tau in (followed.tau_model, followed.tau)
    )
    assert np.all(with_it < 0.5 * without)
    assert np.all(with_it < 1.3 * NOISE)


def test_a_torque_is_the_models_to_the_bit_until_something_has_moved():
    run, followed = warmed(SEEDS[0])
    total = model().evaluate(run.q, run.dq, run.ddq)[0]
    np.testing.assert_array_equal(followed.tau[:50], total[:50])
    np.testing.assert_allclose(followed.tau_model, total, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(followed.tau_measured, run.tau)


def test_a_load_that_is_hung_on_is_followed_and_friction_stays():
    run = recorded(300.0, 4201, change=CHANGES["load"][0], at=60.0)
    followed = Adaptation(model(), ("friction", "payload"), mass=5.0, watch=watching()).adapt(run)
    assert followed.load[followed.t < 60, 0].max() < 0.05
    np.testing.assert_allclose(followed.load[-1], LOAD, atol=0.05)
    assert abs(followed.mass[-1] - LOAD[0]) < 1.96 * followed.mass_std[-1]
    np.testing.assert_allclose(followed.factors[-1], 1.0, atol=0.03)
    # Nothing that cannot be was used on the way.
    mass, moments = followed.load[:, 0], np.linalg.norm(followed.load[:, 1:], axis=1)
    assert np.all((mass >= 0) & (mass <= 5.0) & (moments <= 0.2 * mass + 1e-12))
    before, after = (
        np.sqrt(np.mean((run.tau - tau)[run.t > 200] ** 2, axis=0)) for tau in (followed.tau_model, followed.tau)
    )
    assert np.all(after <= 1.05 * before)
    assert np.all(after < 1.6 * NOISE)
    assert before.max() > 10


def test_the_log_tells_every_move_of_a_twentieth():
    _, followed = warmed(SEEDS[0])
    assert {one.reason for one in followed.log} == {"followed"}
    for joint in model().robot.joint_names:
        own = [one for one in followed.log if one.joint == joint]
        assert [one.before for one in own] == [1.0, *(one.now for one in own[:-1])]
        assert all(0.05 <= abs(one.now - one.before) < 0.06 for one in own)
        assert all(one.interval[0] < one.now < one.interval[1] for one in own)
        k = model().robot.joint_names.index(joint)
        assert abs(followed.factors[-1, k] - own[-1].now) < 0.05


def test_a_limit_stops_it_and_is_told():
    run = recorded(120.0, 4301, change=lambda terms, load: 0.6 * terms[:, 2])
    followed = Adaptation(model(), watch=watching(), factor=(0.5, 1.25)).adapt(run)
    assert followed.factors.max() == 1.25
    np.testing.assert_array_equal(followed.factors[-1], 1.25)
    stopped = [one for one in followed.log if one.reason == "limit"]
    assert sorted(one.joint for one in stopped) == sorted(model().robot.joint_names)
    assert all(np.mean(one.interval) > 1.25 for one in stopped)
    assert followed.status[-1] & 32768


def test_what_was_learnt_goes_on_in_the_next_run():
    run, followed = warmed(SEEDS[0])
    half = int(300 / STEP)
    adaptation = Adaptation(model(), watch=watching())
    first = adaptation.adapt(run[:half])
    second = adaptation.adapt(run[half:], remembered=first.remembered)
    np.testing.assert_allclose(second.factors[5], first.factors[-1], atol=0.01)
    np.testing.assert_allclose(second.factors[-1], followed.factors[-1], atol=0.01)
    other = Adaptation(model(), watch=watching(), memory=30.0)
    with pytest.raises(dyn.FormatError, match="other settings"):
        other.adapt(run[half:], remembered=first.remembered)
    with pytest.raises(dyn.FormatError, match="begin anew"):
        adaptation.adapt(run[half:], remembered=first.remembered.replace(":[", ":[7e90,", 1))


def test_the_adapted_model_is_another_one_that_says_the_same(tmp_path):
    run = recorded(200.0, 4401, change=lambda terms, load: 0.2 * terms[:, 2] + load @ LOAD)
    adaptation = Adaptation(model(), ("friction", "payload"), mass=5.0, watch=watching())
    before = model().evaluate(run.q[:5], run.dq[:5], run.ddq[:5])[0]
    followed = adaptation.adapt(run)
    changed = adaptation.adapted_model(followed)
    changed.save(tmp_path / "adapted.json")
    last = slice(-20, None)
    total = dyn.TorqueModel.load(tmp_path / "adapted.json").evaluate(run.q[last], run.dq[last], run.ddq[last])[0]
    np.testing.assert_allclose(followed.tau[last], total, atol=0.02)
    np.testing.assert_array_equal(model().evaluate(run.q[:5], run.dq[:5], run.ddq[:5])[0], before)


def test_friction_of_a_physical_set_takes_the_factors_of_the_models():
    n = model().robot.n_joints
    ones, roots = np.ones(n), np.tile(np.eye(4), (n, 1, 1))
    phi = dyn._core.phi_from_pseudo_inertia(roots)
    bodies = model().with_physical(
        dyn.PhysicalSet(phi, ones, damping=2 * ones, friction=3 * ones, drive_gain=ones),
    )
    factors = np.linspace(0.5, 1.5, n)
    physical = dyn._core.with_adapted(bodies, factors.tolist(), (0.0, 0.0, 0.0, 0.0)).physical
    np.testing.assert_allclose(physical.damping, 2 * factors)
    np.testing.assert_allclose(physical.friction, 3 * factors)
    assert dyn._core.with_adapted(bodies, factors.tolist(), (1.0, 0.0, 0.0, 0.0)).physical is None


def test_positions_alone_are_followed_too():
    run = replace(recorded(120.0, 4501, change=CHANGES["friction grown"][0]), dq=None, ddq=None)
    followed = Adaptation(model(), watch=watching()).adapt(run)
    np.testing.assert_allclose(followed.factors[-1, 1], 1.2, atol=0.05)
    before, after = followed.rmse()
    assert after[1] < before[1]


@pytest.mark.parametrize("delays", [[0.02] * 6, [0.0, 0.0, 0.02, 0.0, 0.0, 0.0]])
def test_as_long_as_a_late_channel_is_not_reached_the_oldest_state_is_answered(delays):
    plain = model()
    late = dyn.TorqueModel(
        plain.robot,
        plain.phi,
        plain.effects,
        encoder_delay=plain.encoder_delay,
        noise_std=plain.noise_std,
        domain=plain.domain,
        step=STEP,
        torque_delay=delays,
    )
    run = recorded(1.0, 4701)
    expected, _, status = late.evaluate(run.q, run.dq, run.ddq)
    followed = Adaptation(late).adapt(run)
    np.testing.assert_array_equal(followed.status, status)
    held = status != 0
    assert np.count_nonzero(held) == 10
    np.testing.assert_allclose(followed.tau[held], expected[held], rtol=1e-12)


def test_nothing_moves_much_where_nothing_has_changed():
    run = recorded(300.0, 4601)
    followed = Adaptation(model(), ("friction", "payload"), mass=5.0, watch=watching()).adapt(run)
    late = followed.t > 60
    assert np.abs(followed.factors - 1.0)[late].max() < 0.04
    before, after = followed.rmse()
    assert np.all(after < 1.02 * before)


def test_the_code_of_the_page_runs():
    page = (ROOT / "docs" / "how_to" / "adapt.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    runs = [recorded(20.0, seed) for seed in (4801, 4802, 4803)]
    known = {"dyn": dyn, "model": model(), "healthy_runs": runs[:1], "run": runs[1], "next_run": runs[2]}
    exec(code, known)
    assert known["new_model"].term_names == model().term_names
    assert known["followed"].factors.shape == (len(known["followed"].t), 6)


def test_what_is_no_adaptation_is_refused():
    run = recorded(5.0, 4701)
    with pytest.raises(ValueError, match="say how much the arm may carry"):
        Adaptation(model(), ("payload",)).adapt(run)
    for parts in ((), "friction", ("gain",)):
        with pytest.raises(ValueError, match="parts: expected"):
            Adaptation(model(), parts).adapt(run)
    for wrong in ({"memory": 0.0}, {"factor": (1.2, 2.0)}, {"reach": -1.0}, {"said": float("nan")}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            Adaptation(model(), **wrong).adapt(run)
    short = Adaptation(model()).adapt(run[:20])
    with pytest.raises(ValueError, match="too short"):
        Adaptation(model()).adapted_model(short)
