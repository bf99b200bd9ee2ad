"""Runs of which each torque channel is late by its own: fitted on the encoders' clock, predicted on the channels'."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured
from numpy.testing import assert_allclose

from dynid_rs.identification.results import score
from dynid_rs.identification.three_loops import ThreeLoopIdentifier

DELAYS = np.array([0.0, 0.012, -0.005])


def shown_late(run, delays):
    """The same run with every torque channel late by its own."""
    columns = zip(run.tau.T, delays, strict=True)
    return replace(run, tau=np.stack([np.interp(run.t - delay, run.t, column) for column, delay in columns], axis=1))


def errors(fit, run):
    return score(fit.model_, [fit.states(run)]).rmse


@pytest.mark.parametrize("delays", [DELAYS, np.full(3, 0.012)])
def test_each_channel_is_brought_to_the_clock_of_the_encoders(delays):
    *train, test = measured(n_runs=3)
    plain = ThreeLoopIdentifier(ROBOT, residual=None).fit(train)
    late = [shown_late(run, delays) for run in (*train, test)]
    told = ThreeLoopIdentifier(ROBOT, residual=None, torque_delay=delays).fit(late[:-1])
    assert_allclose(told.model_.torque_delay, delays)
    assert_allclose(errors(told, late[-1]), errors(plain, test), rtol=0.05)
    untold = ThreeLoopIdentifier(ROBOT, residual=None).fit(late[:-1])
    at = np.flatnonzero(delays)
    assert np.all(errors(untold, late[-1])[at] > 1.05 * errors(told, late[-1])[at])
    # Less a delay that is all of it the prediction is that of no delay.
    assert_allclose(told.predict(late[-1], torque_delay=delays), plain.predict(test), atol=0.5)


def test_one_number_is_that_of_all_channels():
    run = measured(n_runs=1)[0]
    np.testing.assert_array_equal(run.less_torque_delay(0.01).tau, run.less_torque_delay(np.full(3, 0.01)).tau)
    assert run.less_torque_delay(np.zeros(3)) is run
