"""A fit that begins where one of nearly the same model ended is the fit that begins from nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, SIX_AXES, measured
from numpy.testing import assert_allclose
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from dynid_rs.identification.loads import has_settled, with_load
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import PlacedEffect

SHAPES = np.full(3, 0.02), np.full(3, 2.5)


def identifier(width):
    effects = [
        PlacedEffect("load_hysteresis", (1,), (("presliding_distance", (width,)),)),
        PlacedEffect("torque_saturation", (2,)),
    ]
    friction = SmoothFrictionIdentifier(SHAPES, held=True)
    return ThreeLoopIdentifier(ROBOT, effects=effects, friction=friction, friction_law="smooth", residual=None)


@pytest.fixture(scope="module")
def runs():
    return measured("load_hysteresis:elbow:2", "torque_saturation:wrist:2", n_runs=2, duration=8.0)


def test_near_itself_nothing_moves_and_nothing_is_chosen_again(runs, monkeypatch):
    first = identifier(0.01).fit(runs)

    def choose(*_):
        raise AssertionError("the prior is known")

    monkeypatch.setattr("dynid_rs.regression.evidence._likeliest", choose)
    again = identifier(0.01).fit(runs, near=first)
    assert again.links_.posterior_.choice == first.links_.posterior_.choice
    assert_allclose(again.links_.posterior_.n_effective, first.links_.posterior_.n_effective)
    assert_allclose(again.links_.x_, first.links_.x_, rtol=1e-4, atol=1e-6 * np.abs(first.links_.x_).max())


def test_near_another_shape_the_fit_is_that_from_nothing(runs):
    first = identifier(0.01).fit(runs)
    near, fresh = identifier(0.013).fit(runs, near=first), identifier(0.013).fit(runs)
    assert_allclose(near.links_.posterior_.n_effective, first.links_.posterior_.n_effective)
    assert_allclose(near.links_.noise_std_, fresh.links_.noise_std_, rtol=5e-3)  # samples are worth a little else


@pytest.mark.parametrize("near", [False, True])
def test_the_loads_that_a_fit_was_asked_with_are_those_that_it_gives(runs, near):
    fit = identifier(0.01).fit(runs, near=identifier(0.012).fit(runs) if near else None)
    loaded = with_load(fit.observations_.plan, fit.links_, fit.links_.own_)
    given = [loaded(states) for states in fit.runs_]
    assert has_settled(fit.runs_, given)
    for name in ("tau_link", "tau_motor"):
        for joint in range(3):
            moved = [
                replace(states, **{name: getattr(states, name) * (1 + 1e-5 * (np.arange(3) == joint))})
                for states in given
            ]
            assert not has_settled(moved, given)


def test_a_fit_of_other_joints_is_refused(runs):
    first = identifier(0.01).fit(runs)
    other = ThreeLoopIdentifier(SIX_AXES, residual=None)
    with pytest.raises(ValueError, match="near is a fit of other joints"):
        other.fit(measured(robot=SIX_AXES, n_runs=1, duration=8.0), near=first)
    with pytest.raises(ValueError, match="runs, free gains"):
        identifier(0.01).fit(runs[:1], near=first)
    with pytest.raises(ValueError, match="runs, free gains"):
        clone(first).set_params(free_gains=(1,)).fit(runs, near=first)
    with pytest.raises(NotFittedError):
        identifier(0.01).fit(runs, near=identifier(0.01))
