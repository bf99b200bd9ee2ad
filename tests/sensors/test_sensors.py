"""Channels and contacts: what is no model's matter is found where it is, and nothing where nothing is."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers import data
from helpers.data import data_folder
from helpers.diagnosed import ROBOT, SIX_AXES, entry_of, found_in, holds, measured, names, recorded, rigid, with_effects
from helpers.small_arm import JOINTS

import dynid_rs as dyn
from dynid_rs.diagnosis.examination import examine
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.identification.training import prepare_training_runs
from dynid_rs.regression.priors import declares_inertia
from dynid_rs.runs.encoders import EncoderDelay
from dynid_rs.runs.preprocessing import choose_band, common_rate, without
from dynid_rs.sensors import channel_errors, channels_of
from dynid_rs.sensors.channels import channel_findings
from dynid_rs.sensors.contact import _smooth, find_contacts
from dynid_rs.sensors.messages import encoder_entries
from dynid_rs.sensors.watch import Watch
from dynid_rs.simulation import bundled_robot, simulate

CLEAN_SEEDS = 6
PLACEHOLDER = (
    '<inertial><mass value="0.001"/><inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial>'
)
EDGES = 0.25
"""Start and end of a push are known this well [s]: it swells and fades over half its length."""


def robot():
    return SIX_AXES


@cache
def runs(*wishes, seed=0, duration=20.0):
    """Arms and recordings of four runs of a rigid six-axis arm with one encoder; the last one is kept for testing."""
    arm = with_effects(rigid(SIX_AXES), *wishes) if wishes else rigid(SIX_AXES)
    sim = simulate(arm, n_runs=4, duration=duration, rate=250, seed=seed)
    return sim, [replace(recording, q_motor=None) for recording in sim.recordings]


def fitted(recordings):
    return ThreeLoopIdentifier(robot(), residual=None).fit(recordings)


@cache
def clean_fit(seed=0, duration=20.0):
    """What the first three runs of the clean arm tell; whoever takes it only reads it."""
    return fitted(runs(seed=seed, duration=duration)[1][:3])


def states(recordings):
    return prepare_training_runs(recordings, choose_band(recordings), common_rate(recordings))


@cache
def clean_states():
    """The first three short runs of the clean arm, prepared."""
    return states(runs(duration=8.0)[1][:3])


@pytest.mark.parametrize("encoder_delay", [0.0, 0.0028, 0.01])
def test_the_delay_between_encoders_is_taken_out(encoder_delay):
    arm = replace(rigid(SIX_AXES), delay=encoder_delay)
    fit = fitted(simulate(arm, n_runs=2, duration=15.0, rate=250, seed=3).recordings)
    assert fit.model_.encoder_delay == pytest.approx(np.full(6, encoder_delay), abs=3e-5)


@pytest.mark.parametrize("delay_ms", [3.0, 12.0])
def test_one_delay_of_all_torque_channels_is_recovered(delay_ms):
    recordings = measured(f"torque_delay::{delay_ms / 5}")
    found = found_in(recordings)
    assert names(found) == {("torque_delay", JOINTS)}
    assert holds(entry_of(found, "torque_delay"), {"delay": 1e-3 * delay_ms}) == []
    # The correction is what it says: on the corrected runs there is no delay left.
    np.testing.assert_allclose(found.setup.torque_delay, 1e-3 * delay_ms, atol=2e-3)
    again = found_in([recording.less_torque_delay(found.setup.torque_delay) for recording in recordings])
    assert again.entries == []


def test_clean_arms_have_no_contact():
    for seed in range(CLEAN_SEEDS):
        _, recordings = runs(seed=seed, duration=8.0)
        fit = clean_fit(seed, 8.0)
        assert not find_contacts(fit, fit.raw_runs_), seed
        assert not find_contacts(fit, fit.raw_runs_, [fit.states(recordings[3])]), seed


def test_pushes_are_found_in_training_and_test_runs_and_nothing_else():
    sim, recordings = runs("contact::0.2")
    setup, fit, findings = examine(Setup(robot()), recordings[:3], recordings[3:])
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
    clean = clean_fit().links_.noise_std_
    np.testing.assert_allclose(fit.links_.noise_std_, clean, rtol=0.15)
    test = setup.identifier(residual=None).fit(recordings[:3]).states(recordings[3])
    for start, end in setup.excluded[recordings[3].name]:
        assert not test.moving[(test.t > start) & (test.t < end)].any()


def test_a_push_in_the_test_run_touches_no_fit():
    _, pushed = runs("contact::0.2")
    _, free = runs()
    fits = [examine(Setup(robot()), free[:3], [test])[1] for test in (free[3], pushed[3])]
    np.testing.assert_array_equal(fits[0].links_.x_, fits[1].links_.x_)


def test_pushes_are_neither_fitted_nor_named_and_do_not_hide_a_delay():
    found = found_in(measured("contact::0.3", "torque_delay::2", duration=20.0))
    assert {finding.code for finding in found.findings} == {"contact"}
    assert names(found) == {("torque_delay", JOINTS)}
    assert holds(entry_of(found, "torque_delay"), {"delay": 1e-2}) == []


def test_excluded_samples_keep_a_guard_for_the_filter():
    run = clean_states()[0]
    left = without(run, [(3.0, 4.0)])
    guard = 1 / run.band.cutoff
    np.testing.assert_array_equal(left.moving, run.moving & ((run.t < 3.0 - guard) | (run.t > 4.0 + guard)))
    assert without(run, []) is run


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
        ({"tau": (SWAPPED, 1.0)}, "torque_swapped", "tau_1"),
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
    recordings = changed(runs(duration=8.0)[1][:3], **signals)
    findings = channel_findings(robot(), states(recordings))
    assert [(finding.code, finding.severity, finding.column) for finding in findings] == [(code, "error", column)]


def test_a_zero_by_another_convention_is_named_and_either_mend_mends_it():
    """A quarter turn on the second axis: it used to be taken for an exchange of two joints of the wrist."""
    recordings = [replace(run, q=run.q + np.pi / 2 * (np.arange(6) == 1)) for run in runs(duration=8.0)[1][:3]]
    (finding,) = channel_findings(robot(), states(recordings))
    assert (finding.code, finding.severity, finding.column) == ("zero_shifted", "error", "q_1")
    assert (finding.value, finding.unit) == (-90.0, "deg")
    assert "add -90 degrees to that column" in finding.message
    text = Path(bundled_robot()).read_text(encoding="utf-8")
    start = text.index('<joint name="joint_2"')
    end = text.index("</joint>", start)
    assert '<axis xyz="0 1 0"/>' in text[start:end]
    turned = (
        text[:start] + text[start:end].replace('rpy="0 0 0"', f'rpy="0 {np.radians(finding.value)} 0"') + text[end:]
    )
    assert turned != text
    assert channel_findings(dyn.RobotModel.from_urdf_string(turned), states(recordings)) == []


def test_joints_that_only_move_together_tell_no_zero():
    """What one of them does from another zero, the others' links do as well: it was an error on a measured arm."""
    t = np.arange(0, 20.0, 1 / 250)
    wave = 0.8 * np.sin(1.1 * t) + 0.3 * np.sin(2.9 * t)
    rng = np.random.default_rng(4)
    recordings = []
    for k in range(2):
        q = wave[:: 1 - 2 * k, None] * np.array([0.9, 1.0, 0.8, 1.1, 0.7, 1.2])
        dq = np.gradient(q, t, axis=0)
        seen = q + np.pi / 2 * (np.arange(6) == 1)
        tau = robot().inverse_dynamics(q, dq, np.gradient(dq, t, axis=0)) + 2 * np.sign(dq)
        recordings.append(dyn.Recording(t, seen, tau=tau + 0.2 * rng.normal(size=q.shape), name=f"run_{k}.csv"))
    assert "zero_shifted" not in [finding.code for finding in channel_findings(robot(), states(recordings))]


