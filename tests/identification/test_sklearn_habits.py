"""What scikit-learn's users expect: fit on runs or data frames, predict, score, clone, and its own tools."""

import functools

import numpy as np
import pandas
import polars
import pytest
import sklearn.base
from helpers.small_arm import URDF, run
from sklearn.exceptions import NotFittedError
from sklearn.metrics import r2_score
from sklearn.model_selection import GridSearchCV, KFold, cross_val_score
from sklearn.utils import get_tags

from dynid_rs import DataError, MomentumObserver, PartsWarning, Recording, RobotModel, ThreeLoopIdentifier
from dynid_rs.identification.results import evaluate_runs, summarise

ROBOT = RobotModel.from_urdf_string(URDF)
TO_TOOL = {"t": "stamp", "q": "axis{n}_deg", "tau": "axis{n}_moment"}
CONFIG = {"columns": TO_TOOL, "units": {"angle": "deg"}}


@functools.cache
def recordings() -> tuple[Recording, ...]:
    frames = (pandas.DataFrame(run(k)) for k in range(3))
    return tuple(Recording.from_dataframe(frame, ROBOT, name=f"run_{k}") for k, frame in enumerate(frames))


def identifier(**options) -> ThreeLoopIdentifier:
    return ThreeLoopIdentifier(ROBOT, residual=None, **options)


@functools.cache
def fitted() -> ThreeLoopIdentifier:
    return identifier().fit(recordings()[:2])


def in_words_of_a_tool(recording: Recording) -> dict[str, np.ndarray]:
    columns = {"stamp": recording.t}
    for j in range(3):
        columns |= {f"axis{j + 1}_deg": np.rad2deg(recording.q[:, j]), f"axis{j + 1}_moment": recording.tau[:, j]}
    return columns


def test_one_and_several_are_the_same():
    one = identifier().fit(recordings()[0]).model_
    for again in ([recordings()[0]], Recording.concat([recordings()[0]]), iter([recordings()[0]])):
        np.testing.assert_array_equal(identifier().fit(again).model_.phi, one.phi)


@pytest.mark.parametrize("library", [pandas, polars])
def test_data_frames_give_the_model_that_recordings_give(library):
    frames = [library.DataFrame(run(k)) for k in range(3)]
    ident = identifier().fit(frames[:2])
    np.testing.assert_array_equal(ident.model_.phi, fitted().model_.phi)
    assert ident.score(frames[2]) == fitted().score(recordings()[2])
    np.testing.assert_array_equal(ident.predict(frames[2]), fitted().predict(recordings()[2]))


def test_the_mapping_is_a_parameter():
    frames = [pandas.DataFrame(in_words_of_a_tool(recording)) for recording in recordings()]
    ident = sklearn.base.clone(identifier(config=CONFIG)).fit(frames[:2])
    assert ident.score(frames[2]) == pytest.approx(fitted().score(recordings()[2]), rel=1e-9)
    motion = frames[2].drop(columns=[f"axis{n}_moment" for n in (1, 2, 3)])
    np.testing.assert_allclose(ident.predict(motion), fitted().predict(recordings()[2]), rtol=1e-7, atol=1e-9)
    with pytest.raises(DataError, match="data frame 1: column q_0 or q_shoulder is missing"):
        identifier().fit(frames[:2])


def test_predict_is_as_long_as_what_it_was_asked_for():
    one, two = fitted().predict(recordings()[0]), fitted().predict(list(recordings()[:2]))
    assert one.shape == recordings()[0].tau.shape
    assert isinstance(two, list)
    np.testing.assert_array_equal(two[0], one)
    frame = pandas.DataFrame(run(2))
    frame.loc[700:, "t"] += 4.0  # a gap, and behind it a piece of ten rows that is no run
    frame.loc[1590:, "t"] += 4.0
    with pytest.warns(PartsWarning, match="data frame: a gap of"):
        predicted = fitted().predict(frame)
    assert predicted.shape == (len(frame), 3)
    assert np.isfinite(predicted[:1590]).all()
    assert np.isnan(predicted[1590:]).all()


def test_the_score_is_that_of_the_reports_numbers():
    """R2 = 1 - (rmse / torque_std)^2 of the test runs, as result.json has them."""
    train, test = recordings()[:2], recordings()[2:]
    seen = [evaluate_runs(fitted().model_, runs, [fitted().states(r) for r in runs]) for runs in (train, test)]
    numbers = summarise(fitted(), *seen, ())["rmse"]["test"]
    expected = 1 - (np.array(numbers["after"]) / numbers["torque_std"]) ** 2
    np.testing.assert_allclose(fitted().score(test, per_joint=True), expected, rtol=1e-12)
    assert fitted().score(test) == pytest.approx(expected.mean(), rel=1e-12)


