"""The friction experiment: planned within limits, found again in measured data, friction as exact as its noise."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers import friction_arm
from helpers.friction_arm import (
    RATE,
    TOP,
    arm,
    experiment,
    friction_torque,
    identified,
    paper_limits,
    plan,
    robot,
    true_torque,
)
from helpers.run_files import write
from helpers.small_arm import URDF, dynid, refusal, run, write_robot, write_runs
from helpers.tolerances import EXACT, FINITE_DIFFERENCE
from numpy.testing import assert_allclose

from dynid_rs import DataError, RobotModel, ThreeLoopIdentifier, _core
from dynid_rs.excitation.friction_experiment import plan_friction_experiment
from dynid_rs.excitation.friction_segments import FrictionExperiment, Leg, ReversedPair
from dynid_rs.identification.friction_experiment import odd_friction
from dynid_rs.identification.friction_experiment.odd import _Samples, _summary
from dynid_rs.identification.friction_experiment.pairs import check_reversals, find_mirrors
from dynid_rs.identification.friction_laws import LAWS_BY_JOINT
from dynid_rs.identification.law_comparison import compare_friction_laws
from dynid_rs.runs.preprocessing import Band, States, prepare
from dynid_rs.simulation import Tracking, motion_limits, simulate, typical_arm
from dynid_rs.simulation.folder import run_columns
from dynid_rs.simulation.tracking import track

JOINTS = range(6)
COEFFICIENT = 0.02
"""Largest relative error of a Coulomb or viscous coefficient, either direction, any order."""
FLOOR = 1.2
"""Largest error of the friction torque over its noise floor."""
SMALL = 2e-4
"""Errors of the friction torque over itself that no friction search needs to be better than."""
REVERSAL = 0.05
"""Speeds next to a reversal [rad/s]."""


@pytest.fixture(scope="module")
def small():
    return RobotModel.from_urdf_string(URDF)


@pytest.fixture(scope="module")
def small_truth(small):
    return replace(typical_arm(small).rigid(), delay=0.0)


def short_plan(small, **changes):
    options = {"n_speeds": 4, "leg_time": 1.0, "pair_time": 8.0, "levels": (1.0, 0.1)} | changes
    return plan_friction_experiment(small, **options)


@pytest.fixture(scope="module")
def small_run(small, small_truth):
    return small_truth.record(short_plan(small), 250.0, np.random.default_rng(0), "friction.csv")


# The plan


def on_a_grid(trajectory):
    t = np.arange(0.0, trajectory.duration, 1e-3)
    return t, *trajectory.evaluate(t)


@pytest.mark.parametrize("limits", [None, paper_limits()])
def test_no_bound_is_violated_on_a_grid_of_a_millisecond(limits):
    _, q, dq, ddq = on_a_grid(plan_friction_experiment(robot(), limits, n_speeds=5))
    limits = motion_limits(robot()) if limits is None else limits
    assert (q >= limits.lower).all()
    assert (q <= limits.upper).all()
    assert (np.abs(dq) <= limits.velocity).all()
    assert (np.abs(ddq) <= limits.acceleration).all()


def test_velocity_and_acceleration_are_the_derivatives_and_start_from_rest(small):
    t, q, dq, ddq = on_a_grid(short_plan(small))
    # Central differences err by a third of a squared step times the jerk, where a ramp begins by its jump.
    assert_allclose(np.gradient(q, t, axis=0), dq, rtol=0, atol=1e-4)
    assert_allclose(np.gradient(dq, t, axis=0)[1:-1], ddq[1:-1], rtol=0, atol=2e-2)
    assert_allclose([dq[0], ddq[0], dq[-1]], 0, rtol=0, atol=1e-6)
    assert np.abs(np.diff(ddq, axis=0)).max() < 0.25  # no step of the acceleration


def test_every_leg_comes_back_over_the_same_positions_at_graded_speeds(small):
    segments = short_plan(small).segments
    for j in range(3):
        legs = [s for s in segments if isinstance(s, Leg) and s.cruise > 0 and s.velocity[j]]
        out, back = legs[::2], legs[1::2]
        assert all(np.count_nonzero(leg.velocity) == 1 for leg in legs)
        for first, second in zip(out, back, strict=True):
            assert_allclose(second.velocity, -first.velocity, **EXACT)
            assert_allclose(second.start, first.end, **EXACT)
            assert_allclose(second.end, first.start, rtol=0, atol=1e-12)
        speeds = np.unique([leg.velocity[j] for leg in out])
        assert len(speeds) == 4
        assert_allclose(speeds[1:] / speeds[:-1], speeds[1] / speeds[0], rtol=1e-9)


def test_a_pair_plays_the_same_positions_backwards_in_time():
    pair = next(s for s in plan().segments if isinstance(s, ReversedPair))
    s = np.linspace(0.0, pair.half, 500)
    (q, dq, ddq), (q_back, dq_back, ddq_back) = pair.evaluate(s), pair.evaluate(pair.duration - s)
    assert_allclose(q_back, q, **FINITE_DIFFERENCE)
    assert_allclose(dq_back[1:-1], -dq[1:-1], **FINITE_DIFFERENCE)
    assert_allclose(ddq_back, ddq, **FINITE_DIFFERENCE)
    assert (np.abs(dq).max(axis=0) > 0.8 * TOP).all()


def test_a_plan_survives_its_file(small):
    planned = short_plan(small)
    again = FrictionExperiment.from_json(json.loads(json.dumps(planned.to_json())))
    t = np.linspace(-1.0, planned.duration + 1.0, 5000)
    for ours, stored in zip(planned.evaluate(t), again.evaluate(t), strict=True):
        assert_allclose(stored, ours, **EXACT)
    with pytest.raises(ValueError, match="expected a friction experiment of version 1"):
        FrictionExperiment.from_json({"format": "dynid-model", "version": 1})


def test_only_the_wanted_joints_move(small):
    pose = np.array([0.3, -0.4, 0.5])
    _, q, _, _ = on_a_grid(short_plan(small, joints=[1], pose=pose))
    assert_allclose(q[:, [0, 2]], np.broadcast_to(pose[[0, 2]], (len(q), 2)), rtol=0, atol=1e-12)
    assert np.ptp(q[:, 1]) > 1.0


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"slowest": 1.5}, "slowest must lie between 0 and 1"),
        ({"leg_time": 0.1}, "leg_time must be at least"),
        ({"pair_time": 1.0}, "pair_time must be 0"),
        ({"levels": (2.0,)}, "levels must lie above 0"),
        ({"joints": [7]}, "joints must be different indices from 0 to 2"),
        ({"n_speeds": 0, "pair_time": 0.0}, "n_speeds must be at least 1 without pairs"),
        ({"pose": np.array([0.0, 9.0, 0.0])}, "the pose's elbow = 9 lies outside its limits"),
        ({"pose": np.zeros(2)}, "pose must hold 3 finite positions"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_in_a_sentence(small, changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        short_plan(small, **changes)


@pytest.mark.parametrize("broken", ["room", "velocity", "acceleration"])
def test_limits_without_room_for_a_leg_name_the_joint(small, broken):
    limits = motion_limits(small)
    upper, velocity, acceleration = limits.upper.copy(), limits.velocity.copy(), limits.acceleration.copy()
    if broken == "room":
        upper[1] = limits.lower[1] + 1e-4
    else:
        {"velocity": velocity, "acceleration": acceleration}[broken][1] = 0.0
    broken_limits = replace(limits, upper=upper, velocity=velocity, acceleration=acceleration)
    with pytest.raises(ValueError, match=r"no room for a leg of joint elbow.*"):
        plan_friction_experiment(small, broken_limits)


# Eq. 8 from measured data


def planned_pairs(planned):
    """Times at which the plan turns round: between a leg and its way back, and in the middle of a pair."""
    edges = np.concatenate([[0.0], np.cumsum([segment.duration for segment in planned.segments])])
    turns = []
    for k, segment in enumerate(planned.segments):
        if isinstance(segment, ReversedPair):
            turns.append(edges[k] + segment.duration / 2)
        elif segment.cruise > 0 and segment.velocity.max() > 0:
            turns.append((edges[k + 1] + edges[k + 2]) / 2)
    return np.array(turns)


@pytest.mark.parametrize(("rate", "jitter", "delay"), [(250.0, 0.0, 0.0), (250.0, 2e-4, 0.003), (125.0, 0.0, 0.0)])
def test_every_planned_pair_is_found_without_the_plan(small, small_truth, rate, jitter, delay):
    planned = short_plan(small)
    truth = replace(small_truth, delay=delay)
    recording = truth.record(planned, rate, np.random.default_rng(1), "friction", stamp_jitter=jitter)
    from dynid_rs.runs.preprocessing import Band, common_rate

    states = prepare(recording, Band(5.0), common_rate([recording]))
    mirrors = find_mirrors(states)
    covered = np.zeros(len(states.t), dtype=bool)
    for mirror in mirrors:
        after, before = mirror.samples()
        assert not covered[after].any()  # no sample serves twice
        covered[after], covered[np.round(before).astype(int)] = True, True
    for turn in planned_pairs(planned):
        assert covered[int((turn + 0.5) * states.rate)], f"the pair about {turn:.2f} s was missed"


@pytest.mark.parametrize("cutoff", [5.0, 10.0])
def test_a_window_holds_every_sample_that_it_uses(small, small_truth, cutoff):
    """In a closed loop joints creep, and their motion may fall between the thinned samples at a window's end."""
    from dynid_rs.identification.friction_experiment.rows import pair_windows
    from dynid_rs.runs.preprocessing import Band

    played = simulate(small_truth, n_runs=1, rate=1000.0, seed=1, trajectories=[short_plan(small)], tracking=Tracking())
    states = prepare(played.recordings[0], Band(cutoff), 1000.0)
    windows = pair_windows([states])
    assert windows
    for window in windows:
        used = window.every[:, window.every_used.any(axis=0)]
        assert used.min() >= 0
        assert used.max() < len(window.states.t)