def test_a_file_of_equal_links_tells_no_unit():
    """A gram in every link is what somebody filled in, not a torque a thousand times too large."""
    filled = re.sub(
        r"<inertial>.*?</inertial>", PLACEHOLDER, Path(bundled_robot()).read_text(encoding="utf-8"), flags=re.S
    )
    arm = dyn.RobotModel.from_urdf_string(filled)
    assert not declares_inertia(arm)
    assert channel_findings(arm, clean_states()) == []


@pytest.mark.parametrize("link", ["upper_arm", "elbow", "forearm"])
def test_a_robot_file_that_leaves_out_one_link(link):
    """What is told of its moments of inertia beside those of the next one is known all but exactly."""
    text = Path(bundled_robot()).read_text(encoding="utf-8")
    left_out = re.sub(rf'(<link name="{link}">.*?)<inertial>.*?</inertial>', r"\1", text, count=1, flags=re.S)
    arm, recordings = dyn.RobotModel.from_urdf_string(left_out), runs(duration=8.0)[1][:3]
    assert declares_inertia(arm)
    assert np.count_nonzero(arm.phi.reshape(6, 10).any(axis=1)) == 5
    assert channel_findings(arm, clean_states()) == []
    findings = channel_findings(arm, states(changed(recordings, tau=(SWAPPED, 1.0))))
    assert [finding.code for finding in findings] == ["torque_swapped"]


