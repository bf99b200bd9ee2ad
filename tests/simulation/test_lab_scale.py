"""Effects scaled to what the declared model cannot absorb."""

from dataclasses import replace

import numpy as np
import pytest

from dynid_rs import _core
from dynid_rs.simulation import (
    build_effect,
    bundled_robot,
    equip,
    motion_limits,
    parse_wish,
    random_trajectory,
    scale_to,
    typical_arm,
    unabsorbed,
)

SEARCH = 0.011
"""The search stops at 1 %."""


@pytest.fixture(scope="module")
def arm():
    return typical_arm(_core.RobotModel.from_urdf(bundled_robot()))


@pytest.fixture(scope="module")
def trajectories(arm):
    return [random_trajectory(motion_limits(arm.robot), 12.0, np.random.default_rng(seed)) for seed in (0, 1)]


def left_by_hand(arm, effect, trajectories):
    """Residual of the declared model per joint."""
    ideal = replace(arm.rigid(), delay=0.0, noise_std=np.zeros(6), link_resolution=np.zeros(6))
    runs = [
        equip(ideal, [effect]).record(each, 50.0, np.random.default_rng(0), derivatives=True) for each in trajectories
    ]
    rows = []
    for run in runs:
        links = arm.robot.joint_torque_regressor(run.q, run.dq, run.ddq)
        for joint in range(6):
            basis = _core.friction_basis(run.dq[:, joint], arm.velocity_threshold[joint], arm.transition_width[joint])
            drives = np.zeros((run.n_samples, 6, 10))
            drives[:, joint] = np.column_stack([basis, run.ddq[:, joint], np.ones(run.n_samples)])
            rows.append(np.column_stack([links[:, joint], drives.reshape(run.n_samples, 60), run.tau[:, joint]]))
    size = np.concatenate([run.tau for run in runs]).std(axis=0)
    stacked = np.vstack([part / size[k % 6] for k, part in enumerate(rows)])
    A, y = stacked[:, :-1], stacked[:, -1]
    norms = np.linalg.norm(A, axis=0)
    A = A[:, norms > 1e-12 * norms.max()]  # what is left of a column without any effect is rounding
    A = A / np.linalg.norm(A, axis=0)
    # Minimum norm over all sixty inertial parameters, not the base set.
    residual = np.split(y - A @ np.linalg.lstsq(A, y, rcond=1e-9)[0], len(rows))
    return np.array([size[j] * np.sqrt(np.mean(np.concatenate(residual[j::6]) ** 2)) for j in range(6)])


@pytest.mark.parametrize("text", ["torque_ripple:0", "encoder_eccentricity:1:-1", "joint_elasticity:2"])
def test_size_leaves_what_was_asked_for(arm, trajectories, text):
    wish = scale_to(parse_wish(text), arm, 2.0, trajectories)
    assert np.sign(wish.size) == np.sign(parse_wish(text).size)
    left = unabsorbed(arm, [build_effect(wish, arm)], trajectories)
    assert np.max(left / arm.noise_std) == pytest.approx(2.0, rel=SEARCH)


def test_remainder_is_that_of_least_squares(arm, trajectories):
    effect = build_effect(parse_wish("torque_ripple"), arm)
    left = unabsorbed(arm, [effect], trajectories)
    by_hand = left_by_hand(arm, effect, trajectories)
    np.testing.assert_allclose(left, by_hand, rtol=1e-4)  # the two cut the rank elsewhere
    assert unabsorbed(arm, [], trajectories).max() < 1e-6


def test_what_is_absorbed_cannot_be_scaled(arm, trajectories):
    with pytest.raises(ValueError, match="payload cannot be scaled to 3 times the torque noise: at size 1 "):
        scale_to(parse_wish("payload"), arm, 3.0, trajectories)
    with pytest.raises(ValueError, match="the ratio must be positive, got 0"):
        scale_to(parse_wish("stribeck"), arm, 0.0, trajectories)
    with pytest.raises(ValueError, match="this arm has none"):
        scale_to(parse_wish("stribeck"), typical_arm(arm.robot, noise=0.0), 1.0, trajectories)
