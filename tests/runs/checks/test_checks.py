"""Checks fire on what they are for, and stay silent on a good run."""

# ruff: noqa: E501 - the table of faults has one case a line

import tracemalloc
from contextlib import contextmanager

import numpy as np
import pytest
from helpers.run_files import RATE, motion

from dynid_rs.base.findings import joint_words
from dynid_rs.runs.checks import check_recording, moving_joints, refused_sources
from dynid_rs.runs.checks.bits import lattice_step
from dynid_rs.runs.recording import Recording

N = 1200
HINTS = {"single_encoder"}


@contextmanager
def tracing():
    """Gives the most bytes that were taken at once so far."""
    tracemalloc.start()
    yield lambda: tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()


class Robot:
    """Limits of three joints; the last one turns without end."""

    lower = np.array([-2.0, -2.0, -np.inf])
    upper = np.array([2.0, 2.0, np.nan])


def good():
    """Arrays of a run without any fault: two encoders, noise, standstill nowhere."""
    rng = np.random.default_rng(11)
    t, q, dq, ddq = motion(N)
    tau = 3.0 * ddq + 0.5 * dq + 2.0 * np.cos(q) + 0.05 * rng.standard_normal(q.shape)
    noise = 1e-6 * rng.standard_normal(q.shape)
    return {"t": t, "q": q + noise, "tau": tau, "dq": dq, "ddq": ddq, "q_motor": q + tau / 1e4}


def check(change=None, robot=None, **more):
    arrays = good()
    if change is not None:
        change(arrays)
    return check_recording(Recording(**arrays, name="run.csv", **more), robot)


def test_good_run_has_no_findings():
    assert check() == []
    assert check(robot=Robot()) == []


def test_single_encoder_is_information():
    def change(a):
        a["q_motor"] = None

    (finding,) = check(change)
    assert (finding.code, finding.severity) == ("single_encoder", "info")


def spoil(name, joint, values):
    def change(a):
        a[name][:, joint] = values(a) if callable(values) else values

    return change


def stretch_time(factor):
    def change(a):
        a["t"] *= factor

    return change


def gap(a):
    a["t"] = a["t"].copy()
    a["t"][600:] += 0.05


def jitter(a):
    a["t"] = a["t"] + np.random.default_rng(0).uniform(-0.45, 0.45, N) / RATE
    for name in ("dq", "ddq", "q_motor"):
        a[name] = None


def late(first, stop):
    """Rows from `first` that a program came to only at the time of row `stop`: stamped then, 10 us apart."""

    def change(a):
        a["t"] = a["t"].copy()
        a["t"][first:stop] = a["t"][stop] - 1e-5 * np.arange(stop - first, 0, -1)

    return change


def slow(a):
    for name, values in a.items():
        a[name] = values[::3]


def freeze(name, joint, start, stop):
    def change(a):
        a[name][start:stop, joint] = a[name][start, joint]
        if name == "q":
            a["ddq"] = a["dq"] = None

    return change


def clip(joint, share):
    def change(a):
        tau = a["tau"][:, joint]
        limit = share * np.abs(tau).max()
        tau[:] = np.clip(tau, -limit, limit)

    return change


def wrap(a):
    for name in ("q", "q_motor"):
        a[name][:, 1] = np.mod(5 * a[name][:, 1], 2 * np.pi)
    a["dq"] = a["ddq"] = None


def jump(a):
    a["q"][700, 2] += 0.5


def to_degrees(a):
    for name in ("q", "dq", "ddq", "q_motor"):
        a[name] = a[name] * 180 / np.pi


def swap_motors(a):
    a["q_motor"] = a["q_motor"][:, [1, 0, 2]]


def still(*joints):
    def change(a):
        for joint in joints:
            for name in ("q", "dq", "ddq", "q_motor"):
                a[name][:, joint] = 0.0

    return change


def delay(a):
    a["q_motor"] = a["q"] + 3e-3 * a["dq"]


