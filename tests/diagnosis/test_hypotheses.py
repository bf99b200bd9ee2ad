"""Hypotheses on two joints: forces between them act on both by their power."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured
from numpy.testing import assert_allclose

from dynid_rs import _core
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import Catalogue
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.model.placed import CATALOGUE, effects_of
from dynid_rs.regression.linear_model import Choice
from dynid_rs.regression.priors import REACTION, weak_prior

ELBOW, WRIST = 1, 2
RATIO, WIDTH = -0.4, 0.02


def coupled() -> Shaped:
    return Shaped(
        "coupled_friction", (ELBOW, WRIST), (("partner", -1.0), ("ratio", RATIO), ("transition_width", WIDTH))
    )


def columns_at_full_rate(shaped: Shaped, states, j: int) -> np.ndarray:
    """Torque on joint j per coefficient of its own, (n, k)."""
    ((effect, _),) = effects_of([shaped.placed()], ROBOT.n_joints)
    return _core.effect_columns(effect, *states.signals(), joints=[j])[:, 0]


def test_a_stage_takes_the_power_of_its_own_speed():
    """dq_j tau_j + dq_p tau_p = u (k s(u) + d u), whatever the ratio."""
    (run,) = measured(duration=8.0, n_runs=1)
    states = Belief.in_declared(Setup(ROBOT), [run]).fit.runs_[0]
    own = np.array([0.7, 0.2])
    power = 0.0
    for place, j in enumerate((ELBOW, WRIST)):
        tau = columns_at_full_rate(coupled(), states, j) @ (own * coupled().reaction(place))
        power = power + states.dq_motor[:, j] * tau
    u = states.dq_motor[:, ELBOW] + RATIO * states.dq_motor[:, WRIST]
    assert_allclose(power, u * (own[0] * np.tanh(u / WIDTH) + own[1] * u), rtol=1e-9, atol=1e-12)


def test_a_bearing_is_under_the_joints_beside_it():
    """Before and behind, where there is one."""
    grid = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1)).catalogue.grid
    sides = {(s.joints[0], dict(s.shape)["side"]) for s in grid if s.kind == "bearing_friction"}
    assert sides == {(0, 1.0), (1, -1.0), (1, 1.0), (2, -1.0)}


def test_inertia_couples_two_joints_alike():
    """The mass matrix is symmetric."""
    shaped = Shaped("inertial_coupling", (ELBOW, WRIST), (("partner", -1.0),))
    assert_allclose(shaped.reaction(1), shaped.reaction(0))


@pytest.mark.parametrize("kind", [kind for kind, entry in CATALOGUE.items() if entry["places"] != "joint"])
def test_every_kind_on_two_joints_says_how_it_acts_on_both(kind):
    assert len(CATALOGUE[kind]["reaction"]) == len(CATALOGUE[kind]["coefficients"])


def test_a_force_between_two_joints_is_one_unknown_whatever_their_channels_show():
    """In amperes the same torque is another current on either joint."""
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1))
    (h,) = belief.catalogue.of([coupled()])
    assert h.names == ("coupled_friction", "coupled_viscous")
    own = np.array([0.7, 0.2])
    torque = belief.catalogue.torque(coupled(), np.concatenate([own, own * coupled().reaction(1)]))
    for j in (ELBOW, WRIST):
        assert_allclose(torque[j], h.columns[j] @ (own / h.unit), rtol=1e-9, atol=1e-12)
    gains = np.array([1.0, 2.0, 0.5])
    links = replace_links(belief, gains)
    (scaled,) = links.catalogue.of([coupled()])
    ratio = np.linalg.norm(scaled.columns[WRIST], axis=0) / np.linalg.norm(scaled.columns[ELBOW], axis=0)
    before = np.linalg.norm(h.columns[WRIST], axis=0) / np.linalg.norm(h.columns[ELBOW], axis=0)
    assert_allclose(ratio, before * gains[WRIST] / gains[ELBOW], rtol=1e-9)


def replace_links(belief: Belief, gains: np.ndarray) -> Belief:
    """The same belief, its channels showing `gains` times the torque."""
    fit = copy(belief.fit)
    fit.links_ = copy(fit.links_)
    fit.links_.torque_scale_ = gains
    return replace(belief, fit=fit, catalogue=Catalogue(fit))


@pytest.mark.parametrize("gains", [np.ones(3), np.array([1.0, 2.0, 0.5])])
def test_beforehand_one_joint_tells_what_the_other_feels_but_for_a_tenth(gains):
    effect = coupled().placed()
    fit = Setup(ROBOT, effects=(effect,)).identifier(residual=None).fit(measured(duration=8.0, n_runs=1))
    observations = fit.observations_
    prior = weak_prior(observations.plan, observations.factors(), observations.n_rows, gains)
    ((_, elbow), _, (_, wrist), _) = Belief.in_declared(Setup(ROBOT, effects=(effect,)), [], fit).places()[0]
    rows = prior.rows(Choice())[0][:, [elbow, wrist]]
    covariance = np.linalg.inv(rows.T @ rows)
    share = abs(RATIO) * gains[WRIST] / gains[ELBOW]
    assert covariance[0, 1] / covariance[0, 0] == pytest.approx(share)
    assert covariance[1, 1] == pytest.approx(covariance[0, 0] * share**2 * (1 + REACTION**2))


def test_friction_under_load_is_sought_on_an_upright_axis_too():
    """Its gear carries inertia alone."""
    places = {(s.kind, s.joints) for s in Belief.in_declared(Setup(ROBOT), measured(n_runs=2)).catalogue.grid}
    assert {("load_dependent_friction", (j,)) for j in range(3)} <= places
