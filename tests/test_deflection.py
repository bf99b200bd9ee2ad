"""What two encoders per joint reveal: every kind on its joint with intervals that cover, nothing on rigid arms."""

import json
from dataclasses import replace

import data
import numpy as np
import pyarrow.parquet
import pytest
from numpy.testing import assert_allclose

import dynid_rs as dyn
from dynid_rs.checks import check_recording, refused_sources
from dynid_rs.diagnosis.deflection import GearSignals, examine_deflection, examine_signals
from dynid_rs.diagnosis.deflection.lines import find_orders
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.simulation import build_effects, bundled_robot, equip, parse_wish, simulate, typical_arm

DELAY = 0.0028
STIFFNESS, GAP, CUBIC = 0.05, 0.1, 0.2
"""Greatest relative errors that a robot engineer would put up with."""
STEP = 2 * np.pi / 2**20


@pytest.fixture(scope="module")
def robot():
    return dyn.RobotModel.from_urdf(bundled_robot())


def measured(robot, wishes, delay, seed=0, n_runs=4):
    typical = typical_arm(robot)
    effects = build_effects([parse_wish(wish) for wish in wishes], typical)
    return simulate(equip(replace(typical.rigid(), delay=delay), effects), n_runs=n_runs, seed=seed)


def examined(robot, sim):
    fit = ThreeLoopIdentifier(robot, residual=None).fit(list(sim.recordings[:3]))
    return examine_deflection(fit, sim.recordings[:3], sim.recordings[3:])


@pytest.fixture(scope="module")
def mixed(robot):
    """One gear of each kind, two rigid joints, and two clocks."""
    wishes = (
        "joint_elasticity:1:0.6",
        "backlash:2:0.5",
        "nonlinear_elasticity:3:1.2",
        "encoder_eccentricity:5:0.5",
    )
    sim = measured(robot, wishes, DELAY)
    return sim, examined(robot, sim)


def value(finding, name):
    return next(parameter for parameter in finding.parameters if parameter.name == name)


def of(findings, kind):
    return next(finding for finding in findings if finding.kind == kind)


def test_every_kind_is_named_on_its_joint_and_nothing_else(mixed):
    _, findings = mixed
    assert {(finding.kind, finding.joints) for finding in findings} == {
        ("encoder_delay", (0, 1, 2, 3, 4, 5)),
        ("joint_elasticity", (1,)),
        ("backlash", (2,)),
        ("nonlinear_elasticity", (3,)),
        ("encoder_eccentricity", (5,)),
    }


def test_parameters_are_near_and_their_intervals_cover(mixed):
    sim, findings = mixed
    truth = {effect.kind: {v.name: v.value for v in effect.values} for effect in sim.arm.effects}
    spring, cubic = of(findings, "joint_elasticity"), of(findings, "nonlinear_elasticity")
    eccentric = truth["encoder_eccentricity"]
    amplitude, phase = eccentric["amplitude"][0], eccentric["phase"][0]
    wanted = [
        (of(findings, "encoder_delay"), "delay", DELAY, 1e-3),
        (spring, "stiffness", truth["joint_elasticity"]["stiffness"][0], STIFFNESS),
        (spring, "kinematic_error", sim.arm.kinematic_error[1], STIFFNESS),
        (spring, "kinematic_cycles", sim.arm.kinematic_cycles[1], 1e-3),
        (spring, "hysteresis", sim.arm.hysteresis[1], STIFFNESS),
        (cubic, "stiffness", truth["nonlinear_elasticity"]["stiffness"][0], STIFFNESS),
        (cubic, "cubic", truth["nonlinear_elasticity"]["cubic"][0], CUBIC),
        (of(findings, "backlash"), "gap", truth["backlash"]["gap"][0], GAP),
        (of(findings, "encoder_eccentricity"), "cosine", amplitude * np.sin(phase), GAP),
        (of(findings, "encoder_eccentricity"), "sine", amplitude * np.cos(phase), GAP),
    ]
    for finding, name, true, near in wanted:
        parameter = value(finding, name)
        assert_allclose(parameter.value, true, rtol=near, err_msg=name)
        # Ten intervals of one seed: a few of them may miss, but not by their own width.
        low, high = parameter.interval
        assert low - (high - low) <= true <= high + (high - low), (name, true, parameter)


