"""Laws that a model of any arm and a fit to any runs obey: energy, frames, units, time, order, names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas
import pinocchio as pin
import pytest
from helpers.diagnosed import ROBOT, measured
from helpers.small_arm import JOINTS, URDF
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation

from dynid_rs import Recording, RobotModel, ThreeLoopIdentifier, TorqueModel, _core

few = settings(max_examples=8, deadline=None, derandomize=True)
GRAVITY = np.array([0.0, 0.0, -9.81])
SHAPES = {
    "rotor_inertia": {},
    "joint_spring": {"rest_position": [0.3, -0.2, 0.0]},
    "inertial_coupling": {"partner": [-1.0, 2.0, 1.0]},
    "smooth_friction": {"transition_width": [0.3, 0.2, 0.4], "sharpness": [1.0, 1.5, 2.0]},
}
ROUNDINGS, STAMPS = 1e-5, 1e-4
"""Of searches that stop within their tolerance, after other roundings of the numbers or of the stamps."""


@pytest.fixture(scope="module")
def runs():
    return measured("stribeck:elbow:2", duration=8.0, n_runs=2)


@pytest.fixture(scope="module")
def fit(runs):
    return identified(ROBOT, runs)


def identified(robot, runs):
    return ThreeLoopIdentifier(robot, residual=None, friction_law="smooth").fit(runs)


def assert_same_model(fit, other, tolerance):
    """The same numbers of everything that is fitted, to a part of the greatest of their kind."""
    effects = zip(fit.model_.effects, other.model_.effects, strict=True)
    for one, another in [(fit.model_.phi, other.model_.phi), *((x, y) for (_, x), (_, y) in effects)]:
        assert_allclose(another, one, rtol=0, atol=tolerance * np.abs(one).max())


@few
@given(seed=st.integers(0, 2**32 - 1))
def test_the_work_of_the_torque_is_energy_and_heat(seed):
    """Power of the whole model's torque, over any stretch of any motion: what is stored, and what friction takes."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0, 4001)
    amplitude, frequency, phase = (rng.uniform(*between, (3, 4)) for between in ((0.2, 1.0), (0.5, 6.0), (0.0, 6.0)))
    angle = t[:, None, None] * frequency + phase
    q, dq, ddq = (
        np.sum(amplitude * part, axis=2)
        for part in (np.sin(angle), frequency * np.cos(angle), -(frequency**2) * np.sin(angle))
    )
    inertia, stiffness = rng.uniform(0.1, 2.0, (2, 3))
    coupled, coulomb, viscous = rng.uniform(0.1, 1.0), *rng.uniform(0.5, 5.0, (2, 3))
    friction = _core.Effect.of("smooth_friction", **SHAPES["smooth_friction"])
    parts = {"coulomb": coulomb, "viscous": viscous}
    coefficients = {
        "rotor_inertia": inertia[:, None],
        "joint_spring": stiffness[:, None],
        "inertial_coupling": np.array([[0.0], [coupled], [coupled]]),
        "smooth_friction": np.stack([parts.get(name, np.zeros(3)) for name in friction.coefficient_names], axis=1),
    }
    wide = np.tile([-1e3, 1e3], (3, 1))
    model = TorqueModel(
        ROBOT,
        ROBOT.phi,
        [(_core.Effect.of(kind, **shape), coefficients[kind]) for kind, shape in SHAPES.items()],
        encoder_delay=[0.0] * 3,
        noise_std=[1.0] * 3,
        domain=(wide, [1e3] * 3, [1e6] * 3),
    )
    tau, terms, _ = model.evaluate(q, dq, ddq)
    heat = np.sum(terms[:, list(model.term_names).index("smooth_friction")] * dq, axis=1)
    assert (heat >= 0).all()
    reference = pin.buildModelFromXML(URDF)
    data = reference.createData()
    ends = [0, len(t) - 1]
    stored = [
        pin.computeKineticEnergy(reference, data, q[k], dq[k])
        + pin.computePotentialEnergy(reference, data, q[k])
        + 0.5 * inertia @ dq[k] ** 2
        + coupled * dq[k, 1] * dq[k, 2]
        + 0.5 * stiffness @ (q[k] - SHAPES["joint_spring"]["rest_position"]) ** 2
        for k in ends
    ]
    work, lost = simpson(np.sum(tau * dq, axis=1), x=t), simpson(heat, x=t)
    assert lost > 0
    assert work == pytest.approx(stored[1] - stored[0] + lost, rel=1e-6, abs=1e-6 * lost)


@few
@given(turn=st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_a_base_that_is_turned_with_gravity_is_the_same_arm(turn, runs, fit):
    turned = Rotation.from_euler("xyz", turn)
    place = " ".join(map(str, turned.apply([0.0, 0.0, 0.3])))
    urdf = URDF.replace('xyz="0 0 0.3"', f'xyz="{place}" rpy="{" ".join(map(str, turn))}"')
    assert urdf != URDF
    robot = RobotModel.from_urdf_string(urdf, gravity=turned.apply(GRAVITY).tolist())
    assert_same_model(fit, identified(robot, runs), ROUNDINGS)


@pytest.mark.parametrize("start", [-3.7, 86_400.0, 1.7e9])
def test_when_a_run_was_made_says_nothing(start, runs, fit):
    """Stamps of the day, or since 1970, whose last digit is a quarter of a microsecond."""
    later = [replace(run, t=run.t + start) for run in runs]
    assert_same_model(fit, identified(ROBOT, later), STAMPS)


def test_which_run_comes_first_says_nothing(runs, fit):
    assert_same_model(fit, identified(ROBOT, runs[::-1]), ROUNDINGS)


def test_what_joints_are_called_says_nothing(runs, fit):
    urdf = URDF
    for joint in JOINTS:
        urdf = urdf.replace(f'name="{joint}"', f'name="of_{joint}"')
    robot = RobotModel.from_urdf_string(urdf)
    renamed = [replace(run, joints=tuple(robot.joint_names)) for run in runs]
    assert_same_model(fit, identified(robot, renamed), 0.0)


@pytest.mark.parametrize("scale", [1e-2, 37.0])
def test_in_another_unit_of_current_every_number_is_in_that_unit(scale, runs):
    """Currents have no declared size: a channel that shows `scale` times as much has as large a model."""
    small = identified(ROBOT, [replace(run, torque_unit="A") for run in runs])
    large = identified(ROBOT, [replace(run, tau=scale * run.tau, torque_unit="A") for run in runs])
    for one, another in zip(small.predict(runs), large.predict(runs), strict=True):
        assert_allclose(another, scale * one, rtol=1e-4, atol=1e-4 * scale * np.abs(one).max())


@few
@given(order=st.permutations(range(10)))
def test_columns_may_stand_in_any_order(order, runs):
    run = runs[0]
    columns = {"t": run.t}
    for j, joint in enumerate(JOINTS):
        signals = {"q": run.q, "tau": run.tau, "temperature": 20.0 + run.q}
        columns |= {f"{name}_{joint}": x[:, j] for name, x in signals.items()}
    names = list(columns)
    found = Recording.from_dataframe(pandas.DataFrame({names[k]: columns[names[k]] for k in order}), ROBOT)
    assert found.joints == JOINTS
    for name in ("t", "q", "tau"):
        assert_array_equal(getattr(found, name), getattr(run, name))
    assert_array_equal(found.temperature, 20.0 + run.q)
