"""A joint that rests while others move: what it shows there is neither fitted nor scored, and slow reversals are."""

import numpy as np
import pytest
from helpers.small_arm import URDF
from numpy.testing import assert_allclose, assert_array_equal

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.identification.friction import friction_effect
from dynid_rs.identification.loops import declared_plan
from dynid_rs.regression.evaluation import band_rmse, compare, torque_std
from dynid_rs.runs.preprocessing import Band, prepare

RATE, BAND = 200.0, Band(5.0)
REST = (8.0, 12.0)
"""Seconds in which the elbow stands still while its neighbours move on."""
FRICTION = np.array([[4.0, 3.0], [5.0, 4.0], [1.0, 0.5]])
"""Coulomb [N m] and viscous [N m s/rad] of every joint."""


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf_string(URDF)


def motion(seed):
    """Waves on every joint; the elbow's clock stops, smoothly, while it rests: (t, q)."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 20.0, 1 / RATE)
    own = t - np.clip(t - REST[0], 0, REST[1] - REST[0])
    own = BAND.apply(own[:, None], RATE, 1.0)[:, 0]
    q = np.zeros((len(t), 3))
    for j, clock in enumerate((t, own, t)):
        for k in range(1, 5):
            q[:, j] += 0.25 * rng.normal() * np.sin(2 * np.pi * (0.1 * k + 0.03 * j) * clock + rng.uniform(0, 6))
    return t, q


def recording(robot, seed, stiction):
    """A run of it; `stiction` [N m] is what holds the elbow while it rests."""
    t, q = motion(seed)
    dq = np.gradient(q, t, axis=0)
    ddq = np.gradient(dq, t, axis=0)
    tau = robot.inverse_dynamics(q, dq, ddq, robot.phi) + FRICTION[:, 0] * np.tanh(dq / 0.02) + FRICTION[:, 1] * dq
    tau += 0.02 * np.random.default_rng(seed).normal(size=tau.shape)
    held = (t > REST[0] + 1.2) & (t < REST[1] - 1.2)
    tau[held, 1] += stiction
    return dyn.Recording(t, q, tau=tau, name=f"run_{seed}")


def test_the_joint_rests_and_the_arm_does_not(robot):
    states = prepare(recording(robot, 0, 0.0), BAND, RATE)
    inside = (states.t > REST[0] + 1.2) & (states.t < REST[1] - 1.2)
    assert states.resting[inside, 1].all()
    assert not states.resting[(states.t < REST[0] - 1) | (states.t > REST[1] + 1), 1].any()
    assert not states.resting[:, [0, 2]].any()
    assert states.moving[inside].all()
    assert_array_equal(states.counted, ~states.resting[states.rows])
    assert not prepare(recording(robot, 0, 0.0), BAND, RATE, standstill=True).resting.any()


def test_a_reversal_is_no_rest():
    """Joints that turn round within a second of slow motion are told by it."""
    t = np.arange(0.0, 20.0, 1 / RATE)
    q = np.stack([np.sin(0.6 * t), np.sin(0.9 * t), np.sin(1.3 * t)], axis=1)
    assert not prepare(dyn.Recording(t, q, tau=q), BAND, RATE).resting.any()


def test_what_holds_a_joint_at_rest_changes_nothing(robot):
    """Stiction of ten times the noise, on the training runs and on the test run: same model, same error."""
    fits, errors = [], []
    for stiction in (0.0, 3.0):
        fit = dyn.ThreeLoopIdentifier(robot, residual=None, friction_law="smooth")
        fit.fit([recording(robot, seed, stiction) for seed in (0, 1, 2)])
        states = fit.states(recording(robot, 3, stiction))
        compared = compare(states, fit.model_.evaluate(*states.signals())[0])
        errors.append((band_rmse([compared]), torque_std([compared])))
        fits.append(fit.links_.x_)
    size = np.abs(fits[0]).max()
    assert_allclose(fits[1], fits[0], atol=1e-3 * size)
    assert_allclose(errors[1], errors[0], rtol=0.02)
    assert (errors[0][0] < 0.05 * errors[0][1]).all()


def test_a_rotor_behind_an_elastic_gear_is_told_from_its_link(robot):
    """Where motor and link move alike the first joint's rotor is one with its link; where they do not, it is not."""
    friction = friction_effect(np.zeros(3), np.full(3, 0.02))
    one, two = (declared_plan(robot, friction, apart=apart) for apart in (None, np.ones(3, dtype=bool)))
    assert not one.own[0, 0]

    assert two.own.all()
    assert (0, 0) in one.absorbed
    assert not two.absorbed
