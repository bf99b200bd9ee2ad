"""Effects as curves: over which signal, from which columns, how well known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dynid_rs.diagnosis.curves import ALONG_THE_MOTION, _drawn_over, _signal, _way, effect_plot
from dynid_rs.model.curves import binned
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.regression.error_interval import interval_of_change
from dynid_rs.report.axes import _SIGNALS
from dynid_rs.report.meanings import MEANINGS

N = 500


def _found(torque_unit: str = "N*m", **states: np.ndarray) -> Any:
    """As much of a belief as a plot looks at: two joints, one run."""
    run = SimpleNamespace(**states, rows=np.arange(N), t=np.arange(N))
    return SimpleNamespace(
        setup=SimpleNamespace(robot=SimpleNamespace(joint_names=["a", "b"], joint_kinds=["revolute"] * 2)),
        fit=SimpleNamespace(torque_unit_=torque_unit, links_=SimpleNamespace(torque_scale_=np.array([1.0, 0.5]))),
        catalogue=SimpleNamespace(runs=[run]),
    )


def drawn(effect: PlacedEffect, torque_unit: str = "N*m", **signals: np.ndarray) -> dict[str, Any]:
    """The plot of `effect` with coefficient 2 on a column of its own, which stands behind unknowns of other places."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(N, 3))
    x = np.array([0.0, 5.0, 2.0, 7.0])  # of unknowns 0 to 3; the effect's is number 2
    places = np.array([3, 2, 1])
    target = columns @ x[places] + 0.01 * rng.normal(size=N)
    model = SimpleNamespace(
        rows=[np.column_stack([columns, target])], places=[places], counted=[np.ones(N, dtype=bool)]
    )
    zero = np.zeros((N, 2))
    own = {name: np.column_stack([values, values]) for name, values in signals.items()}
    states = {"q": zero, "dq": zero + 1.0, "q_motor": zero, "dq_motor": zero, **own}
    found = _found(torque_unit, **states)
    fit = SimpleNamespace(covariance=np.diag([1.0, 1.0, 0.04, 1.0]))
    return {"column": columns[:, 1], **effect_plot(found, effect, model, fit, x, [(0, 2)], [])}


def test_an_effect_is_drawn_from_its_own_column() -> None:
    """Unknowns of a joint do not stand in their order: the joint's own come before those of all."""
    q = np.linspace(-1.0, 1.0, N)
    plot = drawn(PlacedEffect.at("joint_spring", 0, rest_position=0.0), q=q)
    assert (plot["signal"], plot["unit"], plot["quantity"]) == ("q_a", "rad", "torque")
    means = [part.mean() for part in np.array_split(plot["column"], len(plot["curve"]))]
    assert_allclose(plot["curve"], 2.0 * np.array(means), atol=1e-12)
    assert_allclose(plot["mean"], plot["curve"], atol=0.02)
    half = 1.96 * 0.2 * np.abs(means)
    assert_allclose(np.array(plot["curve_high"]) - plot["curve"], half, rtol=1e-3)


def test_friction_is_drawn_in_the_direction_of_motion() -> None:
    dq = np.where(np.arange(N) % 2, 1.0, -1.0)
    load = np.linspace(-1.0, 1.0, N)
    plot = drawn(PlacedEffect.at("load_dependent_friction", 0, transition_width=0.01), dq=dq, tau_link=load)
    assert plot["quantity"] == "friction_torque"
    means = [part.mean() for part in np.array_split(dq * plot["column"], len(plot["curve"]))]
    assert_allclose(plot["curve"], 2.0 * np.array(means), atol=1e-12)


@pytest.mark.parametrize("torque_unit", ["N*m", "A"])
@pytest.mark.parametrize("kind", ["load_dependent_friction", "load_hysteresis", "gear_hysteresis"])
def test_the_load_of_a_gear_is_in_the_unit_of_the_torque_channel(kind: str, torque_unit: str) -> None:
    """Masses of a model that was learned in ampere are in ampere too, and so is what the gear carries."""
    load = np.linspace(-1.0, 1.0, N)
    plot = drawn(PlacedEffect(kind, (0,), {}), torque_unit, tau_link=load)
    assert (plot["signal"], plot["unit"]) == ("tau_link_a", torque_unit)


