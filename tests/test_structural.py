"""Tilt, geometry, gains and encoder discs: the true one explains most, and its refined parameters are the lab's."""

import re
from dataclasses import replace

import numpy as np
import pytest
import tolerances
from numpy.testing import assert_allclose

import dynid_rs as dyn
from dynid_rs.assembly import evaluate
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural import (
    Beside,
    displacement,
    levelled,
    put_back,
    refine,
    structural_candidates,
    structural_parameters,
    tilt_of,
)
from dynid_rs.diagnosis.structural.encoder_eccentricity import eccentricity_columns
from dynid_rs.diagnosis.structural.frames import moved_joints, tilted_gravity, with_displacement
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.results import score
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm

N_SIGMA = 4
"""Standard errors from the truth: seeded, so that it cannot flake."""
NEAR_ORACLE = 1.03
"""Error on the test run over that of a model that was told the truth."""


@pytest.fixture(scope="module")
def robot():
    return dyn.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def arm(robot):
    return replace(typical_arm(robot).rigid(), delay=0.0)


def measured(arm, wish, robot, seed=0):
    """The lab's effect, and three runs with one encoder."""
    effects = build_effects([parse_wish(wish)] if wish else [], typical_arm(robot))
    runs = simulate(equip(arm, effects), n_runs=3, duration=20, seed=seed).recordings
    return effects, [dyn.Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints) for r in runs]


def fitted(setup, runs):
    fit = setup.identifier().fit(runs[:2])
    return fit, score(fit.model_, [fit.states(runs[2])]).rmse


def explained(fit, candidates):
    """How much of the squared residual each explains beside the whole model, with its coefficients."""
    beside = Beside(fit)
    left = beside.left(beside.residual)
    gains = []
    for candidate in candidates:
        columns = beside.left(beside.stacked(candidate.columns))
        norms = np.linalg.norm(columns, axis=0)
        x = np.linalg.lstsq(columns / norms, left, rcond=1e-10)[0] / norms
        gains.append((float(left @ left - np.sum((left - columns @ x) ** 2)), x))
    return gains


def truth_of(effect):
    """(what `structural_parameters` should say, setup of a model that was told) of an effect of the lab."""
    if effect.kind == "gravity_tilt":
        return [effect.roll, effect.pitch]
    if effect.kind == "kinematic_error":
        return [*effect.offset, *effect.turn]
    joint = effect.joints[0]
    if effect.kind == "torque_gain":
        return [effect.gain[joint]]
    return effect.amplitude[joint] * np.array([np.sin(effect.phase[joint]), np.cos(effect.phase[joint])])


def told(setup, effect):
    if effect.kind == "gravity_tilt":
        gravity = tilted_gravity(setup.robot.gravity, effect.roll, effect.pitch)
        return replace(setup, robot=setup.robot.with_gravity(gravity.tolist()))
    if effect.kind == "kinematic_error":
        change = np.array([*effect.offset, *effect.turn])
        return replace(setup, robot=with_displacement(setup.robot, effect.joints[0], change))
    if effect.kind == "torque_gain":
        return replace(setup, gain_joints=effect.joints)
    error = setup.encoder_error.copy()
    error[effect.joints[0]] = truth_of(effect)
    return replace(setup, encoder_error=error)


@pytest.mark.parametrize(
    "wish", ["gravity_tilt::0.3", "kinematic_error:2:0.7", "torque_gain:1:0.3", "encoder_eccentricity:1:4"]
)
def test_the_true_one_explains_most_and_is_found_again(arm, robot, wish):
    (effect,), runs = measured(arm, wish, robot)
    setup = Setup(robot, options={"residual": None})
    fit, before = fitted(setup, runs)
    candidates = structural_candidates(fit, setup)
    gains = explained(fit, candidates)
    best = max(range(len(gains)), key=lambda k: gains[k][0])
    assert candidates[best].place == (effect.kind, effect.joints)
    setup = candidates[best].accept(setup, gains[best][1])
    for _ in range(5):
        fit, after = fitted(setup, runs)
        refined = refine(setup, fit)
        if refined is setup:
            break
        setup = refined
    assert refined is setup
    (found,) = structural_parameters(fit, setup)
    assert (found.kind, found.joints) == (effect.kind, effect.joints)
    assert np.all(np.abs(found.value - truth_of(effect)) < N_SIGMA * found.std_error)
    assert np.linalg.norm(found.value - truth_of(effect)) < np.linalg.norm(truth_of(effect))
    oracle = fitted(told(Setup(robot, options={"residual": None}), effect), runs)[1]
    assert np.all(after < NEAR_ORACLE * oracle)
    assert np.any(after < before)


def test_where_nothing_was_accepted_nothing_is_refined(arm, robot):
    _, runs = measured(arm, "", robot)
    setup = Setup(robot, options={"residual": None})
    fit, _ = fitted(setup, runs)
    assert refine(setup, fit) is setup
    assert structural_parameters(fit, setup) == []


