"""What arms do and channels show that looks like damage and is none; each beside the damage that it looks like.

Each was a false error on a recording that the exam (`tests/exam`) had drawn.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bad_data.clean import tell_clean
from campaigns.next_arm import draw_arm
from exam.case import ROBOT, write_case
from helpers.diagnosed import SIX_AXES, recorded, rigid
from load_coverage import drawn_arm

import dynid_rs as dyn
from dynid_rs.runs.checks import check_recording
from dynid_rs.runs.checks.torque import BEYOND, check_drive_torque
from dynid_rs.runs.recording import Recording
from dynid_rs.sensors import channel_errors
from dynid_rs.sensors.gravity import is_another
from dynid_rs.simulation import Tracking, simulate, typical_arm

RATE = 82.0


def recording(torque):
    """A lone joint that moves for a minute, with a torque (n,) of the time in seconds."""
    t = np.arange(round(60 * RATE)) / RATE
    q = np.sin(0.9 * t) + 0.4 * np.sin(2.3 * t)
    return Recording(t, q[:, None], tau=torque(t)[:, None], name="run.csv")


def errors(run):
    return [(finding.code, finding.column) for finding in check_recording(run) if finding.severity == "error"]


def coarse(x, step):
    return np.round(x / step) * step


def peaked(t):
    """Up and down without a rest, in steps, but for one smooth peak at 20 s, on whose last level it is for 9 rows."""
    zigzag = 6 * np.arcsin(np.sin(5 * t))
    return coarse(np.where(np.abs(t - 20) < 0.5, 12 - 40 * (t - 20) ** 2, zigzag), 0.2)


def test_a_peak_of_a_coarse_channel_is_no_saturation():
    run = recording(peaked)
    assert np.count_nonzero(run.tau == run.tau.max()) == 9
    assert errors(run) == []
    assert errors(replace(run, tau=np.minimum(run.tau, 8.0))) == [("saturated", "tau_0")]


def test_a_peak_that_misses_the_level_below_its_last_is_no_saturation():
    """Twelve rows on the last level, one on that below, as a recording with noise had it."""
    flank = [
        653,
        664,
        675,
        696,
        707,
        739,
        750,
        782,
        793,
        803,
        814,
        825,
        846,
        868,
        889,
        900,
        932,
        943,
        975,
        985,
        996,
        996,
    ]
    peak = np.concatenate([flank, [1018] * 12, [1007], flank[:-5:-1], flank[-5::-1]])

    def struck(t):
        torque = coarse(600 * np.sin(1.3 * t), 10.7)
        torque[1000 : 1000 + len(peak)] = peak
        return torque

    run = recording(struck)
    assert errors(run) == []
    assert errors(replace(run, tau=np.minimum(run.tau, 500.0))) == [("saturated", "tau_0")]


def levelling(t, step=0.5):
    """A torque that levels off for a third of a second at 8 s, in steps."""
    rng = np.random.default_rng(3)
    level = np.where(np.abs(t - 8) < 0.17, 5.0, 5.0 + 9 * np.sin(3 * (t - 8 - 0.17 * np.sign(t - 8))))
    return coarse(level + 0.12 * rng.normal(size=len(t)), step)


def test_a_coarse_channel_that_levels_off_is_not_stuck():
    run = recording(levelling)
    assert errors(run) == []
    held = run.tau.copy()
    held[300:330] = held[300]
    assert abs(held[330, 0] - held[300, 0]) > 3
    assert errors(replace(run, tau=held)) == [("stuck", "tau_0")]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_zero_where_a_coarse_torque_turns_round_is_no_drop_out(sign):
    """Torques of a blow pass zero from row to row: -30, -25, 4, 0, -6, -17."""
    x = np.array([-334, -295, -254, -209, -164, -121, -83, -50, -29.6, -24.7, 4, 0, -6, -17, -32, -48, -68, -91, -117])

    def struck(t):
        torque = 90 * np.cos(1.1 * t)
        torque[400 : 400 + len(x)] = x
        return sign * torque

    run = recording(struck)
    assert errors(run) == []
    dropped = run.tau.copy()
    dropped[403] = 0.0
    assert errors(replace(run, tau=dropped)) == [("torque_spike", "tau_0")]


def noisy(t, step=0.1):
    """A small torque whose noise is less than its steps, most rows like their neighbours; one is zero."""
    rng = np.random.default_rng(1)
    torque = coarse(2.0 * np.sin(0.9 * t) + 0.04 * rng.normal(size=len(t)), step)
    torque[next(row for row in range(100, len(t)) if torque[row - 1] == torque[row + 1] == 3 * step)] = 0.0
    return torque


def test_a_zero_among_the_steps_of_a_small_torque_is_no_drop_out():
    run = recording(noisy)
    assert errors(run) == []
    dropped = run.tau + 5.0
    assert errors(replace(run, tau=dropped)) == []
    dropped[1500] = 0.0
    assert errors(replace(run, tau=dropped)) == [("torque_spike", "tau_0")]


def test_an_angle_that_rests_where_it_starts_again_is_not_stuck():
    """It rests for a second at the edge, and goes on with a step of a whole turn."""
    run = recording(lambda t: np.sin(t))
    q, rest = run.q.copy(), slice(1000, 1082)
    q[rest] = q[1000]
    q[1082:] += q[1000] - q[1082]
    turned = np.where(q > q[1000], q - 2 * np.pi, q)
    q_after = q[1082:1090] - q[1000]
    assert np.all(q_after[1:] > 0), "the step out of the rest is one of a turn"
    assert errors(replace(run, q=turned)) == [("wrapped", "q_0")]
    stuck = turned.copy()
    stuck[2000:2100] = stuck[2000]
    assert errors(replace(run, q=stuck)) == [("stuck", "q_0"), ("wrapped", "q_0")]


def test_both_encoders_may_rest_where_they_start_again():
    """The motor's goes over the edge while the link's rests: that is no way of two turns."""
    run = recording(lambda t: np.sin(t))
    q = run.q.copy()
    q[1000:1082] = q[1000]
    q[1082:] += q[1000] - q[1082]
    motor = q + np.where(np.arange(len(q)) >= 1041, 1e-4, -1e-4)[:, None]
    edge = float(q[1000, 0])
    turned = [np.where(x > edge, x - 2 * np.pi, x) for x in (q, motor)]
    assert errors(replace(run, q=turned[0], q_motor=turned[1])) == [("wrapped", "q_0"), ("wrapped", "q_motor_0")]


def test_a_damaged_position_of_a_joint_at_rest_is_no_stuck_encoder():
    run = recording(lambda t: np.sin(t))
    q = run.q.copy()
    q[1000:1100] = q[1000]
    q[1100:] += q[1000] - q[1100]
    q[1050] += 2.2
    assert errors(replace(run, q=q)) == [("position_jump", "q_0")]
    stuck = run.q.copy()
    stuck[1000:1050] = stuck[1000]
    assert errors(replace(run, q=stuck)) == [("stuck", "q_0")]


def test_a_gear_that_yields_much_is_questioned_and_no_error():
    """Far beyond its rated load, and out of phase with the motion."""
    run = recording(lambda t: np.sin(t))
    t, q = run.t, run.q
    bent = replace(run, q_motor=q + 0.4 * np.sin(1.7 * t)[:, None])
    assert [(f.code, f.severity) for f in check_recording(bent) if f.severity != "info"] == [
        ("motor_disagrees", "warning")
    ]
    assert errors(replace(run, q_motor=0.8 * np.sin(1.7 * t)[:, None])) == [("motor_disagrees", "q_motor_0")]


def test_a_damaged_velocity_of_a_joint_at_rest_is_no_stuck_encoder():
    run = recording(lambda t: np.sin(t))
    q = run.q.copy()
    q[1000:1100] = q[1000]
    q[1100:] += q[1000] - q[1100]
    dq = np.gradient(q[:, 0], run.t)[:, None]
    assert errors(replace(run, q=q, dq=dq)) == []
    dq[1050] = 700.0
    assert errors(replace(run, q=q, dq=dq)) == [("velocity_spike", "dq_0")]


def test_a_channel_beyond_its_limit_is_not_damaged_in_its_greatest_rows():
    """Torques of another, stronger joint: three of its rows are beyond what no drive gives, the rest nearly so."""
    run = recording(lambda t: 6.6 * np.sin(t) + 0.1 * np.sin(40 * t))
    robot = SimpleNamespace(effort_limits=(0.66,), lower=None, upper=None)
    beyond = np.count_nonzero(np.abs(run.tau) > BEYOND * 0.66)
    assert 0 < beyond < 200
    few = replace(run, tau=np.where(np.abs(run.tau) > 6.69, run.tau, np.clip(run.tau, -6.6, 6.6)))
    assert [finding.code for finding in check_drive_torque(few, robot)] == []
    rest = np.arange(len(run.t))[:, None]
    two = replace(run, tau=np.where(rest == 1500, 60.0, np.where(rest == 900, 3.0, 0.1 * run.tau)))
    (said,) = check_drive_torque(two, robot)
    assert (said.code, "1 more" in said.message) == ("torque_spike", True)
    lone = replace(run, tau=np.where(np.arange(len(run.t))[:, None] == 1500, 6.7, 0.1 * run.tau))
    assert [finding.code for finding in check_drive_torque(lone, robot)] == ["torque_spike"]


def test_encoders_of_a_fast_joint_on_two_clocks_are_late_and_not_of_another_scale():
    """Forty milliseconds at 3 rad/s are more than a tenth of what the joint moves."""
    run = recording(lambda t: np.sin(t))
    t = run.t
    late = replace(run, q=np.sin(3 * t)[:, None], q_motor=np.sin(3 * (t + 0.04))[:, None])
    found = {finding.code: finding for finding in check_recording(late)}
    assert found["encoder_delay"].value == pytest.approx(0.04, rel=0.02)
    assert errors(late) == []
    assert errors(replace(late, q_motor=1.3 * late.q)) == [("motor_scale", "q_motor_0")]
    both = replace(late, q_motor=1.3 * np.sin(3 * (t + 0.03))[:, None])
    assert errors(both) == [("motor_scale", "q_motor_0")], "a clock of its own explains no scale"


def test_runs_that_begin_in_fast_motion_are_not_pushed_there():
    """The filters have nothing before the first row to go by; three recordings of an arm that nothing touches."""
    told = tell_clean(3065250053)
    assert told.n_runs == 3
    assert (told.alarms, told.failed) == ([], "")


def test_an_arm_on_a_wall_without_masses_has_no_joints_swapped(tmp_path):
    """Its first joint carries a load: another mounting explains that, and an exchange of two joints nearly as well."""
    truth = write_case(785517222, tmp_path)
    robot = dyn.RobotModel.from_urdf(tmp_path / ROBOT)
    (finding,) = channel_errors(robot, [dyn.read_recording(tmp_path / truth["train"][0], robot)])
    assert (finding.code, finding.severity) == ("mounting", "warning")
    assert finding.value == pytest.approx(90, abs=3)
    assert "its opposite" in finding.message


def test_in_amperes_too_an_arm_on_a_wall_is_on_a_wall():
    """Gains are told anew for every direction of gravity: those of the wrong one explain nothing with the right one."""
    gains = np.array([9.0, 12.0, 11.0, 7.0, 5.0, 4.0])
    runs = recorded(rigid(SIX_AXES.with_gravity((0.0, 9.81, 0.0))), n_runs=2)
    runs = [replace(run, tau=run.tau / gains, torque_unit="A") for run in runs]
    (finding,) = channel_errors(SIX_AXES, runs)
    assert (finding.code, finding.severity) == ("mounting", "warning")
    assert "--gravity 0.00,9.81,0.00" in finding.message
    level = [replace(run, tau=run.tau / gains, torque_unit="A") for run in recorded(rigid(SIX_AXES), n_runs=2)]
    assert channel_errors(SIX_AXES, level) == []


def test_gears_that_yield_are_no_late_channel():
    """Of the arm of `make demo` one joint's positions came 18 ms late, it was said; the encoders do by 2.8 ms."""
    arm = typical_arm(SIX_AXES)
    runs = simulate(arm, n_runs=4).recordings
    assert arm.delay == pytest.approx(0.0028)
    assert channel_errors(SIX_AXES, runs) == []


