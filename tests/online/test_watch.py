"""`Watch`: what of a model no longer holds is named with its size, and nothing is where nothing has changed."""

import json

import numpy as np
import pytest
from helpers.watched_arm import CHANGES, LOAD, STEP, WORTH, model, motion, recorded, watching

from dynid_rs import FormatError, Recording, Tolerated, Watch


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_named_with_its_size_and_taken_for_granted(name):
    change, kind, joint, size = CHANGES[name]
    at = 20.0
    watched = watching().watch(recorded(80.0, 5, change=change, at=at))
    named, settled = watched.changes
    assert (named.kind, settled.kind) == (kind, kind)
    assert named.joint == settled.joint == model().robot.joint_names[joint]
    assert (named.said, settled.said, named.either) == ("named", "settled", None)
    assert at < named.t < at + 20 < settled.t + 10
    assert settled.size == pytest.approx(size, rel=0.1)
    low, high = settled.interval
    assert abs(settled.size - size) < 0.75 * (high - low)  # of six intervals of 95 % one may miss
    assert high - low < named.interval[1] - named.interval[0]
    if kind == "load":
        np.testing.assert_allclose(settled.moments, np.sign(size) * LOAD[1:], atol=0.04)
        assert named.t < at + 3.0
    # What was named is expected from then on.
    late = (watched.t > settled.t + 1) & watched.watched.all(axis=1)
    relative = watched.left[late] / watched.deviation[late]
    assert np.abs(relative.mean(axis=0)).max() < 1.0


@pytest.mark.parametrize("joint", [1, 2])
def test_a_position_that_jumps_is_named_and_taken_for_granted(joint):
    """The encoder is 0.04 rad off from 20 s on, once friction has grown on another joint that is told beside it."""
    size, at = -0.04, 20.0
    friction = CHANGES["friction fallen"][0]
    run = recorded(120.0, 12, change=lambda terms, load: np.where(run_time(terms) > 70.0, friction(terms, load), 0.0))
    late = (run.t >= at)[:, None] * (np.arange(6) == joint)
    jumped = Recording(run.t, run.q + size * late, run.dq, ddq=run.ddq, tau=run.tau, joints=run.joints)
    watched = watching().watch(jumped)
    slip, grown = (change for change in watched.changes if change.said == "settled")
    assert (slip.kind, slip.joint) == ("slip", model().robot.joint_names[joint])
    assert slip.size == pytest.approx(size, rel=0.05)
    assert slip.interval[0] - 0.001 < size < slip.interval[1] + 0.001
    assert (grown.kind, grown.joint) == ("friction", model().robot.joint_names[4])
    assert len(watched.changes) == 4
    assert "encoder slip" in str(slip)
    assert str(slip).endswith("(settled)")


def run_time(terms):
    return (np.arange(len(terms)) * STEP)[:, None]


def test_one_change_after_the_other():
    first, _kind, _j, _size = CHANGES["friction grown"]
    second = CHANGES["load"][0]

    def both(terms, load):
        late = (np.arange(len(terms)) * STEP > 50.0)[:, None]
        return first(terms, load) + late * second(terms, load)

    changes = [
        change
        for change in watching().watch(recorded(100.0, 6, change=both, at=10.0)).changes
        if change.said == "settled"
    ]
    assert [(change.kind, round(change.size, 1)) for change in changes] == [("friction", 0.2), ("load", 2.0)]


def test_what_is_tolerated_is_no_change():
    def little(terms, load):
        gain = 0.02 * terms.sum(axis=1) * (np.arange(6) == 4)
        return 0.05 * terms[:, 2] + gain + load @ [0.05, 0.0, 0.0, 0.0]

    assert watching().watch(recorded(120.0, 7, change=little)).changes == ()


def test_nothing_is_named_where_nothing_has_changed():
    """Half an hour: one false alarm a day would be two in a hundred of such tests."""
    for seed in range(20, 35):
        assert watching().watch(recorded(120.0, seed)).changes == ()


def test_a_change_without_a_name_is_called_unknown():
    def shaking(terms, load):
        return 6.0 * np.sin(np.arange(len(terms)) * STEP * 2 * np.pi * 1.7)[:, None] * (np.arange(6) == 3)

    (named, *_) = watching().watch(recorded(60.0, 8, change=shaking, at=20.0)).changes
    assert (named.kind, named.joint) == ("unknown", model().robot.joint_names[3])
    assert named.size > 1.0
    assert "look again" in str(named)