@pytest.mark.parametrize(("before", "behind"), [(4.0, 5.0), (5.0, 4.0), (4.0, 4.0)])
@pytest.mark.parametrize("rest", [199, 200])
def test_a_mirror_reaches_as_far_as_the_run_does(before, behind, rest):
    """Of a run that begins, or ends, in the middle of a motion every sample that has an image counts."""
    rate = 200.0
    first, last = round(before * rate), round(before * rate) + rest
    k = np.arange(last + round(behind * rate) + 1)
    since = np.maximum(np.maximum(first - k, k - last), 0)[:, None] / rate
    q, turned = 1 - np.cos(0.9 * since), np.where(k < first, -1.0, 1.0)[:, None]
    motion = q, 0.9 * turned * np.sin(0.9 * since), 0.81 * np.cos(0.9 * since)
    moving = np.ones(len(k), dtype=bool)
    states = States("mirror", k / rate, *motion, *motion, np.zeros_like(q), rate, Band(5.0), moving, two_encoders=False)
    (mirror,) = find_mirrors(states)
    assert mirror.middle == pytest.approx((first + last) / 2, abs=0.05)
    after, images = mirror.samples()
    assert images.min() > -0.1
    assert after.max() < len(k)
    assert images.min() < 1 or after.max() == len(k) - 1