def test_torque_on_the_motor_side_names_the_gears_and_every_flipped_joint_is_named():
    recordings = runs(duration=8.0)[1][:3]
    (finding,) = channel_findings(robot(), states(changed(recordings, tau=(ORDER, 1 / robot().gear_ratio))))
    assert "motor's side" in finding.message
    findings = channel_findings(robot(), states(changed(recordings, tau=(ORDER, -1.0))))
    assert [finding.code for finding in findings] == ["torque_flipped"] * 6


def test_channels_that_are_what_they_are_called_say_nothing():
    assert not channel_findings(robot(), clean_states())


def test_a_wrong_channel_ends_the_diagnosis_with_a_sentence_and_no_effect():
    recordings = changed(runs(duration=8.0)[1], tau=(SWAPPED, 1.0))
    setup = Setup(robot())
    after, fit, findings = examine(setup, recordings[:3])
    assert after is setup
    assert fit is None
    assert [finding.code for finding in findings] == ["torque_swapped"]
    found = found_in(recordings, SIX_AXES)
    assert found.entries == []
    assert found.before is found.after
    assert [finding.code for finding in found.findings] == ["torque_swapped"]
    assert "dynid.toml" in findings[0].message


def test_two_short_runs_that_hardly_overlap_do_not_contradict_each_other():
    model, recordings = real("kuka_kr300_weigand", "traj_A", "traj_B")
    assert channel_errors(model, recordings) == []


def real(folder, *files):
    data_folder()
    model = dyn.RobotModel.from_urdf(data.data_file(folder))
    return model, [dyn.read_recording(data.data_file(folder, f"{name}.parquet"), model) for name in files]


def test_the_pushed_robot_is_seen_to_be_pushed_and_the_free_one_is_not():
    free = ("20_02_12_50sec_12harm", "20_02_10_30sec_12harm", "20_02_19_14harm50sec", "20_02_12_40sec_12harm")
    model, recordings = real("ur10e_innopolis", *free, "20_01_22_push_pose_1")
    setup, _, findings = examine(Setup(model), recordings[:3], recordings[3:])
    assert list(setup.excluded) == ["20_01_22_push_pose_1.parquet"]
    # Read off the currents by eye: four pushes, each about a second long.
    seen = ((2.4, 0.8), (5.2, 1.0), (8.9, 0.8), (12.6, 0.8))
    windows = setup.excluded["20_01_22_push_pose_1.parquet"]
    assert len(windows) == len(seen) == len([finding for finding in findings if finding.code == "contact"])
    for (start, end), (middle, width) in zip(windows, seen, strict=True):
        assert start < middle < end < start + width + 2.0


