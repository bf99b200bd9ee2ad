"""Mixture regression against gmr and the text book, and the friction basis against the paper's page."""

from itertools import product

import numpy as np
import pytest
from gmr import GMM
from helpers.tolerances import ALGEBRAIC, statistical
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal, norm
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks

from dynid_rs import GaussianMixtureRegressor, _core


def random_mixture(seed, n_inputs, n_components):
    """weights (K,), means (K, d + 1), covariances (K, d + 1, d + 1); well conditioned."""
    rng = np.random.default_rng(seed)
    width = n_inputs + 1
    weights = rng.dirichlet(np.full(n_components, 2.0))
    means = rng.uniform(-2, 2, size=(n_components, width))
    factors = rng.normal(size=(n_components, width, width))
    return weights, means, factors @ factors.transpose(0, 2, 1) + 0.1 * np.eye(width)


def textbook(weights, means, covariances, u):
    """Eqs. 31-38 with densities, and the variance with the spread of the means: h, mean, variance."""
    d = u.shape[1]
    density = np.stack(
        [
            weight * multivariate_normal(mean[:d], covariance[:d, :d]).pdf(u)
            for weight, mean, covariance in zip(weights, means, covariances, strict=True)
        ],
        axis=1,
    )
    h = density / density.sum(axis=1, keepdims=True)
    conditional, variance = np.empty_like(h), np.empty(len(weights))
    for k, (mean, covariance) in enumerate(zip(means, covariances, strict=True)):
        gain = covariance[d, :d] @ np.linalg.inv(covariance[:d, :d])
        conditional[:, k] = mean[d] + (u - mean[:d]) @ gain
        variance[k] = covariance[d, d] - gain @ covariance[:d, d]
    mean = np.sum(h * conditional, axis=1)
    return h, mean, np.sum(h * (variance + (conditional - mean[:, None]) ** 2), axis=1)


CASES = list(product(range(5), (1, 2, 3), (1, 2, 6)))


@pytest.mark.parametrize(("seed", "n_inputs", "n_components"), CASES)
def test_prediction_agrees_with_gmr_and_the_textbook(seed, n_inputs, n_components):
    parts = random_mixture(seed, n_inputs, n_components)
    mixture = _core.GaussianMixtureRegression(*parts)
    u = np.random.default_rng(seed).uniform(-3, 3, size=(200, n_inputs))
    mean, variance = mixture.predict(u)
    h, textbook_mean, textbook_variance = textbook(*parts, u)
    gmm = GMM(n_components, priors=parts[0], means=parts[1], covariances=parts[2])
    assert_allclose(mean, gmm.predict(np.arange(n_inputs), u)[:, 0], **ALGEBRAIC)
    assert_allclose(mean, textbook_mean, **ALGEBRAIC)
    assert_allclose(variance, textbook_variance, **ALGEBRAIC)
    assert_allclose(mixture.responsibilities(u), h, **ALGEBRAIC)


def test_variance_is_that_of_samples_near_the_query():
    # Eq. 39 as printed leaves out the spread of the means, which is most of the variance here.
    weights = np.array([0.5, 0.5])
    means = np.array([[0.0, -3.0], [0.0, 3.0]])
    covariances = np.array([np.diag([1.0, 0.25])] * 2)
    mean, variance = _core.GaussianMixtureRegression(weights, means, covariances).predict([[0.3]])
    rng = np.random.default_rng(0)
    n = 400_000
    samples = rng.choice(means[:, 1], size=n) + 0.5 * rng.normal(size=n)
    assert_allclose(mean, samples.mean(), **statistical(samples.std() / np.sqrt(n)))
    spread = (samples - samples.mean()) ** 2
    assert_allclose(variance, spread.mean(), **statistical(spread.std() / np.sqrt(n)))
    assert_allclose(variance, 9.25, **ALGEBRAIC)


def test_one_gaussian_is_linear_regression():
    weights, means, covariances = random_mixture(3, 2, 1)
    u = np.random.default_rng(0).uniform(-50, 50, size=(100, 2))
    mean, variance = _core.GaussianMixtureRegression(weights, means, covariances).predict(u)
    slope = np.linalg.solve(covariances[0, :2, :2], covariances[0, :2, 2])
    assert_allclose(mean, means[0, 2] + (u - means[0, :2]) @ slope, **ALGEBRAIC)
    assert_allclose(variance, covariances[0, 2, 2] - covariances[0, 2, :2] @ slope, rtol=1e-9)


@pytest.mark.parametrize(("offset", "std"), [(1e3, 1e-5), (1e4, 1e-4), (1e6, 1e-2)])
def test_variance_does_not_cancel(offset, std):
    covariances = np.array([np.diag([1.0, std**2])] * 2)
    mixture = _core.GaussianMixtureRegression([0.5, 0.5], np.array([[0.0, offset], [1.0, offset]]), covariances)
    _, variance = mixture.predict([[0.3]])
    assert_allclose(variance, std**2, rtol=1e-6)