def test_a_tilt_brings_hidden_parameters_to_light(arm):
    """A vertical first axis hides where the masses about it are. Tilted, they pull, and this file says nothing."""
    bare = re.sub(r"<inertial>.*?</inertial>", "", bundled_robot().read_text(), flags=re.S)
    (effect,), runs = measured(arm, "gravity_tilt", arm.robot)
    setup = Setup(dyn.RobotModel.from_urdf_string(bare), options={"residual": None})
    fit, _ = fitted(setup, runs)
    tilt = next(c for c in structural_candidates(fit, setup) if c.kind == "gravity_tilt")
    narrow = replace(tilt, columns=[{j: rows[:, :2] for j, rows in run.items()} for run in tilt.columns])
    (whole, x), (alone, _) = explained(fit, [tilt, narrow])
    total = float(np.sum(Beside(fit).left(Beside(fit).residual) ** 2))
    assert total - whole < 0.97 * (total - alone)
    assert np.all(np.abs(x[:2] - truth_of(effect)) < 0.1 * np.linalg.norm(truth_of(effect)))


def test_two_encoders_show_a_disc_by_themselves(arm, robot):
    runs = simulate(arm, n_runs=2, duration=10, seed=1).recordings
    setup = Setup(robot, options={"residual": None})
    kinds = {c.kind for c in structural_candidates(setup.identifier().fit(list(runs)), setup)}
    assert kinds == {"gravity_tilt", "kinematic_error", "torque_gain"}


def test_columns_of_a_disc_are_differences_of_two_runs(arm, robot):
    """By another road: positions with the error, differentiated in time."""
    _, runs = measured(arm, "", robot)
    fit, _ = fitted(Setup(robot, options={"residual": None}), runs)
    columns = eccentricity_columns(Beside(fit), 1)[0]
    states, size = fit.raw_runs_[0], 1e-3
    t, top = states.t, slice(200, -200)
    motion = simulate(arm, n_runs=1, duration=20, seed=0).motions[0]
    q, dq, ddq = motion.evaluate(t)
    exact = replace(states, q=q, dq=dq, ddq=ddq, q_motor=q, dq_motor=dq, ddq_motor=ddq)
    true = q.copy()
    true[:, 1] -= size * np.sin(q[:, 1])
    rate = [np.gradient(true, t, axis=0)]
    rate.append(np.gradient(rate[0], t, axis=0))
    moved = replace(states, q=true, dq=rate[0], ddq=rate[1], q_motor=true, dq_motor=rate[0], ddq_motor=rate[1])
    expected = (evaluate(fit.model_, moved)[0] - evaluate(fit.model_, exact)[0]) / size
    rows = np.flatnonzero(np.isin(states.rows, np.arange(len(t))[top]))
    expected = states.in_band(expected)[rows]
    for j in (1, 2):
        difference = columns[j][rows, 1] - expected[:, j]
        # Speeds that were measured against exact ones: a per cent.
        assert np.linalg.norm(difference) < 0.03 * np.linalg.norm(expected[:, j])


@pytest.mark.parametrize("gravity", [(0, 0, -9.81), (9.81, 0, 0), (0, 0, 9.81), (1.0, -5.0, 8.0)])
def test_tilt_is_read_back(robot, gravity):
    standing = robot.with_gravity(gravity)
    turned = standing.with_gravity(tilted_gravity(standing.gravity, 0.3, -0.2).tolist())
    assert_allclose(tilt_of(standing, turned), (0.3, -0.2), **tolerances.ALGEBRAIC)
    assert_allclose(np.linalg.norm(turned.gravity), np.linalg.norm(gravity), **tolerances.ALGEBRAIC)
    setup = Setup(turned, declared=standing)
    assert_allclose(levelled(setup).robot.gravity, gravity, **tolerances.ALGEBRAIC)


@pytest.mark.parametrize("joint", [0, 2, 5])
def test_displacement_is_read_back(robot, joint):
    change = np.array([0.003, -0.002, 0.001, 0.02, -0.03, 0.01])
    moved = with_displacement(with_displacement(robot, joint, change), 1 if joint != 1 else 2, -change)
    assert_allclose(displacement(robot, moved, joint), change, **tolerances.ALGEBRAIC)
    assert set(moved_joints(robot, moved)) == {1, joint}
    back = put_back(Setup(moved, declared=robot), joint)
    assert moved_joints(robot, back.robot) == (1,)


def test_only_free_gains_are_fitted(arm, robot):
    (effect,), runs = measured(arm, "torque_gain:2", robot)
    links = ThreeLoopIdentifier(robot, residual=None, free_gains=(2,)).fit(runs[:2]).links_
    assert_allclose(np.delete(links.torque_scale_, 2), 1.0, **tolerances.EXACT)
    assert abs(links.torque_scale_[2] - 1 - effect.gain[2]) < 0.1 * effect.gain[2]


def test_free_gains_change_nothing_in_ampere(arm, robot):
    _, runs = measured(arm, "", robot)
    runs = [replace(run, torque_unit="A") for run in runs[:2]]
    plain, told_so = (ThreeLoopIdentifier(robot, residual=None, free_gains=g).fit(runs).links_ for g in ((), (2,)))
    assert_allclose(told_so.x_, plain.x_, **tolerances.EXACT)
    assert_allclose(told_so.torque_scale_, plain.torque_scale_, **tolerances.EXACT)


@pytest.mark.parametrize("gains", [(6,), (-1,), (0, 1, 2, 3, 4, 5)])
def test_impossible_gains_are_refused(arm, robot, gains):
    _, runs = measured(arm, "", robot)
    with pytest.raises(ValueError, match="free_gains"):
        ThreeLoopIdentifier(robot, residual=None, free_gains=gains).fit(runs[:1])
