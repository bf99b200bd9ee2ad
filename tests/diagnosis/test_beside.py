"""What stands open beside every hypothesis: columns by another road."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured
from scipy.interpolate import CubicSpline

from dynid_rs.diagnosis.beside import YIELDS, other_time, yielding
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.identification.smooth_friction import shape_slopes
from dynid_rs.model.assembly import evaluate


@pytest.fixture(scope="module")
def fit():
    return Setup(ROBOT).identifier(residual=None).fit(measured(n_runs=2))


def test_friction_that_turns_round_later_is_that_of_a_shifted_clock(fit):
    late = 1e-3
    for j in range(ROBOT.n_joints):
        width, sharpness = fit.friction_.transition_width_[j], fit.friction_.sharpness_[j]
        shown = []
        for states in fit.runs_:
            dq = states.dq_motor[:, j]
            sign = dq / (width**sharpness + np.abs(dq) ** sharpness) ** (1 / sharpness)
            later, sooner = (np.interp(states.t - dt, states.t, sign) for dt in (late, -late))
            shown.append(states.in_band(later - sooner))
        column, width_column = other_time(fit)[j][:, 0], shape_slopes(fit.observations_.plan, fit.links_, fit.runs_, j)
        assert abs(np.corrcoef(column, np.concatenate(shown))[0, 1]) > 0.99
        # As usual as another width is, and as large.
        assert np.linalg.norm(column) == pytest.approx(np.linalg.norm(width_column[:, 0]))


def test_with_one_encoder_a_link_hangs_behind_its_motor(fit):
    """Inverse dynamics along the motion that a spline through the bend gives."""
    columns = yielding(fit, About.of(fit))
    assert len(columns) == ROBOT.n_joints
    loads = [evaluate(fit.model_, states)[1][:, 0] / fit.links_.torque_scale_ for states in fit.raw_runs_]
    size = np.sqrt(np.mean(np.concatenate(loads) ** 2, axis=0))
    phi = About.of(fit).phi
    for j, column in enumerate(columns):
        shown = []
        for states, load in zip(fit.raw_runs_, loads, strict=True):
            bend = CubicSpline(states.t, YIELDS * load[:, j] / size[j])
            motion = [states.q.copy(), states.dq.copy(), states.ddq.copy()]
            for k, signal in enumerate(motion):
                signal[:, j] -= bend(states.t, k)
            still = fit.robot.inverse_dynamics(states.q, states.dq, states.ddq, phi)
            hanging = fit.robot.inverse_dynamics(*motion, phi)
            shown.append(states.in_band(hanging - still) * fit.links_.torque_scale_)
        expected = np.concatenate(shown)
        for k, part in column.items():
            if np.linalg.norm(expected[:, k]) > 1e-3 * np.linalg.norm(expected):
                assert np.linalg.norm(part[:, 0] - expected[:, k]) < 0.05 * np.linalg.norm(expected[:, k])
