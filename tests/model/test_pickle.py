"""Copies and other processes: what is pickled comes back to the last bit."""

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest
from helpers.robots import random_chain, random_states
from helpers.small_arm import study
from numpy.testing import assert_array_equal

from dynid_rs import (
    Effect,
    FormatError,
    RobotModel,
    ThreeLoopIdentifier,
    TorqueModel,
    _core,
    read_recording,
)
from dynid_rs.simulation import bundled_robot

WAYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    **{f"pickle {p}": lambda x, p=p: pickle.loads(pickle.dumps(x, p)) for p in range(2, pickle.HIGHEST_PROTOCOL + 1)},
}
way = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)


@way
def test_robots(way):
    # A chain of every kind of joint, limits that are infinite, a gravity of its own; and one with rotors and gears.
    odd = random_chain(3)
    for robot in (RobotModel.from_urdf_string(odd.urdf, gravity=odd.gravity), RobotModel.from_urdf(bundled_robot())):
        other = way(robot)
        states = random_states(20, robot.n_joints, 0)
        assert_array_equal(other.joint_torque_regressor(*states), robot.joint_torque_regressor(*states))
        assert_array_equal(other.rnea(*states), robot.rnea(*states))
        for name in ("name", "joint_names", "link_names", "joint_kinds"):
            assert getattr(other, name) == getattr(robot, name)
        limits = ("lower", "upper", "velocity_limits", "acceleration_limits", "effort_limits")
        for name in (*limits, "gravity", "phi", "rotor_inertia", "gear_ratio"):
            assert_array_equal(getattr(other, name), getattr(robot, name))


@way
@pytest.mark.parametrize("kind", ["rotor_inertia", "torque_offset", "friction"])
def test_effects(way, kind):
    effect = Effect.friction([0.0, 0.1], [1 / 3, 1e-4]) if kind == "friction" else getattr(Effect, kind)()
    other = way(effect)
    assert (other.kind, other.shape, other.n_columns) == (effect.kind, effect.shape, effect.n_columns)


@way
def test_base_parameters(way):
    base = RobotModel.from_urdf(bundled_robot()).base_parameters()
    other = way(base)
    for name in ("pivots", "dependent", "beta"):
        assert_array_equal(getattr(other, name), getattr(base, name))
    for name in ("names", "gap", "spread", "n_base", "n_standard"):
        assert getattr(other, name) == getattr(base, name)


@way
@pytest.mark.parametrize("encoders", [1, 2])
def test_models(way, encoders, tmp_path):
    model = TorqueModel.load(study(encoders).model)
    other = way(model)
    states = random_states(50, 3, 0)
    for one, two in zip(model.evaluate(*states), other.evaluate(*states), strict=True):
        assert_array_equal(two, one)
    other.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == study(encoders).model.read_bytes()


@pytest.fixture(scope="module")
def fitted():
    case = study(1)
    robot = RobotModel.from_urdf(case.robot)
    runs = [read_recording(path, robot) for path in case.runs]
    return ThreeLoopIdentifier(robot).fit(runs[:2]), runs[2]


def predict(identifier, recording):
    return identifier.predict(recording)


@pytest.mark.parametrize("way", [WAYS["deepcopy"], WAYS["pickle 5"]], ids=["deepcopy", "pickle 5"])
def test_a_fitted_identifier(way, fitted):
    identifier, recording = fitted
    other = way(identifier)
    assert_array_equal(other.predict(recording), identifier.predict(recording))
    assert vars(other).keys() == vars(identifier).keys()


def test_a_fitted_identifier_works_in_another_process(fitted):
    identifier, recording = fitted
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert_array_equal(pool.submit(predict, identifier, recording).result(), identifier.predict(recording))


def test_texts_that_nobody_pickled_are_refused():
    for build in (_core._robot_of, _core._model_of):
        with pytest.raises(FormatError, match=r"^<pickle>: "):
            build("{}")
    with pytest.raises(ValueError, match="velocity_threshold"):
        _core._effect_of("friction", [])
    with pytest.raises(ValueError, match="no base parameters"):
        _core._base_of(([12], [], []), 1.0, 1.0, ["link"])


def test_a_folder_that_is_not_there_is_named_and_no_temporary_file(tmp_path):
    place = tmp_path / "none" / "x.json"
    with pytest.raises(FileNotFoundError) as error:
        TorqueModel.load(study().model).save(place)
    assert str(error.value) == f"{place}: the folder {place.parent} does not exist; create it first"
    (tmp_path / "none").write_text("a file")
    with pytest.raises(NotADirectoryError) as error:
        TorqueModel.load(study().model).save(place)
    assert ".dynid-" not in str(error.value)