@pytest.mark.parametrize("n_samples", [4, 5, 20, 21])
def test_a_burst_is_seen_where_it_is(n_samples):
    """Played backwards a run shows the same bursts backwards: no kernel leans to one side."""
    rng = np.random.default_rng(n_samples)
    shape = 200, 2
    residual, slack, unsure = rng.standard_normal((3, *shape))
    seen, step = rng.random(shape) > 0.1, 0.01
    moving = np.zeros(len(residual), dtype=bool)
    since, turn = np.ones(shape), np.zeros(shape, dtype=int)
    pause = np.where(np.arange(200) // 60 == 1, 0, -1)
    forwards = Watch("run", step * np.arange(200), residual, seen, slack, unsure, since, turn, moving, pause, step)
    turned = (x[::-1] for x in (residual, seen, slack, unsure))
    backwards = Watch("run", forwards.t, *turned, since, turn, moving, pause[::-1], step)
    there, back = _smooth(forwards, n_samples * step), _smooth(backwards, n_samples * step)
    assert there.enough.any()
    for name in ("m", "slack", "unsure", "enough"):
        np.testing.assert_allclose(getattr(back, name)[::-1], getattr(there, name), atol=1e-12)


def test_axes_whose_clocks_differ_by_more_than_their_errors_are_no_better_than_their_spread():
    """Of equal weights the delay and its interval are those of Student's test on the axes themselves."""
    from scipy.stats import ttest_1samp

    values = np.array([2.0e-3, 2.4e-3, 3.1e-3, 2.6e-3])
    (entry,) = encoder_entries(EncoderDelay(values, np.full(4, 1e-5), np.ones(4, dtype=bool)))
    student = ttest_1samp(values, 0.0)
    assert entry["value"] == pytest.approx(values.mean(), rel=1e-12)
    assert entry["interval"] == pytest.approx(tuple(student.confidence_interval(0.95)), rel=1e-9)
    assert entry["p_value"] == pytest.approx(student.pvalue, rel=1e-9)
    alike = np.array([2.0e-3, 2.0e-3, 2.0e-3, 2.0e-3])
    (entry,) = encoder_entries(EncoderDelay(alike, np.full(4, 1e-5), np.ones(4, dtype=bool)))
    assert entry["std_error"] == pytest.approx(0.5e-5, rel=1e-12)


def test_channels_of_an_arm_with_a_joint_that_stands_still_are_not_judged():
    flipped = [replace(run, tau=run.tau * [1, -1, 1]) for run in measured(duration=8.0, n_runs=1)]
    assert channels_of(ROBOT, flipped)
    held = [replace(run, q=run.q * [1, 1, 0]) for run in flipped]
    assert channels_of(ROBOT, held) == []


def test_one_torque_channel_that_is_late_is_named_alone():
    """Whatever the channels before it show."""
    runs = measured(duration=12.0, n_runs=2)
    late = [replace(run, tau=np.where([False, True, False], np.roll(run.tau, 30, axis=0), run.tau)) for run in runs]
    (finding,) = channels_of(ROBOT, late)
    assert (finding.code, finding.column) == ("torque_late", "tau_1")


def averaged(tau, n_rows):
    """The mean of every sample and those before it, as controllers smooth what they log."""
    padded = np.concatenate([np.repeat(tau[:1], n_rows - 1, axis=0), tau])
    return np.lib.stride_tricks.sliding_window_view(padded, n_rows, axis=0).mean(axis=-1)


@pytest.mark.parametrize(
    ("torque", "code"),
    [
        (lambda tau, noise: np.roll(tau, 20, axis=0) + averaged(noise, 40), "torque_late"),
        (lambda tau, noise: averaged(tau + noise, 40), "torque_filtered"),
    ],
    ids=["late", "filtered"],
)
def test_all_channels_late_are_filtered_only_if_a_filter_explains_what_they_make_of_the_motion(torque, code):
    """Noise that falls off by itself says nothing where no channel is in time."""
    arm = rigid(ROBOT)
    runs = recorded(replace(arm, noise_std=1e-3 * arm.noise_std), duration=12.0, n_runs=2)
    rng, size = np.random.default_rng(5), 0.02 * np.std(runs[0].tau, axis=0)
    late = [replace(run, tau=torque(run.tau, size * rng.standard_normal(run.tau.shape))) for run in runs]
    (finding,) = channels_of(ROBOT, late)
    assert finding.code == code
    delay = 20 * (runs[0].t[1] - runs[0].t[0])
    assert finding.value == pytest.approx(delay, abs=0.004)


@pytest.mark.parametrize("at", np.arange(2.0, 6.1, 0.5).tolist())
def test_a_push_at_one_of_few_reversals_is_told_by_the_others(at):
    """Eight seconds have a few reversals of a joint each: a push at one is most of what lies as far from any."""
    _, recordings = runs(duration=8.0)
    pushed = recordings[3]
    tau = pushed.tau.copy()
    tau[:, 1] += 20.0 * np.exp(-(((pushed.t - pushed.t[0] - at) / 0.2) ** 2))
    fit = clean_fit(duration=8.0)
    (contact,) = find_contacts(fit, fit.raw_runs_, [fit.states(replace(pushed, tau=tau))])
    assert contact.most == 1
    assert abs((contact.start + contact.end) / 2 - pushed.t[0] - at) < 0.3


HELD = np.array([0.0, 100.0, 45.0, 0.0, 0.0, 0.0])
"""What changes the torque of a pause [N m]: more than twice what friction may hold."""


def pushed_at_rest(tau, t):
    """Half a second of push on two joints."""
    return tau + np.multiply.outer(np.sin(np.pi * np.clip((t - 1.6) / 0.5, 0.0, 1.0)), HELD)


def braked(tau, t):
    """The brakes close, the motors let go; then they hold again, before the brakes open."""
    return tau * ((t < 1.4) | (t > 2.6))[:, None]


def settling(tau, t):
    """What a controller's integrators hold fades after the stop."""
    return tau + np.multiply.outer(np.exp(-np.maximum(t, 0.0) / 0.3) * (t > 0), HELD)


def held_otherwise(tau, t):
    """A brake closes for good, the drives stay on at another torque."""
    return tau + np.multiply.outer(t > 1.6, HELD)


def hunting(tau, t):
    """A controller that integrates what friction holds goes up until the joint gives way, and back."""
    return tau + np.multiply.outer(np.interp(t, [1.3, 1.7, 2.4, 2.9], [0.0, 1.0, -1.0, 0.0]), HELD / 4)


@pytest.mark.parametrize("what", [pushed_at_rest, braked, settling, held_otherwise, hunting])
def test_a_push_in_a_pause_is_seen_and_what_an_arm_does_by_itself_there_is_not(what):
    """The run goes on at rest for three seconds, and something happens to the torque meanwhile."""
    _, recordings = runs()
    run, rng = recordings[3], np.random.default_rng(8)
    step = run.t[1] - run.t[0]
    t = np.concatenate([run.t, run.t[-1] + step * np.arange(1, round(3.0 / step))])
    stop = run.t[np.nonzero(np.abs(np.diff(run.q, axis=0)).max(axis=1) > 1e-3 * step)[0][-1]]
    n_more = len(t) - len(run.t)
    noise = np.std(np.diff(run.tau[:20], axis=0), axis=0) / np.sqrt(2) * rng.standard_normal((n_more, run.tau.shape[1]))
    held = np.median(run.tau[-20:], axis=0) + noise
    longer = replace(
        run,
        t=t,
        q=np.concatenate([run.q, np.tile(run.q[-1], (n_more, 1))]),
        tau=what(np.concatenate([run.tau, held]), t - stop),
    )
    fit = clean_fit()
    found = find_contacts(fit, fit.raw_runs_, [fit.states(longer)])
    if what is not pushed_at_rest:
        assert not found
        return
    (contact,) = found
    assert contact.most in (1, 2)
    assert abs((contact.start + contact.end) / 2 - stop - 1.85) < 0.1
    assert {1, 2} <= set(contact.joints)