@pytest.mark.parametrize("distance", [10.0, 1e3, 1e6, 1e9, 1e100])
def test_far_queries_are_finite_and_responsibilities_sum_to_one(distance):
    weights, means, covariances = random_mixture(1, 2, 5)
    mixture = _core.GaussianMixtureRegression(weights, means, covariances)
    angle = np.linspace(0, 2 * np.pi, 50)
    u = distance * np.column_stack([np.cos(angle), np.sin(angle)])
    mean, variance = mixture.predict(u)
    assert np.isfinite(mean).all()
    assert np.isfinite(variance).all()
    assert np.all(variance >= 0)
    h = mixture.responsibilities(u)
    assert_allclose(h.sum(axis=1), 1.0, rtol=1e-14)
    assert np.all((h >= 0) & (h <= 1))
    if distance <= 1e6:  # the component that wins is the one whose density falls slowest
        parts = zip(means, covariances, strict=True)
        logs = [multivariate_normal(mean[:2], s[:2, :2]).logpdf(u) for mean, s in parts]
        assert_array_equal(h.argmax(axis=1), np.argmax(np.log(weights)[:, None] + logs, axis=0))


def test_order_of_components_does_not_matter():
    parts = random_mixture(4, 2, 5)
    u = np.random.default_rng(0).uniform(-4, 4, size=(100, 2))
    turned = [part[::-1].copy() for part in parts]
    for a, b in zip(
        _core.GaussianMixtureRegression(*parts).predict(u),
        _core.GaussianMixtureRegression(*turned).predict(u),
        strict=True,
    ):
        assert_allclose(a, b, **ALGEBRAIC)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda w, m, c: (w[:-1], m, c),
        lambda w, m, c: (w, m[:-1], c),
        lambda w, m, c: (w, m, c[:-1]),
        lambda w, m, c: (-w, m, c),
        lambda w, m, c: (0 * w, m, c),
        lambda w, m, c: (w, m, -c),
        lambda w, m, c: (w, m, 0 * c),
        lambda w, m, c: (w * np.nan, m, c),
        lambda w, m, c: (w, m * np.inf, c),
        lambda w, m, c: (w, m[:, :1], c[:, :1, :1]),
    ],
)
def test_what_is_no_mixture_is_refused(spoil):
    parts = random_mixture(0, 2, 3)
    _core.GaussianMixtureRegression(*parts)
    with np.errstate(invalid="ignore"):
        spoiled = spoil(*parts)
    with pytest.raises(ValueError):
        _core.GaussianMixtureRegression(*spoiled)


@pytest.mark.parametrize(
    ("u", "sentence"),
    [
        (np.zeros(2), r"^u has shape \(2,\), expected \(n_samples, 2\)$"),
        (np.zeros((4, 3)), r"^u has shape \(4, 3\), expected \(n_samples, 2\)$"),
        (np.full((4, 2), np.nan), r"^u holds NaN at row 0, column 0"),
    ],
)
def test_wrong_queries_are_named(u, sentence):
    mixture = _core.GaussianMixtureRegression(*random_mixture(0, 2, 3))
    for method in (mixture.predict, mixture.responsibilities):
        with pytest.raises(ValueError, match=sentence):
            method(u)


# The scikit-learn face.


@parametrize_with_checks([GaussianMixtureRegressor()])
def test_scikit_learn_conventions(estimator, check):
    check(estimator)


def noisy_sine(n_samples, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-3, 3, size=(n_samples, 1))
    return x, np.sin(x[:, 0]) + 0.05 * rng.normal(size=n_samples)


def test_regressor_is_the_conditional_of_its_own_mixture():
    x, y = noisy_sine(500)
    regressor = GaussianMixtureRegressor(6, random_state=0).fit(x, y)
    mean, std = regressor.predict(x, return_std=True)
    core_mean, core_variance = regressor.mixture_.predict(x)
    assert_array_equal(mean, core_mean)
    assert_array_equal(std, np.sqrt(core_variance))
    assert_array_equal(mean, regressor.predict(x))


def test_regressor_learns_a_curve_and_knows_its_noise():
    x, y = noisy_sine(3000)
    regressor = GaussianMixtureRegressor(12, random_state=0).fit(x, y)
    grid = np.linspace(-2.5, 2.5, 100)[:, None]
    mean, std = regressor.predict(grid, return_std=True)
    assert np.sqrt(np.mean((mean - np.sin(grid[:, 0])) ** 2)) < 0.05
    assert 0.04 < np.median(std) < 0.12
    # Share of new samples within two standard deviations; the mixture may be a little wide.
    x_new, y_new = noisy_sine(3000, seed=1)
    mean, std = regressor.predict(x_new, return_std=True)
    assert np.mean(np.abs(y_new - mean) < 2 * std) > norm.cdf(2) - norm.cdf(-2) - 0.02


def test_units_do_not_decide():
    x, y = noisy_sine(400)
    predict = [
        GaussianMixtureRegressor(5, random_state=0).fit(x * a, y * b).predict(x * a) / b
        for a, b in ((1.0, 1.0), (1024.0, 1.0), (1.0, 2.0**-20), (2.0**-15, 2.0**12))
    ]
    for other in predict[1:]:
        assert_allclose(other, predict[0], **ALGEBRAIC)


