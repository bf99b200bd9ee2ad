"""Expectation and maximisation in Rust: scikit-learn's steps, to rounding, from scikit-learn's start."""

import os
import subprocess
import sys
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.cluster import kmeans_plusplus
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture

from dynid_rs import GaussianMixtureRegressor, _core
from dynid_rs.identification.mixture import FUSED_FROM, start_of
from dynid_rs.identification.mixture_fit import MixtureFit, k_means_plus_plus

LOG_LIKELIHOOD = 1e-9
"""What is promised of the mean log-likelihood per sample."""
PARAMETERS = {"rtol": 1e-6, "atol": 1e-7}
"""Rounding, after tens of iterations of a map that hardly contracts along some directions."""


def samples(n, k, d, seed=0):
    """Of k Gaussians that overlap, standardised: (n, d)."""
    rng = np.random.default_rng(seed)
    centres = 2 * rng.normal(size=(k, d))
    mix = np.eye(d) + 0.3 * rng.normal(size=(d, d))
    x = centres[rng.integers(k, size=n)] + 0.6 * rng.normal(size=(n, d)) @ mix
    return (x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-300)


def reference(x, k, max_iter=200, tol=1e-4, reg_covar=1e-6):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        mixture = GaussianMixture(
            k, max_iter=max_iter, tol=tol, reg_covar=reg_covar, init_params="k-means++", random_state=0
        )
        return mixture.fit(x)


def fitted(x, start, max_iter=200, tol=1e-4, reg_covar=1e-6):
    parts = start.weights_, start.means_, start.covariances_
    return _core.fit_mixture(x, *parts, reg_covar=reg_covar, tol=tol, max_iter=max_iter)


# Whole blocks, parts of blocks, several tasks of several blocks.
@pytest.mark.parametrize(
    ("n", "k", "d"),
    [(300, 3, 1), (129, 2, 2), (2000, 5, 3), (2048, 10, 3), (8193, 6, 3), (20_001, 10, 3), (5000, 4, 5), (3000, 3, 8)],
)
def test_every_iteration_is_scikit_learns(n, k, d):
    x = samples(n, k, d)
    start, expected = reference(x, k, max_iter=0), reference(x, k)
    weights, means, covariances, bounds, converged, log_likelihood = fitted(x, start)
    assert len(bounds) == expected.n_iter_ > 2
    assert converged is expected.converged_ is True
    assert abs(bounds[-1] - expected.lower_bound_) < LOG_LIKELIHOOD
    assert abs(log_likelihood - expected.score(x)) < LOG_LIKELIHOOD
    for iteration, bound in enumerate(bounds[:5], start=1):
        stopped = reference(x, k, max_iter=iteration)
        assert abs(bound - stopped.lower_bound_) < LOG_LIKELIHOOD
    assert_allclose(weights, expected.weights_, **PARAMETERS)
    assert_allclose(means, expected.means_, **PARAMETERS)
    assert_allclose(covariances, expected.covariances_, **PARAMETERS)
    assert_array_equal(covariances, covariances.transpose(0, 2, 1))


@pytest.mark.parametrize("means_init", [None, np.zeros((4, 3)) + np.arange(4)[:, None]])
def test_the_start_is_scikit_learns(means_init):
    x = samples(700, 4, 3)
    settings = {"reg_covar": 1e-4, "init_params": "k-means++", "means_init": means_init, "random_state": 3}
    expected = GaussianMixture(4, max_iter=0, **settings).fit(x)
    weights, means, covariances = start_of(GaussianMixture(4, **settings), x)
    assert_allclose(weights, expected.weights_, rtol=1e-15)
    assert_allclose(means, expected.means_, rtol=1e-15)
    assert_allclose(covariances, expected.covariances_, rtol=1e-15, atol=1e-25)


@pytest.mark.parametrize("k", [1, 2, 4, 9])
@pytest.mark.parametrize("seed", range(3))
def test_samples_far_apart_are_those_that_scikit_learn_draws(k, seed):
    x = samples(500, 4, 3, seed=seed)
    for state in (seed, np.random.RandomState(seed)):
        theirs = kmeans_plusplus(x, k, random_state=seed)[1]
        assert_array_equal(k_means_plus_plus(x, k, state), theirs)


@pytest.mark.parametrize("means_init", [None, np.arange(12.0).reshape(4, 3) / 6])
def test_a_fit_without_scikit_learn_is_that_of_the_regressor(means_init):
    x = samples(700, 4, 3)
    options = {"tol": 1e-2, "means_init": means_init, "random_state": 0}
    ours, theirs = MixtureFit(4, **options), GaussianMixtureRegressor(4, solver="scikit-learn", **options)
    ours.fit(x[:, :2], x[:, 2])
    theirs.fit(x[:, :2], x[:, 2])
    assert_allclose(ours.bic_, theirs.bic_, rtol=1e-9)
    assert_allclose(ours.mixture_.means, theirs.mixture_.means, **PARAMETERS)
    assert_allclose(ours.predict(x[:, :2]), theirs.predict(x[:, :2]), **PARAMETERS)


def test_the_likelihood_never_falls():
    x = samples(4000, 6, 3, seed=3)
    bounds = fitted(x, reference(x, 6, max_iter=0), tol=0.0, max_iter=120, reg_covar=0.0)[3]
    assert len(bounds) == 120
    assert np.diff(bounds).min() > -1e-12


