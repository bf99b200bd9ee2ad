"""Two doors, one model: `TorqueModel.evaluate` in Python and `dynid-estimator` give the same bits."""

import subprocess

import numpy as np
import pytest
from helpers import online_answers
from helpers.online_answers import States, assert_same_bits, csv_text, from_csv, from_json, json_text, run
from helpers.robots import random_chain
from helpers.whole_model import recorded_states, whole_model

from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

LINK_SIDE = ("q", "dq", "ddq")
MOTOR_SIDE = ("q_motor", "dq_motor", "ddq_motor")
N_STATES = 400
estimator = online_answers.estimator
"""The fixture that finds the binary."""


def mixture(rng: np.random.Generator, scale: tuple[float, ...]) -> _core.GaussianMixtureRegression:
    """Four components over inputs of about this size."""
    size = np.array([*scale, 1.0])
    width = len(size)
    half = 0.4 * rng.normal(size=(4, width, width)) + 0.5 * np.eye(width)
    covariances = (half @ half.transpose(0, 2, 1)) * np.outer(size, size)
    return _core.GaussianMixtureRegression(
        rng.dirichlet(np.ones(4)),
        rng.normal(size=(4, width)) * size,
        0.5 * (covariances + covariances.transpose(0, 2, 1)),
    )


def rbf(rng: np.random.Generator, scale: tuple[float, ...]) -> _core.NormalisedRbf:
    """Eight centres over inputs of about this size."""
    size = np.array(scale)
    centers = rng.normal(size=(8, len(size))) * size
    return _core.NormalisedRbf(centers, 4 / size**2, rng.normal(size=8), rng.uniform(0.1, 1, 8))


def random_model(robot: _core.RobotModel, inputs: str | None, *, delayed: bool, seed: int) -> _core.TorqueModel:
    """Every effect there is, random sizes; `inputs` of the residual, or None without one."""
    rng = np.random.default_rng(seed)
    n = robot.n_joints
    friction = _core.Effect.friction(rng.uniform(0, 0.1, n).tolist(), rng.uniform(1e-3, 0.05, n).tolist())
    residual = signals = None
    if inputs == "signals":
        # Joint 0 has them all but one, of itself and its neighbours; the others have fewer.
        names = ("dq", "tau_link", "q_motor", "q", "ddq", "dq_motor")
        signals = [[(name, (j + k) % n) for k, name in enumerate(names[j % 6 :])] for j in range(n)]
        scale = dict.fromkeys(names, 3.0) | {"tau_link": 100.0, "ddq": 8.0}
        sizes = [tuple(scale[name] for name, _ in joint) for joint in signals]
        residual = (inputs, [None if j == 1 else (rbf if j == 2 else mixture)(rng, sizes[j]) for j in range(n)])
    elif inputs is not None:
        scale = (2.0, 1.5) if inputs == "joint_state" else (2e-3, 2e-2)
        joints = [None if j == 1 else (rbf if j == 2 else mixture)(rng, scale) for j in range(n)]
        residual = (inputs, joints)
    return _core.TorqueModel(
        robot,
        rng.normal(size=10 * n),
        [
            (_core.Effect.rotor_inertia(), rng.uniform(0.1, 2, (n, 1))),
            (_core.Effect.torque_offset(), rng.normal(size=(n, 1))),
            (friction, rng.normal(size=(n, 8)) * 5),
        ],
        residual=residual,
        residual_signals=signals,
        compliance=rng.uniform(0, 1e-5, n).tolist() if inputs == "load_free_deflection" else None,
        torque_scale=rng.uniform(0.5, 2, n).tolist(),
        encoder_delay=(rng.uniform(1e-3, 4e-3, n) if delayed else np.zeros(n)).tolist(),
        noise_std=rng.uniform(0.1, 1, n).tolist(),
        domain=([[-2.5, 2.5]] * n, [2.0] * n, [8.0] * n),
    )


def random_states(n: int, signals: tuple[str, ...], seed: int) -> States:
    """Ordinary states; some far away, some at rest, some with numbers that are awkward to write."""
    rng = np.random.default_rng(seed)
    size = (N_STATES, n)
    states = {"q": rng.uniform(-3, 3, size), "dq": rng.normal(size=size), "ddq": 4 * rng.normal(size=size)}
    states["q_motor"] = states["q"] + 2e-3 * rng.normal(size=size)
    states["dq_motor"] = states["dq"] + 2e-2 * rng.normal(size=size)
    states["ddq_motor"] = states["ddq"] + rng.normal(size=size)
    for values in states.values():
        values[:20] *= 10.0 ** rng.uniform(-300, 6, (20, n))
        values[20:30] = rng.choice([0.0, -0.0, 5e-324, 1.0, -1e22, 1 / 3], (10, n))
    return {signal: states[signal] for signal in signals}


