"""Searches that end in a wrong valley: frames far from their place, patched cylinders, ripple at half its order."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_search import ARM, ROBOT, measured, start

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidate import stacked
from dynid_rs.diagnosis.deflection_entries import ECCENTRICITY, seen_again
from dynid_rs.diagnosis.hypothesis import Hypothesis
from dynid_rs.diagnosis.intervals import estimates
from dynid_rs.diagnosis.kinds import RIPPLES
from dynid_rs.diagnosis.one_cylinder import without_patches
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shape_search import refined_shape
from dynid_rs.diagnosis.structural.kinematic_error import USUAL, spread
from dynid_rs.diagnosis.valleys import mirrored, pulls
from dynid_rs.diagnosis.wrong_geometry import with_other_geometry
from dynid_rs.placed import PlacedEffect
from dynid_rs.simulation import build_effects, parse_wish, typical_arm

ELBOW = 1
CYLINDER = {"a": 1.0, "b": 0.5, "phase": 0.4, "gas_length": 1.25}
FAR = 12
"""Multiple of the laboratory's wrong frame: some centimetres and a tenth of a radian."""


def power_beside(beside, bounds):
    return lambda columns: beside.gains(columns, [slice(None)], [bounds])[0].power


def own_shape(wish):
    """Effect of the laboratory: its shape on the joint that it acts on."""
    (effect,) = build_effects([parse_wish(wish)], typical_arm(ROBOT))
    return {name: float(values[effect.joints[0]]) for name, values in effect.shape.items()}


def test_ripple_at_half_its_order_is_told_at_its_own():
    wish = "torque_ripple:elbow:3"
    true = own_shape(wish)["cycles"]
    state = start(Setup(ROBOT), measured(wish, n_runs=3))
    half = Hypothesis("torque_ripple", (ELBOW,), (("cycles", true / 2),))
    power = power_beside(Beside(state.fit), np.tile([-np.inf, np.inf], (4, 1)))
    found = dict(refined_shape(state.kinds, half, power, own_order=True).shape)["cycles"]
    assert found == pytest.approx(true, abs=0.1)


def test_a_spring_beside_a_cylinder_of_the_wrong_shape_goes_and_real_ripple_stays():
    own = own_shape("counterbalance:elbow:2")
    runs = measured("counterbalance:elbow:2", n_runs=3)
    wrong = PlacedEffect.at("counterbalance", ELBOW, **own | {"b": 0.9 * own["b"], "gas_length": 5.0})
    spring = PlacedEffect.at("joint_spring", ELBOW, rest_position=0.0)
    simpler = without_patches(start(Setup(ROBOT, effects=(wrong, spring)), runs))
    assert [effect.kind for effect in simpler.effects] == ["counterbalance"]

    teeth = own_shape("torque_ripple:elbow:3")
    both = measured("counterbalance:elbow:2", "torque_ripple:elbow:3", n_runs=3)
    effects = (PlacedEffect.at("counterbalance", ELBOW, **own), PlacedEffect.at("torque_ripple", ELBOW, **teeth))
    assert teeth["cycles"] < RIPPLES[1]
    state = start(Setup(ROBOT, effects=effects), both)
    assert without_patches(state) is state.setup


def test_a_short_cylinder_has_a_mirror_image_and_a_long_one_has_none():
    runs = measured("counterbalance:elbow:2", n_runs=3)
    state = start(Setup(ROBOT), runs)
    own = Hypothesis("counterbalance", (ELBOW,), tuple(own_shape("counterbalance:elbow:2").items()))
    beside = Beside(state.fit)
    assert pulls(own)
    assert mirrored(beside, state.kinds, own) is None
    assert mirrored(beside, state.kinds, Hypothesis("joint_spring", (ELBOW,), (("rest_position", 0.0),))) is None
    # With noise a hundred times as large nothing tells which of the two it is.
    rng = np.random.default_rng(0)
    loud = [replace(run, tau=run.tau + rng.normal(0, 100 * ARM.noise_std, run.tau.shape)) for run in runs]
    state = start(Setup(ROBOT), loud)
    other = mirrored(Beside(state.fit), state.kinds, own)
    assert other is not None
    assert not pulls(other)


def test_a_frame_far_from_its_place_is_put_back_and_a_true_one_stays():
    wish = f"kinematic_error:elbow:{FAR}"
    runs = measured(wish, n_runs=3)
    setup = Setup(ROBOT)
    state = start(setup, runs)
    found = with_other_geometry(state, setup, runs)
    assert found.steps[0].action == "added"
    assert found.steps[0].choice.weighed.candidate.place == ("kinematic_error", (ELBOW,))
    before, after = (Beside(s.fit).residual.std(axis=0) for s in (state, found))
    assert np.all(after < 0.9 * before)
    assert found.steps[0].choice.p_value < 1e-6

    true = start(setup, measured(n_runs=3))
    assert with_other_geometry(true, setup, measured(n_runs=3)) is true


def test_what_no_torque_shows_of_a_frame_may_be_as_far_out_as_what_is_seen():
    assert np.array_equal(spread(np.zeros(6)), USUAL)
    assert spread(np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0])) == pytest.approx(10 * USUAL)


def test_an_encoder_error_that_was_corrected_is_still_told():
    disc, gap, disc_again = (
        SimpleNamespace(kind=kind, joints=(j,)) for kind, j in ((ECCENTRICITY, 0), ("backlash", 1), (ECCENTRICITY, 0))
    )
    assert seen_again([gap, disc_again], [disc]) == [disc, gap]
    assert seen_again([gap], []) == [gap]


def test_what_follows_the_load_is_as_unsure_as_the_rotors_share():
    state = start(Setup(ROBOT), measured("torque_saturation:shoulder:3", n_runs=3))
    hypothesis = Hypothesis("torque_saturation", (0,), ())
    beside = Beside(state.fit)
    columns = stacked(state.kinds.columns([hypothesis])[0])
    x = beside.gains(columns, [slice(None)], [np.array([[-np.inf, np.inf]])])[0].coefficients
    friction = state.fit.links_.own_[:, state.fit.observations_.plan.friction[1]]
    assert state.kinds.hidden_rotor[0] > 0  # nothing but its axis sees the first joint's rotor
    (wide,) = estimates(beside, state.kinds, hypothesis, x, friction)
    state.kinds.hidden_rotor[:] = 0.0
    (narrow,) = estimates(beside, state.kinds, hypothesis, x, friction)
    assert wide.interval[0] <= narrow.interval[0] < wide.value < narrow.interval[1] <= wide.interval[1]
    assert np.ptp(wide.interval) > np.ptp(narrow.interval)
