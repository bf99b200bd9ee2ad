"""Fleets of arms whose torques are currents: gains are fitted beside all else, and told from friction and loads."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from helpers.small_arm import URDF

from dynid_rs import ArmEstimate, Fleet, Recording, RobotModel, ThreeLoopIdentifier
from dynid_rs.identification.results import evaluate_runs, summarise
from dynid_rs.pooling.gains import gain_response
from dynid_rs.regression.evaluation import band_rmse, compare

ROBOT = RobotModel.from_urdf_string(URDF)
GAINS = np.array([20.0, 15.0, 6.0])
N_ARMS = 14


def recordings(seed, shows=(1.0, 1.0, 1.0), friction=(1.0, 1.0, 1.0)):
    """Three runs [A] of an arm that shows `shows` times the current, with so many times the friction."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 12.0, 0.01)
    gain = GAINS / shows * np.exp(0.02 * rng.normal(size=3))
    coulomb = np.array([4.0, 3.0, 1.0]) * friction * np.exp(0.05 * rng.normal(size=3))
    w = 2 * np.pi * np.array([0.13, 0.31, 0.47])
    for k in range(3):
        angle = t[:, None, None] * w + np.random.default_rng(100 + k).uniform(0, 2 * np.pi, (3, 3))
        q, dq, ddq = (0.4 * np.sum(x, axis=2) for x in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
        tau = ROBOT.inverse_dynamics(q, dq, ddq, ROBOT.phi) + coulomb * np.tanh(dq / 0.02) + dq * friction
        noise = rng.normal(size=tau.shape) * [0.7, 0.7, 0.35]
        yield Recording(t, q, tau=(tau + noise) / gain, name=f"run_{k}", torque_unit="A")


def fitted(runs):
    return ThreeLoopIdentifier(ROBOT, friction_law="coulomb_viscous", residual=None).fit(runs)


@functools.cache
def arm(seed, *change):
    """Estimate of an arm, its model, and states of a run that it has not seen."""
    *train, unseen = recordings(seed, *change)
    fit = fitted(train)
    test = [fit.states(unseen)]
    told = [evaluate_runs(fit.model_, *pair) for pair in ((train, fit.raw_runs_), ([unseen], test))]
    return ArmEstimate.of(f"arm_{seed}", fit, summarise(fit, *told, [])), fit.model_, test


@pytest.mark.parametrize("j", range(3))
def test_a_gain_moves_scales_and_links_as_its_response_says(j):
    """Another fit, of runs whose channel shows 0.1 % more; the first joint's holds the unit."""
    runs = list(recordings(0))[:2]
    more = np.where(np.arange(3) == j, 1.001, 1.0)
    one, other = fitted(runs), fitted([replace(run, tau=run.tau * more) for run in runs])
    found = np.append(other.links_.x_ - one.links_.x_, np.log(other.links_.torque_scale_ / one.links_.torque_scale_))
    std = np.sqrt(np.diag(one.covariance_with_gains()))
    found, said, std = found[std > 0] / 1e-3, gain_response(one)[j, std > 0], std[std > 0]
    assert np.linalg.norm((found - said) / std) < 0.1 * np.linalg.norm(said / std)


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (((1.3, 1.0, 1.0),), ("gain", "shoulder")),
        (((1.0, 1.35, 1.0),), ("gain", "elbow")),
        (((1.0, 1.0, 1.0), (1.0, 1.5, 1.0)), ("friction", "elbow")),
        (((1.3, 1.3, 1.3),), ("gain", "all joints")),
    ],
)
def test_gain_and_friction_are_told_apart(change, wanted):
    arms = [arm(seed)[0] for seed in range(N_ARMS)]
    (odd,) = Fleet().fit([*arms, arm(77, *change)[0]]).odd()
    assert odd.name == "arm_77"
    assert [(cause.kind, cause.place) for cause in odd.causes] == [wanted]


def test_no_arm_is_odd_and_pooled_models_are_better():
    """Links and torque scales are drawn to the type together."""
    arms = [arm(seed) for seed in range(N_ARMS)]
    fleet = Fleet().fit([estimate for estimate, _, _ in arms])
    assert fleet.odd() == []
    errors = np.array(
        [
            [
                band_rmse([compare(states, one.evaluate(*states.signals())[0]) for states in test])
                for one in (model, fleet.model(estimate.name, model))
            ]
            for estimate, model, test in arms
        ]
    )
    own, pooled = errors.mean(axis=0)
    assert np.all(pooled < own)
