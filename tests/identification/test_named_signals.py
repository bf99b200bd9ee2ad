"""A third loop on signals that every joint names: in the file, in Python, and online as offline."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from dynid_rs import GaussianMixtureRegressor, RbfRegressor, TorqueModel, _core
from dynid_rs.model.assembly import with_changes, with_parts
from dynid_rs.simulation import bundled_robot

N = 6
NAMES = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")
SIGNALS = [[], [("q", 1), ("tau_link", 2), ("dq", 2)], [], [("ddq_motor", 0)], [], []]
DELAY = 2e-3


@pytest.fixture(scope="module")
def signals():
    """Six signals (n, 6) of a motion; the motor side is ahead and a little off."""
    t = np.linspace(0, 10, 2000)[:, None]
    angle = np.linspace(0.5, 1.5, N) * t + np.arange(N)
    link = [np.sin(angle), np.cos(angle) * np.linspace(0.5, 1.5, N), -np.sin(angle)]
    return [*link, *(x + 1e-3 * np.cos(3 * angle) for x in link)]


def plain_model(**parts):
    robot = _core.RobotModel.from_urdf(str(bundled_robot()))
    given = {
        "encoder_delay": [DELAY] * N,
        "noise_std": [1.0] * N,
        "domain": ([[-9.0, 9.0]] * N, [9.0] * N, [9.0] * N),
        "torque_scale": [2.0] * N,
    }
    return TorqueModel(robot, robot.phi, [], **(given | parts))


def seen(model, signals, named):
    """What the regressions see, put together by hand: the link side on the motor's clock, the load by the robot."""
    q, dq, ddq, *motor = signals
    q, dq = _core.align_link_side(q, dq, ddq, model.encoder_delay)
    run = dict(zip(NAMES, (q, dq, ddq, *motor), strict=True))
    run["tau_link"] = model.robot.inverse_dynamics(q, dq, ddq, model.phi)
    assert_array_equal(
        _core.named_signals(named, **run), np.stack([run[name][:, joint] for name, joint in named], axis=1)
    )
    return _core.named_signals(named, **run)


def with_regressions(model, regressions):
    return with_changes(model, residual=("signals", regressions), residual_signals=SIGNALS, compliance=None)


@pytest.fixture(scope="module")
def fitted(signals):
    """A model whose third loop was fitted on joints 1 and 3 to smooth functions of what they see."""
    model = plain_model()
    u = seen(model, signals, SIGNALS[1])
    mixture = GaussianMixtureRegressor(3, random_state=0).fit(u, u[:, 0] * u[:, 2])
    rates = seen(model, signals, SIGNALS[3])
    rbf = RbfRegressor(8).fit(rates, np.sin(rates[:, 0]))
    return with_regressions(model, [None, mixture.mixture_, None, rbf.rbf_, None, None])


def test_online_and_offline_see_the_same_to_the_last_bit(fitted, signals):
    _, terms, status = fitted.evaluate(*signals)
    trusted = (status & 4) == 0
    assert trusted.mean() > 0.95
    _, (_, mixture, _, rbf, _, _) = fitted.residual
    for j, regression in ((1, mixture), (3, rbf)):
        torque = regression.predict(seen(fitted, signals, SIGNALS[j]))[0]
        assert_array_equal(terms[trusted, -1, j], torque[trusted])
    assert_array_equal(terms[:, -1, [0, 2, 4, 5]], 0.0)


def test_everything_comes_back(fitted, signals, tmp_path):
    fitted.save(tmp_path / "model.json")
    kept = with_parts(fitted, fitted.phi, fitted.effects)
    for again in (TorqueModel.load(tmp_path / "model.json"), pickle.loads(pickle.dumps(fitted)), kept):
        assert again.residual[0] == "signals"
        assert again.residual_signals == SIGNALS
        for now, then in zip(again.evaluate(*signals), fitted.evaluate(*signals), strict=True):
            assert_array_equal(now, then)
        assert_array_equal(again.predicted_std(*signals), fitted.predicted_std(*signals))


def test_a_pair_has_no_signals_and_may_take_their_place(fitted):
    mixture = _core.GaussianMixtureRegression([1.0], np.zeros((1, 3)), np.eye(3)[None])
    pair = plain_model(residual=("joint_state", [mixture] * N))
    assert plain_model().residual_signals is None
    assert pair.residual_signals is None
    named = with_regressions(pair, fitted.residual[1])
    assert named.residual_signals == SIGNALS
    assert named.residual[1][0] is None


BUMP = _core.NormalisedRbf([[0.0]], [1.0], [1.0], [0.0])


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"residual_signals": [[("tau", 0)]] * N}, 'there is no signal "tau", expected one of q, dq, ddq, q_motor'),
        ({"residual_signals": [[("q", N)]] * N}, "the residual of joint 0 names a signal of joint 6"),
        ({"residual_signals": [[("q", 0)]] * 5}, "residual signals has 5 values, expected 6"),
        ({"residual_signals": [[("q", 0), ("dq", 0)]] * N}, "the residual of joint 0 has 1 inputs, expected 2"),
        ({"residual_signals": [[("q", 0)] * 7] * N}, "number of signals of a joint's residual is outside its range"),
        ({}, "residual_signals is missing"),
        (
            {"residual": ("joint_state", [None] * N), "residual_signals": [[]] * N},
            'residual_signals is for a residual of "signals", found "joint_state"',
        ),
    ],
)
def test_signals_that_make_no_sense_are_refused(parts, words):
    plain_model(residual=("signals", [BUMP] * N), residual_signals=[[("q", 0)]] * N)
    with pytest.raises(ValueError, match=words):
        plain_model(**({"residual": ("signals", [BUMP] * N)} | parts))


def test_what_a_run_does_not_have_is_said(signals):
    with pytest.raises(ValueError, match="the signals name tau_link, which was not given"):
        _core.named_signals([("q", 0), ("tau_link", 1)], *signals)
    with pytest.raises(ValueError, match="there is no joint 6, the signals are those of 6 joints"):
        _core.named_signals([("q", 6)], *signals)
    assert _core.named_signals([], *signals).shape == (2000, 0)