def test_a_push_passes_and_blinds_nothing():
    """Two seconds of a hand on the elbow, and half a minute later more friction there."""
    first = CHANGES["friction grown"][0]

    def pushed(terms, load):
        t = np.arange(len(terms)) * STEP
        push = 20.0 * ((t > 15.0) & (t < 17.0))[:, None] * (np.arange(6) == 1)
        return push + (t > 50.0)[:, None] * first(terms, load)

    changes = watching().watch(recorded(100.0, 9, change=pushed)).changes
    assert [change.said for change in changes if change.t < 50.0] in ([], ["named", "withdrawn"])
    (settled,) = (change for change in changes if change.said == "settled")
    assert settled.kind == "friction"
    assert settled.size == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize("joint", [0, 4])
def test_a_bump_is_over_when_it_is(joint):
    """A fifth of a second of 10 N m: five seconds later the watch listens again, and goes on doing so."""

    def bumped(terms, load):
        t = np.arange(len(terms)) * STEP
        return 10.0 * ((t > 10.0) & (t < 10.2))[:, None] * (np.arange(6) == joint)

    for seconds in (18.0, 22.0, 26.0, 30.0):
        done = watching().watch(recorded(seconds, 5, change=bumped))
        assert done.changes == ()
        assert json.loads(done.remembered)["numbers"][0] == 0.0, "it still looks at what was there"


def test_a_load_is_named_beside_warm_gears():
    """Friction that has fallen by what is tolerated on all joints does not hide it."""

    def warm(terms, load):
        return load @ LOAD - 0.09 * terms[:, 2]

    settled = [
        change for change in watching().watch(recorded(80.0, 11, change=warm)).changes if change.said == "settled"
    ]
    assert settled[0].kind == "load"
    assert settled[0].size == pytest.approx(LOAD[0], rel=0.06)


def test_a_joint_that_stands_and_states_outside_say_nothing():
    t, (q, dq, ddq) = motion(40.0, 3)
    for signal in (q, dq, ddq):
        signal[:, 2] = 0.0
    tau = model().evaluate(q, dq, ddq)[0]
    tau[:, 2] += 5.0  # static friction holds any torque
    rec = Recording(t, q, dq, ddq=ddq, tau=tau, joints=model().robot.joint_names)
    watched = Watch(model()).watch(rec)
    assert watched.changes == ()
    assert not watched.watched[:, 2].any()
    assert watched.watched[:, 0].mean() > 0.5
    far = Recording(t, q + 9.0, dq, ddq=ddq, tau=tau, joints=model().robot.joint_names)
    assert not Watch(model()).watch(far).watched.any()


def test_fit_finds_how_much_rows_are_worth():
    """Noise of this memory leaves rows of this size: the mean of an Ornstein-Uhlenbeck process."""
    watch = watching()
    ratio = 0.2 / WORTH
    expected = 2 / ratio**2 * (ratio - 1 + np.exp(-ratio))
    np.testing.assert_allclose(watch.inflation_, expected, rtol=0.35)
    assert np.all((watch.memory_ >= 1) & (watch.memory_ < 6))


def test_fit_takes_what_few_rows_say_at_the_unfavourable_end():
    """Of sixty joints that were learned from twenty seconds few are taken for better than they are."""
    exact = Watch(model()).fit([recorded(200.0, seed) for seed in range(40, 48)])
    long_run = exact.inflation_ * exact.memory_
    short = [Watch(model()).fit([recorded(20.0, seed)]) for seed in range(50, 60)]
    ratios = np.concatenate([one.inflation_ * one.memory_ / long_run for one in short])
    assert np.mean(ratios < 0.9) < 0.15
    assert np.median(ratios) > 1.1
    found = np.concatenate([one.inflation_ for one in short]).reshape(10, -1) / exact.inflation_
    assert np.mean(found < 0.9) < 0.1


