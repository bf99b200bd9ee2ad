"""Tilt, mounting, geometry, gains and encoder discs: columns by another road, and what was accepted is read back."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers import tolerances
from helpers.diagnosed import (
    ROBOT,
    SIX_AXES,
    entry_of,
    errors,
    found_in,
    holds,
    measured,
    names,
    recorded,
    rigid,
    truth_of,
    with_effects,
)
from helpers.small_arm import JOINTS, URDF
from numpy.testing import assert_allclose

import dynid_rs as dyn
from dynid_rs.base.errors import DataError
from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.loop import diagnose
from dynid_rs.diagnosis.setup import Setup, believed
from dynid_rs.diagnosis.standing import sized, standing
from dynid_rs.diagnosis.structural import structural_hypotheses, undone, value_of, with_value
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.diagnosis.structural.torque_delay import later
from dynid_rs.diagnosis.structure_plot import structure_plot
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.model.placement import (
    displacement,
    tilt_of,
    tilted_gravity,
    with_displacement,
)

SIDEWAYS = (9.81, 0.0, 0.0)


def fitted(setup, runs):
    return setup.identifier(residual=None).fit(runs)


@pytest.mark.parametrize("gravity", [SIDEWAYS, (0.0, 0.0, 9.81)], ids=["on a wall", "upside down"])
def test_another_mounting_is_named_and_the_error_is_that_of_an_arm_that_was_told(gravity):
    told = ROBOT.with_gravity(list(gravity))
    runs = recorded(replace(rigid(), robot=told))
    found = found_in(runs)
    assert names(found) == {("gravity_tilt", JOINTS)}
    assert_allclose(found.setup.robot.gravity, gravity, atol=0.1)
    before, after = errors(found, runs[2:])
    oracle = fitted(Setup(told), runs[:2])
    _, oracle_error = errors(replace(found, after=oracle, setup=Setup(told)), runs[2:])
    assert np.all(after < 1.3 * oracle_error)
    assert before[1] > 5 * after[1]
    assert not [number for number in entry_of(found, "gravity_tilt")["parameters"] if "joint" in number]  # of no joint
    plot = entry_of(found, "gravity_tilt")["plot"]
    assert (plot["signal"], plot["unit"], plot["quantity"]) == (f"q_{plot['joint']}", "rad", "torque")
    size = np.ptp(plot["curve"])
    assert size > 10.0  # N m: gravity from another side
    assert_allclose(plot["mean"], plot["curve"], atol=0.1 * size)


def test_a_mounting_is_named_on_an_arm_whose_file_says_nothing_of_its_links():
    """The data are far more probable under another gravity, whatever the links may weigh."""
    bare = dyn.RobotModel.from_urdf_string(re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.S))
    found = found_in(recorded(replace(rigid(), robot=ROBOT.with_gravity(list(SIDEWAYS)))), bare)
    assert names(found) == {("gravity_tilt", JOINTS)}
    assert_allclose(np.abs(found.setup.robot.gravity), SIDEWAYS, atol=0.1)  # heavy and up is light and down


def test_a_mounting_that_is_declared_stays():
    robot = ROBOT.with_gravity(list(SIDEWAYS))
    found = found_in(recorded(replace(rigid(), robot=robot)), robot)
    assert found.entries == []
    assert_allclose(found.setup.robot.gravity, SIDEWAYS, **tolerances.EXACT)


def test_a_mounting_is_not_quite_on_a_wall_and_nothing_else_is_blamed_for_it():
    """Two degrees off: the wall is where the search begins, not where it ends."""
    gravity = tilted_gravity(SIDEWAYS, 0.02, 0.03)
    found = found_in(recorded(replace(rigid(), robot=ROBOT.with_gravity(gravity.tolist()))))
    assert names(found) == {("gravity_tilt", JOINTS)}
    before, after = (np.linalg.norm(np.asarray(g) - gravity) / 9.81 for g in (SIDEWAYS, found.setup.robot.gravity))
    assert before > 0.03
    assert after < 0.1 * before
    told = dict(zip(("roll", "pitch"), tilt_of(ROBOT, ROBOT.with_gravity(gravity.tolist())), strict=True))
    assert holds(entry_of(found, "gravity_tilt"), told) == []


def test_a_mounting_and_a_friction_are_both_named():
    arm = with_effects(rigid(), "friction_hysteresis:wrist:2")
    found = found_in(recorded(replace(arm, robot=ROBOT.with_gravity(list(SIDEWAYS)))))
    assert names(found) == {("gravity_tilt", JOINTS), ("friction_hysteresis", ("wrist",))}


def test_a_tilt_is_found_on_an_arm_whose_file_says_nothing_of_its_links():
    """A vertical first axis hides where the masses about it are. Tilted, they pull."""
    bare = dyn.RobotModel.from_urdf_string(re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.S))
    arm = with_effects(rigid(), "gravity_tilt::3")
    found = found_in(recorded(arm), bare)
    assert names(found) == {("gravity_tilt", JOINTS)}
    assert holds(entry_of(found, "gravity_tilt"), truth_of(arm, "gravity_tilt")) == []
    (tie,) = entry_of(found, "gravity_tilt")["ties"]
    assert (tie["kind"], tie["joints"], tie["same_torque"]) == ("kinematic_error", ["shoulder"], True)


def test_two_encoders_show_a_disc_by_themselves():
    runs = measured(encoders=2)
    setup = Setup(ROBOT)
    kinds = {h.kind for h in structural_hypotheses(fitted(setup, runs), setup)}
    assert kinds == {"torque_delay", "gravity_tilt", "kinematic_error", "torque_gain"}


def test_amperes_have_gains_anyway():
    runs = [replace(run, torque_unit="A") for run in measured()]
    setup = Setup(ROBOT)
    assert "torque_gain" not in {h.kind for h in structural_hypotheses(fitted(setup, runs), setup)}


def changes(fit, setup, kind, joints, steps):
    """Torque in the band when the setup of the model is changed, per unit: (n_rows, n_joints) for every step."""
    (h,) = (h for h in structural_hypotheses(fit, setup, [kind]) if h.joints == joints)
    found = []
    for k, step in enumerate(steps):
        ends = []
        for sign in (1.0, -1.0):
            x = np.zeros(len(h.unit))
            x[k] = sign * step
            ends.append(h.accept(setup, x))
        found.append((h, k, ends))
    return found


@pytest.mark.parametrize(
    ("kind", "joints", "steps"),
    [
        ("kinematic_error", (2,), (1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4)),
        ("gravity_tilt", (0, 1, 2), (1e-4, 1e-4)),
    ],
)
def test_columns_are_what_the_accepted_robot_predicts(kind, joints, steps):
    """By another road: the links' torque of the changed robots, with the inertials that the fit has."""
    runs = measured(n_runs=2)
    setup = Setup(ROBOT)
    fit = fitted(setup, runs)
    about = About.of(fit)
    for h, k, (there, back) in changes(fit, setup, kind, joints, steps):
        expected = []
        for states in fit.runs_:
            motion = (states.q, states.dq, states.ddq)
            if kind == "gravity_tilt":
                motion = (states.q, np.zeros_like(states.q), np.zeros_like(states.q))
            torque = [end.robot.inverse_dynamics(*motion, about.phi) for end in (there, back)]
            expected.append(states.in_band((torque[0] - torque[1]) / (2 * steps[k])))
        expected = np.concatenate(expected)
        for j, columns in h.columns.items():
            size = np.abs(expected[:, j]).max()
            assert_allclose(columns[:, k] / h.unit[k], expected[:, j], rtol=0, atol=1e-3 * max(size, 1e-6))


