"""Sensors and clocks: delays, contact, gains and channels are found where they are, and nothing where nothing is."""

from dataclasses import replace
from functools import cache

import data
import numpy as np
import pytest
from data import data_folder

import dynid_rs as dyn
from dynid_rs.diagnosis.sensors import examine, torque_gains
from dynid_rs.diagnosis.sensors.beside import Beside
from dynid_rs.diagnosis.sensors.channels import channel_findings
from dynid_rs.diagnosis.sensors.clocks import DelayParts, choose_delay, delay_parts, measure_delay
from dynid_rs.diagnosis.sensors.contact import find_contacts
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import choose_band, common_rate, without
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm
from dynid_rs.training import prepare_training_runs

CLEAN_SEEDS = 20
SUB_MILLISECOND = 5e-4
"""Delays are recovered this well [s]; one sample lasts 4 ms."""
SIGMAS = 4.0
"""Seeded estimates lie within this many of their own standard errors."""
EDGES = 0.2
"""Start and end of a push are known this well [s]: it swells and fades over half its length."""


@cache
def robot():
    return dyn.RobotModel.from_urdf(bundled_robot())


@cache
def runs(*wishes, seed=0, duration=20.0, encoders=1):
    """Arms and recordings of four runs of a rigid six-axis arm; the last one is kept for testing."""
    typical = typical_arm(robot())
    arm = typical if encoders == 2 else replace(typical.rigid(), delay=0.0)
    arm = equip(arm, build_effects([parse_wish(wish) for wish in wishes], typical))
    sim = simulate(arm, n_runs=4, duration=duration, rate=250, seed=seed)
    recordings = [replace(r, q_motor=r.q_motor if encoders == 2 else None) for r in sim.recordings]
    return sim, recordings


def fitted(recordings):
    return ThreeLoopIdentifier(robot(), residual=None).fit(recordings)


def states(recordings):
    return prepare_training_runs(recordings, choose_band(recordings), common_rate(recordings))


@pytest.mark.parametrize("encoder_delay", [0.0, 0.0028, 0.01])
def test_inertia_of_links_whose_channel_is_late_is_not_late(encoder_delay):
    """The acceleration has to come to the motor's clock with position and speed, or inertia's part is late."""
    arm = replace(typical_arm(robot()).rigid(), delay=encoder_delay)
    fit = fitted(simulate(arm, n_runs=3, duration=20.0, rate=250, seed=3).recordings)
    assert fit.model_.encoder_delay == pytest.approx(np.full(6, encoder_delay), abs=2e-5)
    parts = delay_parts(fit)
    inertia, sure = parts.value[1], parts.std_error[1] < SUB_MILLISECOND
    assert sure.sum() > 2
    assert np.all(np.abs(inertia[sure]) < SIGMAS * parts.std_error[1][sure])


@pytest.mark.parametrize("delay_ms", [1.0, 5.0, 12.0])
def test_one_delay_of_all_torque_channels_is_recovered(delay_ms):
    _, recordings = runs(f"torque_delay::{delay_ms / 5}")
    setup, findings, entries = examine(Setup(robot()), recordings[:3], recordings[3:])
    assert [finding.code for finding in findings] == ["torque_delay"]
    assert "with one encoder" in findings[0].message
    (entry,) = entries
    assert entry["kind"] == "torque_delay"
    assert entry["joints"] == tuple(range(6))
    truth = 1e-3 * delay_ms
    assert abs(entry["value"] - truth) < min(SUB_MILLISECOND, SIGMAS * entry["std_error"])
    np.testing.assert_allclose(setup.torque_delay, entry["value"])
    # The correction is what it says: on the corrected runs there is no delay left.
    again = fitted([setup.corrected(recording) for recording in recordings[:3]])
    assert not choose_delay(delay_parts(again)).places


@pytest.mark.parametrize("joint", [0, 3])
def test_a_delay_of_one_joint_is_told_from_a_common_one(joint):
    _, recordings = runs(f"torque_delay:{joint}:1")
    delay = choose_delay(delay_parts(fitted(recordings[:3])))
    assert delay.places == ((joint,),)
    assert abs(delay.value[0] - 5e-3) < max(SUB_MILLISECOND, SIGMAS * delay.std_error[0])


@pytest.mark.parametrize("wish", ["friction_hysteresis:2:3", "stribeck:2:3", "gravity_tilt::1", "kinematic_error:2:3"])
def test_physics_that_follows_the_motion_is_not_taken_for_a_delay(wish):
    _, recordings = runs(wish)
    assert not choose_delay(delay_parts(fitted(recordings[:3]))).places