def together(a):
    for name in ("q", "dq", "ddq", "q_motor"):
        a[name][:, 2] = -0.7 * a[name][:, 0]


def small(a):
    for name in ("q", "dq", "ddq", "q_motor"):
        a[name] = 0.1 * a[name]


def crawl(a):
    a["q"] = 0.3 * np.sin(0.2 * a["t"])[:, None] * [1, -1, 1] + 0.1 * np.sin(0.5 * a["t"])[:, None] * [
        0,
        1,
        2,
    ]
    a["dq"] = a["ddq"] = a["q_motor"] = None


def one_way(a):
    a["q"] = a["t"][:, None] * [0.3, 0.4, 0.5] + 0.02 * np.sin(a["t"])[:, None] * [1, 3, 9]
    a["dq"] = a["ddq"] = a["q_motor"] = None


def short(a):
    for name, values in a.items():
        a[name] = values[:300]


def absurd(a):
    a["q"][5, 1] = 1e200


# change, code, severity, column, words of the message
CASES = {
    "milliseconds": (stretch_time(1e3), "sampling_rate", "error", "t", r"milliseconds.*time = \"ms\""),
    "too_fast": (stretch_time(1e-4), "sampling_rate", "error", "t", "not seconds"),
    "slow_rate": (slow, "sampling_rate", "warning", "t", "slow for identification"),
    "jitter": (jitter, "jitter", "warning", "t", "of the usual step"),
    "late": (late(600, 605), "jitter", "warning", "t", r"once a row is late .* \(by up to (49.9|50) ms, at row 601\): .* times of arrival"),
    "late_at_the_start": (late(0, 5), "jitter", "warning", "t", r"once a row is late .* \(by up to (49.9|50) ms, at row 1\): .* times of arrival"),
    "gap": (gap, "gap", "warning", "t", r"1 gap of more than 2.5 median steps, the longest 60 ms before row 601"),
    "never_moves": (still(1), "joint_never_moves", "warning", "q_1", "joint 1 never moves"),
    "dead_torque": (spoil("tau", 0, 0.0), "stuck", "error", "tau_0", "0 N.m in every row"),
    "frozen_torque": (freeze("tau", 1, 300, 360), "stuck", "error", "tau_1", r"rows 301 to 360"),
    "frozen_velocity": (freeze("dq", 1, 300, 360), "stuck", "error", "dq_1", r"rows 301 to 360"),
    "frozen_motor": (freeze("q_motor", 2, 300, 360), "stuck", "error", "q_motor_2", r"rows 301 to 360"),
    "frozen_link": (freeze("q", 0, 300, 360), "stuck", "error", "q_0", r"rows 301 to 360"),
    "frozen_to_the_end": (freeze("q", 0, 1000, N), "stuck", "error", "q_0", r"rows 1001 to 1200"),
    "clipped": (clip(2, 0.6), "saturated", "error", "tau_2", "largest value .* saturated"),
    "wrapped": (wrap, "wrapped", "error", "q_1", "whole turn .* unwrap"),
    "jump": (jump, "position_jump", "error", "q_2", "jumps by 0.457 rad at row 701"),
    "degrees": (to_degrees, "units_degrees", "warning", "q_0", r"angle = \"deg\""),
    "dq_degrees": (spoil("dq", 0, lambda a: a["dq"][:, 0] * 180 / np.pi), "dq_disagrees", "warning", "dq_0", "deg/s"),
    "dq_rpm": (spoil("dq", 0, lambda a: a["dq"][:, 0] * 30 / np.pi), "dq_disagrees", "warning", "dq_0", "rpm"),
    "dq_flipped": (spoil("dq", 2, lambda a: -a["dq"][:, 2]), "dq_disagrees", "warning", "dq_2", "sign is flipped"),
    "dq_swapped": (spoil("dq", 2, lambda a: a["dq"][:, 1]), "dq_disagrees", "warning", "dq_2", "follows joint 1"),
    "dq_zero": (spoil("dq", 1, 0.0), "dq_disagrees", "warning", "dq_1", "zero"),
    "dq_late": (spoil("dq", 1, lambda a: np.roll(a["dq"][:, 1], 20)), "dq_disagrees", "warning", "dq_1", "not the derivative"),
    "ddq_scaled": (spoil("ddq", 1, lambda a: 0.7 * a["ddq"][:, 1]), "ddq_disagrees", "warning", "ddq_1", "0.7 times"),
    "motor_flipped": (spoil("q_motor", 1, lambda a: -a["q_motor"][:, 1]), "motor_flipped", "error", "q_motor_1", "sign is flipped"),
    "motor_gear": (spoil("q_motor", 1, lambda a: 101 * a["q_motor"][:, 1]), "motor_scale", "error", "q_motor_1", "times as far as q_1.* gear ratio"),
    "motor_swapped": (swap_motors, "motor_swapped", "error", "q_motor_0", "follows joint 1"),
    "motor_noise": (spoil("q_motor", 0, lambda a: np.cos(9 * a["t"])), "motor_disagrees", "error", "q_motor_0", "does not follow"),
    "motor_dead": (spoil("q_motor", 0, 0.5), "stuck", "error", "q_motor_0", "stays at 0.5"),
    "motor_copy": (spoil("q_motor", 0, lambda a: a["q"][:, 0]), "motor_copy", "info", "q_motor_0", "one encoder"),
    "motor_offset": (spoil("q_motor", 0, lambda a: a["q"][:, 0] + 0.2), "encoder_offset", "warning", "q_motor_0", r"\+0.2 rad"),
    "motor_delay": (delay, "encoder_delay", "info", "q_motor_0", "q_0 came about 3 ms after q_motor_0"),
    "together": (together, "joints_together", "warning", "q_2", "joints 0, 2 always move together"),
    "small": (small, "small_motion", "info", "q_0", "moves by only 0.16 rad"),
    "crawl": (crawl, "slow_motion", "info", "q_0", "inertia and viscous friction hardly show"),
    "one_way": (one_way, "few_reversals", "info", "q_0", "changes its direction 0 times"),
    "short": (short, "short_run", "info", None, "short"),
    "absurd": (absurd, "absurd_value", "error", "q_1", "row 6"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "code", "severity", "column", "text"), CASES.values(), ids=CASES)