def test_columns_of_a_late_channel_are_those_of_a_shifted_clock():
    runs = measured(n_runs=2)
    setup = Setup(ROBOT)
    fit = fitted(setup, runs)
    h, *alone = structural_hypotheses(fit, setup, ["torque_delay"])
    assert [one.joints for one in alone] == [(0,), (1,), (2,)]
    assert all(np.array_equal(one.columns[j], h.columns[j]) for one in alone for j in one.joints)
    late = 2e-3
    shown = []
    for states in fit.raw_runs_:
        torque = evaluate(fit.model_, states)[0]
        moved = np.stack([np.interp(states.t - late, states.t, column) for column in torque.T], axis=1)
        shown.append(states.in_band((moved - torque) / late))
    shown = np.concatenate(shown)
    for j in range(3):
        column = h.columns[j][:, 0] / h.unit[0]
        # A line between samples, and a difference to one side.
        assert np.linalg.norm(column - shown[:, j]) < 0.05 * np.linalg.norm(column)


def test_columns_of_a_disc_are_differences_of_two_runs():
    """By another road: positions with the error, differentiated in time."""
    arm = rigid(SIX_AXES)
    runs = recorded(arm, n_runs=2, duration=20.0)
    setup = Setup(SIX_AXES)
    fit = fitted(setup, runs)
    (h,) = (h for h in structural_hypotheses(fit, setup, ["encoder_eccentricity"]) if h.joints == (1,))
    states, size = fit.raw_runs_[0], 1e-3
    t = states.t
    q, dq, ddq = states.q, states.dq, states.ddq
    true = q.copy()
    true[:, 1] -= size * np.sin(q[:, 1])
    rate = [dq.copy(), ddq.copy()]
    change = np.gradient(size * np.sin(q[:, 1]), t)
    rate[0][:, 1] -= change
    rate[1][:, 1] -= np.gradient(change, t)
    moved = replace(states, q=true, dq=rate[0], ddq=rate[1], q_motor=true, dq_motor=rate[0], ddq_motor=rate[1])
    expected = states.in_band((evaluate(fit.model_, moved)[0] - evaluate(fit.model_, states)[0]) / size)
    inside = slice(20, len(expected) - 20)
    for j in (1, 2):
        column = h.columns[j][: len(expected), 1] / h.unit[1]
        # The columns are those of the links; friction and rotor, which follow the same encoder, are less than a tenth.
        assert np.linalg.norm((column - expected[:, j])[inside]) < 0.1 * np.linalg.norm(expected[inside, j])


