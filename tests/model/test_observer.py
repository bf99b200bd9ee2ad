"""The momentum observer: against the textbook's integral in numpy, and on simulated runs that something pushes."""

import numpy as np
import pytest
from helpers.tolerances import statistical

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

N, RATE = 6, 500.0
TIME_CONSTANT = 0.03
VISCOUS = np.array([6.0, 7.0, 5.0, 1.0, 1.0, 0.5])
COULOMB = np.array([9.0, 10.0, 8.0, 2.0, 1.5, 1.0])
ROTOR = np.array([4.0, 5.0, 3.0, 0.2, 0.2, 0.1])
NOISE = np.array([1.0, 1.2, 0.8, 0.2, 0.2, 0.1])
PUSH = np.array([0.0, 25.0, -15.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def model():
    robot = _core.RobotModel.from_urdf(str(bundled_robot()))
    friction = np.zeros((N, 8))
    friction[:, :2], friction[:, 2:4] = COULOMB[:, None], VISCOUS[:, None]
    effects = [
        (_core.Effect.rotor_inertia(), ROTOR[:, None]),
        (_core.Effect.friction([0.0] * N, [0.005] * N), friction),
    ]
    domain = ([[-7.0, 7.0]] * N, [9.0] * N, [99.0] * N)
    return dyn.TorqueModel(robot, robot.phi, effects, encoder_delay=[0.0] * N, noise_std=NOISE.tolist(), domain=domain)


def motion(duration, late=0.0):
    t = np.arange(0, duration, 1 / RATE)
    w = 2 * np.pi * np.array([0.31, 0.23, 0.37, 0.51, 0.43, 0.61])
    phase = np.arange(N) + np.multiply.outer(t - late, w)
    return t, np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)


def recording(model, duration=4.0, *, push=None, noise=None, derivatives=True):
    """A run in which the controller holds the motion against a push: the torque is less by it."""
    t, q, dq, ddq = motion(duration)
    tau = model.evaluate(q, dq, ddq)[0]
    if push is not None:
        tau = tau - push(t)[:, None] * PUSH
    if noise is not None:
        tau = tau + noise
    return dyn.Recording(t, q, dq if derivatives else None, ddq if derivatives else None, tau)


def step_from(begin, end=np.inf):
    return lambda t: ((t >= begin) & (t < end)).astype(float)


def textbook(model, run):
    """r = K (p - p0 - integral of (tau - friction - g + C^T dq + r)), trapezoidal, from the mass matrix alone."""
    robot = model.robot
    free = robot.with_gravity([0.0, 0.0, 0.0])
    zeros = np.zeros_like(run.q)

    def momentum(q):
        columns = [free.inverse_dynamics(q, zeros, np.broadcast_to(unit, q.shape)) for unit in np.eye(N)]
        mass = np.stack(columns, axis=-1)
        return np.einsum("kij,kj->ki", mass, run.dq)

    h = 1e-5
    rate = (momentum(run.q + h * run.dq) - momentum(run.q - h * run.dq)) / (2 * h)
    drift = rate - free.inverse_dynamics(run.q, run.dq, zeros)
    p = momentum(run.q) + ROTOR * run.dq
    s = np.abs(np.tanh(run.dq / 0.005))  # Eqs. 9-11, the same in both directions
    friction = 0.5 * (s + 1) * (np.sign(run.dq) * s * COULOMB + VISCOUS * run.dq)
    u = run.tau - friction - robot.inverse_dynamics(run.q, zeros, zeros) + drift
    gain, dt = 1 / TIME_CONSTANT, 1 / RATE
    r, integral = np.zeros_like(p), np.zeros(N)
    for k in range(1, len(p)):
        integral += dt * 0.5 * (u[k] + u[k - 1] + r[k - 1])
        r[k] = gain * (p[k] - p[0] - integral) / (1 + 0.5 * gain * dt)
        integral += dt * 0.5 * r[k]
    return r


def test_it_is_the_textbooks_residual(model):
    rng = np.random.default_rng(1)
    run = recording(model, 3.0, push=step_from(1.0, 2.0), noise=rng.normal(size=(1500, N)) * NOISE)
    found = dyn.MomentumObserver(model, time_constant=TIME_CONSTANT).observe(run)
    assert found.delay == 0
    expected = textbook(model, run)
    # A step of 2 ms against 30 ms: the two rules differ by (dt / T)^2 / 12.
    error, size = np.abs(found.external - expected), np.abs(expected)
    assert np.all(error.max(axis=0) < 2e-3 * size.max(axis=0))


@pytest.mark.parametrize("derivatives", [True, False])
def test_a_push_has_its_size_and_its_time(model, derivatives):
    run = recording(model, push=step_from(2.0), derivatives=derivatives)
    observer = dyn.MomentumObserver(model, time_constant=TIME_CONSTANT, window=11)
    found = observer.observe(run)
    assert found.delay == pytest.approx(0.0 if derivatives else 5 / RATE)
    since = np.maximum(run.t - 2.0 - found.delay + 0.5 / RATE, 0)
    expected = np.multiply.outer(1 - np.exp(-since / TIME_CONSTANT), PUSH)
    settled = (run.t > 0.3) & (np.abs(run.t - 2.0 - found.delay) > found.delay + 1e-9)
    dq = motion(4.0)[2]
    still = np.abs(dq).min(axis=1) > 0.2  # friction's step within a window is smoothed otherwise
    error = np.abs(found.external - expected)[settled & still]
    assert np.max(error) < (0.02 if derivatives else 0.12) * np.max(np.abs(PUSH))
    assert not found.contact[run.t < 2.0].any()
    assert found.contact[run.t > 2.0 + found.delay + 5 * TIME_CONSTANT].all()


@pytest.mark.parametrize(
    "delays", [[0.0, 0.004, 0.0125, 0.0, 0.02, 0.001], [-0.006] * N, [0.01, -0.004, 0.0125, -0.008, 0.0, -0.0125]]
)
def test_every_channel_is_held_against_its_own_time(model, delays):
    """A late channel shows its joint's motion of before, an early one that of later, for which its torque waits."""
    late = dyn.TorqueModel(
        model.robot,
        model.phi,
        model.effects,
        encoder_delay=[0.0] * N,
        noise_std=NOISE.tolist(),
        domain=model.domain,
        step=1 / RATE,
        torque_delay=delays,
    )
    t, q, dq, ddq = motion(4.0)
    shown = [model.evaluate(*motion(4.0, late=delay)[1:])[0][:, j] for j, delay in enumerate(delays)]
    run = dyn.Recording(t, q, dq, ddq, np.stack(shown, axis=1) - step_from(2.0)(t)[:, None] * PUSH)
    found = dyn.MomentumObserver(late, time_constant=TIME_CONSTANT).observe(run)
    since = np.maximum(np.subtract.outer(t - 2.0 + 0.5 / RATE, np.maximum(0.0, -np.array(delays))), 0)
    expected = (1 - np.exp(-since / TIME_CONSTANT)) * PUSH
    slow = np.abs(dq).min(axis=1) < 0.5  # friction's step within a sample is none that a mean of two tells
    error = np.abs(found.external - expected)[(t > 0.3) & ~slow]
    assert np.max(error) < 0.02 * np.max(np.abs(PUSH))
    assert not found.contact[t < 2.0].any()
    assert found.contact[t > 2.02 + 5 * TIME_CONSTANT].all()


def noise_of(rng, n_samples, correlation):
    """What a model leaves: NOISE in deviation, forgetting over `correlation`."""
    keep = np.exp(-1 / RATE / correlation)
    noise = np.zeros((n_samples, N))
    for k in range(1, n_samples):
        noise[k] = keep * noise[k - 1] + np.sqrt(1 - keep**2) * rng.normal(size=N)
    return noise * NOISE


def test_fit_finds_the_correlation_time_and_clean_runs_are_clean(model):
    rng = np.random.default_rng(2)
    correlation = 0.02
    clean = [recording(model, 20.0, noise=noise_of(rng, 10_000, correlation)) for _ in range(3)]
    observer = dyn.MomentumObserver(model, time_constant=TIME_CONSTANT).fit(clean[:2])
    # The joint that averages out least decides, so it is the largest of six: one-sided, and a fifth too long at most.
    np.testing.assert_allclose(observer.correlation_time_, 1.1 * correlation, **statistical(0.1 * correlation, 3))
    found = observer.observe(clean[2])
    assert not found.contact.any()
    wide = dyn.MomentumObserver(model, time_constant=TIME_CONSTANT).observe(clean[2])
    assert np.all(found.threshold[100:] < wide.threshold[100:])
    pushed = recording(model, 4.0, push=step_from(2.0), noise=noise_of(rng, 2000, correlation))
    assert observer.observe(pushed).contact[pushed.t > 2.3].all()


@pytest.mark.parametrize("ratio", [1.0, -1.0, -0.5])
def test_a_stage_of_two_joints_sticks_whichever_way_it_adds_their_speeds(model, ratio):
    """Beside what sticks of a joint's own: a half of a stage's step, or all of it, is what a hand feels at rest."""
    partner, ratios, level = np.full(N, -1.0), np.ones(N), np.zeros((N, 2))
    partner[4:], ratios[4:], level[4:, 0] = (5.0, 4.0), (ratio, 1 / ratio), (3.0, 3.0 * abs(ratio))
    width = np.full(N, 0.005)
    stage = _core.Effect.of("coupled_friction", partner=partner, ratio=ratios, transition_width=width)
    parts = {"encoder_delay": [0.0] * N, "noise_std": NOISE.tolist(), "domain": model.domain}
    coupled = dyn.TorqueModel(model.robot, model.phi, [*model.effects, (stage, level)], **parts)
    still = np.zeros((50, N))
    run = dyn.Recording(np.arange(50) / RATE, still, dq=still, ddq=still, tau=coupled.torque(still, still, still))
    alone, both = (dyn.MomentumObserver(one).observe(run).threshold[-1] for one in (model, coupled))
    np.testing.assert_allclose(both[:4], alone[:4])
    np.testing.assert_allclose(both[4:] - alone[4:], level[4:, 0], rtol=0.1)


def test_a_joint_that_stands_holds_what_its_friction_under_load_may(model):
    """The arm sinks, stops twice, and friction holds on to what it was while it slid."""
    width, share = 0.005, 0.1
    loaded = _core.Effect.of("load_dependent_friction", transition_width=[width] * N, sharpness=[2.5] * N)
    shares = np.column_stack([np.full(N, share), np.zeros(N)])
    arm = dyn.TorqueModel(
        model.robot,
        model.phi,
        [*model.effects, (loaded, shares)],
        encoder_delay=[0.0] * N,
        noise_std=NOISE.tolist(),
        domain=model.domain,
    )
    t = np.arange(0, 6, 1 / RATE)
    speed = np.maximum(0, 0.4 * np.sin(np.pi * t)) ** 2
    reach = np.array([0.3, 0.5, 0.4, 0.6, 0.3, 0.2])
    path = np.cumsum(speed) / RATE
    q = np.array([0.0, -1.2, 0.6, 0.0, 0.5, 0.0]) + np.outer(path, reach)
    dq, ddq = np.outer(speed, reach), np.outer(np.gradient(speed, t), reach)
    tau = arm.evaluate(q, np.maximum(dq, 4 * width), ddq)[0]
    found = dyn.MomentumObserver(arm, time_constant=TIME_CONSTANT).observe(dyn.Recording(t, q, dq, ddq, tau))
    assert not found.contact[t > 0.1].any()
    load = np.abs(model.robot.inverse_dynamics(q, dq, ddq))
    stands = (speed == 0.0) & (t > 1)
    unloaded = dyn.MomentumObserver(model, time_constant=TIME_CONSTANT).observe(dyn.Recording(t, q, dq, ddq, tau))
    more = (found.threshold - unloaded.threshold)[stands]
    np.testing.assert_allclose(more, share * load[stands], rtol=0.1, atol=1e-9)


def test_a_joint_that_stands_holds_what_its_friction_around_the_turn_may_there(model):
    """There was room for its cosine alone, wherever the joint stood."""
    cos, sin = 0.3, -0.8
    around = _core.Effect.of(
        "position_dependent_friction", cycles=[2.0] * N, transition_width=[0.005] * N, sharpness=[2.5] * N
    )
    parts = np.tile([cos, sin], (N, 1))
    whole = [*model.effects, (around, parts)]
    options = {"encoder_delay": [0.0] * N, "noise_std": NOISE.tolist(), "domain": model.domain}
    arm = dyn.TorqueModel(model.robot, model.phi, whole, **options)
    for place in (0.0, 0.4, 2.0):
        t = np.arange(0, 1, 1 / RATE)
        q = np.full((len(t), N), place)
        still = np.zeros_like(q)
        tau = model.robot.inverse_dynamics(q, still, still)
        levels = [
            dyn.MomentumObserver(one, time_constant=TIME_CONSTANT).observe(dyn.Recording(t, q, still, still, tau))
            for one in (arm, model)
        ]
        more = levels[0].threshold[-1] - levels[1].threshold[-1]
        there = cos * np.cos(2 * place) + sin * np.sin(2 * place)
        np.testing.assert_allclose(more, there, rtol=0.1)


def test_what_does_not_fit_is_refused(model):
    run = recording(model, 1.0)
    observer = dyn.MomentumObserver(model)
    with pytest.raises(ValueError, match="has 1 joints, the model has 6"):
        observer.observe(dyn.Recording(run.t, run.q[:, :1], tau=run.tau[:, :1]))
    with pytest.raises(ValueError, match="torque in A, the model gives N"):
        observer.observe(dyn.Recording(run.t, run.q, tau=run.tau, torque_unit="A"))
    with pytest.raises(ValueError, match="time_constant: a number of seconds from 1e-05 to 100, found 0"):
        dyn.MomentumObserver(model, time_constant=0.0).observe(run)
    with pytest.raises(ValueError, match="window: an odd number of samples from 5 to 101, found 4"):
        dyn.MomentumObserver(model, window=4).observe(run)
    still = dyn.Recording(run.t, run.q[:1].repeat(500, 0), 0 * run.q, 0 * run.q, run.tau)
    with pytest.raises(ValueError, match="no joint moves long enough"):
        observer.fit([still])