def test_random_state_reproduces():
    x, y = noisy_sine(300)
    regressor = GaussianMixtureRegressor(5, random_state=3)
    assert_array_equal(regressor.fit(x, y).predict(x), clone(regressor).fit(x, y).predict(x))


def test_means_init_is_in_the_units_of_the_data():
    x, y = noisy_sine(2000)
    start = GaussianMixtureRegressor(5, random_state=0, max_iter=500, tol=1e-8).fit(100 * x, 1e-3 * y)
    again = GaussianMixtureRegressor(5, means_init=start.mixture_.means, tol=1e-2).fit(100 * x, 1e-3 * y)
    assert again.n_iter_ <= start.n_iter_
    assert_allclose(again.mixture_.means / [100, 1e-3], start.mixture_.means / [100, 1e-3], rtol=0, atol=0.3)


@pytest.mark.parametrize("distance", [1e3, 1e6, 1e100])
def test_regressor_is_finite_far_away(distance):
    x, y = noisy_sine(500)
    regressor = GaussianMixtureRegressor(6, random_state=0).fit(x, y)
    mean, std = regressor.predict([[distance], [-distance]], return_std=True)
    assert np.isfinite(mean).all()
    assert np.isfinite(std).all()


def test_a_constant_input_and_a_constant_output_are_no_trouble():
    x, y = noisy_sine(200)
    with_constant = np.column_stack([x, np.full(200, 7.0)])
    regressor = GaussianMixtureRegressor(3, random_state=0).fit(with_constant, y)
    assert np.isfinite(regressor.predict(with_constant)).all()
    flat = GaussianMixtureRegressor(2, random_state=0).fit(x, np.full(200, 7.0)).predict(x)
    assert_allclose(flat, 7.0, rtol=1e-6)


# Friction: a transcription of Eqs. 9-11 of the paper, term by term; superscripts are indices.


def friction_of_the_paper(dq, k, lam, eps):
    """tau_f of one joint at speed dq; k = (k_c1, k_c2, k_v1, k_v2, k_v1^2, k_v2^2, k_v1^3, k_v2^3)."""
    k_c1, k_c2, k_v1, k_v2, k_v1_2, k_v2_2, k_v1_3, k_v2_3 = k
    s = np.tanh(dq / eps)
    if dq >= 0:
        tau_fc = k_c1 * s * (s + 1) / 2
        tau_fv = k_v1 * (s + 1) / 2 * dq + k_v1_2 * dq**2 + k_v1_3 * dq**3
    else:
        tau_fc = k_c2 * s * (1 - s) / 2
        tau_fv = k_v2 * (1 - s) / 2 * dq + k_v2_2 * dq**2 + k_v2_3 * dq**3
    return tau_fc if abs(dq) < lam else tau_fc + tau_fv


SPEEDS = np.concatenate(
    [
        np.linspace(-3, 3, 601),
        np.linspace(-1e-3, 1e-3, 201),
        [0.0, -0.0, 0.05, -0.05, 1e-300, -1e-300, 5e-324],
    ]
)


@pytest.mark.parametrize("lam", [0.0, 0.05, 1.0, 10.0])
@pytest.mark.parametrize("eps", [1e-4, 1e-2, 1.0])
def test_friction_basis_is_equations_9_to_11(lam, eps):
    basis = _core.friction_basis(SPEEDS, lam, eps)
    assert basis.shape == (len(SPEEDS), 8)
    for column, unit in enumerate(np.eye(8)):
        expected = [friction_of_the_paper(dq, unit, lam, eps) for dq in SPEEDS]
        assert_allclose(basis[:, column], expected, rtol=1e-14, atol=0, err_msg=_core.FRICTION_NAMES[column])
    k = np.random.default_rng(0).normal(size=8)
    assert_allclose(basis @ k, [friction_of_the_paper(dq, k, lam, eps) for dq in SPEEDS], **ALGEBRAIC)


def test_friction_names_are_the_order_of_the_basis():
    assert _core.FRICTION_NAMES == [
        "coulomb_pos",
        "coulomb_neg",
        "viscous1_pos",
        "viscous1_neg",
        "viscous2_pos",
        "viscous2_neg",
        "viscous3_pos",
        "viscous3_neg",
    ]


def test_friction_is_zero_at_rest():
    assert_array_equal(_core.friction_basis([0.0, -0.0], 0.0, 1e-3), 0.0)


def test_viscous_friction_jumps_at_the_threshold():
    below, at = _core.friction_basis([np.nextafter(0.1, 0), 0.1], 0.1, 1e-3)
    assert_array_equal(below[2:], 0.0)
    assert_allclose(at[[2, 4, 6]], [0.1, 0.01, 0.001], rtol=1e-14)


@pytest.mark.parametrize(("lam", "eps"), [(-0.1, 1e-3), (0.1, 0.0), (0.1, -1.0), (np.nan, 1.0), (0.1, np.inf)])
def test_wrong_shapes_of_friction_are_refused(lam, eps):
    with pytest.raises(ValueError):
        _core.friction_basis([0.1], lam, eps)
    with pytest.raises(ValueError):
        _core.Effect.friction([lam], [eps])