def test_a_leg_that_is_noisier_than_the_others_is_known_less_well():
    """Its own blocks say so; what all legs say together is too little for it."""
    rng, n, rate = np.random.default_rng(0), 1000, 200.0
    legs = [
        _Samples(rate, np.arange(n), np.full(n, speed), 5.0 + size * rng.standard_normal(n), 2.0)
        for speed, size in [*((0.2 * k, 0.1) for k in range(1, 10)), (2.0, 1.0)]
    ]
    errors = _summary("elbow", legs).std_error
    assert errors[-1] == pytest.approx(1 / np.sqrt(n), rel=0.5)
    assert errors[-1] > 2 * errors[:-1].max()


@pytest.mark.parametrize("memory", [0.0, 0.05])
def test_the_standard_error_of_eq_8_is_honest(small, small_truth, memory):
    """Deviations from the truth over their standard error have about unit spread, with white and with slow noise."""
    planned, scores = short_plan(small), []
    quiet = replace(small_truth, noise_std=0.0)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        recording = quiet.record(planned, 250.0, rng, "friction")
        noise = rng.standard_normal(recording.tau.shape)
        if memory:
            from scipy.signal import lfilter

            a = np.exp(-1 / (250.0 * memory))
            noise = lfilter([np.sqrt(1 - a**2)], [1, -a], noise, axis=0)
        recording = replace(recording, tau=recording.tau + small_truth.noise_std * noise)
        for j, odd in enumerate(odd_friction(recording)):
            assert odd.joint == small.joint_names[j]
            scores.append((odd.tau_odd - odd_truth(small_truth, j, odd.speed)) / odd.std_error)
    scores = np.concatenate(scores)
    assert len(scores) > 200
    assert 0.7 < np.sqrt(np.mean(np.clip(scores, -6, 6) ** 2)) < 1.5
    assert np.mean(np.abs(scores) > 3) < 0.04


