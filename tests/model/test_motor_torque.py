"""Torque of the motors as a model predicts it, and the effect that is made of it: one formula on every road.

``tau_motor = torque_scale * tau_link + rotor inertia + torque offset + friction``; `torque_saturation` is
``c tau_motor^3``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.compiled_header import assert_same, compiled
from helpers.diagnosed import ROBOT, found_in, names, recorded, rigid
from helpers.tolerances import ALGEBRAIC
from numpy.testing import assert_allclose, assert_array_equal
from test_effects import N, effect_of, model_of, signals

from dynid_rs import _core
from dynid_rs.identification.loads import with_load
from dynid_rs.identification.smooth_friction import WAY, sign_by_way
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.model.export import c_header
from dynid_rs.model.placed import PlacedEffect
from dynid_rs.regression.columns import observe, run_rows
from dynid_rs.simulation import SimulatedArm, bundled_robot, equip, motion_limits, random_trajectory, typical_arm
from dynid_rs.simulation.effects.columns import column_effect

DECLARED = ("rotor_inertia", "torque_offset", "smooth_friction", "friction")
KINDS = ("torque_saturation", "joint_spring", "rotor_inertia", "stribeck", *DECLARED[1:])
"""The effect before what it is made of, and two beside it that do not count."""
SHOULDER = 0
"""The joint whose axis is upright: its load is inertia alone."""


def motor_torque(model, states):
    """By numpy: scaled rigid-body torque and what is declared; `states` after the encoders' delay."""
    q, dq, ddq, _, dq_motor, ddq_motor = states
    total = model.torque_scale * model.robot.inverse_dynamics(q, dq, ddq, model.phi)
    for effect, own in model.effects:
        shape = {name: np.array(values) for name, values in effect.shape}
        if effect.kind == "rotor_inertia":
            total = total + own[:, 0] * ddq_motor
        elif effect.kind == "torque_offset":
            total = total + own[:, 0]
        elif effect.kind == "friction":
            shapes = zip(shape["velocity_threshold"], shape["transition_width"], strict=True)
            basis = [_core.friction_basis(dq_motor[:, j], *of_joint) for j, of_joint in enumerate(shapes)]
            total = total + np.stack([columns @ own[j] for j, columns in enumerate(basis)], axis=1)
        elif effect.kind == "smooth_friction":
            p, size = shape["sharpness"], np.abs(dq_motor)
            s = dq_motor / (size**p + shape["transition_width"] ** p) ** (1 / p)
            columns = [s, np.abs(s), dq_motor, size, dq_motor * size, dq_motor**2]
            total = total + np.sum([k * column for k, column in zip(own.T, columns, strict=True)], axis=0)
    return total


def aligned(model, run):
    """The run as the model's effects see it."""
    q, dq, ddq, *motor = run
    return [*_core.align_link_side(q, dq, ddq, model.encoder_delay), ddq, *motor]


def test_the_motors_torque_is_the_rigid_bodys_and_all_that_is_declared():
    model, run = model_of(KINDS), signals(1)
    states = aligned(model, run)
    expected = motor_torque(model, states)
    _, terms, status = model.evaluate(*run)
    assert_array_equal(status, 0)
    counted = [k for k, name in enumerate(model.term_names) if name in ("rigid_body", *DECLARED)]
    assert_allclose(terms[:, counted].sum(axis=1), expected, **ALGEBRAIC)
    own = dict((effect.kind, values) for effect, values in model.effects)["torque_saturation"]
    assert_allclose(terms[:, 1], own[:, 0] * expected**3, **ALGEBRAIC)


def test_a_batch_has_the_bits_of_the_estimator():
    model, run = model_of(KINDS), signals(1)
    states = aligned(model, run)
    tau_link = model.robot.inverse_dynamics(*states[:3], model.phi)
    tau_motor = _core.motor_torque(model.effects, model.torque_scale, *states, tau_link=tau_link)
    effect, own = model.effects[0]
    terms = model.evaluate(*run)[1]
    assert_array_equal(_core.effect_torque(effect, own, *states, tau_link, tau_motor=tau_motor), terms[:, 1])
    columns = _core.effect_columns(effect, *states, tau_motor=tau_motor)
    assert_allclose(columns[:, :, 0], motor_torque(model, states) ** 3, **ALGEBRAIC)


