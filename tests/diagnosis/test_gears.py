"""What two encoders per joint show: delay, compliance and lost motion on their joints, nothing on rigid gears."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import data
from helpers.diagnosed import ROBOT, entry_of, found_in, holds, names, recorded, rigid, with_effects
from helpers.small_arm import JOINTS, URDF
from numpy.testing import assert_allclose, assert_array_equal

import dynid_rs as dyn
from dynid_rs.diagnosis.belief import fitted
from dynid_rs.diagnosis.gear_model import Flat, Gear, GearHypothesis
from dynid_rs.diagnosis.gears import _passes, centred, gear_entries, seen_between
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.waves import of_signal
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.linear_model import Choice, LinearModel
from dynid_rs.runs.checks import check_recording, refused_sources

DELAY = 0.0028
ELBOW, WRIST = 1, 2
ON_CLOCKS = replace(rigid(), delay=DELAY)
STIFF = 0.1
"""Relative error of a stiffness that a robot engineer would put up with."""


def both_encoders(arm, **options):
    return recorded(arm, encoders=2, **options)


@pytest.fixture(scope="module")
def elastic():
    arm = with_effects(ON_CLOCKS, "joint_elasticity:elbow:0.6", "backlash:wrist:2")
    return arm, found_in(both_encoders(arm))


def test_a_delay_a_spring_and_play_are_named_on_their_joints(elastic):
    _, found = elastic
    assert names(found) >= {
        ("encoder_delay", JOINTS),
        ("joint_elasticity", ("elbow",)),
        ("backlash", ("wrist",)),
    }
    # Nothing of the torque is accused of what the gears do.
    assert {kind for kind, _ in names(found)} <= {
        *("encoder_delay", "joint_elasticity", "backlash", "gear_hysteresis", "nonlinear_elasticity"),
        "torque_ripple",
    }


def test_their_numbers_are_those_of_the_arm(elastic):
    arm, found = elastic
    truth = {effect.kind: {value.name: value.value[0] for value in effect.values} for effect in arm.effects}
    late = entry_of(found, "encoder_delay")
    assert holds(late, {"delay": DELAY}) == []
    plot = late["plot"]
    assert (plot["signal"], plot["unit"], plot["value_unit"]) == (f"dq_{plot['joint']}", "rad/s", "rad")
    speed, shown = np.array(plot["curve_x"]), np.array(plot["mean"])
    assert np.ptp(speed) > 1.0
    assert np.polyfit(speed, shown, 1)[0] == pytest.approx(DELAY, rel=0.05)
    spring, play = entry_of(found, "joint_elasticity"), entry_of(found, "backlash")
    (compliance,) = (p for p in spring["parameters"] if p["name"] == "compliance")
    assert compliance["value"] == pytest.approx(1 / truth["joint_elasticity"]["stiffness"], rel=STIFF)
    assert compliance["unit"] == "rad/(N*m)"
    (gap,) = play["parameters"]
    assert gap["value"] == pytest.approx(truth["backlash"]["gap"] / 2, rel=0.2)


def test_the_interval_of_a_stiffness_holds_the_truth(elastic):
    arm, found = elastic
    (effect,) = (effect for effect in arm.effects if effect.kind == "joint_elasticity")
    truth = {value.name: value.value[0] for value in effect.values}
    assert holds(entry_of(found, "joint_elasticity"), {"compliance": 1 / truth["stiffness"]}) == []


def test_the_delay_is_taken_out_of_the_fit(elastic):
    _, found = elastic
    assert found.after.model_.encoder_delay == pytest.approx(np.full(3, DELAY), abs=2e-5)


@pytest.mark.parametrize("seed", [1, 2])
def test_rigid_gears_on_one_clock_have_no_entry(seed):
    found = found_in(both_encoders(rigid(), seed=seed))
    assert found.entries == []


def test_a_copy_or_no_second_encoder_has_none():
    runs = both_encoders(rigid())
    for changed in ([replace(run, q_motor=run.q.copy()) for run in runs], [run.without("q_motor") for run in runs]):
        fit = ThreeLoopIdentifier(ROBOT, residual=None).fit(changed[:2])
        assert gear_entries(fit, {}) == []


def test_an_encoder_that_is_not_centred_is_named():
    arm = with_effects(ON_CLOCKS, "encoder_eccentricity:elbow:0.5")
    found = found_in(both_encoders(arm))
    entry = entry_of(found, "encoder_eccentricity")
    assert entry["joints"] == ["elbow"]
    (effect,) = arm.effects
    size, phase = effect.amplitude[ELBOW], effect.phase[ELBOW]
    # The link encoder shows too much: size sin(q + phase).
    known = {p["name"]: p["value"] for p in entry["parameters"]}
    assert known["cosine"] == pytest.approx(size * np.sin(phase), abs=0.1 * size)
    assert known["sine"] == pytest.approx(size * np.cos(phase), abs=0.1 * size)
    assert_allclose(found.after.model_.encoder_error[ELBOW], [known["cosine"], known["sine"]], rtol=0.05)
    # Beside a torque that is a function of the same angle and has no name, the gear's has none either.
    entries = gear_entries(found.after, {ELBOW: of_signal(("q", ELBOW))})
    assert {(e["kind"], e.get("told_as")) for e in entries} == {
        ("encoder_delay", None),
        ("unknown", "encoder_eccentricity"),
    }


def test_an_encoder_that_is_far_from_centred_looks_like_no_frame():
    arm = with_effects(ON_CLOCKS, "encoder_eccentricity:elbow:10")
    found = found_in(both_encoders(arm))
    assert {entry["kind"] for entry in found.entries} == {"encoder_delay", "encoder_eccentricity"}


def test_a_declared_error_stays_where_no_gear_shows_one():
    runs = both_encoders(ON_CLOCKS)
    declared = np.zeros((3, 2))
    declared[WRIST] = 1e-6, -2e-6
    setup = Setup(ROBOT, encoder_error=declared)
    centred_on, _ = centred(setup, runs, fitted(setup, runs), declared)
    assert_array_equal(centred_on.encoder_error, declared)


def test_an_encoder_along_a_straight_way_is_not_off_centre():
    robot = dyn.RobotModel.from_urdf_string(
        URDF.replace('name="wrist" type="revolute"', 'name="wrist" type="prismatic"')
    )
    arm = replace(rigid(robot), delay=DELAY)
    fit = fitted(Setup(robot), both_encoders(with_effects(arm, "joint_elasticity:elbow:0.6")))
    offered = {gear.joint: {h.kind for h in gear.hypotheses()} for gear in Gear.all_of(fit)}
    assert "encoder_eccentricity" in offered[ELBOW]
    assert "encoder_eccentricity" not in offered.get(WRIST, set())


@pytest.fixture(scope="module")
def kuka():
    robot = dyn.RobotModel.from_urdf(data.data_file("kuka_kr300_weigand"))
    runs = [
        dyn.read_recording(data.data_file("kuka_kr300_weigand", f"{name}.parquet"), robot)
        for name in ("traj_A", "traj_B")
    ]
    return robot, [run.without(*refused_sources(check_recording(run, robot))) for run in runs]


def test_the_kuka_s_link_encoders_are_late_and_its_gears_yield_about_as_its_authors_say(kuka):
    robot, runs = kuka
    found = gear_entries(ThreeLoopIdentifier(robot, residual=None).fit(runs), {})
    (clock,) = (entry for entry in found if entry["kind"] == "encoder_delay")
    assert clock["joints"] == list(robot.joint_names[:3])  # axes 4 to 6 have one encoder
    assert 2.6e-3 < clock["parameters"][0]["value"] < 3.2e-3
    compliance = {
        entry["joints"][0]: entry["parameters"][0]["value"] for entry in found if entry["kind"] == "joint_elasticity"
    }
    # A priori 7.5e6 N m/rad; the third axis, 4.1e6, is told where it moves enough.
    assert 0.5 < compliance[robot.joint_names[1]] * 7.5e6 < 2.0
    assert 0.5 < compliance.get(robot.joint_names[2], 1 / 4.1e6) * 4.1e6 < 2.0
    assert {entry["joints"][0] for entry in found} <= set(robot.joint_names[:3])


def test_where_an_encoder_was_set_to_zero_tells_nothing(elastic):
    """It is set anew between runs: what is constant over a run is in no row."""
    _, found = elastic
    for gear in Gear.all_of(found.after):
        shown = gear.deflection
        assert max(abs(part.mean()) for part in shown) < 1e-12
        signals = [states.q[:, gear.joint] for states in found.after.runs_]
        moved = [q + 0.1 * (k + 1) for k, q in enumerate(signals)]
        for here, there in zip(gear.rows(signals), gear.rows(moved), strict=True):
            assert_allclose(there, here, rtol=0, atol=1e-9)


def test_the_declared_model_of_two_encoders_holds_no_learned_term(elastic):
    """Else names would be weighed against a term that has learned their torque."""
    _, found = elastic
    learned = ThreeLoopIdentifier(ROBOT).fit(found.train)
    assert learned.model_.residual is not None
    assert found.before.model_.residual is None
    assert found.after.model_.residual is None


def test_in_ampere_a_gear_yields_by_what_its_own_channel_shows():
    """A spring of the elbow, whose drive makes a quarter of the shoulder's torque of an ampere."""
    arm = with_effects(rigid(), "joint_elasticity:elbow:0.6")
    gains = np.array([10.0, 2.5, 10.0])
    runs = [replace(run, tau=run.tau / gains, torque_unit="A") for run in both_encoders(arm)]
    fit = Setup(ROBOT).identifier(residual=None).fit(runs)
    (spring,) = [seen for seen in seen_between(fit) if seen.what.kind == "joint_elasticity"]
    (stiffness,) = [value.value[0] for effect in arm.effects for value in effect.values if value.name == "stiffness"]
    assert spring.joint == ELBOW
    assert spring.value[0] == pytest.approx(gains[ELBOW] / stiffness, rel=2 * STIFF)
    assert spring.what.units[0] == "rad/(A)"
    assert (spring.drawn["unit"], spring.drawn["value_unit"]) == ("A", "rad")