def odd_truth(truth, j, speed):
    shape = float(truth.velocity_threshold[j]), float(truth.transition_width[j])
    forwards, backwards = (_core.friction_basis(v, *shape) @ truth.friction[j] for v in (speed, -speed))
    return (forwards - backwards) / 2


def test_legs_and_reversed_motion_are_told_apart(small_run):
    for odd in odd_friction(small_run):
        assert odd.kind.count("leg") >= 3
        assert odd.kind.count("reversed") >= 10
        assert (odd.speed > 0).all()


def test_a_friction_run_without_reversal_names_joint_and_file(small, small_truth):
    planned = short_plan(small, pair_time=0.0)
    first = next(k for k, segment in enumerate(planned.segments) if segment.velocity[2])
    kept = planned.segments[:first]
    forwards = Leg(kept[-1].end, np.array([0.0, 0.0, 0.2]), 0.5, 3.0)
    one_way = FrictionExperiment((*kept, forwards, Leg(forwards.end, np.zeros(3), 0.5, 0.0)))
    recording = small_truth.record(one_way, 250.0, np.random.default_rng(0), "one_way.csv")
    with pytest.raises(DataError, match=r"one_way\.csv: joint wrist moves in one direction only, without reversal"):
        odd_friction(recording)


def test_speeds_that_are_never_constant_nor_played_backwards_are_refused(small, small_truth):
    recording = simulate(small_truth, n_runs=1, duration=15.0, rate=250.0, seed=4).recordings[0]
    with pytest.raises(DataError, match="its speed is never constant over the same positions both ways"):
        odd_friction(recording)


def test_friction_without_a_run_is_refused():
    with pytest.raises(ValueError, match="no run to read friction from"):
        odd_friction([])


def test_identification_refuses_such_a_friction_run(small, small_truth):
    runs = simulate(small_truth, n_runs=2, duration=10.0, rate=250.0, seed=4).recordings
    with pytest.raises(DataError, match=r"friction needs the same positions passed in both directions"):
        ThreeLoopIdentifier(small, residual=None).fit(list(runs), runs[0])


# Friction by the three loops


def test_coefficients_of_both_directions_and_all_orders_are_within_two_percent():
    error = identified().links_.own_[:, -8:] / arm().friction - 1
    print("\nlargest error of a coefficient [%], joint by joint:", np.round(100 * np.abs(error).max(axis=1), 2))
    assert np.abs(error).max() < COEFFICIENT


def test_the_shape_is_found():
    found = identified().friction_
    assert_allclose(found.velocity_threshold_, arm().velocity_threshold, rtol=0.02)
    assert_allclose(found.transition_width_, arm().transition_width, rtol=0.02)


def errors_at(model, j, top):
    """RMSE of joint j's friction torque at speeds between -top and top, and of its even part.

    A fine grid between the samples of any round number: at lambda there is a jump.
    """
    speeds = top * (np.arange(-200_000, 200_000) + 0.5) / 200_000
    error = friction_torque(model, j, speeds) - true_torque(j, speeds)
    return np.sqrt(np.mean(error**2)), np.sqrt(np.mean((error + error[::-1]) ** 2)) / 2


@pytest.fixture(scope="module")
def averages():
    """Pair averages of Eq. 8 in the experiment: what the data says about friction without any law."""
    model = identified()
    return odd_friction(prepare(experiment(), model.band_, RATE))


