"""Normalised radial basis functions as an estimator, as a file, and as a bad argument."""

import copy
import json
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.utils.estimator_checks import parametrize_with_checks

from dynid_rs import FormatError, RbfRegressor, TorqueModel, _core
from dynid_rs.identification.residual import ResidualCompensator, choose_inputs
from dynid_rs.simulation import bundled_robot


@parametrize_with_checks([RbfRegressor()])
def test_sklearn_conventions(estimator, check):
    check(estimator)


def noisy_step(n, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (n, 2))
    return x, np.tanh(5 * x[:, 1]) + 0.1 * rng.normal(size=n)


def test_it_learns_and_knows_how_well():
    x, y = noisy_step(2000)
    fitted = RbfRegressor(8).fit(x, y)
    unseen, torque = noisy_step(2000, seed=1)
    mean, std = fitted.predict(unseen, return_std=True)
    assert fitted.score(unseen, torque) > 0.95
    assert 0.9 < np.mean(np.abs(torque - mean) < 2 * std) < 0.99


def test_grid_points_without_data_are_left_out():
    """Data on a diagonal fills few of 64 cells, and the others get no weight to explode with."""
    x = np.linspace(-1, 1, 400)[:, None] + np.zeros((1, 2))
    fitted = RbfRegressor(8).fit(x, np.sin(3 * x[:, 0]))
    assert len(fitted.centers_) == 8
    corner = fitted.predict([[1.0, -1.0], [50.0, -50.0]])
    assert np.all(np.abs(corner) <= 1.1)


def test_little_data_does_not_explode():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(40, 2)), rng.normal(size=40)
    fitted = RbfRegressor(8).fit(x, y)
    assert np.max(np.abs(fitted.weights_)) < 3 * np.max(np.abs(y))


def test_units_do_not_matter():
    x, y = noisy_step(500)
    plain, scaled = RbfRegressor(5).fit(x, y), RbfRegressor(5).fit(x * [1e-4, 1e-2], 100 * y)
    assert_allclose(scaled.predict(x * [1e-4, 1e-2]), 100 * plain.predict(x), rtol=1e-8, atol=1e-8)


def test_a_constant_input_and_a_constant_output_are_no_trouble():
    x, _ = noisy_step(200)
    flat = RbfRegressor(4).fit(np.column_stack([x, np.full(200, 7.0)]), np.full(200, 7.0))
    assert_allclose(flat.predict(np.column_stack([x, np.full(200, 7.0)])), 7.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"n_centers": 1}, "n_centers must be at least 2, found 1"),
        ({"weighting": "both"}, "weighting must be 'least_squares' or 'weighted_means', found 'both'"),
        ({"ridge": -1.0}, "ridge must not be negative, found -1.0"),
        ({"n_centers": 200, "as_printed": True}, "as_printed needs the whole grid"),
    ],
)
def test_wrong_arguments_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        RbfRegressor(**arguments).fit(*noisy_step(50))


GOOD = {"centers": [[0.0, 1.0], [2.0, 3.0]], "precision": [1.0, 2.0], "weights": [1.0, 2.0], "variances": [0.1, 0.0]}


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        ({"precision": [1.0, 0.0]}, "precision is outside its range"),
        ({"precision": [1.0]}, "centers"),
        ({"variances": [0.1, -1.0]}, "variances is outside its range"),
        ({"variances": [0.1]}, "variances"),
        ({"weights": []}, "weights is outside its range"),
        ({"weights": [1.0, np.nan]}, "weights"),
        ({"centers": [[0.0, 1.0]]}, "centers has 2 values, expected 4"),
    ],
)
def test_what_is_no_basis_is_refused(spoil, words):
    _core.NormalisedRbf(**GOOD)
    parts = GOOD | spoil
    if len(parts["weights"]) == 0:
        parts["variances"], parts["centers"] = [], np.zeros((0, 2))
    with pytest.raises(ValueError, match=words):
        _core.NormalisedRbf(**parts)


def test_copies_are_the_same():
    rbf = _core.NormalisedRbf(**GOOD)
    u = np.random.default_rng(0).normal(size=(20, 2))
    for again in (copy.deepcopy(rbf), pickle.loads(pickle.dumps(rbf))):
        assert_array_equal(again.predict(u), rbf.predict(u))
    assert rbf.n_components == 2


def model(inputs="load_free_deflection", compliance=(1e-6,) * 6):
    robot = _core.RobotModel.from_urdf(str(bundled_robot()))
    mixture = _core.GaussianMixtureRegression([1.0], np.zeros((1, 3)), 1e-4 * np.eye(3)[None])
    return TorqueModel(
        robot,
        robot.phi,
        [],
        residual=(inputs, [_core.NormalisedRbf(**GOOD), mixture, None, None, None, None]),
        compliance=None if compliance is None else list(compliance),
        encoder_delay=[0.0] * 6,
        noise_std=[1.0] * 6,
        domain=([[-1.0, 1.0]] * 6, [1.0] * 6, [1.0] * 6),
    )


def test_a_saved_model_is_the_same(tmp_path):
    model().save(tmp_path / "model.json")
    again = TorqueModel.load(tmp_path / "model.json")
    inputs, (rbf, mixture, *others) = again.residual
    assert inputs == "load_free_deflection"
    assert others == [None] * 4
    assert isinstance(mixture, _core.GaussianMixtureRegression)
    for name, value in GOOD.items():
        assert_array_equal(getattr(rbf, name), value)
    assert_array_equal(again.compliance, [1e-6] * 6)
    signals = [np.random.default_rng(0).normal(size=(30, 6)) for _ in range(6)]
    for now, then in zip(again.evaluate(*signals), model().evaluate(*signals), strict=True):
        assert_array_equal(now, then)
    assert_array_equal(again.predicted_std(*signals), model().predicted_std(*signals))


def test_files_without_compliance_load_as_before(tmp_path):
    """What earlier releases wrote: mixtures only, and no compliance."""
    path = tmp_path / "model.json"
    model("deflection", None).save(path)
    residual = json.loads(path.read_text())["residual"]
    assert set(residual) == {"inputs", "joints"}
    assert set(residual["joints"][1]) == {"weights", "means", "covariances"}
    assert_array_equal(TorqueModel.load(path).compliance, 0.0)


def test_a_joint_that_is_neither_is_refused(tmp_path):
    path = tmp_path / "model.json"
    model().save(path)
    path.write_text(path.read_text().replace('"precision"', '"precisiom"'))
    with pytest.raises(FormatError):
        TorqueModel.load(path)


def test_compliance_must_fit():
    with pytest.raises(ValueError, match="compliance has 2 values, expected 6"):
        model(compliance=(1e-6, 1e-6))
    with pytest.raises(ValueError, match="compliance is outside its range"):
        model(compliance=(-1e-6,) * 6)


def test_choices_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match="method must be 'mixture' or 'rbf', found 'gmr'"):
        ResidualCompensator(method="gmr").fit([], [])
    with pytest.raises(ValueError, match="found 'angle'"):
        choose_inputs("angle", [])
    with pytest.raises(ValueError, match="needs the predicted rigid-body torque; give tau_link"):
        choose_inputs("load_free_deflection", [], load_known=False)