def test_as_recorded_it_is_scikit_learns():
    runs = recordings()[1:]
    tau = np.concatenate([recording.tau for recording in runs])
    predicted = np.concatenate(fitted().predict(runs))
    expected = r2_score(tau, predicted, multioutput="raw_values")
    np.testing.assert_allclose(fitted().score(runs, per_joint=True, as_recorded=True), expected, rtol=1e-12)
    assert fitted().score(runs, as_recorded=True) == pytest.approx(r2_score(tau, predicted))


def test_a_model_scores_and_predicts_as_its_identifier():
    model, test = fitted().model_, recordings()[2]
    np.testing.assert_array_equal(model.predict(test), fitted().predict(test))
    np.testing.assert_array_equal(model.predict([test])[0], fitted().predict(test))
    for options in ({}, {"per_joint": True}, {"as_recorded": True}):
        np.testing.assert_array_equal(model.score(test, **options), fitted().score(test, **options))


def test_scikit_learns_own_tools():
    runs = list(recordings())
    by_hand = [
        identifier().fit([runs[i] for i in train]).score([runs[i] for i in test])
        for train, test in KFold(3).split(runs)
    ]
    np.testing.assert_array_equal(cross_val_score(identifier(), runs, cv=3), by_hand)
    laws = ["coulomb_viscous", "stribeck"]
    search = GridSearchCV(identifier(), {"friction_law": laws}, cv=2).fit(runs[:2])
    assert search.best_params_["friction_law"] in laws
    assert 0.9 < search.score(runs[2:]) <= 1


def test_what_it_is_and_whether_it_is_fitted():
    tags = get_tags(identifier())
    assert tags.estimator_type == "regressor"
    assert not tags.target_tags.required
    assert sklearn.base.is_regressor(identifier())
    for call in (identifier().predict, identifier().score):
        with pytest.raises(NotFittedError):
            call(recordings()[0])
    assert "not fitted" in identifier()._repr_html_()
    assert "fitted" in fitted()._repr_html_()
    assert "Torque model of small_arm" in fitted()._repr_html_()


def test_a_clone_has_the_parameters_and_nothing_learned():
    again = sklearn.base.clone(fitted().set_params(max_iter=fitted().max_iter))
    assert again.get_params(deep=False).keys() == fitted().get_params(deep=False).keys()
    assert not hasattr(again, "model_")


@pytest.mark.parametrize("wrong", ["run.csv", 3, {"t": [1.0]}, np.zeros((30, 7)), [np.zeros((30, 7))], [["run.csv"]]])
def test_what_is_no_run(wrong):
    with pytest.raises(ValueError, match="expected a Recording, a data frame, or a list of them"):
        identifier().fit(wrong)


def test_what_else_is_refused():
    with pytest.raises(ValueError, match=r"robot must be a RobotModel, found str; read one with RobotModel.from_urdf"):
        ThreeLoopIdentifier("robot.urdf").fit(recordings()[0])
    with pytest.raises(ValueError, match="no recording to learn from"):
        identifier().fit([])
    for score in (fitted().model_.score, fitted().score):
        for as_recorded in (False, True):
            with pytest.raises(ValueError, match="no recording to compare with; give at least one"):
                score([], as_recorded=as_recorded)
    with pytest.raises(ValueError, match="y: the measured torque is in the runs themselves"):
        fitted().score(recordings()[2], recordings()[2].tau)
    two = Recording(t=np.arange(100) / 100, q=np.zeros((100, 2)), tau=np.zeros((100, 2)), name="two")
    for call in (fitted().model_.predict, fitted().model_.score, fitted().predict, fitted().score):
        with pytest.raises(DataError, match=r"two has 2 joints, the robot 'small_arm' has 3; is it a run of this"):
            call(two)
    ampere = Recording(recordings()[2].t, recordings()[2].q, tau=recordings()[2].tau, torque_unit="A", name="amps")
    for call in (fitted().model_.score, fitted().score):
        with pytest.raises(DataError, match=r"amps: holds torque in A, the model gives N\*m"):
            call(ampere)


def test_the_observer_takes_what_the_identifier_takes():
    by_list = MomentumObserver(fitted().model_).fit(list(recordings()[:2])).correlation_time_
    frames = [pandas.DataFrame(run(k)) for k in range(2)]
    assert MomentumObserver(fitted().model_).fit(frames).correlation_time_ == by_list