@pytest.fixture(scope="module")
def lossy():
    """Runs of an arm whose gears lose torque by the way of their load; its link encoders are 2.8 ms late."""
    arm = drawn_arm(np.random.default_rng([2, True]), elastic=True)
    return simulate(arm, n_runs=2, duration=12, seed=4, tracking=Tracking()).recordings


def of_one_encoder(run):
    return replace(run, q_motor=None, dq_motor=None)


def with_late_torque(run, delay):
    return replace(run, tau=np.stack([np.interp(run.t - delay, run.t, tau) for tau in run.tau.T], axis=1))


@pytest.mark.parametrize("seen", [lambda run: run, of_one_encoder], ids=["two encoders", "one encoder"])
def test_gears_that_lose_torque_are_no_late_channel(lossy, seen):
    """They lead by as much as the way takes: positions came 14 ms late, it was said."""
    assert channel_errors(SIX_AXES, [seen(run) for run in lossy]) == []


@pytest.mark.parametrize("delay", [0.03, -0.015])
@pytest.mark.parametrize("seen", [lambda run: run, of_one_encoder], ids=["two encoders", "one encoder"])
def test_a_delay_is_found_beside_gears_that_lose_torque(lossy, seen, delay):
    """By what the gears lead with, torques that were 30 ms late were said to be 17 ms late."""
    (finding,) = channel_errors(SIX_AXES, [with_late_torque(seen(run), delay) for run in lossy])
    assert finding.code == "torque_late"
    assert finding.value == pytest.approx(delay, abs=0.007)  # of which 2.8 ms are the encoders'


