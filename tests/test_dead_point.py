"""What is believed of a cylinder under the robot file: where it stands, which way it helps, what it is called."""

from __future__ import annotations

import re
from dataclasses import replace

import data
import numpy as np
import pytest
from real_diagnosis import CASES, load
from scipy.optimize import brentq
from small_arm import URDF
from test_diagnosis_search import HYSTERESIS, measured, start

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.assembly import evaluate
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import stacked
from dynid_rs.diagnosis.choice import weigh
from dynid_rs.diagnosis.dead_point import BESIDE_UPRIGHT, PUSHES, built_for_weight
from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.diagnosis.intervals import _sandwich
from dynid_rs.diagnosis.kinds import LEAST_WAVES, Kinds
from dynid_rs.diagnosis.loop import diagnose
from dynid_rs.diagnosis.one_cylinder import named_by_task
from dynid_rs.diagnosis.sensors import channel_errors
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import EVEN, TRUSTED, Choice, still_trusted, trusted
from dynid_rs.diagnosis.warmth import takes_too_much
from dynid_rs.links import LinkDynamicsIdentifier
from dynid_rs.placed import CATALOGUE
from dynid_rs.results import score

ROBOT = dyn.RobotModel.from_urdf_string(URDF)
WRIST = 2
BELIEVED = "KUKA KR300, the file's inertials believed"
AXIS_2 = 1
AUTHORS_LEVER, AUTHORS_PHASE = 0.2 / 0.8, np.deg2rad(95) - np.pi
"""Of the cylinder in the set's own model, which nobody tells the diagnosis."""


def usual(name, sign=1.0):
    """Geometric mean of the catalogue's lengths of one sign."""
    (grid,) = (parameter["grid"] for parameter in CATALOGUE["counterbalance"]["shape"] if parameter["name"] == name)
    return sign * float(np.prod([abs(x) for x in grid if x * sign > 0]) ** (1 / sum(x * sign > 0 for x in grid)))


def cylinder(joint, dead_point, *, pulls=True, beside=0.0):
    phase = (np.pi if pulls else 0.0) - dead_point + beside
    shape = {"a": 1.0, "b": usual("b"), "phase": phase, "gas_length": usual("gas_length", 1.0 if pulls else -1.0)}
    return Hypothesis("counterbalance", (joint,), tuple(shape.items()))


@pytest.fixture(scope="module")
def kuka():
    return load(CASES[BELIEVED])


@pytest.fixture(scope="module")
def upright(kuka):
    return built_for_weight(kuka.robot, kuka.train[0].q).upright


def mean_weight(robot, joint, places):
    """Weight of a joint at an angle, averaged over random turns of the joints beyond."""
    rng = np.random.default_rng(3)
    q = np.tile(places, (4000, 1))
    q[:, joint + 1 :] = rng.uniform(-np.pi, np.pi, (len(q), robot.n_joints - joint - 1))

    def weight(angle):
        q[:, joint] = angle
        return float(robot.inverse_dynamics(q, 0 * q, 0 * q, np.asarray(robot.phi))[:, joint].mean())

    return weight


@pytest.mark.parametrize("joint", [AXIS_2, 2])
def test_upright_is_where_the_weight_of_all_that_hangs_there_is_highest(kuka, upright, joint):
    weight = mean_weight(kuka.robot, joint, kuka.train[0].q[::300])
    up = upright[joint]
    top = brentq(weight, up - 1.0, up + 1.0)
    assert top == pytest.approx(up, abs=0.02)  # of random turns
    assert weight(top - 0.3) > 0 > weight(top + 0.3)  # it falls to both sides


def test_an_axis_that_carries_no_weight_has_no_cylinder(kuka, upright):
    assert np.isnan(upright[0])
    setup = Setup(kuka.robot, options=kuka.options)
    kinds = start(setup, list(kuka.train)).kinds
    joints = {h.joints[0] for h in kinds.grid(["counterbalance"])}
    assert AXIS_2 in joints
    assert 0 not in joints


@pytest.mark.parametrize("pulls", [True, False])
def test_a_cylinder_at_its_dead_point_carries_whichever_way_the_arm_leans(kuka, upright, pulls):
    best = cylinder(AXIS_2, upright[AXIS_2], pulls=pulls)
    weight = mean_weight(kuka.robot, AXIS_2, kuka.train[0].q[::300])
    effect = _core.Effect.of("counterbalance", **{name: [value] for name, value in best.shape})
    for lean in (-0.4, -0.1, 0.1, 0.4):
        q = np.array([[upright[AXIS_2] + lean]])
        carried = float(_core.effect_torque(effect, [[1.0]], q, 0 * q, 0 * q)[0, 0])
        assert carried * weight(q[0, 0]) < 0, lean


