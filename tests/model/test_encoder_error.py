"""Link encoders whose discs are not centred: what they show too much goes before anything else, online as offline."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers import online_answers
from helpers.online_answers import assert_same_bits, csv_text, from_csv
from helpers.online_answers import run as answer_of
from numpy.testing import assert_array_equal

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.model.assembly import evaluate, with_parts
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.simulation import (
    build_effects,
    bundled_robot,
    equip,
    motion_limits,
    parse_wish,
    random_trajectory,
    simulate,
    typical_arm,
)

estimator = online_answers.estimator
"""The fixture that finds the binary."""

N = 6
RNG = np.random.default_rng(4)
ERROR = RNG.normal(size=(N, 2)) * 3e-3
NAMES = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")


@pytest.fixture(scope="module")
def robot():
    return _core.RobotModel.from_urdf(str(bundled_robot()))


@pytest.fixture(scope="module")
def recording(robot):
    """A run of an ideal arm with recorded derivatives; the motor side is that of an elastic gear."""
    trajectory = random_trajectory(motion_limits(robot), 8.0, np.random.default_rng(1))
    arm = replace(typical_arm(robot, noise=0.0), delay=2e-3)
    return arm.record(trajectory, 250.0, np.random.default_rng(0), derivatives=True)


def model(robot, encoders, error=ERROR, delay=2e-3):
    rotor, offset = _core.Effect.rotor_inertia(), _core.Effect.torque_offset()
    return _core.TorqueModel(
        robot,
        robot.phi,
        [(rotor, np.full((N, 1), 0.7)), (offset, np.ones((N, 1)))],
        encoder_delay=[delay if encoders == 2 else 0.0] * N,
        encoder_error=error,
        encoder_error_sides="link" if encoders == 2 else "both",
        noise_std=[1.0] * N,
        domain=([[-9.0, 9.0]] * N, [9.0] * N, [9.0] * N),
    )


def states_of(recording, encoders):
    if encoders == 1:
        recording = dyn.Recording(
            recording.t, recording.q, dq=recording.dq, ddq=recording.ddq, tau=recording.tau, joints=recording.joints
        )
    return prepare(recording, Band(5.0), 250.0)


def test_what_the_laboratory_adds_is_taken_out_to_second_order(robot):
    """The laboratory shows q + A sin(q + phase) with its chain rule; here a = A sin(phase), b = A cos(phase)."""
    trajectory = random_trajectory(motion_limits(robot), 8.0, np.random.default_rng(2))
    rng = np.random.default_rng(0)
    (effect,) = build_effects([parse_wish("encoder_eccentricity::5")], typical_arm(robot, noise=0.0))
    arm = equip(replace(typical_arm(robot, noise=0.0).rigid(), delay=0.0), [effect])
    shown = arm.record(trajectory, 250.0, rng, derivatives=True)
    truth = trajectory.evaluate(shown.t)
    error = np.stack([effect.amplitude * np.sin(effect.phase), effect.amplitude * np.cos(effect.phase)], axis=1)
    motion = _core.true_motion(shown.q, shown.dq, shown.ddq, error)
    largest = np.abs(effect.amplitude).max()
    assert largest > 4e-3
    speed = np.abs(truth[1]).max()
    sizes = (1.0, speed, np.abs(truth[2]).max() + 2 * speed**2)
    for seen, raw, true, size in zip(motion, (shown.q, shown.dq, shown.ddq), truth, sizes, strict=True):
        assert np.abs(seen - true).max() < largest**2 * size
        assert np.abs(raw - true).max() > 20 * np.abs(seen - true).max()


@pytest.mark.parametrize("encoders", [1, 2])
def test_columns_of_a_fit_see_what_the_model_sees(robot, recording, encoders):
    """Aligned states and the online model: the same rigid body and rotor torque, to the last bit."""
    with_error = model(robot, encoders)
    states = states_of(recording, encoders)
    seen = states.aligned(with_error.encoder_delay, with_error.encoder_error)
    _, terms, _ = evaluate(with_error, states)
    assert_array_equal(terms[:, 0], robot.inverse_dynamics(seen.q, seen.dq, seen.ddq, robot.phi))
    columns = _core.effect_columns(with_error.effects[0][0], *seen.signals())
    assert_array_equal(terms[:, 1], 0.7 * columns[:, :, 0])
    side = (states.ddq_motor, seen.ddq_motor)
    if encoders == 2:
        assert_array_equal(*side)
    else:
        assert_array_equal(seen.ddq_motor, seen.ddq)
        assert np.abs(side[0] - side[1]).max() > 1e-3


@pytest.mark.parametrize("encoders", [1, 2])
def test_the_binary_gives_the_bits_of_python(estimator, robot, recording, tmp_path, encoders):
    """With one encoder the file of states may hold the motor side or not: it is the same signal."""
    with_error = model(robot, encoders)
    with_error.save(tmp_path / "model.json")
    signals = dict(zip(NAMES, states_of(recording, encoders).signals(), strict=True))
    total = with_error.evaluate(**signals)[0]
    link = {name: signals[name] for name in NAMES[:3]}
    for given in [signals] if encoders == 2 else [signals, link]:
        text = answer_of(estimator, tmp_path / "model.json", csv_text(given))
        assert_same_bits(from_csv(text, with_error.term_names, N).total, total)
        assert_array_equal(with_error.evaluate(**given)[0], total)


def test_everything_comes_back(robot, recording, tmp_path):
    for encoders, sides in ((1, "both"), (2, "link")):
        with_error = model(robot, encoders)
        with_error.save(tmp_path / "model.json")
        again = [_core.TorqueModel.load(tmp_path / "model.json"), pickle.loads(pickle.dumps(with_error))]
        signals = states_of(recording, encoders).signals()
        for other in [*again, with_parts(with_error, with_error.phi, with_error.effects)]:
            assert_array_equal(other.encoder_error, ERROR)
            assert other.encoder_error_sides == sides
            assert_array_equal(other.evaluate(*signals)[0], with_error.evaluate(*signals)[0])


def test_no_error_is_no_line_in_the_file(robot, tmp_path):
    model(robot, 2, error=np.zeros((N, 2))).save(tmp_path / "model.json")
    assert "encoder_error" not in (tmp_path / "model.json").read_text()
    assert_array_equal(_core.TorqueModel.load(tmp_path / "model.json").encoder_error, np.zeros((N, 2)))


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"encoder_error": np.zeros((5, 2))}, "encoder_error has 5 values, expected 6"),
        ({"encoder_error": np.zeros(6)}, r"encoder_error has shape \(6,\), expected \(n_samples, 2\)"),
        ({"encoder_error_sides": "motor"}, 'encoder_error_sides must be "link" or "both", found "motor"'),
    ],
)
def test_what_makes_no_sense_is_refused(robot, parts, words):
    box = ([[-9.0, 9.0]] * N, [9.0] * N, [9.0] * N)
    with pytest.raises(ValueError, match=words):
        _core.TorqueModel(robot, robot.phi, [], encoder_delay=[0.0] * N, noise_std=[1.0] * N, domain=box, **parts)
    with pytest.raises(ValueError, match=r"encoder_error has shape \(3, 2\), expected \(6, 2\)"):
        dyn.ThreeLoopIdentifier(robot, encoder_error=np.zeros((3, 2))).fit([])


@pytest.mark.parametrize("encoders", [1, 2])
def test_a_fit_that_knows_the_error_is_rid_of_it(robot, encoders):
    """5 mrad on the shoulder reach every joint's torque; without noise 1 % of it is left, and it is not absorbed."""
    typical = typical_arm(robot, noise=0.0)
    rigid = replace(typical.rigid(), delay=0.0)
    (effect,) = build_effects([parse_wish("encoder_eccentricity:1:5")], typical)
    error = np.stack([effect.amplitude * np.sin(effect.phase), effect.amplitude * np.cos(effect.phase)], axis=1)
    runs = simulate(equip(rigid, [effect]), n_runs=2, duration=10, rate=250, seed=0).recordings
    if encoders == 1:
        runs = [dyn.Recording(r.t, r.q, tau=r.tau, name=r.name, joints=r.joints) for r in runs]

    def left(encoder_error):
        fit = dyn.ThreeLoopIdentifier(robot, friction_law="paper", residual=None, encoder_error=encoder_error).fit(
            list(runs)
        )
        assert fit.model_.encoder_error_sides == ("both" if encoders == 1 and encoder_error is not None else "link")
        return fit.links_.noise_std_

    assert np.all(left(error) < 0.02 * left(None))
