"""What a fit leaves open beside every hypothesis: columns by another road."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured
from scipy.interpolate import CubicSpline

from dynid_rs.diagnosis.doubts import SHAPE_SPREAD, YIELDS, doubts, other_time, turning, yielding
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.smooth_friction import shape_slopes
from dynid_rs.model.assembly import evaluate


@pytest.fixture(scope="module")
def fit():
    runs = measured(n_runs=2)
    return Setup(ROBOT).identifier().fit(runs)


def is_near(column, expected, tolerance):
    return np.linalg.norm(column - expected) < tolerance * np.linalg.norm(expected)


def test_friction_that_turns_round_later_is_friction_on_a_shifted_clock(fit):
    late, shown = 2e-3, []
    for states in fit.raw_runs_:
        kinds = [effect.kind for effect, _ in fit.model_.effects]
        friction = evaluate(fit.model_, states)[1][:, 1 + kinds.index("smooth_friction")]
        moved = np.stack([np.interp(states.t - late, states.t, column) for column in friction.T], axis=1)
        shown.append(states.in_band((moved - friction) / late))
    shown, turns = np.concatenate(shown), turning(fit)
    for j in range(3):
        assert is_near(turns[:, j], shown[:, j], 0.1)
        # As large as what another width makes, which is as usual.
        width = shape_slopes(fit.observations_.plan, fit.links_, fit.runs_, j)[:, 0]
        column = other_time(fit, turns, j)[:, 0]
        assert np.sqrt(np.mean(column**2)) == pytest.approx(np.sqrt(np.mean(width**2)))
        assert np.corrcoef(column, turns[:, j])[0, 1] == pytest.approx(1.0)


def test_with_one_encoder_a_motor_is_ahead_of_the_link_that_it_carries(fit):
    shown, loads = [[] for _ in range(3)], []
    for states in fit.raw_runs_:
        loads.append(evaluate(fit.model_, states)[1][:, 0] / fit.links_.torque_scale_)
    size = np.sqrt(np.mean(np.concatenate(loads) ** 2, axis=0))
    for states, load in zip(fit.raw_runs_, loads, strict=True):
        plain = evaluate(fit.model_, states)[0]
        for j in range(3):
            # A tenth of the way, for friction's sign is round.
            bend = CubicSpline(states.t, 0.1 * YIELDS * load[:, j] / size[j])
            motor = [states.q_motor.copy(), states.dq_motor.copy(), states.ddq_motor.copy()]
            for k, signal in enumerate(motor):
                signal[:, j] += bend(states.t, k)
            signals = [states.q, states.dq, states.ddq, *motor]
            torque = fit.model_.evaluate(*signals, step=1 / states.rate)[0]
            shown[j].append(states.in_band(10 * (torque - plain))[:, j])
    columns = yielding(fit)
    assert len(columns) == 6
    for j in range(3):
        hangs, ahead = columns[2 * j : 2 * j + 2]
        assert set(hangs) >= {j}
        assert set(ahead) == {j}
        assert is_near(ahead[j][:, 0], np.concatenate(shown[j]), 0.1)


def test_two_encoders_leave_open_what_they_differ_in_and_no_bend():
    one = Setup(ROBOT).identifier().fit(measured(n_runs=2))
    two = Setup(ROBOT).identifier().fit(measured(n_runs=2, encoders=2))
    assert len(doubts(one)) - len(yielding(one)) == 9  # three of friction's turn, per joint
    assert len(doubts(two)) == 9 + 3
    assert SHAPE_SPREAD < 1.0