def test_rows_slower_than_healthy_ones_say_nothing():
    """A joint that creeps as none did, on which friction may be anything."""
    t, (q, dq, ddq) = motion(30.0, 3)
    speed = 0.3 * watching().least_speed_[1]
    assert speed > 0.0
    q[:, 1], dq[:, 1], ddq[:, 1] = q[0, 1] + speed * t, speed, 0.0
    tau = model().evaluate(q, dq, ddq)[0]
    tau[:, 1] += 20.0
    run = Recording(t, q, dq, ddq=ddq, tau=tau, joints=model().robot.joint_names)
    assert not watching().watch(run).watched[:, 1].any()
    assert watching().watch(run).changes == ()
    assert Watch(model()).watch(run).watched[:, 1].any()


def test_texts_tell_kind_place_and_size():
    changes = [watching().watch(recorded(80.0, 5, change=CHANGES[name][0], at=20.0)).changes[1] for name in CHANGES]
    said = [str(change) for change in changes]
    assert all("settled" in text for text in said)
    for text, (_, kind, _, _) in zip(said, CHANGES.values(), strict=True):
        assert {"offset": "constant torque"}.get(kind, kind) in text
    assert "kg" in said[-1]
    assert "N*m" in said[3]
    assert "%" in said[0]
    assert changes[0].to_json()["kind"] == "friction"


def test_wrong_runs_and_settings_are_refused():
    run = recorded(10.0)
    with pytest.raises(ValueError, match=r"holds torque in A, the model gives N\*m"):
        watching().watch(recorded(10.0, unit="A"))
    with pytest.raises(ValueError, match="friction is outside its range"):
        Watch(model(), tolerated=Tolerated(friction=0.0)).watch(run)
    with pytest.raises(ValueError, match=r"^recording: no joint moves .* too little to tell what it leaves"):
        Watch(model()).fit(recorded(3.0))


def test_a_watch_goes_on_after_a_restart_with_what_it_knew():
    """A run in two parts is told as in one; what was settled is not said again, and what was under way goes on."""
    watch = watching()
    run = recorded(90.0, 5, change=CHANGES["friction grown"][0], at=4.0)
    whole = watch.watch(run).changes
    assert [change.said for change in whole] == ["named", "settled"]
    for cut in (whole[0].t - 1.0, whole[0].t + 5.0, whole[1].t + 2.0):
        at = int(np.searchsorted(run.t, cut))
        first = watch.watch(run[:at])
        second = watch.watch(run[at:], remembered=first.remembered)
        told = first.changes + second.changes
        assert [(one.kind, one.joint, one.said) for one in told] == [(one.kind, one.joint, one.said) for one in whole]
        for one, other in zip(told, whole, strict=True):
            assert abs(one.t - other.t) < 1.0  # a row or two are lost
            # A name is given by few rows, a size settles by many.
            low, high = other.interval
            assert abs(one.size - other.size) < (0.02 if one.said == "settled" else 0.5 * (high - low))
        assert len(watch.watch(run[at:]).changes) == 2  # and without it begins anew
    # Part by part nothing is lost but rows in the making: after ten more restarts it still stands.
    for _ in range(10):
        second = watch.watch(run[at:], remembered=second.remembered)
        assert second.changes == ()


def test_what_another_watch_remembers_is_refused():
    known = watching().watch(recorded(5.0, 5)).remembered
    for other in (Watch(model()), Watch(model("A")).fit([recorded(60.0, 1, unit="A")])):
        with pytest.raises(FormatError, match="remembered: of another model, or of a watch with other settings"):
            other.watch(recorded(5.0, 5, unit=other.model.torque_unit), remembered=known)
    for bad in ("", "{}", "[]", known[:-9], known.replace('"numbers":[', '"numbers":[1e300,'), known + "x"):
        with pytest.raises(FormatError, match="remembered: "):
            watching().watch(recorded(5.0, 5), remembered=bad)


def test_a_run_without_a_row_leaves_what_is_known():
    watch = watching()
    known = watch.watch(recorded(5.0, 5)).remembered
    short = recorded(5.0, 6)[:40]
    assert watch.watch(short, remembered=known).remembered == known


def test_a_run_of_a_row_that_is_not_judged_leaves_what_is_known():
    """Whatever the length of a run, what is remembered after it can be recalled."""
    watch = watching()
    known = watch.watch(recorded(5.0, 5)).remembered
    run = recorded(5.0, 6)
    for n in range(95, 135, 3):
        after = watch.watch(run[:n], remembered=known).remembered
        assert "null,null,null,null,null,null,null,null,null,null,null,null" not in after[:200]
        watch.watch(run, remembered=after)
