"""What has changed against a trusted model: named where something has, silent where nothing has."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import tolerances
from helpers.data import data_file
from helpers.whole_model import RESIDUALS, recorded_states, whole_model
from numpy.testing import assert_allclose

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate, with_changes
from dynid_rs.reference import compare, weigh_load
from dynid_rs.reference.change_search import ChangeSearch
from dynid_rs.reference.changes import Believed, change_columns, hypotheses
from dynid_rs.runs.checks import check_recording, refused_sources
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.runs.readers import Config
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm

HALF_WIDTHS = 2.0
"""Half-widths of a 95 % interval within which the truth lies: 4 standard errors, seeded."""
UR10E_GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)
"""Published [N*m/A]."""
UR10E_PAYLOAD, UR10E_TOLERANCE = 2.805, 0.12
"""Declared mass [kg]; the published gains of the joints disagree by about as much."""
SILENT_GROWTH = 1.02
"""Nothing named, nothing changed."""


@pytest.fixture(scope="module")
def robot():
    return dyn.RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def arm(robot):
    return replace(typical_arm(robot).rigid(), delay=0.0)


@pytest.fixture(scope="module")
def reference(arm, robot):
    return ThreeLoopIdentifier(robot, residual=None).fit(runs_of(arm, seed=100)).model_


def runs_of(arm, seed, n_runs=3):
    runs = simulate(arm, n_runs=n_runs, duration=20, seed=seed).recordings
    return [dyn.Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints) for r in runs]


def changed(arm, *wishes):
    return equip(arm, build_effects([parse_wish(wish) for wish in wishes], typical_arm(arm.robot)))


def compared(reference, arm, seed=200):
    runs = runs_of(arm, seed, n_runs=2)
    return compare(reference, arm.robot, runs[:1], runs[1:])


def values(effect):
    """Value and half-width of the interval of every parameter."""
    interval = np.array([p["interval"] for p in effect["parameters"]])
    return np.array([p["value"] for p in effect["parameters"]]), np.diff(interval)[:, 0] / 2


def test_nothing_has_changed(reference, arm):
    changes = compared(reference, arm)
    assert changes.effects == []
    assert changes.findings == []
    assert_allclose(changes.rmse["test"]["after"], changes.rmse["test"]["before"], **tolerances.EXACT)


@pytest.mark.parametrize("size", [1.0, 0.05])
def test_a_payload_is_weighed(reference, arm, size):
    heavier = changed(arm, f"payload::{size}")
    changes = compared(reference, heavier)
    (effect,) = changes.effects
    assert effect["kind"] == "payload"
    plot = effect["plot"]
    assert (plot["signal"], plot["unit"], plot["quantity"]) == (f"q_{plot['joint']}", "rad", "torque")
    assert_allclose(plot["mean"], plot["curve"], atol=0.15 * np.ptp(plot["curve"]))
    assert effect["ties"] == []
    value, half = values(effect)
    assert np.all(np.abs(value - heavier.effects[0].parameters) < HALF_WIDTHS * half)
    assert half[0] < 0.02
    assert np.linalg.eigvalsh(_core.pseudo_inertia(value)[0])[0] > 0
    assert np.all(changes.rmse["test"]["after"] < 1.2 * reference.noise_std)
    assert_allclose(effect["rmse_test_after"], changes.rmse["test"]["after"], **tolerances.EXACT)


@pytest.mark.parametrize("size", [1.0, 0.05])
def test_a_load_is_weighed_as_a_body(reference, arm, size):
    heavier = changed(arm, f"payload::{size}")
    load = weigh_load(reference, runs_of(heavier, seed=200, n_runs=1))
    pseudo = _core.pseudo_inertia(np.asarray(heavier.effects[0].parameters))[0]
    mass, centre = pseudo[3, 3], pseudo[:3, 3] / pseudo[3, 3]
    moments = pseudo[:3, :3] - mass * np.outer(centre, centre)
    inertia = np.trace(moments) * np.eye(3) - moments
    truth = [mass, *centre, *np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    middle, half = load.intervals.mean(axis=1), np.diff(load.intervals)[:, 0] / 2
    assert np.all(np.abs(middle - truth) < HALF_WIDTHS * half)
    assert half[0] < 0.05
    assert load.p_value < 1e-6
    assert load.findings == []
    assert np.all(load.rmse_after < 1.2 * reference.noise_std)
    assert load.rmse_before.max() > 2 * load.rmse_after.max()


def test_no_load_is_no_load(reference, arm):
    load = weigh_load(reference, runs_of(arm, seed=300, n_runs=1))
    assert load.p_value > 0.01
    assert load.intervals[0, 0] < 0 < load.intervals[0, 1]


def test_what_is_saved_is_the_reference_with_the_payload(reference, arm, tmp_path):
    changes = compared(reference, changed(arm, "payload"))
    changes.model.save(tmp_path / "model.json")
    loaded = dyn.TorqueModel.load(tmp_path / "model.json")
    value, _ = values(changes.effects[0])
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, (3, 20, 6))
    load = reference.robot.joint_torque_regressor(q, dq, ddq)[:, :, -10:] @ value
    difference = loaded.evaluate(q, dq, ddq)[0] - reference.evaluate(q, dq, ddq)[0]
    assert_allclose(difference, load, **tolerances.ALGEBRAIC)


def test_a_payload_that_was_taken_off_is_negative(reference, arm, robot):
    loaded = changed(arm, "payload::0.5")
    trusted = ThreeLoopIdentifier(robot, residual=None).fit(runs_of(loaded, seed=100)).model_
    (effect,) = compared(trusted, arm).effects
    value, half = values(effect)
    assert effect["kind"] == "payload"
    assert abs(value[0] + loaded.effects[0].parameters[0]) < HALF_WIDTHS * half[0]
    assert np.linalg.eigvalsh(_core.pseudo_inertia(-value)[0])[0] > 0


def test_a_tilt_is_no_payload(reference, arm):
    tilted = changed(arm, "gravity_tilt::0.4")
    changes = compared(reference, tilted)
    (effect,) = changes.effects
    assert effect["kind"] == "gravity_tilt"
    assert effect["ties"] == []
    value, half = values(effect)
    assert np.all(np.abs(value - [tilted.effects[0].roll, tilted.effects[0].pitch]) < HALF_WIDTHS * half)
    assert np.all(changes.rmse["test"]["after"] < 1.2 * reference.noise_std)


def test_payload_and_tilt_are_both_named(reference, arm):
    changes = compared(reference, changed(arm, "payload::0.5", "gravity_tilt::0.4"))
    assert {effect["kind"] for effect in changes.effects} == {"payload", "gravity_tilt"}


@pytest.mark.parametrize(
    ("kind", "joint"), [("friction", 2), ("torque_gain", 1), ("torque_offset", 3)], ids=lambda x: str(x)
)
def test_what_one_joint_has_is_named_there(reference, arm, robot, kind, joint):
    if kind == "torque_gain":
        now = changed(arm, f"torque_gain:{joint}")
    elif kind == "friction":
        now = replace(arm, friction=arm.friction * np.where(np.arange(6) == joint, 1.5, 1.0)[:, None])
    else:
        now = replace(arm, torque_offset=arm.torque_offset + np.where(np.arange(6) == joint, 2.0, 0.0))
    changes = compared(reference, now)
    (effect,) = changes.effects
    assert (effect["kind"], effect["joints"]) == (kind, [robot.joint_names[joint]])
    assert np.all(changes.rmse["test"]["after"] < 1.2 * reference.noise_std)


def test_friction_that_remembers_its_way_grows_with_the_rest(reference, robot):
    grown = replace(Believed.unchanged(reference, robot.phi), friction=np.full((6, 3), [0.2, 0.0, 0.0])).model()
    growth = {
        effect.kind: np.asarray(now) / np.asarray(before)
        for (effect, before), (_, now) in zip(reference.effects, grown.effects, strict=True)
        if np.all(before)
    }
    assert {"smooth_friction", "friction_hysteresis"} <= set(growth)
    for kind, factor in growth.items():
        assert_allclose(factor, 1.2 if "friction" in kind else 1.0, rtol=tolerances.ALGEBRAIC["rtol"])


def test_friction_of_another_day_is_not_named(reference, arm):
    today = replace(arm, friction=arm.friction * np.linspace(0.92, 1.1, 6)[:, None])
    assert compared(reference, today).effects == []


def test_a_reference_of_another_arm_is_refused(reference, arm, robot):
    runs = runs_of(arm, seed=1, n_runs=1)
    short = dyn.RobotModel.from_urdf_string(
        '<robot name="one"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    with pytest.raises(DataError, match="same arm"):
        compare(reference, short, runs)
    with pytest.raises(DataError, match="drive gains"):
        compare(reference, robot, [replace(run, torque_unit="A") for run in runs])


def test_ur10e_carries_a_payload_and_nothing_else():
    robot = dyn.RobotModel.from_urdf(data_file("ur10e_innopolis"))
    config = replace(Config(), drive_gain=UR10E_GAINS)

    def read(name):
        run = dyn.read_recording(data_file("ur10e_innopolis", f"{name}.parquet"), robot, config)
        return run.without(*refused_sources(check_recording(run, robot)))

    unloaded = ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec")
    reference = ThreeLoopIdentifier(robot, residual=None).fit([read(name) for name in unloaded]).model_
    first, second = read("20_02_19_14harm50secLoad"), read("20_01_31_load")
    for train, test in ((first, second), (second, first)):
        changes = compare(reference, robot, [train], [test])
        (effect,) = changes.effects
        assert effect["kind"] == "payload"
        assert effect["ties"] == []
        value, _ = values(effect)
        assert abs(value[0] / UR10E_PAYLOAD - 1) < UR10E_TOLERANCE
        # The load shows on all joints but the first, whose axis stands upright.
        assert np.all(changes.rmse["test"]["after"][1:] < 0.25 * changes.rmse["test"]["before"][1:])
    flange = robot.link_frame("tool0")[1:]
    for name, mass in (("20_02_19_14harm50secLoad", UR10E_PAYLOAD), ("20_01_31_load", None)):
        load = weigh_load(reference, [read(name)], frame=flange)
        assert load.p_value < 1e-6
        assert mass is None or abs(load.mass / mass - 1) < UR10E_TOLERANCE
        # Fifteen centimetres from the flange, as a fit of the last link alone has it.
        assert 0.1 < np.linalg.norm(load.centre) < 0.2
        xx, yy, zz, xy, xz, yz = load.inertia
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert 0 < moments[0] < moments[2] < moments[0] + moments[1]
    for name in ("20_01_31_unload", "20_02_12_40sec_12harm", "20_02_05_20sec_12harm"):
        assert compare(reference, robot, [read(name)]).effects == []


@pytest.mark.parametrize("gain", [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.3, -0.2, 0.5, -0.4, 0.2, -0.1)])
def test_columns_of_changes_are_what_the_model_changes_by(reference, arm, robot, gain):
    """Every column against a central difference of the model itself, whatever the torque channel shows of a torque."""
    states = prepare(runs_of(arm, 200, n_runs=1)[0], Band(8.0), 200.0)
    believed = replace(
        Believed.unchanged(reference, robot.phi), gain=np.array(gain), offset=np.linspace(0.5, -0.5, 6) * np.any(gain)
    )
    columns = change_columns(believed, [states], np.ones(6))
    kinds = set()
    for h in hypotheses(believed, columns):
        kinds.add(h.kind)
        for k in range(len(h.names)):
            step = 1e-4 * np.eye(len(h.places))[k]
            ahead, behind = (
                evaluate(h.added(believed, sign * step, columns).model(), states)[0] for sign in (1.0, -1.0)
            )
            change = states.in_band((ahead - behind) / 2e-4)
            assert np.abs(change).max() > 0
            error = columns.rows[0][:, :, h.places[k]] - change
            assert np.abs(error).max() <= tolerances.FINITE_DIFFERENCE["rtol"] * np.abs(change).max(), (
                h.kind,
                h.joints,
            )
    assert kinds == {"payload", "gravity_tilt", "torque_gain", "friction", "torque_offset"}


@pytest.mark.parametrize("inputs", [None, *RESIDUALS])
def test_a_gain_is_one_of_every_term(robot, inputs):
    """Of what a cube of the torque makes, and of the third loop, whose wind-up stays as it is, too."""
    states = {name: np.nan_to_num(signal, nan=30.0) for name, signal in recorded_states().items()}
    model, gain = whole_model(robot, states, inputs, seed=7), np.linspace(-0.2, 0.3, robot.n_joints)
    _, terms, _ = model.evaluate(**states)
    _, gained, _ = replace(Believed.unchanged(model, robot.phi), gain=gain).model().evaluate(**states)
    for name, own, shown in zip(model.term_names, terms.swapaxes(0, 1), gained.swapaxes(0, 1), strict=True):
        assert_allclose(shown, (1 + gain) * own, rtol=0, atol=1e-9 * np.abs(own).max(), err_msg=name)


def test_what_differs_from_day_to_day_is_a_share_of_friction(reference, arm, robot):
    """In another unit of torque a factor is as free as before, and offset and friction are in that unit."""
    states = prepare(runs_of(arm, 200, n_runs=1)[0], Band(8.0), 200.0)

    def precision(unit):
        model = with_changes(
            reference,
            phi=unit * reference.phi,
            effects=[(effect, unit * np.asarray(coefficients)) for effect, coefficients in reference.effects],
            noise_std=(unit * reference.noise_std).tolist(),
        )
        search = ChangeSearch(Believed.unchanged(model, unit * robot.phi), [replace(states, tau=unit * states.tau)])
        return search.weigh().precision[:24].reshape(6, 4)

    offset, factor, *friction = precision(1e3).T
    assert_allclose(factor, precision(1.0)[:, 1], rtol=1e-6)
    assert_allclose(np.stack([offset, *friction], axis=1), precision(1.0)[:, [0, 2, 3]] / 1e6, rtol=1e-6)