def test_the_encoders_steps_are_all_that_is_left(mixed):
    _, findings = mixed
    for finding in findings:
        assert all(a < b for a, b in zip(finding.rms_test_after, finding.rms_test_before, strict=True))
        if finding.kind != "encoder_delay":
            assert finding.rms_test_after[0] < STEP, finding.kind
        x, partial, curve = finding.plot
        assert x.shape == partial.shape == curve.shape
        assert np.std(partial - curve) < STEP


def test_findings_are_json(mixed, robot):
    _, findings = mixed
    entry = json.loads(json.dumps(findings[1].to_json(robot.joint_names, 2), allow_nan=False))
    assert entry["rank"] == 2
    assert entry["joints"] == [robot.joint_names[1]]
    assert {"name", "value", "unit", "interval"} == set(entry["parameters"][0])


@pytest.mark.parametrize("seed", [1, 2])
def test_a_rigid_arm_has_no_findings(robot, seed):
    assert examined(robot, measured(robot, (), 0.0, seed)) == []


def test_a_copy_or_no_second_encoder_has_none(robot):
    sim = measured(robot, (), 0.0, n_runs=3)
    copies = [replace(run, q_motor=run.q.copy()) for run in sim.recordings]
    alone = [replace(run, q_motor=None) for run in sim.recordings]
    for runs in (copies, alone):
        fit = ThreeLoopIdentifier(robot, residual=None).fit(runs[:2])
        assert examine_deflection(fit, runs[:2], runs[2:]) == []


def test_a_run_without_a_second_encoder_is_refused(robot):
    sim = measured(robot, (), DELAY, n_runs=3)
    fit = ThreeLoopIdentifier(robot, residual=None).fit(list(sim.recordings[:2]))
    with pytest.raises(ValueError, match=r"run_2.*second encoder"):
        examine_deflection(fit, sim.recordings[:2], [replace(sim.recordings[2], q_motor=None)])


def test_an_encoder_error_that_the_fit_knows_is_not_found_again(robot):
    sim = measured(robot, ["encoder_eccentricity:1:0.5"], DELAY)
    runs = list(sim.recordings)
    found = examined(robot, sim)
    assert [finding.kind for finding in found] == ["encoder_delay", "encoder_eccentricity"]
    error = np.zeros((robot.n_joints, 2))
    error[1] = [value(found[1], name).value for name in ("cosine", "sine")]
    fit = ThreeLoopIdentifier(robot, residual=None, encoder_error=error).fit(runs[:3])
    assert [finding.kind for finding in examine_deflection(fit, runs[:3], runs[3:])] == ["encoder_delay"]