def test_a_sign_that_is_told_by_the_way_is_friction_and_a_gears_hysteresis_is_not():
    model, run = model_of(["torque_offset"]), signals(2)
    states = aligned(model, run)
    still = dict(tau_link=0 * run[0])
    for way, counts in ((WAY, 1.0), (2.8e-4, 1.0), (3e-4, 0.0)):
        effect = _core.Effect.of("friction_hysteresis", presliding_distance=[way] * N)
        assert effect.is_declared == bool(counts)
        own = np.array([[1.0], [2.0], [3.0]])
        tau = _core.motor_torque([(effect, own)], [1.0] * N, *states, **still)
        assert_array_equal(tau, counts * _core.effect_torque(effect, own, *states))
    assert sign_by_way(N).is_declared
    assert not effect_of("stribeck").is_declared
    # A way that one joint alone has short is a gear's.
    assert not _core.Effect.of("friction_hysteresis", presliding_distance=[WAY, WAY, 0.01]).is_declared


def test_what_the_motors_torque_needs_is_asked_for():
    q = np.zeros((10, N))
    for arguments, words in (
        ({"torque_scale": [1.0] * 2}, "torque_scale has shape .*2.*expected .*3"),
        ({"tau_link": q[1:]}, "tau_link has 9 samples"),
        ({"terms": [(effect_of("friction"), np.zeros((N, 7)))]}, "coefficients"),
        ({"terms": [(effect_of("friction"), np.zeros((2, 8)))]}, "coefficients"),
        ({"tau_link": q + np.nan}, "tau_link holds NaN"),
    ):
        given = {"terms": [], "torque_scale": [1.0] * N, "tau_link": q} | arguments
        with pytest.raises(ValueError, match=words):
            _core.motor_torque(given.pop("terms"), given.pop("torque_scale"), q, q, q, **given)


def test_c_sums_the_motors_torque_up_as_the_estimator_does(tmp_path):
    """Whatever the order of the terms, and with friction that has a memory."""
    model, run = model_of(KINDS), signals(3)
    terms = [(sign_by_way(N), np.full((N, 1), 0.7)), *model.effects, (sign_by_way(N), np.full((N, 1), -2.0))]
    model = _core.TorqueModel(
        model.robot,
        model.phi,
        terms,
        torque_scale=[1.0, 0.7, 1.3],
        encoder_delay=[0.003, 0.0, 0.001],
        noise_std=[0.1] * N,
        domain=([[-9, 9]] * N, [99] * N, [999] * N),
    )
    header = c_header(model, "arm")
    assert (
        "x->tau_motor[j] = terms[0][j] + terms[1][j] + terms[4][j] + terms[6][j] + terms[7][j] + terms[8][j] + "
        in header
    )
    found = dict(zip(("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor"), run, strict=True))
    assert_same(model, compiled(header), found)
    assert "tau_motor[j] =" not in c_header(model_of(["friction", "load_dependent_friction"]), "arm")


def with_friction(times):
    """The small arm with so much of its friction, as large as the load then; motors feel a rotor and an offset too."""
    arm = rigid()
    return replace(arm, friction=times * arm.friction, torque_offset=0.3 * times * arm.friction[:, 0])


def saturating(arm, joint, part):
    """The arm with a drive that shows `part` too much at the greatest torque of its runs."""
    peak = max(float(np.abs(run.tau[:, joint]).max()) for run in recorded(arm))
    size = np.zeros(ROBOT.n_joints)
    size[joint] = part / peak**2
    return equip(arm, [column_effect("torque_saturation", (joint,), 1.0, {}, {"saturation": size})]), size[joint]