@pytest.mark.parametrize("place", [0, 1])
def test_what_the_joint_beside_makes_is_drawn_over_its_torque(place: int) -> None:
    other = 1 - place
    loads = np.stack([np.linspace(-1.0, 1.0, N), np.linspace(3.0, 5.0, N)], axis=1)
    effect = PlacedEffect.at("bearing_friction", place, side=float(other - place))
    name, unit, values = _signal(_found(tau_link=loads), effect, np.zeros(N))
    assert (name, unit) == ("tau_link", "{torque}")
    assert_allclose(values, loads[:, other] * [1.0, 0.5][other])  # as the neighbour's channel shows it
    assert _drawn_over(effect) == other


def test_a_coupling_is_drawn_over_the_acceleration_that_makes_it() -> None:
    pair = PlacedEffect("inertial_coupling", (0, 1), (("partner", (1.0, 0.0)),))
    assert drawn(pair, ddq=np.linspace(-1.0, 1.0, N))["signal"] == "ddq_b"
    accelerations = np.stack([np.linspace(-1.0, 1.0, N), np.linspace(3.0, 5.0, N)], axis=1)
    name, _, values = _signal(_found(ddq=accelerations), pair, np.zeros(N))
    assert name == "ddq"
    assert_allclose(values, accelerations[:, 1])  # a channel's gain is none of a motion's


def test_what_goes_round_often_is_drawn_over_one_cycle() -> None:
    q = np.linspace(0.0, 6.0, N)
    plot = drawn(PlacedEffect.at("torque_ripple", 0, cycles=40.0), q=q, q_motor=q)
    assert plot["signal"] == "angle_in_cycle_a"
    assert 0.0 <= min(plot["x"]) < max(plot["x"]) <= 2 * np.pi / 40
    assert max(plot["x"]) > 0.9 * 2 * np.pi / 40


def test_way_since_the_last_reversal() -> None:
    q = np.array([0.0, 1.0, 2.0, 1.5, 1.0, 1.25, 1.75])
    states: Any = SimpleNamespace(q_motor=q[:, None], rows=np.arange(len(q)))
    assert_allclose(_way(states, 0), [np.nan, np.nan, 0.0, 0.5, 0.0, 0.25, 0.75])


def test_few_rows_make_few_bins() -> None:
    few = binned(np.arange(3.0), np.arange(3.0), np.ones((3, 1)), np.array([2.0]), np.zeros((1, 1)))
    assert few["curve"] == [2.0]
    assert few["mean"] == [1.0]
    none = binned(np.empty(0), np.empty(0), np.empty((0, 1)), np.array([2.0]), np.zeros((1, 1)))
    assert none["x"] == none["curve"] == []


@pytest.mark.parametrize("kind", [kind for kind, entry in CATALOGUE.items() if entry["sought"]])
def test_every_kind_that_is_sought_has_words(kind: str) -> None:
    assert kind in MEANINGS
    drawn_against = CATALOGUE[kind]["drawn_against"]
    assert drawn_against is None or drawn_against[0] in _SIGNALS
    assert set(CATALOGUE) >= ALONG_THE_MOTION


def test_interval_of_a_change_from_errors() -> None:
    """What an effect brings is told from what it does not."""
    rng = np.random.default_rng(1)
    noise = rng.normal(size=2000)
    wave = np.sin(np.arange(2000) / 3)
    helps, nothing = interval_of_change([noise, noise], [noise + wave, noise + 1e-3 * rng.normal(size=2000)])
    assert helps is not None
    assert helps[1] < 0.0
    assert nothing is not None
    assert nothing[0] < 0.0 < nothing[1]
