"""What pooling knows of one arm: the numbers of its fit, and what a wrong gain would do to them."""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest
from helpers.small_arm import URDF, run

from dynid_rs import ArmEstimate, LinkDynamicsIdentifier, Recording, RobotModel, ThreeLoopIdentifier
from dynid_rs.identification.results import evaluate_runs, summarise
from dynid_rs.pooling.arm import _mark
from dynid_rs.pooling.gains import gain_response

ROBOT = RobotModel.from_urdf_string(URDF)


@functools.cache
def recordings(gain=(1.0, 1.0, 1.0)):
    """Two runs whose torque channels show `gain` times the torque."""
    runs = []
    for k in range(2):
        columns = run(k, rate=100.0)
        q = np.stack([columns[f"q_{j}"] for j in range(3)], axis=1)
        tau = np.stack([gain[j] * columns[f"tau_{j}"] for j in range(3)], axis=1)
        runs.append(Recording(t=columns["t"], q=q, tau=tau, name=f"run_{k}"))
    return runs


@functools.cache
def fitted(gain=(1.0, 1.0, 1.0)):
    return ThreeLoopIdentifier(ROBOT, residual=None).fit(recordings(gain))


@functools.cache
def estimate(gain=(1.0, 1.0, 1.0)):
    identifier = fitted(gain)
    told = evaluate_runs(identifier.model_, recordings(gain), identifier.raw_runs_)
    return ArmEstimate.of("one", identifier, summarise(identifier, told, told, []))


def test_it_survives_a_file():
    arm = estimate()
    back = ArmEstimate.from_json(json.loads(json.dumps(arm.to_json())))
    for name in ("form", "unknowns", "kinematics", "friction"):
        assert getattr(back, name) == getattr(arm, name)
    for name in ("x", "covariance", "gain_response", "regrouping", "speed", "error", "torque_std", "error_spread"):
        np.testing.assert_allclose(getattr(back, name), getattr(arm, name), rtol=1e-8, atol=0, err_msg=name)
    assert back.to_json() == arm.to_json()


def test_values_and_errors_are_those_of_the_result():
    identifier, arm = fitted(), estimate()
    np.testing.assert_array_equal(arm.x, identifier.links_.x_)
    assert len(arm.unknowns) == len(arm.x) == len(arm.covariance)
    assert arm.own(2, "rotor_inertia") is not None
    assert arm.own(0, "rotor_inertia") is None  # not told from the link's inertia about the axis
    np.testing.assert_allclose(arm.regrouping @ ROBOT.phi, ROBOT.base_parameters().project(ROBOT.phi), atol=1e-12)


def test_friction_at_a_speed_is_the_model_s():
    """Half the difference and half the sum of what the model's own terms say at plus and minus the speed."""
    identifier, arm = fitted(), estimate()
    model = identifier.model_
    for j, speed in ((0, 0.7), (1, 1.3), (2, 0.05)):
        q, dq = np.zeros((2, 200, 3)), np.zeros((2, 200, 3))
        dq[:, :, j] = np.array([[speed], [-speed]])
        q[:, :, j] = dq[:, :, j] * np.linspace(0, 0.2, 200)
        ends = [model.evaluate(q[way], dq[way], np.zeros((200, 3)))[1][-1, :, j] for way in range(2)]
        own = [k for k, name in enumerate(model.term_names) if "friction" in name or name == "torque_offset"]
        forth, back = (float(sum(end[own])) for end in ends)
        level, offset = arm.friction_at(j, speed)
        assert level @ arm.x == pytest.approx(0.5 * (forth - back), rel=1e-9)
        assert offset @ arm.x == pytest.approx(0.5 * (forth + back), rel=1e-9)


@pytest.mark.parametrize("j", range(3))
def test_a_gain_moves_the_estimate_as_its_response_says(j):
    """Another fit, of runs whose channel shows 0.1 % more: weights and the prior's width are found anew."""
    gain = [1.0, 1.0, 1.0]
    gain[j] += 1e-3
    arm, moved = estimate(), estimate(tuple(gain))
    std = np.sqrt(np.diag(arm.covariance))
    found = (moved.x - arm.x)[arm.estimable] / 1e-3
    said = arm.gain_response[j][arm.estimable]
    assert np.linalg.norm((found - said) / std[arm.estimable]) < 0.1 * np.linalg.norm(said / std[arm.estimable])


def test_responses_of_all_joints_and_the_prior_add_up():
    """Without a prior the responses alone add up to the estimate: all channels doubled double it."""
    links = LinkDynamicsIdentifier(prior=None, max_iter=300, tol=1e-12)  # its weights are then those of the last step
    plain = ThreeLoopIdentifier(ROBOT, residual=None, links=links).fit(recordings())
    np.testing.assert_allclose(gain_response(plain).sum(axis=0), plain.links_.x_, rtol=1e-6, atol=1e-9)


def out_and_back():
    """A run of the friction experiment: all joints out in 2 s, a pause, and back."""
    t = np.arange(0.0, 6.0, 0.01)
    x = np.clip((t - 0.5) / 2.0, 0.0, 1.0) - np.clip((t - 3.5) / 2.0, 0.0, 1.0)
    q = 0.6 * (x**3 * (10 - 15 * x + 6 * x**2))[:, None] * np.ones(3)
    dq = np.gradient(q, 0.01, axis=0)
    tau = ROBOT.inverse_dynamics(q, dq, np.gradient(dq, 0.01, axis=0), ROBOT.phi) + 3.0 * np.tanh(dq / 0.02) + dq
    return Recording(t, q, tau=tau + 0.3 * np.random.default_rng(0).normal(size=tau.shape), name="slow")


def test_channels_of_a_friction_experiment_show_as_much_more():
    links = LinkDynamicsIdentifier(prior=None, max_iter=300, tol=1e-12)
    plain = ThreeLoopIdentifier(ROBOT, residual=None, links=links, friction_law="coulomb_viscous")
    plain.fit(recordings(), out_and_back())
    np.testing.assert_allclose(gain_response(plain).sum(axis=0), plain.links_.x_, rtol=1e-5, atol=1e-7)


def test_arms_of_other_lengths_have_another_mark():
    names = tuple(ROBOT.base_parameters().names)
    other = RobotModel.from_urdf_string(URDF.replace('xyz="0.4 0 0"', 'xyz="0.45 0 0"'))
    assert _mark(ROBOT, names, "N*m") != _mark(other, tuple(other.base_parameters().names), "N*m")
    assert _mark(ROBOT, names, "N*m") != _mark(ROBOT, names, "A")
    level, tilted = (ROBOT.with_gravity((x, 0.0, -9.81)) for x in (1e-5, -1e-5))
    assert _mark(level, names, "N*m") == _mark(tilted, names, "N*m") == _mark(ROBOT, names, "N*m")