@pytest.mark.parametrize("gravity", [(0, 0, -9.81), (9.81, 0, 0), (0, 0, 9.81), (1.0, -5.0, 8.0)])
def test_tilt_is_read_back(gravity):
    standing = SIX_AXES.with_gravity(gravity)
    turned = standing.with_gravity(tilted_gravity(standing.gravity, 0.3, -0.2).tolist())
    assert_allclose(tilt_of(standing, turned), (0.3, -0.2), **tolerances.ALGEBRAIC)
    assert_allclose(np.linalg.norm(turned.gravity), np.linalg.norm(gravity), **tolerances.ALGEBRAIC)
    level = undone(Setup(turned, declared=standing), Setup(standing), "gravity_tilt", ())
    assert_allclose(level.robot.gravity, gravity, **tolerances.ALGEBRAIC)


@pytest.mark.parametrize("joint", [0, 2, 5])
def test_displacement_is_read_back(joint):
    robot = SIX_AXES
    change = np.array([0.003, -0.002, 0.001, 0.02, -0.03, 0.01])
    moved = with_displacement(with_displacement(robot, joint, change), 1, -change)
    assert_allclose(displacement(robot, moved, joint), change, **tolerances.ALGEBRAIC)
    back = undone(Setup(moved, declared=robot), Setup(robot), "kinematic_error", (joint,)).robot
    assert_allclose(displacement(robot, back, joint), np.zeros(6), **tolerances.ALGEBRAIC)
    assert_allclose(displacement(robot, back, 1), -change, **tolerances.ALGEBRAIC)


