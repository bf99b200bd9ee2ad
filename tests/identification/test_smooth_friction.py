"""The smooth law: width and sharpness of Coulomb's sign, found by the evidence beside everything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import RobotModel, ThreeLoopIdentifier, _core
from dynid_rs.identification.smooth_friction import FIRST_SHARPNESS, FIRST_WIDTH, SmoothFrictionIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.kept_columns import effect_rows
from dynid_rs.regression.uncertainty import WIDTH_STEP, law_slopes
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.simulation import bundled_robot, simulate, typical_arm

N = 6
TEST_RUN = 2
WIDTH = 0.01
"""Width of the friction that is put in, over a joint's greatest speed."""


@pytest.fixture(scope="module")
def robot():
    return RobotModel.from_urdf(bundled_robot())


@pytest.fixture(scope="module")
def frictionless(robot):
    """Two runs to learn from and one to test on, of an arm with noise and without any friction."""
    arm = replace(typical_arm(robot).rigid(), delay=0.0)
    bare = replace(arm, friction=np.zeros_like(arm.friction))
    return arm, simulate(bare, n_runs=3, duration=20.0, rate=200.0, seed=4, derivatives=True).recordings


def with_friction(runs, law):
    """Runs whose friction is a law of the speed, (n, N) to (n, N)."""
    return [replace(run, tau=run.tau + law(run.dq)) for run in runs]


def rounded(dq, width, sharpness):
    """Written out once more: v / (|v|^p + e^p)^(1/p)."""
    return dq / (np.abs(dq) ** sharpness + width**sharpness) ** (1 / sharpness)


def smooth(width, sharpness, coulomb, viscous):
    return lambda dq: coulomb * rounded(dq, width, sharpness) + viscous * dq


def top_speed(runs):
    return np.max([np.abs(run.dq).max(axis=0) for run in runs], axis=0)


def fit(robot, runs, **options):
    return ThreeLoopIdentifier(robot, residual=None, friction_law="smooth", **options).fit(runs)


def left(identifier, run):
    """RMS per joint of what the model leaves of a run, in its band."""
    states = identifier.states(run)
    error = states.in_band(states.tau - evaluate(identifier.model_, states)[0])
    return np.sqrt(np.mean(error**2, axis=0))