def test_gears_that_lose_torque_inside_do_not_hide_or_feign_a_delay():
    for wishes, places in (((), ()), (("torque_delay::2",), (tuple(range(6)),))):
        _, recordings = runs(*wishes, encoders=2)
        delay = choose_delay(delay_parts(fitted(recordings[:3])))
        assert delay.places == places
        if places:
            assert abs(delay.value[0] - 1e-2) < SIGMAS * delay.std_error[0]


def test_clean_arms_get_nothing_and_delays_are_as_uncertain_as_they_say():
    deviations = []
    for seed in range(CLEAN_SEEDS):
        _, recordings = runs(seed=seed, duration=8.0)
        fit = fitted(recordings[:3])
        parts = delay_parts(fit)
        assert not choose_delay(parts).places, seed
        assert not find_contacts(fit, [*fit.raw_runs_, fit.states(recordings[3])]), seed
        common = measure_delay(parts, [tuple(range(6))])
        deviations.append(common.value[0] / common.std_error[0])
    # Root mean square of 20 standardised errors: 0.6 to 1.4 holds 99 % of honest ones.
    assert 0.6 < np.sqrt(np.mean(np.square(deviations))) < 1.4


def test_pushes_are_found_in_training_and_test_runs_and_nothing_else():
    sim, recordings = runs("contact::0.2")
    setup, findings, _ = examine(Setup(robot()), recordings[:3], recordings[3:])
    assert {finding.code for finding in findings} == {"contact"}
    found = 0
    for arm, recording in zip(sim.arms, recordings, strict=True):
        pushes = arm.effects[0].pushes
        for start, end in setup.excluded[recording.name]:
            (push,) = [push for push in pushes if push.start < end and push.end > start]
            assert abs(start - push.start) < EDGES
            assert abs(end - push.end) < EDGES
            found += 1
    assert found == sum(len(arm.effects[0].pushes) for arm in sim.arms)
    # What is excluded is not fitted: the arm's noise is all that is left, as without any push.
    clean = fitted(runs()[1][:3]).links_.noise_std_
    kept = setup.identifier(residual=None).fit(recordings[:3])
    np.testing.assert_allclose(kept.links_.noise_std_, clean, rtol=0.15)
    test = kept.states(recordings[3])
    for start, end in setup.excluded[recordings[3].name]:
        assert not test.moving[(test.t > start) & (test.t < end)].any()


def test_a_delay_and_hard_pushes_do_not_hide_each_other():
    _, recordings = runs("contact::0.3", "torque_delay::1")
    setup, findings, _ = examine(Setup(robot()), recordings[:3], recordings[3:])
    assert {finding.code for finding in findings} == {"contact", "torque_delay"}
    np.testing.assert_allclose(setup.torque_delay, 5e-3, atol=SUB_MILLISECOND)


def test_excluded_samples_keep_a_guard_for_the_filter():
    run = states(runs(duration=8.0)[1][:3])[0]
    left = without(run, [(3.0, 4.0)])
    guard = 1 / run.band.cutoff
    np.testing.assert_array_equal(left.moving, run.moving & ((run.t < 3.0 - guard) | (run.t > 4.0 + guard)))
    assert without(run, []) is run


@pytest.mark.parametrize(("joint", "size"), [(1, -1.0), (4, 0.4)])
def test_a_drive_gain_is_seen_through_the_links_that_joints_share(joint, size):
    _, recordings = runs(f"torque_gain:{joint}:{size}")
    value, std_error = torque_gains(fitted(recordings[:3]))
    truth = np.zeros(6)
    truth[joint] = 0.05 * size
    assert np.all(np.abs(value - truth) < SIGMAS * std_error)
    assert abs(value[joint]) > 10 * std_error[joint]


def test_columns_count_with_what_the_model_cannot_absorb():
    fit = fitted(runs(duration=8.0)[1][:3])
    beside = Beside(fit)
    rng = np.random.default_rng(0)
    column = rng.standard_normal((len(beside.torque), 1))
    # The weight of the last link about the third joint, say: any base parameter is the model's own.
    plan = fit.observations_.plan
    inside = np.zeros(len(beside.torque))
    n_rows = len(inside) // 6
    for j in range(6):
        base = np.concatenate([block.rows[j] for block in fit.observations_.blocks])[:, plan.n_own : -1]
        inside[j * n_rows : (j + 1) * n_rows] = beside.weights[j] * (base @ (plan.pivots[plan.pivots >= 10 * j] % 7))
    torque = beside.torque + 3.0 * column[:, 0] + 1e3 * inside
    weighed = beside.weigh(column, torque)
    assert abs(weighed.value[0] - 3.0) < SIGMAS * weighed.std_error[0]
    assert np.isnan(beside.weigh(inside[:, None]).value[0])


def changed(recordings, **signals):
    """Runs with signals replaced: joint order, or factors."""
    out = []
    for recording in recordings:
        new = {}
        for name, (order, factor) in signals.items():
            new[name] = getattr(recording, name)[:, order] * factor
        out.append(replace(recording, **new))
    return out