def test_one_fault_at_a_time(change, code, severity, column, text):
    import re

    findings = check(change)
    first = next((f for f in findings if f.code == code), None)
    assert first is not None, [f.code for f in findings]
    assert (first.severity, first.column, first.file) == (severity, column, "run.csv")
    assert re.search(text, first.message), first.message
    if first.rows is not None:
        assert 0 <= first.rows[0] < first.rows[1] <= N
    first.to_json()
    if severity != "error":
        assert not [f for f in findings if f.severity == "error"]


EXACT = (
    "frozen_torque",
    "frozen_motor",
    "clipped",
    "motor_flipped",
    "motor_gear",
    "motor_offset",
    "dq_degrees",
    "jump",
)


@pytest.mark.parametrize("name", EXACT)
def test_one_fault_gives_findings_about_that_channel_only(name):
    change, _, _, column, _ = CASES[name]
    assert {f.column for f in check(change) if f.severity != "info"} == {column}


def test_worst_findings_come_first():
    def change(a):
        gap(a)
        clip(2, 0.6)(a)
        spoil("q_motor", 0, a["q"][:, 0])(a)

    severities = [finding.severity for finding in check(change)]
    assert severities == sorted(severities, key=["error", "warning", "info"].index)
    assert set(severities) == {"error", "warning", "info"}


def test_no_joint_moves_is_an_error():
    findings = check(still(0, 1, 2))
    assert {f.severity for f in findings if f.code == "joint_never_moves"} == {"error"}


def test_moving_joints():
    arrays = good()
    still(1)(arrays)
    assert moving_joints(Recording(**arrays)).tolist() == [True, False, True]


