"""Torque channels that show one value all the time: told at once, on their joint, and nothing else is said of it."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.watched_arm import CHANGES, STEP, model, recorded, watching

from dynid_rs import Watch
from dynid_rs.model.healthy import LEAST_FROZEN, beyond_records
from dynid_rs.model.standing import standing

AT, JOINT = 20.0, 2


def spoiled(run, value, start=AT, end=np.inf, joint=JOINT):
    """The same run, whose channel shows `value` (None: what it showed last) from `start` to `end`."""
    tau = run.tau.copy()
    late = (run.t >= start) & (run.t < end)
    tau[late, joint] = tau[np.argmax(late), joint] if value is None else value
    return replace(run, tau=tau)


def stepped(run, step):
    return replace(run, tau=np.round(run.tau / step) * step)


@pytest.mark.parametrize("value", [None, 0.0], ids=["frozen", "lost"])
def test_a_channel_that_stands_still_is_told_within_100_ms_and_nothing_else_is(value):
    watched = watching().watch(spoiled(recorded(60.0, 5), value))
    named, settled = watched.changes
    joint = model().robot.joint_names[JOINT]
    assert [(one.kind, one.joint, one.said) for one in watched.changes] == [
        ("frozen", joint, "named"),
        ("frozen", joint, "settled"),
    ]
    assert AT < named.t < AT + 0.1
    assert settled.t == pytest.approx(named.t + 20.0, abs=0.2)
    assert (named.size == 0.0) == (value == 0.0)
    assert "the torque channel does not change any more" in str(named)
    assert not watched.watched[watched.t > AT + 0.5, JOINT].any()
    assert watched.watched[watched.t > AT + 0.5].any(axis=0).sum() == len(model().robot.joint_names) - 1


def test_a_change_of_another_joint_is_named_beside_it_and_the_channel_may_come_back():
    change, kind, joint, size = CHANGES["friction grown"]
    run = spoiled(recorded(90.0, 5, change=change, at=30.0), None, end=70.0)
    watched = watching().watch(run)
    said = [(one.kind, one.said) for one in watched.changes]
    assert [one for one in said if one[0] == "frozen"] == [
        ("frozen", word) for word in ("named", "settled", "withdrawn")
    ]
    assert [one for one in said if one[0] != "frozen"] == [(kind, "named"), (kind, "settled")]
    assert watched.changes[-1].t == pytest.approx(70.0, abs=2 * STEP)
    (stands,) = standing(watching(), watched).changes
    assert (stands.kind, stands.joint) == (kind, model().robot.joint_names[joint])
    assert stands.size == pytest.approx(size, rel=0.1)
    early = watching().watch(run[: int(60.0 / STEP)])
    assert {one.kind for one in standing(watching(), early).changes} == {kind, "frozen"}


def test_several_channels_at_once_are_all_told():
    run = recorded(25.0, 5)
    for joint in range(6):
        run = spoiled(run, None, joint=joint)
    changes = watching().watch(run).changes
    assert [one.kind for one in changes] == ["frozen"] * 6
    assert {one.joint for one in changes} == set(model().robot.joint_names)
    assert max(one.t for one in changes) < AT + 0.1


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_of_coarse_channels_healthy_runs_say_how_far_the_torque_goes_while_a_value_lasts(step):
    """Steps of a deviation, and of a fifth of it: healthy runs are silent, a fault is told once the torque moves."""
    watch = Watch(model()).fit([stepped(recorded(60.0, seed), step) for seed in (1, 2)])
    assert (watch.frozen_after_ >= LEAST_FROZEN).all()
    assert (watch.frozen_way_ > 0.0).any()
    for seed in (20, 21, 22):
        assert watch.watch(stepped(recorded(120.0, seed), step)).changes == ()
    first = watch.watch(spoiled(stepped(recorded(60.0, 5), step), None)).changes[0]
    assert (first.kind, first.joint) == ("frozen", model().robot.joint_names[JOINT])
    assert first.t - AT < 1.0


def test_a_channel_that_is_measured_less_often_than_read_is_not_frozen_where_the_arm_moves_faster():
    """Held for a tenth of a second: three times as fast, the torque goes further while a value lasts than ever."""
    held = slice(None, None, round(0.1 / STEP))

    def read_slowly(run):
        tau = np.repeat(run.tau[held], round(0.1 / STEP), axis=0)[: len(run.tau)]
        return replace(run, tau=tau)

    watch = Watch(model()).fit([read_slowly(recorded(60.0, seed)) for seed in (1, 2)])
    assert (watch.frozen_after_ > 0.1).all()
    faster = recorded(60.0, 20)
    faster = replace(faster, dq=3.0 * faster.dq, ddq=9.0 * faster.ddq)
    torque, *_ = model().evaluate(faster.q, faster.dq, faster.ddq)
    changes = watch.watch(read_slowly(replace(faster, tau=torque))).changes
    assert "frozen" not in {one.kind for one in changes}


def test_an_arm_that_rests_has_no_fault():
    run = recorded(60.0, 5)
    rests = (run.t > AT) & (run.t < 40.0)
    at = int(np.argmax(rests))
    held = {name: np.where(rests[:, None], getattr(run, name)[at], getattr(run, name)) for name in ("q", "tau")}
    still = {name: np.where(rests[:, None], 0.0, getattr(run, name)) for name in ("dq", "ddq")}
    assert not [one for one in watching().watch(replace(run, **held, **still)).changes if one.kind == "frozen"]


def test_what_was_told_is_remembered():
    watch, run = watching(), spoiled(recorded(60.0, 5), None)
    first = watch.watch(run[: int(30.0 / STEP)])
    second = watch.watch(run[int(30.0 / STEP) :], remembered=first.remembered)
    assert [one.said for one in first.changes + second.changes] == ["named", "settled"]
    assert [(one.kind, one.said) for one in second.before] == [("frozen", "named")]
    again = watch.watch(recorded(30.0, 6), remembered=second.remembered)
    assert [(one.kind, one.said) for one in again.before + again.changes] == [
        ("frozen", "settled"),
        ("frozen", "withdrawn"),
    ]
    assert again.changes[0].t < 0.1


def test_a_watch_without_healthy_runs_knows_no_frozen_channel(tmp_path):
    watch = Watch(model())
    assert "frozen" not in {one.kind for one in watch.watch(spoiled(recorded(30.0, 5), None)).changes}
    watch.save(tmp_path / "watch.json")
    assert np.isinf(Watch.load(tmp_path / "watch.json", model()).frozen_after_).all()


def test_how_far_the_torque_may_go_while_a_value_lasts_keeps_the_promise():
    """It goes geometrically far while one lasts, of a thousand channels: what is further is as rare as promised."""
    rng = np.random.default_rng(1)
    n, seconds, per_day = 2000, 60.0, 20.0
    chances, keep = [], 0.6
    for _ in range(1000):
        ways = rng.geometric(1 - keep, n)
        chances.append(keep ** (beyond_records(n, 86_400 / seconds, per_day) * int(ways.max())))
    expected = 86_400 / seconds * n * np.mean(chances)
    assert 0.0 < expected < per_day