ORDER = list(range(6))
SWAPPED = [0, 2, 1, 3, 4, 5]
THIRD = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("signals", "code", "column"),
    [
        ({"tau": (SWAPPED, 1.0)}, "torque_swapped", "tau_2"),
        ({"tau": (ORDER, THIRD)}, "torque_flipped", "tau_2"),
        ({"q": (ORDER, THIRD)}, "position_flipped", "q_2"),
        ({"q": (ORDER, THIRD), "tau": (ORDER, THIRD)}, "joint_flipped", "q_2"),
        ({"q": (SWAPPED, 1.0)}, "position_swapped", "q_1"),
        ({"q": (SWAPPED, 1.0), "tau": (SWAPPED, 1.0)}, "joints_swapped", "q_1"),
        ({"tau": (ORDER, 1e3)}, "torque_unit", "tau_0"),
        ({"q": (ORDER, 180 / np.pi)}, "units_degrees", "q_0"),
    ],
)
def test_channels_that_are_not_what_they_are_called_are_errors(signals, code, column):
    recordings = changed(runs()[1][:3], **signals)
    findings = channel_findings(robot(), states(recordings))
    assert [(finding.code, finding.severity, finding.column) for finding in findings] == [(code, "error", column)]


def test_torque_on_the_motor_side_names_the_gears_and_every_flipped_joint_is_named():
    recordings = runs(duration=8.0)[1][:3]
    (finding,) = channel_findings(robot(), states(changed(recordings, tau=(ORDER, 1 / robot().gear_ratio))))
    assert "motor's side" in finding.message
    findings = channel_findings(robot(), states(changed(recordings, tau=(ORDER, -1.0))))
    assert [finding.code for finding in findings] == ["torque_flipped"] * 6


def test_channels_that_are_what_they_are_called_say_nothing():
    assert not channel_findings(robot(), states(runs(duration=8.0)[1][:3]))


def test_a_wrong_channel_stops_the_examination_and_corrects_nothing():
    recordings = changed(runs(duration=8.0)[1][:3], tau=(SWAPPED, 1.0))
    setup = Setup(robot())
    after, findings, entries = examine(setup, recordings)
    assert after is setup
    assert not entries
    assert [finding.code for finding in findings] == ["torque_swapped"]


def real(folder, *names):
    model = dyn.RobotModel.from_urdf(data.data_file(folder))
    return model, [dyn.read_recording(data.data_file(folder, f"{name}.parquet"), model) for name in names]


def test_the_kuka_s_link_encoders_are_late():
    data_folder()
    model, recordings = real("kuka_kr300_weigand", "traj_A", "traj_B")
    _, findings, entries = examine(Setup(model), recordings[:1], recordings[1:])
    assert not [finding for finding in findings if finding.severity != "info"]
    (entry,) = entries
    assert entry["kind"] == "encoder_delay"
    assert entry["significant"]
    assert entry["joints"] == (0, 1, 2)
    assert 2.6e-3 < entry["interval"][0] < entry["interval"][1] < 3.2e-3


def test_the_pushed_robot_is_seen_to_be_pushed_and_the_free_one_is_not():
    data_folder()
    free = ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec", "20_02_12_40sec_12harm")
    model, recordings = real("ur10e_innopolis", *free, "20_01_22_push_pose_1")
    setup, findings, entries = examine(Setup(model), recordings[:3], recordings[3:])
    assert not entries
    assert list(setup.excluded) == ["20_01_22_push_pose_1.parquet"]
    # Read off the currents by eye: four pushes, each about a second long.
    seen = ((2.4, 0.8), (5.2, 1.0), (8.9, 0.8), (12.6, 0.8))
    windows = setup.excluded["20_01_22_push_pose_1.parquet"]
    assert len(windows) == len(seen) == len([finding for finding in findings if finding.code == "contact"])
    for (start, end), (middle, width) in zip(windows, seen, strict=True):
        assert start < middle < end < start + width + 2.0


def test_one_part_of_the_torque_alone_is_no_clock():
    """Gravity does not see a vertical axis; where friction contradicts inertia, physics lags and no channel."""
    value = np.array([[np.nan, 0.0], [2.6e-3, 0.1e-3], [-0.2e-3, 0.1e-3]])
    std = np.array([0.3, 0.3, 0.37, 0.3, 0.4, 0.3]) * 1e-3
    against = DelayParts(value, np.diag(std**2), 300)
    assert choose_delay(against).places == ()
    agreeing = value.copy()
    agreeing[2, 0] = 2.4e-3
    assert choose_delay(DelayParts(agreeing, np.diag(std**2), 300)).places == ((0,),)