def test_a_laboratory_arm_saturates_with_its_motors_whole_torque():
    robot = _core.RobotModel.from_urdf(bundled_robot())
    typical = typical_arm(robot, noise=0.0)
    effect = column_effect("torque_saturation", (0, 2), 1.0, {}, {"saturation": np.array([2e-5, 0, 3e-5, 0, 0, 0])})
    trajectory = random_trajectory(motion_limits(robot), 6.0, np.random.default_rng(7))
    t = np.arange(0.0, 6.0, 0.01)
    plain, motion = typical.motion(trajectory, t), equip(typical, [effect]).motion(trajectory, t)
    expected = np.array([2e-5, 0, 3e-5, 0, 0, 0]) * plain.tau**3
    assert_allclose(motion.effects[0], expected, **ALGEBRAIC)
    assert np.abs(plain.tau - plain.tau_link)[:, 0].max() > 0.2 * np.abs(plain.tau_link)[:, 0].max()
    assert isinstance(typical, SimulatedArm)


@pytest.fixture(scope="module")
def saturated():
    """Runs of an arm whose upright joint saturates under friction as large as its load, and the coefficient."""
    arm, size = saturating(with_friction(4.0), SHOULDER, 0.25)
    return recorded(arm), size


@pytest.fixture(scope="module")
def fit(saturated):
    return fitted(saturated[0][:2])


def fitted(runs, law=None):
    effect = PlacedEffect.at("torque_saturation", SHOULDER)
    return ThreeLoopIdentifier(ROBOT, residual=None, friction_law=law, effects=(effect,)).fit(runs)


def size_in(fit):
    """Coefficient of the shoulder's saturation that a fit has found."""
    names = [name for effect in fit.observations_.plan.effects for name in effect.coefficient_names]
    return fit.links_.own_[SHOULDER, names.index("saturation")]


def unsettled(fit):
    """Largest difference of the torque that columns were made of from the model's own, over the largest torque."""
    loaded = with_load(fit.observations_.plan, fit.links_, fit.links_.own_)
    pairs = [(states.tau_motor[:, SHOULDER], loaded(states).tau_motor[:, SHOULDER]) for states in fit.runs_]
    return max(np.abs(one - other).max() / np.abs(other).max() for one, other in pairs)


def test_columns_of_a_fit_are_made_of_what_it_has_fitted(fit):
    plan, links = fit.observations_.plan, fit.links_
    names = [name for effect in plan.effects for name in effect.coefficient_names]
    at, loaded = names.index("saturation"), with_load(plan, links, links.own_)
    for states in fit.runs_:
        terms = evaluate(fit.model_, states)[1]
        declared = [k for k, name in enumerate(fit.model_.term_names) if name != "torque_saturation"]
        predicted = terms[:, declared].sum(axis=1)
        assert_allclose(loaded(states).tau_motor, predicted, rtol=0, atol=1e-9 * np.abs(predicted).max())
        assert np.abs(predicted - states.tau_link)[:, SHOULDER].max() > 0.3 * np.abs(predicted)[:, SHOULDER].max()
        rows = run_rows(plan, states, states.tau)[SHOULDER]
        moves = states.counted[:, SHOULDER]
        expected = states.in_band(states.tau_motor**3)[:, SHOULDER] * moves
        assert_allclose(rows[:, at], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_rows_without_the_motors_torque_are_refused(fit):
    with pytest.raises(ValueError, match="torque_saturation needs tau_motor, which was not given"):
        observe(fit.observations_.plan, [replace(states, tau_motor=None) for states in fit.runs_])


@pytest.mark.parametrize(("law", "most", "off"), [("paper", 2e-3, 0.02), ("smooth", 1e-2, 0.05)])
@pytest.mark.parametrize("part", [0.1, 0.25, 0.5])
def test_a_fit_settles_and_finds_the_size_however_strong(part, law, most, off):
    """At half of the torque what is off comes back 1.5 times as large from a fit that only repeats itself."""
    arm, size = saturating(with_friction(4.0), SHOULDER, part)
    found = fitted(recorded(arm)[:2], law)
    assert unsettled(found) < most
    assert size_in(found) == pytest.approx(size, rel=off)


def test_saturation_under_much_friction_is_named_and_no_friction_under_load(saturated):
    """(l + f s)^3 holds 3 l^2 f s: beside the load's cube alone it is friction that grows with the load."""
    named = names(found_in(saturated[0]))
    assert ("torque_saturation", ("shoulder",)) in named
    assert not [kind for kind, _ in named if kind == "load_dependent_friction"]