def test_doubt_is_the_logarithm_of_a_normal_law(kuka, upright):
    belief = built_for_weight(kuka.robot, kuka.train[0].q)
    at = upright[AXIS_2]
    assert belief.doubt(cylinder(AXIS_2, at)) == pytest.approx(0.0, abs=1e-12)
    assert belief.doubt(cylinder(AXIS_2, at, beside=2 * BESIDE_UPRIGHT)) == pytest.approx(2.0)
    assert belief.doubt(cylinder(AXIS_2, at, beside=2 * np.pi)) == pytest.approx(0.0, abs=1e-12)
    assert belief.doubt(cylinder(AXIS_2, at, pulls=False)) == pytest.approx(PUSHES)
    assert belief.doubt(HYSTERESIS) == 0.0


def test_belief_narrows_an_interval_as_one_more_measurement_does():
    rng = np.random.default_rng(0)
    S = np.diag([4.0, 1.0])
    scores = np.sqrt([[4.0], [1.0]]) * rng.standard_normal((2, 100_000))
    active = np.ones(2, dtype=bool)
    plain, believed = _sandwich(S, scores, active), _sandwich(S, scores, active, np.array([0.0, 3.0]))
    np.testing.assert_allclose(plain, [0.5, 1.0], rtol=0.02)
    np.testing.assert_allclose(believed, [0.5, 0.5], rtol=0.02)


BELIEVE = {"links": LinkDynamicsIdentifier(prior="robot")}


def test_where_nothing_is_found_the_model_stays_as_it_was():
    runs = measured(n_runs=2)
    found = diagnose(Setup(ROBOT, options=BELIEVE), runs[:1], runs[1:])
    assert found.effects == []
    states = found.before.states(runs[1])
    np.testing.assert_array_equal(evaluate(found.after.model_, states)[0], evaluate(found.before.model_, states)[0])


def test_a_users_own_trust_is_left_alone():
    setup = Setup(ROBOT, options={"links": LinkDynamicsIdentifier(prior="robot", prior_spread=0.3)})
    assert trusted(setup) == {}
    assert trusted(Setup(ROBOT, options=BELIEVE))["links"].prior_spread == TRUSTED
    assert trusted(Setup(ROBOT)) == {}


@pytest.mark.parametrize(("factor", "kept"), [(1.06, True), (2.0, False)])
def test_a_file_that_the_evidence_contradicts_is_trusted_no_longer(factor, kept):
    """Links that are so many times as heavy as they are."""

    def heavier(found):
        return f'mass value="{factor * float(found[1])}"'

    robot = dyn.RobotModel.from_urdf_string(re.sub(r'mass value="([^"]*)"', heavier, URDF))
    assert robot.phi[0] != ROBOT.phi[0]
    setup = Setup(robot, effects=(HYSTERESIS.placed(),), options=BELIEVE)
    assert bool(still_trusted(setup, measured(n_runs=3))) == kept


def test_a_spring_stays_a_spring_where_it_explains_more(kuka):
    """Names change hands only between equals, and only for what carries."""
    state = start(Setup(kuka.robot, options=kuka.options), list(kuka.train))
    beside = Beside(state.fit)
    spring = weigh(beside, state.kinds.candidate(Hypothesis("joint_spring", (AXIS_2,), (("rest_position", 0.0),))))
    gas = weigh(beside, state.kinds.candidate(cylinder(AXIS_2, state.kinds.belief.upright[AXIS_2])))

    def named(spring, gas):
        return named_by_task(Choice(spring, 0.0, ties=(Choice(gas, 0.0),)), state.kinds).weighed.candidate.kind

    equal = replace(gas, evidence=spring.evidence)
    assert named(spring, equal) == "counterbalance"
    assert named(spring, replace(gas, evidence=spring.evidence - 2 * EVEN)) == "joint_spring"
    for factor in (-1.0, 0.05):  # presses the arm down; carries next to nothing
        other = replace(spring, gain=replace(spring.gain, coefficients=factor * spring.gain.coefficients))
        assert named(other, equal) == "joint_spring", factor


def test_behind_a_joint_that_leans_there_is_no_upright():
    """A forearm's upright turns with the upper arm; only what stays level before it leaves it in one place."""
    robot = dyn.RobotModel.from_urdf(data.data_file("kuka_kr300_weigand"))
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (200, robot.n_joints))
    belief = built_for_weight(robot, q)
    assert np.isfinite(belief.upright[AXIS_2])
    assert np.isnan(belief.upright[AXIS_2 + 1])
    assert belief.allows(AXIS_2 + 1)
    anywhere = [belief.doubt(cylinder(AXIS_2 + 1, angle)) for angle in (0.0, 1.0, 2.0)]
    assert anywhere == pytest.approx([0.0] * 3, abs=1e-12)
    assert belief.certainty(cylinder(AXIS_2 + 1, 0.0), "phase") == 0.0