def test_refused_sources_leave_the_run_usable():
    arrays = good()
    arrays["dq"][:, 1] *= -1
    rec = Recording(**arrays)
    refused = refused_sources(check_recording(rec))
    assert refused == ("dq",)
    assert rec.without(*refused).dq is None
    assert refused_sources([]) == ()


def test_motor_velocity_is_compared_with_the_motor():
    arrays = good()
    rec = Recording(**arrays, dq_motor=-arrays["dq"])
    assert refused_sources(check_recording(rec)) == ("dq_motor",)
    assert check_recording(Recording(**arrays, dq_motor=arrays["dq"])) == []


def test_rows_that_are_stamped_late_are_no_gap():
    """No sample is missing there, and what interpolates between such stamps is a speed that the arm never had."""
    assert "gap" not in [f.code for f in check(late(600, 605))]


def test_small_jitter_is_information():
    def change(a):
        a["t"] = a["t"] + np.random.default_rng(0).uniform(-0.05, 0.05, N) / RATE

    assert [f.severity for f in check(change) if f.code == "jitter"] == ["info"]


def test_limits_of_the_robot():
    def change(a):
        for name in ("q", "q_motor"):
            a[name][:, 1] += 1.5

    (finding,) = check(change, Robot())
    assert (finding.code, finding.severity, finding.column) == ("position_limits", "warning", "q_1")
    assert finding.value == pytest.approx(0.3, abs=1e-3)


def test_degrees_against_limits_are_an_error():
    codes = {f.code: f.severity for f in check(to_degrees, Robot())}
    assert codes["units_degrees"] == "error"
    assert "position_limits" not in codes


KINDS = ("prismatic", "revolute", "prismatic")


def places(**changes):
    """A run whose first and last joints slide, by what becomes of `q` and `q_motor` per joint."""

    def change(a):
        for joint, of in changes.items():
            for name in ("q", "q_motor"):
                a[name][:, int(joint[1])] = of(a[name][:, int(joint[1])])
        a["dq"] = a["ddq"] = None

    return change


class Gantry(Robot):
    """Limits of a slide, a joint that turns, and a slide."""

    upper = np.array([2.0, 2.0, 2.0])
    lower = -upper


def millimetres(q):
    return 1e3 * q


@pytest.mark.parametrize(
    ("changes", "code", "said"),
    [
        ({"j0": millimetres, "j2": millimetres}, "units_length", 'far beyond the limits of the robot, and all that slide fit as millimetres; if so write in dynid.toml: [units] length = "mm"'),
        ({"j0": lambda q: q + 9.0}, "position_limits", " m, its limits are -2 to 2"),
        ({"j0": lambda q: 1e-3 * q}, "joint_never_moves", "at least 0.005 m is motion"),
        ({"j0": lambda q: 0.1 * q + (np.arange(N) > 600)}, "position_jump", " m is a large step"),
        ({"j0": lambda q: 0.1 * q}, "small_motion", " m"),
        ({"j1": np.degrees}, "units_degrees", "q_1 is far beyond the limits of the robot, and all fit as degrees"),
    ],
)  # fmt: skip
def test_what_slides_is_judged_and_told_in_metres(changes, code, said):
    found = check(places(**changes), Gantry(), kinds=KINDS)
    assert {one.code for one in found if one.severity != "info"} <= {code}
    finding = next(one for one in found if one.code == code)
    assert said in finding.message
    assert finding.unit == ("rad" if "j1" in changes else "m")


def test_slides_in_millimetres_are_no_angles():
    found = check(places(j0=millimetres, j2=millimetres), kinds=KINDS)
    assert "units_degrees" not in {one.code for one in found}


def test_a_locked_joint_is_not_in_degrees():
    robot = Robot()
    robot.lower, robot.upper = np.array([-2.0, 0.0, -2.0]), np.array([2.0, 0.0, 2.0])
    found = check(places(j1=lambda q: 1e-3 * q), robot)
    assert {one.code for one in found if one.severity != "info"} == {"joint_never_moves"}


def test_robot_with_other_joints():
    robot = Robot()
    robot.lower = np.zeros(2)
    with pytest.raises(ValueError, match="the run has 3 joints, the robot has 2"):
        check(robot=robot)