def test_only_free_gains_are_fitted():
    arm = with_effects(rigid(SIX_AXES), "torque_gain:2")
    (effect,), runs = arm.effects, recorded(arm)
    links = ThreeLoopIdentifier(SIX_AXES, residual=None, free_gains=(2,)).fit(runs[:2]).links_
    assert_allclose(np.delete(links.torque_scale_, 2), 1.0, **tolerances.EXACT)
    assert abs(links.torque_scale_[2] - 1 - effect.gain[2]) < 0.1 * effect.gain[2]


def test_free_gains_change_nothing_in_ampere():
    runs = measured(robot=SIX_AXES)
    runs = [replace(run, torque_unit="A") for run in runs[:2]]
    plain, told_so = (ThreeLoopIdentifier(SIX_AXES, residual=None, free_gains=g).fit(runs).links_ for g in ((), (2,)))
    assert_allclose(told_so.x_, plain.x_, **tolerances.EXACT)
    assert_allclose(told_so.torque_scale_, plain.torque_scale_, **tolerances.EXACT)


@pytest.mark.parametrize("gains", [(6,), (-1,), (0, 1, 2, 3, 4, 5)])
def test_impossible_gains_are_refused(gains):
    runs = measured(robot=SIX_AXES, duration=5.0)
    with pytest.raises(ValueError, match="free_gains"):
        ThreeLoopIdentifier(SIX_AXES, residual=None, free_gains=gains).fit(runs[:1])


def test_a_run_that_is_given_twice_is_refused_as_by_the_command():
    runs = recorded(rigid(), n_runs=2)
    said = r"run_0\S* is given twice to learn from; name it once"
    with pytest.raises(DataError, match=said):
        ThreeLoopIdentifier(ROBOT).fit([runs[0], runs[0]])
    with pytest.raises(DataError, match=said):
        diagnose(ROBOT, [runs[0], runs[0]], [runs[1]])
    with pytest.raises(DataError, match="is both learned from and tested on"):
        diagnose(ROBOT, runs, [runs[1]])


def test_a_displaced_frame_is_drawn_over_the_angle_of_the_joint_that_shows_it():
    """The curve is the difference of two robots' torques, the dots lie about it."""
    joint = 1
    moved = with_displacement(ROBOT, joint, np.array([0.01, -0.02, 0.01, 0.05, -0.05, 0.03]))
    belief = Belief.in_declared(
        Setup(moved, declared=ROBOT), recorded(replace(rigid(), robot=moved), n_runs=2, duration=10.0)
    )
    best = belief.beside.best
    place = ("kinematic_error", (joint,))
    plot = structure_plot(belief, place, [], belief.beside.model, best.x)
    (states, _), phi = belief.fit.runs_, About.of(belief.fit).phi
    torque = [robot.inverse_dynamics(states.q, states.dq, states.ddq, phi) for robot in (moved, ROBOT)]
    shown = ROBOT.joint_names.index(plot["joint"])
    assert shown == np.argmax(np.std(torque[0] - torque[1], axis=0))
    assert (plot["signal"], plot["unit"], plot["quantity"]) == (f"q_{plot['joint']}", "rad", "torque")
    assert np.ptp(plot["curve"]) > 0.2 * np.ptp((torque[0] - torque[1])[:, shown])
    assert_allclose(plot["mean"], plot["curve"], atol=5 * rigid().noise_std[shown])
    assert structure_plot(belief, ("torque_delay", (0, 1, 2)), [], belief.beside.model, best.x) is None


