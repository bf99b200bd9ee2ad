"""What stands at the end of a run: what was said, put together, and nothing that was withdrawn."""

import numpy as np
import pytest
from helpers.watched_runs import DEVIATION, both, change, run, watch

from dynid_rs.model.standing import LAST_ROWS, standing


def stands(*changes):
    return {(one.kind, one.joint): one for one in standing(watch(), run(*changes)).changes}


def test_a_settled_change_stands_with_its_settled_size():
    (found,) = stands(*both("friction", size=0.2)).values()
    assert (found.said, found.size, found.interval) == ("settled", 0.2, pytest.approx((0.18, 0.22)))


def test_a_name_that_is_still_open_stands_and_a_withdrawn_one_does_not():
    first, _ = both("gain", "joint_3")
    assert stands(first)["gain", "joint_3"].said == "named"
    assert stands(*both("gain", "joint_3", outcome="withdrawn")) == {}


def test_a_change_that_settles_under_another_name_stands_under_that_alone():
    first, _ = both("gain", "joint_3")
    _, last = both("friction", "joint_2")
    assert set(stands(first, last)) == {("friction", "joint_2")}
    _, gone = both("offset", "joint_1", outcome="withdrawn")
    assert stands(first, gone) == {}


def test_changes_of_one_kind_and_place_add_up():
    found = stands(*both("friction", size=0.2), *both("friction", size=0.15, t=50.0), *both("friction", "joint_5", 0.3))
    assert set(found) == {("friction", "joint_2"), ("friction", "joint_5")}
    total = found["friction", "joint_2"]
    assert (total.size, total.t) == (pytest.approx(0.35), 70.0)
    half = np.hypot(0.02, 0.02)
    assert total.interval == pytest.approx((0.35 - half, 0.35 + half))


def test_errors_without_a_name_multiply():
    found = stands(*both("unknown", size=1.0), *both("unknown", size=2.0, t=50.0))
    assert found["unknown", "joint_2"].size == pytest.approx(2.0 * 3.0 - 1.0)


def test_a_load_that_is_taken_off_again_is_none():
    on, off = both("load", "joint_6", 2.0), both("load", "joint_6", -1.97, t=50.0, moments=(-0.1, 0.0, 0.05))
    assert stands(*on)["load", "joint_6"].moments == (0.1, 0.0, -0.05)
    assert stands(*on, *off) == {}
    half_off = both("load", "joint_6", -1.0, t=50.0)
    left = stands(*on, *half_off)["load", "joint_6"]
    assert left.size == pytest.approx(1.0)
    assert left.moments == pytest.approx((0.2, 0.0, -0.1))


def test_a_sum_whose_interval_reaches_into_what_is_tolerated_is_none():
    """Friction by 10 %; the interval of a sum of two is the root of two as wide."""
    grown = both("friction", size=0.3)
    assert stands(*grown, *both("friction", size=-0.175, t=50.0)) == {}
    assert len(stands(*grown, *both("friction", size=-0.165, t=50.0))) == 1


def test_what_the_watch_settled_stands_as_it_is():
    """A small load far out is none that is tolerated: the watch has judged it, and only sums are judged here."""
    far_out = both("load", "joint_6", 0.09, moments=(0.08, 0.0, 0.0))
    assert stands(*far_out)["load", "joint_6"].size == pytest.approx(0.09)


def test_a_constant_torque_is_held_against_deviations():
    """Two of them are tolerated, 1 N m; what is left may be as small."""
    many = both("offset", size=5.0)
    assert stands(*many, *both("offset", size=-4.01, t=50.0)) == {}
    assert stands(*many, *both("offset", size=-3.9, t=50.0))["offset", "joint_2"].size == pytest.approx(1.1)
    assert 2.0 * DEVIATION == 1.0


def test_the_residual_at_the_end_is_of_the_last_rows_that_were_watched():
    last = run(rows=3 * LAST_ROWS, unseen=(3,))
    last.left[: 2 * LAST_ROWS, 0] = 100.0
    last.left[2 * LAST_ROWS :, 0] = 2.0 * DEVIATION
    last.left[LAST_ROWS : 2 * LAST_ROWS, 1] = -3.0 * DEVIATION
    last.watched[2 * LAST_ROWS :, 1] = False
    state = standing(watch(), last)
    np.testing.assert_allclose(state.residual[:2], [2.0, 3.0])
    assert np.isnan(state.residual[3])
    np.testing.assert_allclose(state.watched, [1, 2 / 3, 1, 0, 1, 1])


def test_a_run_without_a_row_says_nothing():
    state = standing(watch(), run(rows=0))
    assert state.changes == ()
    assert not state.watched.any()
    assert np.isnan(state.residual).all()


def test_a_change_of_kinds_that_differ_is_not_one():
    found = stands(*both("friction"), *both("gain", t=50.0), change("offset", "joint_1", 9.0, t=90.0))
    assert len(found) == 3


def test_a_frozen_channel_stands_until_it_changes_again_whatever_is_said_meanwhile():
    named, settled = both("frozen", "joint_4", 2.5)
    over = change("frozen", "joint_4", 1.0, t=60.0, said="withdrawn")
    other, outcome = both("friction", t=12.0)
    assert set(stands(named)) == {("frozen", "joint_4")}
    found = stands(other, named, outcome, settled)
    assert set(found) == {("frozen", "joint_4"), ("friction", "joint_2")}
    assert found["frozen", "joint_4"].said == "settled"
    assert set(stands(other, named, settled)) == {("frozen", "joint_4"), ("friction", "joint_2")}
    assert set(stands(named, settled, other, over)) == {("friction", "joint_2")}