def test_ampere_is_said():
    assert "torque_in_ampere" in {f.code for f in check(torque_unit="A")}


@pytest.mark.parametrize("moves", [False, True], ids=["stands", "hangs"])
def test_a_coarse_velocity_without_a_zero_does_not_move_a_joint_that_stands(moves):
    """Half a step of a 12 bit channel is 0.07 rad in six seconds; the joint that stands shows it, and nothing more."""
    rng = np.random.default_rng(4)
    t, q, dq, _ = motion(N)
    rows = np.concatenate([np.arange(300), np.full(600, 300), np.arange(300, 600)])
    q, dq = q[rows], np.where(rows[:, None] == 300, 0.5 if moves else 0.0, dq[rows])
    tau = 0.5 * dq + 2.0 * np.cos(q) + 0.05 * rng.standard_normal(q.shape)
    coarse = 0.022 * (np.floor(dq / 0.022) + 0.5)
    found = check_recording(Recording(t=t, q=q, tau=tau, dq=coarse))
    assert ("stuck" in {one.code for one in found}) is moves


def test_standstill_at_the_ends_and_constant_speed_are_no_faults():
    """A trapezoid without noise: long equal stretches in dq, in q and in tau, all of them legitimate."""
    t = np.arange(3000) / 100.0
    speed = np.clip(np.abs((t % 10.0) - 5.0) - 1.0, 0.0, 1.0) * np.where(t % 10.0 < 5.0, 1.0, -1.0)
    q = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.01)])[:, None]
    dq = speed[:, None]
    rec = Recording(t, q, dq, tau=5.0 * np.sign(dq) + 3.0 * np.cos(q))
    assert [f.code for f in check_recording(rec) if f.severity != "info"] == []


@pytest.mark.parametrize("scale", [1e-12, 1e-3, 1e6])
def test_checks_survive_any_scale(scale):
    def change(a):
        for name in ("q", "dq", "ddq", "q_motor", "tau"):
            a[name] = a[name] * scale

    for finding in check(change):
        assert finding.value is None or np.isfinite(finding.value)


def test_the_step_of_a_lattice_is_the_one_that_all_differences_hold():
    levels = np.repeat(0.25 * np.array([-3.0, 0.0, 1.0, 2.0, 7.0]), 8)
    assert lattice_step(levels) == pytest.approx(0.25)
    assert lattice_step(np.where(levels == 0.5, 0.6, levels)) == 0.0
    assert lattice_step(np.arange(100.0)) == 0.0  # as many values as samples


def test_a_coarse_channel_is_seen_where_a_fast_joint_hardly_repeats_a_value():
    """At 120 Hz .01 rad a row, in steps of .0024 rad: half of all values are there once."""
    t = np.arange(1700) / 121.0
    q = (1.1 * np.sin(1.5 * t) + 0.3 * np.sin(0.7 * t))[:, None]
    coarse = 0.0024 * np.round(q / 0.0024)
    assert 3 * len(np.unique(coarse)) > len(t)
    found = [f for f in check_recording(Recording(t, coarse, tau=np.cos(q))) if f.code == "lost_bits"]
    assert [f.value for f in found] == [pytest.approx(0.0024)]
    t = t[:700]
    there_and_back = np.abs(t - 3.0)[:, None]  # at constant speed: equal steps, and the same ones on the way back
    assert "lost_bits" not in {
        f.code for f in check_recording(Recording(t, there_and_back, tau=np.sin(5 * t)[:, None]))
    }


def test_a_longer_step_of_time_explains_a_longer_way():
    """Samples that are lost are a gap, and no jump of the joint that went on meanwhile."""

    def change(a):
        kept = np.r_[0:700, 708:N]
        for name, values in a.items():
            a[name] = values[kept]

    found = check(change)
    assert "position_jump" not in [finding.code for finding in found]
    assert found  # the gap itself