@pytest.mark.parametrize("j", JOINTS)
def test_over_all_speeds_friction_is_as_exact_as_an_oracles(j):
    """Against a fit of the same data that knows lambda and eps and has only the coefficients to find.

    Where that is better than a five-thousandth of the torque, what the samples leave open of lambda is more.
    """
    ours, oracle = errors_at(identified(), j, TOP[j])[0], errors_at(identified(True), j, TOP[j])[0]
    size = np.sqrt(np.mean(true_torque(j, np.linspace(-TOP[j], TOP[j], 4001)) ** 2))
    print(f"\njoint {j}, all speeds: {ours:.4f} N m, oracle {oracle:.4f} N m, ratio {ours / oracle:.2f}")
    assert ours < max(FLOOR * oracle, SMALL * size)
    assert ours < FLOOR * SMALL * size


@pytest.mark.parametrize("j", JOINTS)
def test_at_reversal_friction_is_as_exact_as_the_pairs(averages, j):
    """The floor of the odd part is the standard error of the pair averages, that of the even part the oracle's error.

    An oracle that is told lambda is no floor here: the torque jumps there, and the samples leave open where by about
    a thousandth of lambda, which alone is more than its whole error.
    """
    (ours, _), (oracle, even) = errors_at(identified(), j, REVERSAL), errors_at(identified(True), j, REVERSAL)
    near = averages[j].speed <= REVERSAL
    floor = np.hypot(np.sqrt(np.mean(averages[j].std_error[near] ** 2)), even)
    print(f"\njoint {j}, at reversal: {ours:.4f} N m, floor {floor:.4f} N m, ratio {ours / floor:.2f}", end=" ")
    print(f"(told lambda and eps: {oracle:.4f} N m)")
    assert near.sum() >= 5
    assert ours < FLOOR * floor


def test_without_a_friction_run_nothing_changes(small, small_truth):
    runs = simulate(small_truth, n_runs=2, duration=10.0, rate=200.0, seed=7).recordings
    first, second = (ThreeLoopIdentifier(small, residual=None).fit(list(runs), none) for none in (None, []))
    assert_allclose(second.links_.x_, first.links_.x_, **EXACT)


def test_a_friction_run_improves_what_short_runs_leave_open(small, small_truth, small_run):
    runs = simulate(small_truth, n_runs=2, duration=8.0, rate=250.0, seed=7).recordings
    errors = []
    for friction_run in (None, small_run):
        own = ThreeLoopIdentifier(small, residual=None).fit(list(runs), friction_run).links_.own_
        errors.append(np.abs(own[:, -8:-6] / small_truth.friction[:, :2] - 1).max())
    assert errors[1] < 0.03
    assert errors[1] < errors[0]


# Laws


def law_runs(small_truth, law):
    """Three runs of the small arm with friction of a law, the shape parameters well inside its speeds."""
    friction = small_truth.friction.copy()
    if law != "paper":
        friction[:, 4:] = 0.0
    truth = replace(small_truth, friction=friction, velocity_threshold=0.0)
    simulation = simulate(truth, n_runs=3, duration=40.0, rate=250.0, seed=2)
    if law != "stribeck":
        return list(simulation.recordings)
    falling = _core.Effect.of(
        "stribeck", stribeck_velocity=[0.2] * 3, exponent=[2.0] * 3, transition_width=truth.transition_width
    )
    runs = []
    for trajectory, recording in zip(simulation.trajectories, simulation.recordings, strict=True):
        motion = truth.motion(trajectory, recording.t)
        added = _core.effect_torque(falling, 0.6 * friction[:, :2], motion.q, motion.dq, motion.ddq)
        runs.append(replace(recording, tau=recording.tau + added))
    return runs


@pytest.mark.parametrize("law", ["coulomb_viscous", "stribeck"])
def test_the_law_that_made_the_data_is_chosen(small, small_truth, law):
    runs = law_runs(small_truth, law)
    compared = compare_friction_laws(small, runs[:2], runs[2:], laws=("coulomb_viscous", "paper", "stribeck"))
    assert compared.laws == LAWS_BY_JOINT
    assert compared.rmse.shape == (3, 3)
    assert compared.chosen == (law,) * 3
    assert (compared.interval[..., 0] <= compared.rmse).all()
    assert (compared.rmse <= compared.interval[..., 1]).all()
    if law == "stribeck":
        assert compared.beyond_noise[0].all()
        shape = dict(compared.models["stribeck"].observations_.plan.effects[-2].shape)
        assert_allclose(shape["stribeck_velocity"], 0.2, rtol=0.3)
    assert all(word in str(compared) for word in (*LAWS_BY_JOINT, *small.joint_names))