def test_a_lone_joint_that_slides_along_gravity_has_no_tilt_to_look_for():
    """Its torque changes with the square of the tilt: there is no column, and no hypothesis without one."""
    robot = dyn.RobotModel.from_urdf_string(
        '<robot name="lift"><link name="base"/><link name="cabin"><inertial><origin xyz="0 0 0.2"/><mass value="20"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<joint name="lift" type="prismatic"><parent link="base"/><child link="cabin"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="500"/></joint></robot>'
    )
    found = found_in(recorded(rigid(robot)), robot)
    assert names(found) == set()


def test_what_all_channels_have_and_what_one_has_beyond_it_are_two_changes():
    every, one, declared = ("torque_delay", (0, 1, 2)), ("torque_delay", (1,)), Setup(ROBOT)
    setup = with_value(with_value(declared, *every, np.array([0.004])), *one, np.array([0.002]))
    assert_allclose(setup.delays, [0.004, 0.006, 0.004])
    assert_allclose([value_of(setup, *place)[0] for place in (every, one)], [0.004, 0.002])
    assert_allclose(undone(setup, declared, *every).delays, [0.0, 0.002, 0.0])
    assert_allclose(undone(setup, declared, *one).delays, [0.004] * 3)
    assert_allclose(believed(declared, setup).delays, setup.delays)
    # In steps, and never further than a model can hold.
    assert_allclose(later((1,), setup, np.array([1.0])).delays, [0.004, 0.026, 0.004])
    edge = with_value(declared, *every, np.array([0.495]))
    assert_allclose(later((1,), edge, np.array([1.0])).delays.max(), 0.5)
    assert_allclose(later((1,), setup, np.array([-0.01])).delays, [0.004] * 3)  # what lags is its encoder
    assert_allclose(later((0, 1, 2), setup, np.array([-1.0])).delays, [-0.016, -0.014, -0.016])


def test_which_inertials_a_tilt_brings_out_does_not_hang_on_the_order_of_the_runs():
    """Of one run in which the wrist alone moves, and one in which all joints do."""
    whole, other = measured(n_runs=2, duration=10.0)
    still = whole.q.copy()
    still[:, :2] = 0.3
    part = replace(whole, q=still, name="wrist")
    widths = []
    for runs in ([part, other], [other, part]):
        fit = Setup(ROBOT).identifier(residual=None).fit(runs)
        (tilt,) = structural_hypotheses(fit, Setup(ROBOT), ["gravity_tilt"])
        widths.append(tilt.names)
    assert widths[0] == widths[1]


def test_a_declared_delay_that_is_none_is_taken_back():
    """What is weighed is the change: 5 ms were declared of channels that are not late at all."""
    runs = measured(n_runs=2, duration=8.0)
    belief = Belief.in_declared(Setup(ROBOT, torque_delay=0.005), runs)
    every, *_ = structural_hypotheses(belief.fit, belief.setup, ["torque_delay"])
    belief.accept([Named(every, belief.beside.evidence_for(every)[0])])
    assert belief.setup.torque_delay == pytest.approx(0.0, abs=3e-4)
    assert standing(belief)[every.place] > SURE
    sized(belief)
    assert set(belief.named) == {every.place}


def test_a_tilt_that_came_and_went_leaves_the_setup_as_it_was():
    belief = Belief.in_declared(Setup(ROBOT), measured(n_runs=2, duration=8.0))
    (tilt,) = structural_hypotheses(belief.fit, belief.setup, ["gravity_tilt"])
    belief.accept([Named(tilt, 10.0)])
    assert not belief.setup.is_like(belief.declared)
    belief.remove(tilt.place)
    assert belief.setup.is_like(belief.declared)


def test_a_setup_is_that_of_its_fit():
    belief = Belief.in_declared(Setup(ROBOT), measured("gravity_tilt", n_runs=2, duration=8.0))
    (tilt,) = structural_hypotheses(belief.fit, belief.setup, ["gravity_tilt"])
    belief.accept([Named(tilt, 10.0)])
    assert np.array_equal(belief.setup.robot.gravity, belief.fit.robot.gravity)
