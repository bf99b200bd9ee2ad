"""`TorqueModel.torque`: the total of `evaluate`, one state or many, where it is told to go."""

import numpy as np
import pytest
from helpers.whole_model import RESIDUALS, every_effect, recorded_states, whole_model
from numpy.testing import assert_array_equal

from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

LINK, MOTOR = ("q", "dq", "ddq"), ("q_motor", "dq_motor", "ddq_motor")


def model_and_states(inputs, *, warm=False):
    """A model on recorded states, without the effects of temperature unless it is `warm`."""
    states = recorded_states()
    robot = _core.RobotModel.from_urdf(bundled_robot())
    effects = every_effect(robot.n_joints, np.random.default_rng(0))
    kept = [effect for effect in effects if warm or "temperature" not in effect[0].kind]
    return whole_model(robot, states, inputs, effects=kept), states


@pytest.mark.parametrize("inputs", [None, *RESIDUALS])
def test_it_is_the_total_to_the_last_bit(inputs):
    model, states = model_and_states(inputs)
    link, motor = [states[name] for name in LINK], [states[name] for name in MOTOR]
    for motion in (link, [*link, *motor]):
        many = [signal[300:400] for signal in motion]
        out = np.full_like(many[0], np.nan)
        assert model.torque(*many, out=out) is out
        assert_array_equal(out, model.evaluate(*many)[0])
        # Effects remember: one state alone is a run of its own, whatever was asked before.
        for k in (300, 17, 300):
            one = [signal[k : k + 1] for signal in motion]
            expected = model.evaluate(*one)[0]
            assert_array_equal(model.torque(*one), expected)
            assert_array_equal(model.torque(*(signal.tolist() for signal in one)), expected)


def test_two_models_in_turn_do_not_mix():
    (first, states), (second, _) = model_and_states(None), model_and_states("joint_state")
    one = [states[name][200:201] for name in LINK]
    expected = [model.evaluate(*one)[0] for model in (first, second)]
    assert not np.array_equal(*expected)
    for _ in range(2):
        for model, total in zip((first, second), expected, strict=True):
            assert_array_equal(model.torque(*one), total)


def test_what_it_refuses():
    model, states = model_and_states(None)
    one = [states[name][:1].copy() for name in LINK]
    with pytest.raises(ValueError, match=r"out must be a float64 array in C order of shape \(1, 6\)"):
        model.torque(*one, out=np.zeros((2, 6)))
    one[1][0, 3] = np.inf
    with pytest.raises(ValueError, match="dq holds inf at row 0, column 3"):
        model.torque(*one)
    warm, _ = model_and_states(None, warm=True)
    with pytest.raises(ValueError, match="follows a measured temperature"):
        warm.torque(*(states[name] for name in LINK))