def test_a_simpler_law_has_no_columns_of_the_others(small, small_truth):
    runs = simulate(small_truth, n_runs=2, duration=10.0, rate=200.0, seed=7).recordings
    laws = ("paper", "coulomb_viscous", "stribeck")
    model = ThreeLoopIdentifier(small, residual=None, friction_law=laws).fit(list(runs))
    names = [name for effect in model.observations_.plan.effects for name in effect.coefficient_names]
    stribeck, cubic = names.index("stribeck_pos"), names.index("viscous3_neg")
    assert (model.links_.own_[:, stribeck] != 0).tolist() == [False, False, True]
    assert (model.links_.own_[:, cubic] != 0).tolist() == [True, False, False]
    assert model.friction_.velocity_threshold_[1:].tolist() == [0.0, 0.0]


def test_unknown_laws_are_refused(small, small_run):
    with pytest.raises(
        ValueError, match="friction_law must be one of coulomb_viscous, smooth, stribeck, paper, found 'dahl'"
    ):
        ThreeLoopIdentifier(small, friction_law="dahl").fit(small_run)
    with pytest.raises(ValueError, match="or one per joint; found 3"):
        ThreeLoopIdentifier(small, friction_law=3).fit(small_run)
    with pytest.raises(ValueError, match="friction_law 'smooth' is a law for all joints; give it alone"):
        ThreeLoopIdentifier(small, friction_law=("smooth", "paper", "paper")).fit(small_run)
    with pytest.raises(ValueError, match="one law or 3, one per joint; found 2"):
        ThreeLoopIdentifier(small, friction_law=("paper", "paper")).fit(small_run)
    with pytest.raises(ValueError, match="at least one law and one test run"):
        compare_friction_laws(small, [small_run], [])


# The command line


def test_identify_takes_a_friction_run_and_a_law(tmp_path, small_run):
    robot_file, runs = write_robot(tmp_path), write_runs(tmp_path, velocity=False)
    columns = {k: v for k, v in run_columns(small_run).items() if not k.startswith("q_motor")}
    slow = write(tmp_path / "friction.parquet", columns)
    out = tmp_path / "out"
    done = dynid("identify", robot_file, *runs, "--friction", slow, "--friction-law", "auto", "-o", out)
    assert done.exit_code in (0, 1), done.output
    assert (out / "model.json").exists()


def test_identify_refuses_an_unknown_law_and_a_run_without_reversal(tmp_path):
    robot_file, runs = write_robot(tmp_path), write_runs(tmp_path)
    said = refusal(dynid("identify", robot_file, *runs, "--friction-law", "dahl", "-o", tmp_path / "out"))
    assert said == "--friction-law must be coulomb_viscous, smooth, stribeck, paper or auto, found 'dahl'"
    same = write(tmp_path / "slow.parquet", run(0, duration=12.0))
    said = refusal(dynid("identify", robot_file, *runs, "--friction", same, "-o", tmp_path / "out"))
    assert "slow.parquet: joint shoulder turns round" in said
    assert not (tmp_path / "out").exists()


def test_the_plan_of_these_tests_is_what_they_say():
    assert 600 < plan().duration < 720
    assert friction_arm.RATE == 1000.0


def test_joints_that_rest_may_creep():
    """A controller lets resting joints give way a little, and not the same way in both directions."""
    six_axis = robot()
    elastic, rng = typical_arm(six_axis), np.random.default_rng(0)
    options = {"joints": [0, 1], "n_speeds": 3, "pair_time": 4.0, "levels": (1, 0.3), "leg_time": 1.0}
    planned = plan_friction_experiment(six_axis, motion_limits(six_axis), **options)
    states = prepare(elastic.record(track(elastic, planned, Tracking(), rng), 250.0, rng), Band(5.0), 250.0)
    assert np.ptp(states.q[:, 2:], axis=0).max() > 1e-3
    mirrors = find_mirrors(states)
    assert len(mirrors) >= 6
    check_reversals([states], [mirrors], six_axis.joint_names)
    assert np.any([mirror.moves for mirror in mirrors], axis=0).tolist() == [True, True] + [False] * 4
