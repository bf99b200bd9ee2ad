"""What a fit leaves open beside every hypothesis: columns by another road."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured
from scipy.interpolate import CubicSpline

from dynid_rs.diagnosis.doubts import SHAPE_SPREAD, YIELDS, doubts, other_time, turning, yielding
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.about import About
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


def test_with_one_encoder_a_link_hangs_behind_its_motor(fit):
    """By another road: inverse dynamics along the motion that a spline through the bend gives."""
    columns = yielding(fit)
    assert len(columns) == 3
    loads = [evaluate(fit.model_, states)[1][:, 0] / fit.links_.torque_scale_ for states in fit.raw_runs_]
    size = np.sqrt(np.mean(np.concatenate(loads) ** 2, axis=0))
    for j, column in enumerate(columns):
        shown = []
        for states, load in zip(fit.raw_runs_, loads, strict=True):
            bend = CubicSpline(states.t, YIELDS * load[:, j] / size[j])
            motion = [states.q.copy(), states.dq.copy(), states.ddq.copy()]
            for k, signal in enumerate(motion):
                signal[:, j] -= bend(states.t, k)
            phi = About.of(fit).phi
            still = fit.robot.inverse_dynamics(states.q, states.dq, states.ddq, phi)
            hanging = fit.robot.inverse_dynamics(*motion, phi)
            shown.append(states.in_band(hanging - still) * fit.links_.torque_scale_)
        expected = np.concatenate(shown)
        for k, part in column.items():
            if np.linalg.norm(expected[:, k]) > 1e-3 * np.linalg.norm(expected):
                assert is_near(part[:, 0], expected[:, k], 0.05)


def test_two_encoders_leave_open_what_they_differ_in_and_no_bend():
    one = Setup(ROBOT).identifier().fit(measured(n_runs=2))
    two = Setup(ROBOT).identifier().fit(measured(n_runs=2, encoders=2))
    assert len(doubts(one)) - len(yielding(one)) == 9  # three of friction's turn, per joint
    assert len(doubts(two)) == 9 + 3
    assert SHAPE_SPREAD < 1.0
