"""95 % intervals of errors and of their change hold as often as they say, and are not said where they cannot."""

import error_interval_coverage as simulation
import numpy as np
import pytest

from dynid_rs.regression.error_interval import LEAST_ROWS, change_interval, mean_squares, rmse_interval
from dynid_rs.regression.evaluation import band_rmse

N_RUNS = 1500
"""Simulated runs per case: the standard error of a coverage of 95 % is 0.6 %."""
LEAST, MOST = 92.5, 98.9
"""Coverage [%] that is wanted, 93 to 97, and three standard errors; cautious where a spectrum is flat-topped, as the
stretch for memory is then not needed."""
SAID = [
    ("AR(1)", 15.0, 0.0),
    ("AR(1)", 15.0, 0.5),
    ("AR(1)", 15.0, 1.0),
    ("AR(1)", 30.0, 2.0),
    ("AR(1)", 60.0, 5.0),
    ("band-limited", 30.0, 0.5),
    ("band-limited", 60.0, 2.0),
    ("AR(1), size along the motion", 30.0, 1.0),
    ("AR(1), size drifts", 60.0, 5.0),
    ("white, size drifts", 30.0, 2.0),
]


@pytest.mark.parametrize(("kind", "length", "memory"), SAID)
def test_intervals_hold_as_often_as_they_say(kind, length, memory):
    rng = np.random.default_rng(7)
    before, after = (simulation.as_runs(e) for e in simulation.simulated(rng, kind, length, memory, N_RUNS))
    said, held = simulation.held(rmse_interval([before]), 1.0)
    assert said > 90, said
    assert LEAST <= held <= MOST, held
    said, held = simulation.held(change_interval([after], [before]), simulation.CHANGE)
    assert said > 85, said
    assert LEAST <= held <= MOST, held


def test_a_run_too_short_for_its_memory_gets_no_interval():
    """A few periods of slow noise: what is said nevertheless misses in no more than a twentieth of all runs or so."""
    rng = np.random.default_rng(8)
    errors, _ = simulation.simulated(rng, "band-limited", 15.0, 5.0, N_RUNS)
    said, _ = simulation.held(rmse_interval([simulation.as_runs(errors)]), 1.0)
    assert said < 5, said
    errors, _ = simulation.simulated(rng, "AR(1)", 15.0, 5.0, N_RUNS)
    said, held = simulation.held(rmse_interval([simulation.as_runs(errors)]), 1.0)
    assert said < 60, said
    assert said * (100 - held) / 100 < 7, (said, held)


def test_too_few_rows_no_error_and_one_value_all_along_get_no_interval():
    noise = np.random.default_rng(0).standard_normal((LEAST_ROWS, 3))
    assert None not in rmse_interval([simulation.as_runs(noise)])
    assert rmse_interval([simulation.as_runs(noise[1:])]) == [None] * 3
    still = simulation.as_runs(np.zeros((400, 1)))
    assert rmse_interval([still]) == [None]
    assert rmse_interval([simulation.as_runs(np.full((400, 1), 2.0))]) == [None]
    assert change_interval([still], [still]) == [None]


def test_intervals_are_those_of_a_root_mean_square():
    """Around the RMSE itself, and in its unit; an offset is part of the error, though it has no spread."""
    errors = 3.0 + np.random.default_rng(1).standard_normal((600, 40))
    run = simulation.as_runs(errors)
    pairs = list(zip(rmse_interval([run]), band_rmse([run]), strict=True))
    assert all(low < value < high for (low, high), value in pairs)
    # The mean square has a standard deviation of sqrt(4 * 9 + 2) / sqrt(600), so the RMSE one of 0.040.
    widths = [high - low for (low, high), _ in pairs]
    assert 2 * 1.96 * 0.040 < np.median(widths) < 2 * 1.96 * 0.040 * 1.6
    scaled = rmse_interval([simulation.as_runs(10 * errors)])
    np.testing.assert_allclose(scaled, 10 * np.array(rmse_interval([run])), rtol=1e-12)


def test_the_change_is_compared_place_by_place():
    """What two models share does not count: far narrower than of two independent runs, and nothing where they agree."""
    rng = np.random.default_rng(2)
    shared, own, other = rng.standard_normal((3, 600, 200))
    before, after = simulation.as_runs(shared), simulation.as_runs(0.7 * (shared + 0.1 * own))
    unpaired = simulation.as_runs(0.7 * np.hypot(1, 0.1) * other)
    width, apart = (
        np.median([high - low for low, high in change_interval([run], [before])]) for run in (after, unpaired)
    )
    # With correlation r the difference of the squares varies by 1 - r^4 of what it does without: r^2 = 1 / 1.01.
    assert width < 0.25 * apart
    assert simulation.held(change_interval([unpaired], [before]), 0.7 * np.hypot(1, 0.1) - 1)[1] > 90
    assert change_interval([before], [before]) == [(0.0, 0.0)] * 200


def test_the_change_is_between_root_mean_squares_and_turns_round():
    rng = np.random.default_rng(3)
    before, after = (simulation.as_runs(size * rng.standard_normal((800, 30))) for size in (2.0, 1.0))
    forth, back = np.array(change_interval([after], [before])), np.array(change_interval([before], [after]))
    ratio = band_rmse([after]) / band_rmse([before])
    np.testing.assert_allclose(np.sqrt(np.prod(1 + forth, axis=1)), ratio, rtol=1e-12)
    np.testing.assert_allclose(1 + back, 1 / (1 + forth[:, ::-1]), rtol=1e-12)


def test_rows_on_which_a_joint_rests_do_not_count_and_runs_are_put_together():
    rng = np.random.default_rng(4)
    first, second = simulation.as_runs(rng.standard_normal((300, 1))), simulation.as_runs(rng.standard_normal((500, 1)))
    second.states.resting[400:] = True
    second.error[400:] = 1e3
    (square,) = mean_squares([first, second])
    kept = np.concatenate([first.error, second.error[:400]])
    assert square.value == pytest.approx(np.mean(kept**2))
    ((low, high),) = rmse_interval([first, second])
    assert low < np.sqrt(square.value) < high < 1.5