@pytest.mark.parametrize(
    ("gravity", "said"),
    [
        ((0.0, 0.0, 9.81), "gravity pulls 180 degrees away from 0.00,0.00,9.81 m/s^2"),
        ((0.0, -9.81, 0.0), "gravity pulls 90 degrees away from 0.00,-9.81,0.00 m/s^2"),
        ((0.0, 0.0, -1.62), "gravity is 9.81 m/s^2 and not 1.62"),
        ((0.0, -1.0, 0.0), "gravity is 9.81 m/s^2 and pulls 90 degrees away from 0.00,-1.00,0.00 m/s^2"),
        ((0.0, 0.0, 0.0), "gravity pulls, and is zero"),
    ],
)
def test_a_wrong_gravity_is_questioned_and_the_right_one_named(gravity, said):
    (finding,) = channel_errors(SIX_AXES.with_gravity(gravity), recorded(rigid(SIX_AXES), n_runs=2))
    assert (finding.code, finding.severity) == ("mounting", "warning")
    assert finding.message.startswith(said)
    assert finding.message.endswith("give --gravity 0.00,0.00,-9.81")


PLANE = dyn.RobotModel.from_urdf_string(
    '<robot name="plane"><link name="base"/>'
    + "".join(
        f'<link name="{link}"><inertial><origin xyz="0.3 0 0.05"/><mass value="{mass}"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        f'<joint name="to_{link}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
        '<origin xyz="0.6 0.1 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="3" effort="200"/></joint>'
        for parent, link, mass in (("base", "upper", 8), ("upper", "fore", 4))
    )
    + "</robot>"
)
"""Two axes along y: no torque shows what of gravity is along them."""


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ((0.0, 0.0, 0.0), "0.00,0.00,-9.81"),
        ((0.0, 3.0, 9.34), "0.00,3.00,-9.34"),
        ((0.0, 9.81, 0.0), "0.00,0.00,-9.81"),
    ],
)
def test_what_no_torque_shows_of_gravity_stays_as_the_robot_has_it(declared, said):
    """It was made up: 0,-1.95,-9.61 was said, of a gravity that was 0,0,-9.81."""
    runs = simulate(typical_arm(PLANE), n_runs=2, duration=12.0, rate=250.0, tracking=Tracking()).recordings
    (finding,) = channel_errors(PLANE.with_gravity(declared), list(runs))
    assert finding.code == "mounting"
    assert finding.message.endswith(f"give --gravity {said}")