def test_what_is_not_known_of_a_load_is_in_its_unit():
    """Drawn from what the fit knows: the spread of the load is what stands beside its gear, in ampere too."""
    runs = [replace(run, tau=run.tau / np.array([10.0, 2.5, 10.0]), torque_unit="A") for run in both_encoders(rigid())]
    fit = Setup(ROBOT).identifier(residual=None).fit(runs)
    posterior, observations = fit.links_.posterior_, fit.observations_
    model = posterior.model(observations.plan, observations.joint_rows())
    covariance = model.fit(posterior.choice, posterior.noise_std).covariance
    gear, known = Gear(fit, ELBOW, [np.zeros((len(states.t), 1)) for states in fit.runs_]), fit.links_.phi_base_
    values, vectors = np.linalg.eigh(covariance[: len(known), : len(known)])
    root, rng = vectors * np.sqrt(np.maximum(values, 0.0)), np.random.default_rng(0)
    before, drawn = np.concatenate(gear.rows(gear.load)), []
    for _ in range(40):
        fit.links_.phi_base_ = known + root @ rng.normal(size=len(known))
        drawn.append(np.concatenate(gear.rows(gear.load)) - before)
    spread = np.sqrt(np.mean(np.sum(gear._unknown_load(covariance) ** 2, axis=1)))
    assert spread == pytest.approx(np.sqrt(np.mean(np.square(drawn))), rel=0.25)