@pytest.mark.parametrize("rows", [1, 3])
def test_rows_that_lie_about_a_turn_away_and_come_back_are_damaged(rows):
    """An angle that starts again stays where it is for longer."""

    def change(a):
        a["q"][700 : 700 + rows, 2] += 5.1

    found = [f for f in check(change) if f.severity == "error" and f.column == "q_2"]
    assert [(f.code, f.rows) for f in found] == [("position_jump", (700, 701))]


@pytest.mark.parametrize("every", [8, 40])
def test_a_bit_that_hangs_is_seen_however_often(every):
    """Noise is what most steps are off by: jumps at every eighth sample are none of it."""

    def change(a):
        up = np.arange(len(a["q"])) // every % 2
        a["q"][:, 1] += 0.5 * up

    assert [(f.code, f.column) for f in check(change) if f.code == "lost_bits"] == [("lost_bits", "q_1")]


def test_a_bit_that_hangs_is_seen_where_a_fast_joint_passes_it_at_every_row():
    """At 73 Hz, .025 rad a row and a bit of .012 rad: no step stands out, and every other stretch is never recorded."""
    t = np.arange(1100) / 73.0
    q = (1.2 * np.sin(1.3 * t) + 0.1 * np.sin(4.1 * t + 1.0))[:, None]
    counts = np.round(q / 9.6e-5).astype(np.int64)
    for name, hanging in (("low", counts & ~128), ("high", counts | 128)):
        found = [
            f.code
            for f in check_recording(Recording(t, hanging * 9.6e-5, tau=np.cos(q), name=name))
            if f.severity == "error"
        ]
        assert found == ["lost_bits"]
    assert "lost_bits" not in {f.code for f in check_recording(Recording(t, counts * 9.6e-5, tau=np.cos(q)))}


def test_a_pass_at_constant_speed_leaves_gaps_and_is_no_bit():
    t = np.arange(1100) / 50.0
    q = np.interp(t, [0.0, 2.0, 20.0, 22.0], [0.0, 0.0, 2.5, 2.5])[:, None]
    assert "lost_bits" not in {f.code for f in check_recording(Recording(t, q, tau=np.cos(q)))}


@pytest.mark.parametrize("way", [1e5, 1e15, 1e300])
def test_a_position_that_goes_on_for_ever_takes_no_room(way):
    t = np.arange(1100) / 50.0
    q = (way * np.sin(t))[:, None]
    with tracing() as most:
        check_recording(Recording(t, q, tau=np.cos(t)[:, None]))
    assert most() < 20e6


@pytest.mark.parametrize("delay", [0.02, 0.1, 0.25])
def test_a_late_velocity_is_said_to_be_late_and_by_how_much(delay):
    """A tenth of a second is more than its first order in the motion; it is not 'times as large'."""
    t = np.arange(1500) / 100.0
    dq = np.stack([np.cos(3.0 * t) + 0.6 * np.cos(7.0 * t + 0.3), np.cos(2.0 * t)], axis=1)
    q = np.stack([np.sin(3.0 * t) / 3.0 + 0.6 * np.sin(7.0 * t + 0.3) / 7.0, np.sin(2.0 * t) / 2.0], axis=1)
    late = t - delay
    dq[:, 0] = np.cos(3.0 * late) + 0.6 * np.cos(7.0 * late + 0.3)
    (found,) = (f for f in check_recording(Recording(t, q, dq, tau=np.cos(q))) if f.code == "dq_disagrees")
    assert found.column == "dq_0"
    assert f"it comes {1e3 * delay:.0f} ms late" in found.message


def test_shortest_run_is_checked():
    arrays = {name: values[:20] for name, values in good().items()}
    assert {f.severity for f in check_recording(Recording(**arrays))} <= {"info", "warning"}


def test_joints_are_called_once():
    assert joint_words("elbow") == "joint elbow"
    assert joint_words("0", "2") == "joints 0, 2"
    assert joint_words("joint_1") == "joint_1"
    assert joint_words("elbow_Joint", "wrist") == "elbow_Joint, wrist"
