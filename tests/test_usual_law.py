"""Which law of friction a fit has where none is asked for."""

from __future__ import annotations

import pytest
from small_arm import URDF, dynid, refusal, study, write_robot, write_runs

from dynid_rs import FrictionIdentifier, LinkDynamicsIdentifier, RobotModel, ThreeLoopIdentifier
from dynid_rs.identification.friction_laws import usual_law
from dynid_rs.simulation import simulate, typical_arm


@pytest.fixture(scope="module")
def robot():
    return RobotModel.from_urdf_string(URDF)


@pytest.fixture(scope="module")
def run(robot):
    arm = typical_arm(robot).rigid()
    return simulate(arm, n_runs=1, duration=8.0, rate=200.0, seed=1, derivatives=True).recordings[0]


def kind(identifier):
    """Kind of the friction among the terms of the model."""
    return identifier.observations_.plan.friction[0].kind


def test_it_is_smooth(robot, run):
    assert kind(ThreeLoopIdentifier(robot, residual=None).fit(run)) == "smooth_friction"
    shapes = study().result["parameters"]["friction_shape"]
    assert all("sharpness" in shape for shape in shapes)


@pytest.mark.parametrize(
    "options",
    [
        {"links": LinkDynamicsIdentifier(prior=None)},
        {"links": LinkDynamicsIdentifier(weighting=None)},
        {"friction": FrictionIdentifier(refine=False)},
    ],
)
def test_it_is_the_papers_without_a_prior_or_where_its_search_is_given(robot, run, options):
    assert kind(ThreeLoopIdentifier(robot, residual=None, **options).fit(run)) == "friction"


def test_it_is_the_papers_with_a_friction_experiment():
    assert usual_law(with_prior=True, with_pairs=True) == "paper"
    assert usual_law(with_prior=True, with_pairs=False) == "smooth"


def test_a_smooth_law_without_a_prior_is_refused(robot, run, tmp_path):
    sentence = "friction_law 'smooth' is chosen by the evidence, which needs the weak prior"
    with pytest.raises(ValueError, match=sentence):
        ThreeLoopIdentifier(robot, links=LinkDynamicsIdentifier(prior=None), friction_law="smooth").fit(run)
    runs = write_runs(tmp_path, n_runs=2)
    options = ("--friction-law", "smooth", "--prior", "none")
    said = refusal(dynid("identify", write_robot(tmp_path), *runs, *options, "-o", tmp_path / "out"))
    assert said.startswith(sentence)