def test_the_columns_are_the_closed_form():
    rng = np.random.default_rng(0)
    dq = rng.uniform(-2.0, 2.0, (50, 2))
    width, sharpness = np.array([0.05, 0.2]), np.array([2.0, 4.0])
    effect = _core.Effect.of("smooth_friction", transition_width=width, sharpness=sharpness)
    columns = _core.effect_columns(effect, 0 * dq, dq, 0 * dq)
    s = rounded(dq, width, sharpness)
    expected = np.stack([s, np.abs(s), dq, np.abs(dq), dq * np.abs(dq), dq**2], axis=2)
    assert_allclose(columns, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("sharpness", [1.5, 2.5, 4.0])
def test_width_and_sharpness_are_found(robot, frictionless, sharpness):
    """As near as the shapes that are tried; where a joint has little friction at low speed neighbours are alike."""
    arm, runs = frictionless
    width = WIDTH * top_speed(runs)
    coulomb, viscous = arm.friction[:, 0], arm.friction[:, 2]
    made = with_friction(runs, smooth(width, np.full(N, sharpness), coulomb, viscous))
    found = fit(robot, made[:TEST_RUN])
    ratios = found.friction_.transition_width_ / width, found.friction_.sharpness_ / sharpness
    print("width", ratios[0].round(2), "sharpness", ratios[1].round(2))
    assert np.all((ratios[0] > 0.4) & (ratios[0] < 2.0)), ratios[0]
    assert np.mean((ratios[1] > 0.6) & (ratios[1] < 1.6)) >= 4 / N, ratios[1]
    names = [name for effect in found.observations_.plan.effects for name in effect.coefficient_names]
    assert_allclose(found.links_.own_[:, names.index("coulomb")], coulomb, rtol=0.1)


def test_an_arctan_leaves_no_structure(robot, frictionless):
    """Another rounded sign than the law's own, of a longer tail: what is left on an unseen run is what the law itself
    leaves of its own friction, which is noise."""
    arm, runs = frictionless
    coulomb, viscous = arm.friction[:, 0], arm.friction[:, 2]
    errors = []
    for law in (
        lambda dq: coulomb * 2 / np.pi * np.arctan(dq / 0.01) + viscous * dq,
        smooth(WIDTH * top_speed(runs), np.full(N, FIRST_SHARPNESS), coulomb, viscous),
    ):
        made = with_friction(runs, law)
        errors.append(left(fit(robot, made[:TEST_RUN]), made[TEST_RUN]))
    print("over the law's own", (errors[0] / errors[1]).round(2))
    assert np.all(errors[0] < 1.2 * errors[1])
    assert np.exp(np.mean(np.log(errors[0] / errors[1]))) < 1.06


def test_a_start_is_only_improved(robot, frictionless):
    """From a shape near the truth, which an earlier fit has found, the search does not go far."""
    arm, runs = frictionless
    width = WIDTH * top_speed(runs)
    made = with_friction(runs, smooth(width, np.full(N, 2.5), arm.friction[:, 0], arm.friction[:, 2]))
    start = 1.5 * width, np.full(N, 2.5)
    found = fit(robot, made[:TEST_RUN], friction=SmoothFrictionIdentifier(start)).friction_
    assert np.all((found.transition_width_ > 0.4 * width) & (found.transition_width_ < 2.0 * width))
    assert_allclose(found.sharpness_, start[1], rtol=0.5)


@pytest.mark.parametrize("law", ["smooth", "paper"])
def test_slopes_are_what_the_filtered_friction_changes_by(robot, frictionless, law):
    """Both shape parameters of every joint, against a central difference of the effect itself."""
    states = prepare(frictionless[1][0], Band(6.0), 100.0)
    shape = {"transition_width": np.geomspace(0.003, 0.2, 6)}
    shape |= {"sharpness": np.linspace(0.8, 6.0, 6)} if law == "smooth" else {"velocity_threshold": np.full(6, 0.01)}
    friction = _core.Effect.of({"smooth": "smooth_friction", "paper": "friction"}[law], **shape)
    own = np.random.default_rng(3).normal(size=friction.n_columns)
    names = ["transition_width", "sharpness"] if law == "smooth" else ["transition_width"]
    step, close = (1e-5, 1e-6) if law == "smooth" else (WIDTH_STEP, 0.0)  # of the paper's law it is one
    for j in range(6):
        slopes = law_slopes(friction, states, j, own)
        assert slopes.shape == (len(states.rows), len(names))
        for k, name in enumerate(names):
            ends = []
            for factor in (1 + step, 1 - step):
                other = shape | {name: shape[name] * factor}
                ends.append(effect_rows(_core.Effect.of(friction.kind, **other), states, j) @ own)
            wanted = (ends[0] - ends[1]) / (2 * step) * states.counted[:, j]
            assert_allclose(slopes[:, k], wanted, rtol=0, atol=(close + 1e-9) * np.abs(wanted).max())


def test_before_a_fit_the_shape_is_the_usual_one():
    begun = SmoothFrictionIdentifier().begin(3)
    assert_array_equal(begun.transition_width_, np.full(3, FIRST_WIDTH))
    assert_array_equal(begun.sharpness_, np.full(3, FIRST_SHARPNESS))
    assert_array_equal(begun.velocity_threshold_, np.zeros(3))
    assert begun.effect_.kind == "smooth_friction"


def test_the_model_is_saved_and_read_with_its_bits(robot, frictionless, tmp_path):
    arm, runs = frictionless
    made = with_friction(runs[:1], smooth(0.02, 2.5, arm.friction[:, 0], arm.friction[:, 2]))
    model = fit(robot, made).model_
    model.save(tmp_path / "model.json")
    again = _core.TorqueModel.load(tmp_path / "model.json")
    states = runs[0].q, runs[0].dq, runs[0].ddq
    assert_array_equal(again.torque(*states), model.torque(*states))
    assert "smooth_friction" in again.term_names
