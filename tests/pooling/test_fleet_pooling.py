"""A fleet whose odd arms are known: they are named with their causes, the others are not, and all get better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns.fleet_arms import N_TEST, N_TRAIN, Odd
from campaigns.fleet_judge import true_quantities
from helpers.pooled_arms import N_ARMS, PLANTED, drawn, identified
from scipy.stats import binom

import dynid_rs as dyn
from dynid_rs import Fleet
from dynid_rs.pooling.causes import Cause
from dynid_rs.pooling.quantities import quantities
from dynid_rs.pooling.words import sentence_of

UNSEEN = f"run_{N_TRAIN + N_TEST}.parquet"


def test_odd_arms_are_named_with_their_causes_and_no_other():
    fleet = identified().fleet
    verdicts = list(fleet.verdicts_.values())
    assert [k for k, verdict in enumerate(verdicts) if verdict.odd] == sorted(PLANTED)
    for number, odd in PLANTED.items():
        causes = verdicts[number].causes
        assert [(cause.kind, cause.place) for cause in causes] == [(odd.kind, odd.place)]
        assert sum(map(len, verdicts[number].why)) > 0
        size = causes[0].change if odd.kind in ("friction", "gain") else causes[0].size
        # The arm's own deviation from its type is in it: 10 % of a friction that is 2.2 times the type's, and so on.
        own = {"friction": 0.3, "gain": 0.08, "offset": 1.5, "load": 0.15}[odd.kind]
        assert size == pytest.approx(odd.size, abs=2 * own)
    assert {verdict.name for verdict in fleet.odd()} == {verdicts[number].name for number in PLANTED}
    assert fleet.odd()[0].deviations == max(verdict.deviations for verdict in fleet.odd())


def test_several_causes_of_one_arm():
    """Friction of one joint and a load on the hand, put into the estimates themselves."""
    arms = drawn(np.random.default_rng(1), 30)
    arm = arms[4]
    x = arm.x.copy()
    for name in arm.friction_names:
        if (place := arm.own(0, name)) is not None:
            x[place] *= 2.5
    x[: arm.n_base] += arm.regrouping[:, 20:30] @ (0.9 * np.array([1, 0.12, 0.02, 0.01, *6 * [0.0]]))
    arms[4] = replace(arm, x=x)
    verdict = Fleet().fit(arms).verdicts_["arm_4"]
    assert {(cause.kind, cause.place) for cause in verdict.causes} == {("friction", "shoulder"), ("load", "hand")}
    load = next(cause for cause in verdict.causes if cause.kind == "load")
    assert load.size == pytest.approx(0.9, abs=4 * load.std_error)


def test_a_gain_of_all_joints_is_one_cause():
    arms = drawn(np.random.default_rng(2), 30)
    arms[7] = replace(arms[7], x=arms[7].x + 0.25 * arms[7].gain_response.sum(axis=0))
    (cause,) = Fleet().fit(arms).verdicts_["arm_7"].causes
    assert (cause.kind, cause.place) == ("gain", "all joints")


def test_an_error_that_no_parameter_explains():
    arms = drawn(np.random.default_rng(3), 30)
    arms[2] = replace(arms[2], error=arms[2].error * [1.0, 25.0, 1.0])
    arms[3] = replace(arms[3], error=arms[3].error / 25.0)  # better than its like: not odd
    verdicts = Fleet().fit(arms).verdicts_
    (cause,) = verdicts["arm_2"].causes
    assert (cause.kind, cause.place) == ("error", "elbow")
    assert cause.change > 3
    assert verdicts["arm_3"].odd is False


def test_false_alarms_of_the_whole_fleet():
    """Thirty fleets without odd arms, a rate of one in four: not more are named than that, but for chance."""
    rate, n_fleets = 0.25, 30
    named = sum(bool(Fleet(rate).fit(drawn(np.random.default_rng(100 + k), 14)).odd()) for k in range(n_fleets))
    assert named <= binom.isf(1e-3, n_fleets, rate)


def test_pooled_estimates_are_nearer_to_the_truth():
    """Base parameters of arms without anything odd: squared error in standard errors, and intervals that hold."""
    found = identified()
    alone, pooled, held = [], [], []
    for number, arm in enumerate(found.estimates):
        if number in PLANTED:
            continue
        truth = np.array([value for _, value in sorted_base(found.arms[number])])
        x, covariance = found.fleet.shrunken(arm.name)
        std = np.sqrt(np.diag(arm.covariance))[: arm.n_base]
        alone.append(((arm.x[: arm.n_base] - truth) / std) ** 2)
        pooled.append(((x[: arm.n_base] - truth) / std) ** 2)
        held.append(np.abs(x[: arm.n_base] - truth) < 1.96 * np.sqrt(np.diag(covariance))[: arm.n_base])
    assert np.mean(pooled) < 0.8 * np.mean(alone)
    assert 0.88 < np.mean(held) < 0.99


def sorted_base(arm):
    return sorted(true_quantities(arm).items(), key=lambda pair: int(pair[0][1]))


def test_pooled_models_are_no_worse_on_runs_that_nobody_saw():
    found = identified()
    errors = []
    for number, arm in enumerate(found.estimates):
        own = dyn.TorqueModel.load(found.output / arm.name / "model.json")
        run = dyn.read_recording(found.folder / arm.name / UNSEEN, own.robot)
        pooled = found.fleet.model(arm.name, own)
        errors.append([np.sqrt(1 - model.score(run)) for model in (own, pooled)])
        if number in PLANTED:  # not drawn to what it is not
            assert errors[-1][1] == pytest.approx(errors[-1][0], rel=1e-6)  # estimates are kept to nine digits
            errors.pop()
    errors = np.array(errors)
    assert errors[:, 1].mean() < errors[:, 0].mean()
    assert np.mean(errors[:, 1] < errors[:, 0]) > 0.6


def test_the_model_of_another_arm_is_refused():
    found = identified()
    own = dyn.TorqueModel.load(found.output / "arm_0000" / "model.json")
    bare = dyn.TorqueModel(
        own.robot, own.phi, own.effects[:1], encoder_delay=[0.0] * 3, noise_std=[1.0] * 3, domain=own.domain
    )
    with pytest.raises(ValueError, match="is it another arm's"):
        found.fleet.model("arm_0000", bare)
    with pytest.raises(KeyError):
        found.fleet.shrunken("nobody")


def test_too_few_arms_are_said():
    arms = identified().estimates
    fleet = Fleet().fit(arms[:6])
    assert {verdict.odd for verdict in fleet.verdicts_.values()} == {None}
    assert fleet.least_arms_ > 6
    assert fleet.verdicts_["arm_0003"].why == (
        f"too few arms of this type to say: 6, and {fleet.least_arms_} are needed",
    )
    # A small type takes no part of the rate, and its estimates are pooled all the same.
    other = [replace(arm, name=f"other_{k}", type="other") for k, arm in enumerate(arms[:4])]
    both = Fleet().fit([*arms, *other])
    assert both.n_tests_ == identified().fleet.n_tests_
    assert both.verdicts_["other_1"].odd is None
    assert both.shrunken("other_1")[0].shape == arms[0].x.shape
    # Nor is one judged that would only be large enough if it took none.
    alone = identified().fleet
    border = [replace(arm, name=f"border_{k}", type="border") for k, arm in enumerate(arms[: alone.least_arms_])]
    whole = Fleet().fit([*arms, *border])
    judged = {one.name: one.n_arms >= whole.least_arms_ for one in whole.types_}
    assert judged == {arms[0].type: True, "border": False}
    assert whole.n_tests_ == alone.n_tests_
    # Many that are not judged do not keep others from it.
    lone = [replace(arms[0], name=f"lone_{k}", type=f"lone_{k}") for k in range(100)]
    many = Fleet().fit([*arms[: alone.least_arms_], *lone])
    assert many.verdicts_["arm_0000"].odd is not None
    one = Fleet().fit(arms[:1])
    np.testing.assert_allclose(one.shrunken("arm_0000")[0], arms[0].x)
    np.testing.assert_allclose(one.shrunken("arm_0000")[1], arms[0].covariance)


def test_robots_of_one_name_that_are_not_alike_are_two_types():
    arms = identified().estimates
    other = [replace(arm, name=f"x{arm.name}", kinematics="other") for arm in arms]
    fleet = Fleet().fit([*arms, *other])
    assert [one.name for one in fleet.types_] == ["light_arm", "light_arm (2)"]
    assert [one.n_arms for one in fleet.types_] == [N_ARMS, N_ARMS]


def test_an_arm_of_another_form_is_left_alone():
    arms = identified().estimates
    strange = replace(arms[0], torque_unit="A")
    fleet = Fleet().fit([strange, *arms[1:]])
    assert fleet.verdicts_["arm_0000"].odd is None
    assert (
        "not pooled: it has other joints, parameters, units or another law of friction"
        in fleet.verdicts_["arm_0000"].why[0]
    )
    assert fleet.verdicts_["arm_0003"].odd


def test_the_order_of_the_arms_changes_nothing():
    arms = identified().estimates
    backwards = Fleet().fit(arms[::-1]).verdicts_
    for name, verdict in identified().fleet.verdicts_.items():
        assert backwards[name].why == verdict.why
        assert backwards[name].deviations == pytest.approx(verdict.deviations, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda arms: Fleet(0.0).fit(arms), "false_alarms must be a probability"),
        (lambda arms: Fleet().fit([]), "there is no arm to pool"),
        (lambda arms: Fleet().fit([*arms, arms[3]]), "the arm 'arm_0003' is there twice"),
    ],
)
def test_what_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        given(identified().estimates)


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        (
            Cause("friction", "elbow", "friction", 0.34, 4.1, 1.2, "N*m", 9.4, 12.1, 1.1, 0.8, "rad/s"),
            "elbow: friction +34 % (type 12.1 +- 1.1 N*m at 0.80 rad/s, 9.4 deviations)",
        ),
        (
            Cause("friction", "lift", "friction", -0.2, -40.0, 3.0, "N", -8.0, 200.0, 4.0, 0.1, "m/s"),
            "lift: friction -20 % (type 200 +- 4.0 N at 0.10 m/s, 8.0 deviations)",
        ),
        (
            Cause("gain", "wrist", "gain", -0.19, -0.19, 0.01, "1", -11.4, 0.0, 0.013),
            "wrist: gain -19 % (type +- 1.3 %, 11.4 deviations)",
        ),
        (
            Cause("offset", "elbow", "offset", None, -8.6, 0.7, "N*m", -11.6, 0.306, 0.74),
            "elbow: constant torque -8.60 N*m (type 0.306 +- 0.74 N*m, 11.6 deviations)",
        ),
        (
            Cause("load", "hand", "mass", None, 0.51, 0.03, "kg", 16.0),
            "hand: load or another tool, +0.510 +- 0.030 kg (16.0 deviations)",
        ),
        (
            Cause("load", "hand", "mass", None, 0.51, None, "kg", 16.0),
            "hand: load or another tool, its mass not told (16.0 deviations)",
        ),
        (
            Cause("base", "fore", "hx[fore] + 0.4 m[hand]", 0.5, 0.9, 0.1, "kg*m", 7.0, 1.8, 0.1),
            "fore: hx[fore] and what moves with it +50 % (type 1.80 +- 0.10 kg*m, 7.0 deviations)",
        ),
        (
            Cause("coefficient", "wrist", "rotor_inertia", None, 0.01, 0.001, "kg*m^2", 6.0, 0.001, 0.001),
            "wrist: rotor inertia +0.0100 kg*m^2 (type 0.00100 +- 0.0010 kg*m^2, 6.0 deviations)",
        ),
        (
            Cause("error", "elbow", "error", 2.4, 1.2, 0.2, "1", 6.1, -3.0, 0.2),
            "elbow: error on test runs +240 %, and no parameter says why (6.1 deviations)",
        ),
    ],
)
def test_causes_in_words(cause, said):
    assert sentence_of(cause) == said


def test_which_form_is_pooled_does_not_depend_on_the_order():
    arms = identified().estimates[:6]
    mixed = [replace(arm, torque_unit="A") if k % 2 else arm for k, arm in enumerate(arms)]
    pooled = [{arm.name for one in Fleet().fit(given).types_ for arm in one.arms} for given in (mixed, mixed[::-1])]
    assert pooled[0] == pooled[1]
    assert len(pooled[0]) == 3


def test_speeds_of_a_sliding_joint_are_in_metres_in_amperes_too():
    arms = [
        replace(arm, torque_unit="A", kinds=("revolute", "prismatic", "revolute")) for arm in identified().estimates
    ]
    friction = {one.place: one for one in quantities(arms) if one.kind == "friction"}
    assert [(one.unit, one.at_unit) for one in friction.values()] == [("A", "rad/s"), ("A", "m/s"), ("A", "rad/s")]
    verdict = Fleet().fit(arms).verdicts_["arm_0003"]
    assert "m/s" in verdict.why[0].replace("rad/s", "")


def test_what_is_planted_is_what_is_drawn():
    """The truth of the campaign: an arm of the same seed without what was planted differs by that alone."""
    found = identified()
    assert [arm.odd for arm in found.arms if arm.odd] == list(PLANTED.values())
    assert isinstance(PLANTED[3], Odd)