def test_no_gear_yields_against_its_load():
    """Encoders that were taken for one another show it: nothing of that is a spring, nor play."""
    runs = both_encoders(with_effects(rigid(), "joint_elasticity:elbow:0.6", "backlash:wrist:2"), n_runs=2)
    against = [replace(run, q_motor=2 * run.q - run.q_motor) for run in runs]
    seen, turned = ({entry["kind"] for entry in gear_entries(fitted(Setup(ROBOT), rs), {})} for rs in (runs, against))
    assert {"joint_elasticity", "backlash"} <= seen
    assert not {"joint_elasticity", "backlash"} & turned


@pytest.mark.parametrize(("compliance", "passes"), [(0.3, True), (0.0, False), (-0.01, False)])
def test_a_gear_that_only_damps_is_no_spring(compliance, passes):
    """However clear the damping is: the compliance, which is not negative, has to be told from zero."""
    rng, n = np.random.default_rng(3), 2000
    columns = rng.normal(size=(n, 2))
    y = columns @ [compliance, 0.5] + 0.1 * rng.normal(size=n)
    rows = np.stack([rng.normal(size=n), y], axis=1)
    model = LinearModel([rows], [np.arange(1)], Flat(1), np.array([float(n)]), np.array([1e-6]), n)
    bounds = np.array([[0.0, np.inf], [-np.inf, np.inf]])
    h = GearHypothesis("joint_elasticity", ("compliance", "damping"), ("1", "1"), columns, np.ones(2), bounds)
    assert _passes(model, model.fit(Choice(), np.array([0.3])), h, float(n), 10.0) is passes
