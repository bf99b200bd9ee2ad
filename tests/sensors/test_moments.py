"""Moments without another pass over the rows: under another gravity, with channels put earlier."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import SIX_AXES, rigid

from dynid_rs import RobotModel
from dynid_rs.identification.training import prepare_training_runs
from dynid_rs.runs.preprocessing import choose_band, common_rate
from dynid_rs.sensors.arm import Arm
from dynid_rs.sensors.changes import Bench
from dynid_rs.sensors.gravity import gravity_trial
from dynid_rs.sensors.lag import early, lags
from dynid_rs.sensors.loss import lossy_arm
from dynid_rs.sensors.rows import ArmRows, Moments
from dynid_rs.sensors.units import unit_fits
from dynid_rs.simulation import simulate


@pytest.fixture(scope="module")
def bench():
    sim = simulate(rigid(SIX_AXES), n_runs=2, duration=10.0, rate=250, seed=5)
    recordings = [replace(recording, q_motor=None) for recording in sim.recordings]
    states = prepare_training_runs(recordings, choose_band(recordings), common_rate(recordings))
    return Bench(Arm.of(SIX_AXES), tuple(ArmRows.of(run) for run in states))


def assert_near(found, wanted):
    for name in ("columns", "cross", "power", "count"):
        scale = np.abs(getattr(wanted, name)).max()
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (3.0, -9.0, 1.5)])
def test_moments_under_a_gravity_are_those_of_columns_made_under_it(bench, gravity):
    half = replace(bench.rows[0], told=bench.rows[0].told & (np.arange(len(bench.rows[0].t)) % 2 == 0)[:, None])
    bench = Bench(bench.arm, (half, bench.rows[1]))
    turned = bench.turned(np.array(gravity))
    for found, rows in zip(turned.moments, bench.rows, strict=True):
        assert_near(found, Moments.of(bench.arm.with_gravity(np.array(gravity)), rows))
    assert list(turned.robot.gravity) == list(gravity)


@pytest.mark.parametrize("axis", ["0 0 1", "1 1 1", "1 2 3", "4 5 7"])
@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
def test_base_parameters_are_those_under_any_gravity_whatever_the_axes(kind, axis):
    """An axis of 4 5 7 was along the gravity that they were looked for under: half of the torque was not theirs."""
    link = (
        '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
        "</inertial></link>"
    )
    joint = (
        '<joint name="j_{1}" type="{2}"><parent link="{0}"/><child link="{1}"/><origin xyz="0.3 0 0"/>'
        '<axis xyz="{3}"/><limit lower="-1" upper="1" effort="10" velocity="1"/></joint>'
    )
    links = "".join(link.format(name) for name in "abc")
    joints = joint.format("a", "b", kind, axis) + joint.format("b", "c", "revolute", axis)
    arm = Arm.of(RobotModel.from_urdf_string(f'<robot name="r">{links}{joints}</robot>'))
    states = np.random.default_rng(0).uniform(-3.0, 3.0, (3, 50, 2))
    for gravity in ((0.0, 0.0, -9.81), (3.0, -9.0, 1.5), (0.0, 0.0, 0.0)):
        turned = arm.with_gravity(np.array(gravity))
        whole = turned.robot.joint_torque_regressor(*states)
        np.testing.assert_allclose(turned.regressor(*states) @ arm.regroup, whole, rtol=0, atol=1e-12 * whole.max())


def test_another_mounting_is_found_to_the_grain_of_the_search(bench):
    truth = np.array([5.0, -7.0, 4.0]) * 9.81 / np.sqrt(90.0)
    torque = [
        (rows.regressor(bench.arm.with_gravity(truth)) @ bench.arm.regroup @ bench.robot.phi) for rows in bench.rows
    ]
    hung = Bench(bench.arm, tuple(replace(rows, tau=tau) for rows, tau in zip(bench.rows, torque, strict=True)))
    _, found = gravity_trial(hung)
    assert np.arccos(found @ truth / 9.81**2) < 0.05


def test_gains_of_several_benches_are_those_of_each(bench):
    size = np.array([1.0, 0.5, 2.0, 1.0, 3.0, 1.0])
    scaled = Bench(bench.arm, tuple(replace(rows, tau=rows.tau / size) for rows in bench.rows))
    benches = [scaled, scaled.turned(np.array([0.0, 9.81, 0.0]))]
    together = unit_fits(benches)
    for one, (fit, gains) in zip(benches, together, strict=True):
        [(alone, own)] = unit_fits([one])
        assert fit.log == pytest.approx(alone.log, rel=1e-9)
        np.testing.assert_allclose(gains, own, rtol=1e-9)
    np.testing.assert_allclose(together[0][1], size, rtol=0.1)
    assert together[0][0].log > together[1][0].log


def test_a_joint_without_told_rows_says_nothing_under_any_gravity(bench):
    told = bench.rows[0].told.copy()
    told[:, 2] = False
    rows = replace(bench.rows[0], told=told)
    (found,) = Bench(bench.arm, (rows,)).turned(np.array([0.0, 0.0, -9.81])).moments
    assert_near(found, Moments.of(bench.arm, rows))
    assert not found.columns[2].any()


def test_a_channel_put_earlier_by_a_row_is_that_of_the_row_after(bench):
    arm = lossy_arm(bench)
    rows = arm.rows[0]
    tau, t = rows.rows.tau, rows.rows.t
    moments = early(bench, rows, arm.moments[0], (0.0, float(t[1] - t[0])))
    assert_near(moments.picked([0] * 6), arm.moments[0])
    sooner = np.concatenate([tau[1:], 2 * tau[-1:] - tau[-2:-1]])  # the run goes on as it ends
    assert_near(moments.picked([1] * 6), rows.channels(bench.arm, arm.moments[0], sooner[:, :, None]))


@pytest.mark.parametrize("joints", [tuple(range(6)), (1,)])
def test_a_delay_is_told_with_its_channels(bench, joints):
    runs = []
    for rows in bench.rows:
        tau, t = rows.tau.copy(), rows.t
        for j in joints:
            tau[:, j] = np.interp(t - 0.03, t, rows.tau[:, j])
        runs.append(replace(rows, tau=tau))
    found = max(lags(Bench(bench.arm, tuple(runs)), 30.0), key=lambda lag: lag.trial.fit.log)
    assert found.trial.joints == joints
    assert found.delay == pytest.approx(0.03, abs=0.003)
    assert found.links_log() <= found.trial.fit.log
    assert lags(bench, 30.0) == []