def test_without_the_file_nothing_is_believed():
    kinds = start(Setup(ROBOT), measured(n_runs=2)).kinds
    assert kinds.belief is None
    assert kinds.doubt(cylinder(1, 0.0, beside=1.0)) == 0.0


def test_the_kukas_counterbalance_is_named_and_halves_the_error_of_axis_2(kuka):
    """Learned from A; B goes where A has hardly been: [-1.57, -1.06] against [-2.0, -1.47] rad."""
    found = diagnose(kuka.setup(), kuka.train, kuka.test)
    named = {(effect["kind"], tuple(effect["joints"])): effect for effect in found.effects}
    assert ("encoder_delay", ("joint_1", "joint_2", "joint_3")) in named
    effect = named["counterbalance", ("joint_2",)]
    assert [tie["kind"] for tie in effect["ties"]] == ["joint_spring"]  # thirty degrees do not tell them apart
    intervals = {parameter["name"]: parameter["interval"] for parameter in effect["parameters"]}
    assert intervals["counterbalance"][0] == 0.0  # physics allows no less
    assert intervals["b"][0] < AUTHORS_LEVER < intervals["b"][1]
    assert intervals["phase"][0] < AUTHORS_PHASE < intervals["phase"][1]
    before, after = (
        score(fit.model_, [fit.states(run) for run in kuka.test]).rmse for fit in (found.before, found.after)
    )
    print("after over before", (after / before).round(4))
    assert after[AXIS_2] < 0.51 * before[AXIS_2]  # 0.500 was measured
    assert np.all(after < before)


def test_two_short_runs_that_hardly_overlap_do_not_contradict_each_other():
    robot = dyn.RobotModel.from_urdf(data.data_file("kuka_kr300_weigand"))
    runs = [
        dyn.readers.read_recording(data.data_file("kuka_kr300_weigand", f"traj_{name}.parquet"), robot) for name in "AB"
    ]
    assert channel_errors(Setup(robot), runs) == []


def test_a_ripple_is_sought_where_a_joint_went_through_a_wave_of_it():
    state = start(Setup(ROBOT), measured(n_runs=2))
    turns = np.ptp(np.concatenate([states.q for states in state.fit.runs_]), axis=0) / (2 * np.pi)
    for joint in range(ROBOT.n_joints):
        sought = [dict(h.shape)["cycles"] for h in state.kinds.grid(["torque_ripple"]) if h.joints == (joint,)]
        assert min(sought) * turns[joint] >= LEAST_WAVES
    few = start(Setup(ROBOT), [shrunk(run, 0.1) for run in measured(n_runs=2)])
    n_sought = [len(s.kinds.grid(["torque_ripple"])) for s in (state, few)]
    assert n_sought[1] < n_sought[0]


def shrunk(recording, part):
    """The same torques along a motion that is smaller: nothing is fitted that matters here."""
    q = recording.q[0] + part * (recording.q - recording.q[0])
    return dyn.Recording(recording.t, q, tau=recording.tau, name=recording.name, joints=recording.joints)


@pytest.mark.parametrize(("size", "too_much"), [(0.4, False), (1.0, False), (20.0, True)])
def test_warmth_takes_no_more_friction_than_there_is(size, too_much):
    """A warm-up whose coefficient is `size` times the joint's cold Coulomb friction."""
    state = start(Setup(ROBOT), measured(n_runs=3))
    kinds, beside = Kinds(state.fit), Beside(state.fit)
    shape = {"time_constant": 5.0, "reference_speed": 0.0, "transition_width": float(kinds.widths[WRIST])}
    weighed = weigh(beside, kinds.candidate(Hypothesis("thermal_friction", (WRIST,), tuple(shape.items()))))
    coulomb = np.mean(list(kinds.friction_of(WRIST).values())[:2])
    object.__setattr__(weighed.gain, "coefficients", np.array([-size * coulomb, 0.0]))
    assert takes_too_much(beside, kinds, weighed) == too_much


def test_coefficients_from_other_blocks_are_those_of_the_own_columns_there():
    state = start(Setup(ROBOT), measured(n_runs=3))
    beside = Beside(state.fit)
    columns = stacked(state.kinds.columns([HYSTERESIS])[0])
    free = np.array([[-np.inf, np.inf]])
    left = beside.with_coefficients_of_others(columns, free)
    own = beside.own_part(columns)
    for block in beside.blocks:
        seen = np.setdiff1d(np.arange(beside.n_rows), np.arange(block.start, block.stop))
        x = np.concatenate([beside.weights[j] * own[j][seen, 0] for j in own])
        y = np.concatenate([beside.weights[j] * beside.residual[seen, j] for j in own])
        for j in own:
            expected = beside.residual[block, j] - (x @ y) / (x @ x) * own[j][block, 0]
            np.testing.assert_allclose(left[block, j], expected, rtol=1e-9, atol=1e-12)