def test_a_light_gravity_that_is_so_is_believed():
    moon = SIX_AXES.with_gravity((0.0, 0.0, -1.62))
    assert channel_errors(moon, recorded(rigid(moon), n_runs=2)) == []


def test_an_upright_axis_whose_rotor_could_be_all_of_its_torque_tells_no_unit():
    """A lone joint without gravity: what its link needs is the rotor's for all but a four-hundredth of its power."""
    link = (
        '<inertial><origin xyz="0 0 0.2"/><mass value="2"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial>'
    )
    robot = dyn.RobotModel.from_urdf_string(
        f'<robot name="one"><link name="base"/><link name="arm">{link}</link><joint name="j" type="revolute">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="3" effort="50"/></joint></robot>'
    )
    runs = simulate(typical_arm(robot), n_runs=3, duration=12.0, rate=250.0, tracking=Tracking()).recordings
    assert channel_errors(robot, list(runs)) == []


def test_a_base_that_is_a_search_s_grain_off_level_is_no_other_mounting():
    down = np.array([0.0, 0.0, -9.81])

    def turned(degrees, size=9.81):
        return size * np.array([np.sin(np.radians(degrees)), 0.0, -np.cos(np.radians(degrees))])

    assert [is_another(turned(degrees), down) for degrees in (0, 2.9, 4.1, 4.5, 15, 180)] == [False] * 3 + [True] * 3
    assert is_another(turned(0, 1.62), down)
    assert is_another(down, np.zeros(3))


def test_a_joint_that_another_sign_would_make_senseless_is_not_flipped(tmp_path):
    """A joint whose torque fits nothing weighs nothing: the others were explained better, by links of their own."""
    arm = draw_arm(129642488, tmp_path)
    robot = dyn.RobotModel.from_urdf(arm.robot)
    *runs, test = (dyn.read_recording(path) for path in (*arm.runs, arm.test))
    assert channel_errors(robot, runs, [test]) == []
    turned = np.where(np.arange(robot.n_joints) == 1, -1.0, 1.0)
    (finding,) = channel_errors(robot, [replace(runs[0], tau=turned * runs[0].tau), *runs[1:]], [test])
    assert (finding.code, finding.file, finding.column) == ("torque_flipped", runs[0].name, "tau_1")