def gear(deflection, *, seed, load=None, noise=1e-6, late=0.0, n=4000, rate=200.0):
    """One joint whose load is known: `deflection(load, dq)`, white noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate
    frequencies, phases = rng.uniform(0.1, 0.6, 4), rng.uniform(0, 6, 4)

    def position(at):
        return sum(0.5 * np.sin(2 * np.pi * f * at + p) for f, p in zip(frequencies, phases, strict=True))

    q, dq = position(t), np.gradient(position(t), t)
    torque = 40 * np.cos(q) * np.sin(0.9 * t + seed) if load is None else load(q, dq)
    shown = position(t - late) + noise * rng.standard_normal(n)
    return GearSignals.of_arrays(t, shown, q + deflection(torque, dq), torque, name=f"run {seed}")


def gears(*args, **options):
    runs = [gear(*args, seed=seed, **options) for seed in range(4)]
    return examine_signals(runs[:3], runs[3:])


def test_any_load_will_do():
    found = gears(lambda tau, dq: tau / 2e4 + 1.5e-4 * np.sign(tau), late=1e-3)
    assert [finding.kind for finding in found] == ["encoder_delay", "joint_elasticity", "backlash"]
    assert_allclose(value(found[0], "delay").value, 1e-3, rtol=1e-2)
    assert_allclose(value(found[1], "stiffness").value, 2e4, rtol=STIFFNESS)
    assert_allclose(value(found[2], "gap").value, 3e-4, rtol=GAP)


def test_a_gear_does_not_yield_against_its_load():
    assert "joint_elasticity" not in {finding.kind for finding in gears(lambda tau, dq: -tau / 2e4)}


def test_noise_with_memory_is_no_gear():
    rng = np.random.default_rng(5)

    def wander(tau, dq):
        # As slow as the motion: 2e-5 rad with a memory of a second.
        step = rng.standard_normal(len(tau))
        slow = np.convolve(step, np.hanning(400), mode="same")
        return 2e-5 * slow / slow.std()

    assert gears(wander) == []


def test_clock_and_spring_are_tied_where_load_follows_speed():
    found = gears(lambda tau, dq: tau / 2e4, load=lambda q, dq: 30 * dq, noise=1e-4)
    assert found[0].kind == "encoder_delay"
    assert "joint_elasticity" in found[0].ties


def test_lines_are_found_in_the_angle_domain():
    runs = [gear(lambda tau, dq: 0 * tau, seed=seed) for seed in range(3)]
    rng = np.random.default_rng(0)
    noise = [rng.standard_normal(len(run.load)) for run in runs]
    lines = [0.4 * np.cos(161.3 * run.q_motor + 1) + e for run, e in zip(runs, noise, strict=True)]
    assert_allclose(find_orders(runs, lines)[0], 161.3, atol=0.1)


@pytest.fixture(scope="module")
def kuka():
    robot = dyn.RobotModel.from_urdf(data.data_file("kuka_kr300_weigand"))
    runs = [
        dyn.read_recording(data.data_file("kuka_kr300_weigand", f"{name}.parquet"), robot)
        for name in ("traj_A", "traj_B")
    ]
    return robot, [run.without(*refused_sources(check_recording(run, robot))) for run in runs]


def test_kuka_clocks(kuka):
    robot, (train, test) = kuka
    fit = ThreeLoopIdentifier(robot, residual=None).fit([train])
    clocks = [f for f in examine_deflection(fit, [train], [test]) if f.kind == "encoder_delay"]
    assert {joint for finding in clocks for joint in finding.joints} == {0, 1, 2}
    for finding in clocks:
        assert 2.6e-3 < finding.parameters[0].value < 3.2e-3
        assert np.all(np.array(finding.rms_test_after) < 0.3 * np.array(finding.rms_test_before))


def test_kuka_gears_yield_as_stiffly_as_the_authors_say(kuka):
    robot, runs = kuka
    fit = ThreeLoopIdentifier(robot, residual=None).fit(runs)
    found = examine_deflection(fit, runs, runs)
    # A priori 7.5e6 and 4.1e6 N m/rad; axes 3 to 5 have one encoder.
    springs = {f.joints[0]: f for f in found if f.kind in ("joint_elasticity", "nonlinear_elasticity")}
    assert set(springs) == {1, 2}
    assert max(joint for finding in found for joint in finding.joints) == 2
    for joint, stiffness in ((1, 7.5e6), (2, 4.1e6)):
        low, high = value(springs[joint], "stiffness").interval
        assert low < stiffness < high
    assert value(springs[1], "kinematic_cycles").value == pytest.approx(828, abs=2)


@pytest.mark.parametrize(("joint", "low", "high"), [(1, 4.6e4, 4.8e4), (2, 3.3e4, 3.9e4)])
def test_voraus_stiffness_from_its_torque_sensor(joint, low, high):
    runs = []
    for name in ("sample_12", "sample_1702", "sample_1703", "sample_755"):
        table = pyarrow.parquet.read_table(data.data_file("voraus_sample", f"{name}.parquet"))
        columns = ("t", f"q_{joint}", f"qm_{joint}", f"tau_sensor_a_{joint}")
        runs.append(GearSignals.of_arrays(*(table[c].to_numpy().astype(float) for c in columns), name=name))
    found = of(examine_signals(runs[:3], runs[3:], joint=joint, n_joints=6), "joint_elasticity")
    assert low < value(found, "stiffness").value < high
    assert found.rms_test_after[0] < found.rms_test_before[0]