ROBOTS = {
    "six_axis": lambda: _core.RobotModel.from_urdf(str(bundled_robot())),
    "chain": lambda: _core.RobotModel.from_urdf_string(random_chain(3).urdf, gravity=[1.0, -2.0, 9.0]),
}
CASES = {
    "one encoder": (LINK_SIDE, None, False),
    "one encoder, residual": (LINK_SIDE, "joint_state", False),
    "one encoder, model of two": (LINK_SIDE, "deflection", True),
    "two encoders": ((*LINK_SIDE, *MOTOR_SIDE), "deflection", False),
    "two encoders, delayed": ((*LINK_SIDE, *MOTOR_SIDE), "deflection", True),
    "two encoders, positions and speeds": ((*LINK_SIDE, "q_motor", "dq_motor"), "deflection", True),
    "two encoders, load-free": ((*LINK_SIDE, *MOTOR_SIDE), "load_free_deflection", True),
    "one encoder, signals": (LINK_SIDE, "signals", False),
    "two encoders, signals": ((*LINK_SIDE, *MOTOR_SIDE), "signals", True),
    "two encoders, positions": ((*LINK_SIDE, "q_motor"), "joint_state", True),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_binary_gives_the_bits_of_python(estimator, tmp_path, robot, case):
    signals, inputs, delayed = CASES[case]
    model = random_model(ROBOTS[robot](), inputs, delayed=delayed, seed=len(case))
    path = tmp_path / "model.json"
    model.save(path)
    n, names = model.robot.n_joints, model.term_names
    states = random_states(n, signals, seed=len(case) + n)
    total, terms, status = model.evaluate(**states)
    assert set(status & 2) == {0, 2}, "the states should reach out of the domain and stay in it"
    if inputs is not None:
        assert set(status & 4) == {0, 4}, "the states should reach out of the mixture and stay in it"
    assert_same_bits(_core.TorqueModel.load(path).evaluate(**states)[1], terms)
    read = {"csv": from_csv, "jsonl": from_json}
    for text in (csv_text(states), csv_text(states, model.robot.joint_names), json_text(states)):
        for output, parse in read.items():
            answers = parse(run(estimator, path, text, "--format", output), names, n)
            assert_same_bits(answers.total, total)
            assert_same_bits(answers.terms, terms)
            assert_same_bits(answers.std, model.predicted_std(**states))
            np.testing.assert_array_equal(answers.status, status)
            assert answers.t is None


def test_time_is_passed_through(estimator, tmp_path):
    model = random_model(ROBOTS["six_axis"](), None, delayed=False, seed=0)
    path = tmp_path / "model.json"
    model.save(path)
    t = np.random.default_rng(0).uniform(-1e3, 2e9, N_STATES)
    states = {"t": t, **random_states(6, LINK_SIDE, seed=0)}
    for text, parse in ((csv_text(states), from_csv), (json_text(states), from_json)):
        answers = parse(run(estimator, path, text), model.term_names, 6)
        assert answers.t is not None
        assert_same_bits(answers.t, t)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_none_repeats_the_last_good_torque(estimator, tmp_path, bad):
    model = random_model(ROBOTS["six_axis"](), "joint_state", delayed=False, seed=1)
    path = tmp_path / "model.json"
    model.save(path)
    states = random_states(6, LINK_SIDE, seed=1)
    states = {signal: values[50:60] for signal, values in states.items()}
    total, terms, status = model.evaluate(**states)
    states["dq"][[0, 4, 5], [0, 3, 5]] = bad
    held = [0, 1, 2, 3, 3, 3, 6, 7, 8, 9]  # row 0: nothing good before it
    total, terms = total[held], terms[held]
    total[0], terms[0] = 0.0, 0.0
    status[[0, 4, 5]] = 1
    for text, parse in ((csv_text(states), from_csv), (json_text(states), from_json)):
        answers = parse(run(estimator, path, text), model.term_names, 6)
        assert_same_bits(answers.total, total)
        assert_same_bits(answers.terms, terms)
        np.testing.assert_array_equal(answers.status, status)


def test_effects_that_remember_give_the_bits_of_python(estimator, tmp_path):
    """Hysteresis and warm-up: the same history, the same bits; a NaN leaves no trace; `--step` is `evaluate`'s step."""
    n, robot = 6, ROBOTS["six_axis"]()
    rng = np.random.default_rng(5)
    effects = [
        _core.Effect.of("friction_hysteresis", presliding_distance=[0.02] * n),
        _core.Effect.of(
            "thermal_friction", time_constant=[0.3] * n, reference_speed=[0.0, 1.0] * 3, transition_width=[0.01] * n
        ),
        _core.Effect.of("load_dependent_friction", transition_width=[0.01] * n),
        _core.Effect.of("gear_hysteresis", hysteresis_load=[3.0] * n, carried_load=[1.0] * n),
        _core.Effect.of("friction_hysteresis", presliding_distance=[0.2] * n),
    ]
    model = _core.TorqueModel(
        robot,
        robot.phi,
        [(effect, rng.normal(size=(n, effect.n_columns))) for effect in effects],
        encoder_delay=[0.0] * n,
        noise_std=[0.1] * n,
        domain=([[-9, 9]] * n, [99] * n, [999] * n),
        step=0.004,
    )
    path = tmp_path / "model.json"
    model.save(path)
    t = 0.004 * np.arange(N_STATES)[:, None]
    angle = rng.uniform(1, 9, n) * t + rng.uniform(0, 6, n)
    states = {"q": np.sin(angle), "dq": np.cos(angle), "ddq": -np.sin(angle)}
    states |= {f"{name}_motor": x * (1 + 2e-4) for name, x in states.items()}
    total, terms, _ = model.evaluate(**states)
    names = model.term_names
    assert (np.ptp(terms[:, names.index("gear_hysteresis")], axis=0) > 0).all()
    assert names[-1] == "friction_hysteresis2"
    answers = from_csv(run(estimator, path, csv_text(states)), names, n)
    assert_same_bits(answers.total, total)
    assert_same_bits(answers.terms, terms)

    spoiled = {signal: np.insert(values, 100, np.nan, axis=0) for signal, values in states.items()}
    answers = from_csv(run(estimator, path, csv_text(spoiled)), names, n)
    assert answers.status[100] == 1
    assert_same_bits(np.delete(answers.terms, 100, axis=0), terms)

    slower = model.evaluate(**states, step=0.01)[0]
    assert not np.array_equal(slower, total)
    assert_same_bits(from_csv(run(estimator, path, csv_text(states), "--step", "0.01"), names, n).total, slower)

    for apart, options, said in ((0.004, (), False), (0.01, (), True), (0.01, ("--step", "0.01"), False)):
        timed = {"t": apart * np.arange(N_STATES), **states}
        done = subprocess.run(
            [estimator, path, *options], input=csv_text(timed), capture_output=True, text=True, timeout=240, check=True
        )
        assert ("give --step" in done.stderr) == said


@pytest.mark.parametrize(
    ("delays", "note", "info"),
    [
        (-0.0033, "early (3.3 ms)", "-3.3 ms"),
        (
            [-0.0033, 0.0123, 0.0, -0.0041, 0.0, 0.0],
            "early (joint_1 3.3 ms, joint_4 4.1 ms)",
            "joint_1 -3.3 ms, joint_2 12.3 ms, joint_4 -4.1 ms",
        ),
    ],
)
def test_a_channel_that_is_early_is_told_by_its_joint(estimator, tmp_path, delays, note, info):
    """Of one early joint it was said that the channel is, also of those that are late; 4.1 ms had 17 digits."""
    robot, rng = ROBOTS["six_axis"](), np.random.default_rng(0)
    model = whole_model(
        robot, recorded_states(), None, effects=[(_core.Effect.torque_offset(), rng.normal(size=(6, 1)))]
    )
    path = tmp_path / "model.json"
    model.with_torque_delay(delays).save(path)
    text = csv_text(random_states(6, (*LINK_SIDE, *MOTOR_SIDE), seed=0))
    done = subprocess.run([estimator, path], input=text, capture_output=True, text=True, check=True)
    assert (
        f"the model's torque channel is {note}, and no state is known before it comes: its answers are" in done.stderr
    )
    done = subprocess.run([estimator, path, "--info"], capture_output=True, text=True, check=True)
    assert f"torque delay  {info}" in done.stdout
