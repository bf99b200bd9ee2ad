"""Late torque channels: one name where all share a clock, one for each joint where they do not."""

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.one_clock import _log_density, share_a_clock
from dynid_rs.diagnosis.search import accept, name
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.standing import sized, standing
from dynid_rs.diagnosis.structural import structural_hypotheses

TOGETHER = ("torque_delay", (0, 1, 2))


def late(delays, **options):
    """Runs of a rigid arm whose torque channels are late by `delays` [s]."""
    return [recording.less_torque_delay(-np.asarray(delays)) for recording in measured(n_runs=2, **options)]


def named_alone(runs, joints):
    """What is believed once single joints have been named late, one by one."""
    belief = Belief.in_declared(Setup(ROBOT), runs)
    _, *alone = structural_hypotheses(belief.fit, belief.setup, ["torque_delay"])
    accept(belief, [Named(h, 20.0) for h in alone if h.joints[0] in joints], set())
    return belief


def test_alike_on_all_joints_is_one_name():
    belief = named_alone(late([0.012] * 3), (0, 1, 2))
    assert share_a_clock(belief)
    assert set(belief.named) == {TOGETHER}
    assert_allclose(belief.setup.torque_delay, 0.012, atol=5e-4)
    assert_allclose(belief.setup.own_delay, 0.0)
    assert standing(belief)[TOGETHER] > 20.0
    assert not share_a_clock(belief)  # there is no more than one


def test_a_joint_that_nothing_was_said_of_is_late_with_the_others():
    belief = named_alone(late([0.012] * 3), (1, 2))
    assert share_a_clock(belief)
    assert set(belief.named) == {TOGETHER}
    assert_allclose(belief.setup.delays, 0.012, atol=5e-4)


@pytest.mark.parametrize("delays", [[0.012, 0.0, 0.012], [0.006, 0.012, 0.018]])
def test_others_keep_a_name_each(delays):
    at = [j for j, delay in enumerate(delays) if delay]
    belief = named_alone(late(delays), at)
    assert not share_a_clock(belief)
    assert set(belief.named) == {("torque_delay", (j,)) for j in at}
    assert_allclose(belief.setup.delays, delays, atol=1e-3)


def test_one_name_has_nothing_to_share():
    belief = named_alone(late([0.0, 0.012, 0.0]), (1,))
    assert not share_a_clock(belief)


def test_a_delay_of_no_size_goes():
    belief = named_alone(late([0.0, 0.012, 0.0]), (0, 1))
    sized(belief)
    assert set(belief.named) == {("torque_delay", (1,))}
    assert_allclose(belief.setup.own_delay[[0, 2]], 0.0)


def test_the_search_comes_to_one_clock():
    belief = Belief.in_declared(Setup(ROBOT), late([0.012] * 3))
    name(belief, lambda step: None)
    assert {place for place in belief.named if place[0] == "torque_delay"} == {TOGETHER}


def test_a_condition_is_as_probable_as_its_density():
    rng = np.random.default_rng(3)
    x, root = rng.normal(size=4), rng.normal(size=(4, 4))
    S, condition = root @ root.T, rng.normal(size=(2, 4))
    after = multivariate_normal(condition @ x, condition @ S @ condition.T).logpdf(np.zeros(2))
    before = multivariate_normal(np.zeros(2), condition @ condition.T).logpdf(np.zeros(2))
    assert _log_density(condition, x, S) == pytest.approx(after - before)
    assert _log_density(condition[:0], x, S) == 0.0