def test_an_empty_component_and_a_far_sample_are_as_in_scikit_learn():
    x = samples(1000, 3, 3, seed=1)
    x[17] = 300.0  # hundreds of standard deviations off: its responsibilities are of logarithms like -1e5
    start = reference(x, 4, max_iter=0)
    start.means_[3] = -1e3  # nobody is near, so its weight becomes next to nothing
    expected = reference(x, 4, max_iter=1)
    expected.set_params(warm_start=True, max_iter=3, tol=0.0)
    for name in ("weights_", "means_", "covariances_", "precisions_cholesky_"):
        setattr(expected, name, getattr(start, name).copy())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        expected.fit(x)
    weights, means, _, bounds, converged, _ = fitted(x, start, tol=0.0, max_iter=3)
    assert weights[3] < 1e-15
    assert not converged
    assert abs(bounds[-1] - expected.lower_bound_) < LOG_LIKELIHOOD
    assert_allclose(weights, expected.weights_, **PARAMETERS)
    assert_allclose(means[:3], expected.means_[:3], **PARAMETERS)


CODE = """
import numpy as np
from dynid_rs import _core
rng = np.random.default_rng(0)
x = rng.normal(size=(60_000, 3)) + 3 * rng.integers(3, size=(60_000, 1))
start = np.full(5, 0.2), x[:5], np.tile(np.eye(3), (5, 1, 1))
parts = _core.fit_mixture(x, *start, reg_covar=1e-6, tol=0.0, max_iter=10)
print(*(np.asarray(part, dtype=float).tobytes().hex() for part in parts))
"""


def test_the_number_of_threads_changes_no_bit():
    def bits(threads):
        environment = os.environ | {"RAYON_NUM_THREADS": str(threads)}
        return subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, check=True).stdout

    assert bits(1) == bits(2) == bits(5)


@pytest.mark.parametrize("n", [500, 3000])
def test_the_regressor_is_the_same_by_either_solver(n):
    x = samples(n, 4, 3, seed=5)
    by = {
        solver: GaussianMixtureRegressor(5, random_state=0, solver=solver).fit(100 * x[:, :2], 1e-3 * x[:, 2])
        for solver in ("scikit-learn", "fused", "auto")
    }
    assert by["fused"].n_iter_ == by["scikit-learn"].n_iter_ > 2
    assert by["fused"].converged_ == by["scikit-learn"].converged_
    assert_allclose(by["fused"].bic_, by["scikit-learn"].bic_, rtol=0, atol=2 * n * LOG_LIKELIHOOD)
    query = 100 * samples(200, 4, 3, seed=6)[:, :2]
    assert_allclose(by["fused"].predict(query), by["scikit-learn"].predict(query), rtol=1e-5, atol=1e-9)
    # On little data scikit-learn is the default.
    assert_array_equal(by["auto"].mixture_.means, by["scikit-learn"].mixture_.means)


def test_on_much_data_rust_iterates_by_default():
    x = samples(FUSED_FROM, 4, 3, seed=5)
    auto, fused = (
        GaussianMixtureRegressor(4, random_state=0, max_iter=5, solver=solver).fit(x[:, :2], x[:, 2])
        for solver in ("auto", "fused")
    )
    assert_array_equal(auto.mixture_.means, fused.mixture_.means)
    wide = samples(FUSED_FROM, 2, 9, seed=5)  # more columns than Rust iterates on
    by_default = GaussianMixtureRegressor(2, random_state=0, max_iter=2).fit(wide[:, :8], wide[:, 8])
    assert by_default.n_iter_ == 2


def test_the_information_criterion_is_scikit_learns():
    x = samples(900, 3, 3)
    z = (x - x.mean(axis=0)) / x.std(axis=0)
    regressor = GaussianMixtureRegressor(3, random_state=0).fit(x[:, :2], x[:, 2])
    mixture = reference(z, 3, max_iter=100, tol=1e-3, reg_covar=1e-4)
    assert_allclose(regressor.bic_, mixture.bic(z), rtol=1e-12)


GOOD = (np.zeros((4, 2)) + np.arange(4)[:, None], np.ones(1), np.zeros((1, 2)), np.eye(2)[None])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({0: np.zeros((4, 9))}, "x has 9 columns, expected 1 to 8"),
        ({0: np.zeros((0, 2))}, "0 samples are too few|x has shape"),
        ({0: np.full((4, 2), np.nan)}, "x holds NaN"),
        ({1: np.ones(2)}, "are not those of 2 components with 2 dimensions"),
        ({2: np.zeros((1, 3))}, "means has shape"),
        ({3: np.eye(3)[None]}, "are not those of 1 components with 2 dimensions"),
        ({3: -np.eye(2)[None]}, "component 0 of the mixture has collapsed"),
        ({0: np.full((4, 2), 1e200)}, "the log-likelihood of the mixture"),
        ({1: -np.ones(1)}, "the log-likelihood of the mixture"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_a_sentence(change, said):
    _core.fit_mixture(*GOOD, reg_covar=1e-6, tol=0.0, max_iter=2)
    arguments = [change.get(k, part) for k, part in enumerate(GOOD)]
    with pytest.raises(ValueError, match=said):
        _core.fit_mixture(*arguments, reg_covar=1e-6, tol=0.0, max_iter=2)


def test_a_collapsing_component_is_refused_in_a_sentence():
    x = np.repeat([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]], 50, axis=0)
    start = reference(x, 3, max_iter=0)
    with pytest.raises(ValueError, match="collapsed onto too few samples; take fewer components"):
        fitted(x, start, reg_covar=0.0)


def test_a_solver_of_another_name_is_refused():
    with pytest.raises(ValueError, match="solver must be one of auto, scikit-learn, fused, found 'em'"):
        GaussianMixtureRegressor(solver="em").fit(np.eye(3), np.ones(3))
