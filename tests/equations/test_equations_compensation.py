"""Eqs. 26-39 of the paper by another route: a literal transcription, numpy.linalg, scipy, gmr, quadrature."""

import numpy as np
import pytest
from gmr import GMM
from helpers import printed
from helpers.tolerances import ALGEBRAIC
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import softmax
from scipy.stats import multivariate_normal, norm
from sklearn.mixture import GaussianMixture

from dynid_rs import GaussianMixtureRegressor, RbfRegressor, _core
from dynid_rs.simulation import bundled_robot

QUADRATURE = {"rtol": 1e-7, "atol": 1e-7}
"""Adaptive quadrature over the output, numbers of order one."""

LIMITS = np.array([[-2e-3, 3e-3], [-0.02, 0.05]])
"""Deflection [rad] and its rate [rad/s]."""


def gear_data(n=600, seed=0):
    """Deflection and rate (n, 2), and a torque with a step in the rate (n,)."""
    random = np.random.default_rng(seed)
    u = random.uniform(*LIMITS.T, size=(n, 2))
    u[:2] = LIMITS.T  # the limits of the data are known
    return u, 20 * np.tanh(u[:, 1] / 0.01) - 3e3 * u[:, 0] + 0.5 * random.normal(size=n)


def printed_basis(u, centers, sigma):
    """Eq. 27, one input: psi_j(u), (n, N)."""
    return np.array([[np.exp(-1 / (2 * s**2) * (x - c) ** 2) for c, s in zip(centers, sigma, strict=True)] for x in u])


def printed_centers(low, high, n):
    """Eq. 28, line by line: c_j and sigma_j, the last sigma repeated "to satisfy data synchronization"."""
    c = [low + (j - 1) * ((high - low) / (n - 1)) for j in range(1, n + 1)]
    sigma = [1 / (0.5 * (c[j + 1] - c[j])) ** 2 for j in range(n - 1)]
    return np.array(c), np.array([*sigma, sigma[-1]])


# Eq. 26


def mixture_over(scale, seed=1):
    rng = np.random.default_rng(seed)
    size = np.array([*scale, 5.0])
    half = 0.3 * rng.normal(size=(3, 3, 3)) + 0.5 * np.eye(3)
    covariances = half @ half.transpose(0, 2, 1) * np.outer(size, size)
    return _core.GaussianMixtureRegression([0.2, 0.5, 0.3], rng.normal(size=(3, 3)) * size, covariances)


def rbf_over(scale, seed=2):
    rng = np.random.default_rng(seed)
    centers = rng.normal(size=(7, 2)) * scale
    return _core.NormalisedRbf(centers, 4 / np.square(scale), rng.normal(size=7), rng.uniform(0.1, 1, 7))


def model_with(inputs, regressions):
    robot = _core.RobotModel.from_urdf(str(bundled_robot()))
    n = robot.n_joints
    friction = _core.Effect.friction([0.05] * n, [0.01] * n)
    return _core.TorqueModel(
        robot,
        robot.phi,
        [(friction, np.full((n, 8), 2.0))],
        residual=None if inputs is None else (inputs, regressions),
        compliance=None if inputs is None else [1e-6] * n,
        encoder_delay=[0.0] * n,
        noise_std=[0.5] * n,
        domain=([[-3.0, 3.0]] * n, [3.0] * n, [9.0] * n),
    )


def states(n=200):
    rng = np.random.default_rng(3)
    q, dq, ddq = (rng.uniform(-1, 1, (n, 6)) for _ in range(3))
    return q, dq, ddq, q + 2e-3 * rng.normal(size=q.shape), dq + 0.02 * rng.normal(size=q.shape), ddq


@pytest.mark.parametrize("inputs", ["deflection", "joint_state", "load_free_deflection"])
def test_eq_26_torque_is_friction_plus_residual_plus_link(inputs):
    scale = (1.0, 1.0) if inputs == "joint_state" else (3e-3, 0.03)
    regressions = [mixture_over(scale), rbf_over(scale), None, mixture_over(scale, 4), rbf_over(scale, 5), None]
    model = model_with(inputs, regressions)
    q, dq, ddq, q_motor, dq_motor, _ = signals = states()
    total, terms, status = model.evaluate(*signals)
    tau_link = model.robot.inverse_dynamics(q, dq, ddq, model.phi)
    plain = model_with(None, []).evaluate(*signals)[0]
    deflection, rate = q_motor - q, dq_motor - dq
    pair = {
        "deflection": (deflection, rate),
        "joint_state": (q_motor, dq_motor),
        "load_free_deflection": (deflection - 1e-6 * tau_link, rate),
    }[inputs]
    for j, regression in enumerate(regressions):
        u = np.stack([pair[0][:, j], pair[1][:, j]], axis=1)
        expected = np.zeros(len(q)) if regression is None else regression.predict(u)[0]
        near = status & 4 == 0
        assert near.sum() > 5
        assert_allclose(total[near, j] - plain[near, j], expected[near], **ALGEBRAIC)
        assert_allclose(terms[near, -1, j], expected[near], **ALGEBRAIC)
        friction = printed.friction(dq_motor[:, j], 0.05, 0.01, np.full(8, 2.0))
        assert_allclose(terms[:, 1, j], friction, **ALGEBRAIC)
    assert_allclose(terms[:, 0], tau_link, **ALGEBRAIC)
    assert_allclose(terms.sum(axis=1), total, **ALGEBRAIC)


# Eqs. 27-30


def test_eq_27_basis():
    u, center, h = np.random.default_rng(0).uniform(-1, 1, 50), np.linspace(-1, 1, 6), 7.0
    psi = _core.NormalisedRbf(center[:, None], [h], np.zeros(6), np.zeros(6)).basis(u[:, None])
    assert_allclose(psi, printed_basis(u, center, np.full(6, h**-0.5)), **ALGEBRAIC)


def test_eq_27_two_inputs_multiply():
    rng = np.random.default_rng(0)
    u, centers, h = rng.uniform(-1, 1, (50, 2)), rng.uniform(-1, 1, (6, 2)), [3.0, 11.0]
    psi = _core.NormalisedRbf(centers, h, np.zeros(6), np.zeros(6)).basis(u)
    each = [printed_basis(u[:, i], centers[:, i], np.full(6, h[i] ** -0.5)) for i in range(2)]
    assert_allclose(psi, each[0] * each[1], **ALGEBRAIC)


@pytest.mark.parametrize("n_centers", [2, 3, 8])
def test_eq_28_centers_and_widths(n_centers):
    """On a grid over the limits; the width is sigma = spacing / 2 as meant, 1 / (spacing / 2)^2 as printed."""
    u, y = gear_data()
    built = RbfRegressor(n_centers).fit(u, y)
    printed = RbfRegressor(n_centers, as_printed=True).fit(u, y)
    for i, (low, high) in enumerate(LIMITS):
        c, sigma = printed_centers(low, high, n_centers)
        assert_allclose(np.unique(np.round(printed.centers_[:, i], 12)), c, rtol=0, atol=1e-12)
        assert_allclose(np.unique(np.round(built.centers_[:, i], 12)), c, rtol=0, atol=1e-12)
        assert_allclose(printed.precision_[i] ** -0.5, sigma[0], rtol=1e-10)
        assert_allclose(built.precision_[i] ** -0.5, 0.5 * (c[1] - c[0]), rtol=1e-10)
    assert len(printed.centers_) == n_centers**2


def test_eq_28_as_printed_is_a_constant_at_gear_size():
    """1e-4 rad between the centres make bumps 4e8 rad wide, and Eq. 29 a mean of the weights, whatever they are."""
    u = np.linspace(0, 1e-3, 200)[:, None]
    y = np.sign(u[:, 0] - 5e-4)
    printed = RbfRegressor(11, as_printed=True).fit(u, y)
    assert_allclose(printed.precision_**-0.5, 4e8, rtol=1e-9)
    assert np.ptp(printed.predict(u)) < 1e-12
    assert RbfRegressor(11).fit(u, y).score(u, y) > 0.9


@pytest.mark.parametrize("as_printed", [False, True])
def test_eq_29_normalised_sum(as_printed):
    u, y = gear_data()
    scale = 1.0 if not as_printed else 300.0  # where the printed width is of the data's own size
    fitted = RbfRegressor(5, as_printed=as_printed).fit(scale * u, y)
    psi = np.ones((len(u), len(fitted.centers_)))
    for i in range(2):
        sigma = np.full(len(fitted.centers_), fitted.precision_[i] ** -0.5)
        psi *= printed_basis(scale * u[:, i], fitted.centers_[:, i], sigma)
    assert_allclose(fitted.predict(scale * u), psi @ fitted.weights_ / psi.sum(axis=1), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("distance", [1e2, 1e6, 1e150])
def test_eq_29_far_from_the_centers(distance):
    """Printed, it is 0 / 0 there. In logs it is the weight of the nearest centre: softmax of the exponents."""
    centers, h, w = np.array([[0.0], [1.0], [2.5]]), 4.0, np.array([3.0, -1.0, 2.0])
    rbf = _core.NormalisedRbf(centers, [h], w, np.zeros(3))
    u = np.array([[distance], [-distance], [1.7]])
    with np.errstate(over="ignore"):
        exponents = np.maximum(-h / 2 * (u - centers.T) ** 2, np.finfo(float).min)
    assert_allclose(rbf.shares(u), softmax(exponents, axis=1), **ALGEBRAIC)
    assert_allclose(rbf.predict(u)[0], softmax(exponents, axis=1) @ w, **ALGEBRAIC)
    if distance < 1e100:
        assert_allclose(rbf.predict(u)[0][:2], [2.0, 3.0])


def test_eq_30_weighted_means():
    """The printed system, row by row: sum_i psi_j(i) f_target(i) = w_j sum_i psi_j(i)."""
    u, y = gear_data()
    fitted = RbfRegressor(4, weighting="weighted_means").fit(u, y)
    psi = fitted.rbf_.basis(u)
    assert_allclose(np.diag(psi.sum(axis=0)) @ fitted.weights_, psi.T @ y, **ALGEBRAIC)


def test_eq_30_alternative_is_least_squares():
    u, y = gear_data()
    fitted = RbfRegressor(4, ridge=0.0).fit(u, y)
    psi = fitted.rbf_.basis(u)
    shares = psi / psi.sum(axis=1, keepdims=True)
    assert_allclose(fitted.weights_, np.linalg.lstsq(shares, y, rcond=None)[0], rtol=1e-8)


def test_eq_30_smooths_and_least_squares_does_not():
    u, y = gear_data(4000)
    unseen, torque = gear_data(2000, seed=1)
    means, squares = (
        np.std(torque - RbfRegressor(8, weighting=w).fit(u, y).predict(unseen))
        for w in ("weighted_means", "least_squares")
    )
    assert squares < 0.7 * means


def test_eq_30_ridge_pulls_to_the_weighted_means():
    """Against the closed form (S'S + a)^-1 (S'y + a w_means)."""
    u, y = gear_data()
    fitted = RbfRegressor(6, ridge=0.3).fit(u, y)
    alone = RbfRegressor(6, weighting="weighted_means").fit(u, y).weights_
    shares, n = fitted.rbf_.shares(u), len(alone)
    a = 0.3 * len(y) / n
    assert_allclose(fitted.weights_, np.linalg.solve(shares.T @ shares + a * np.eye(n), shares.T @ y + a * alone))


# Eqs. 31-39

WEIGHTS = np.array([0.2, 0.5, 0.3])
MEANS = np.array([[-1.0, 0.5, 2.0], [0.5, -0.5, -1.0], [1.0, 1.0, 0.5]])
_HALF = np.random.default_rng(3).normal(size=(3, 3, 3))
COVARIANCES = 0.3 * _HALF @ _HALF.transpose(0, 2, 1) + 0.2 * np.eye(3)
MIXTURE = _core.GaussianMixtureRegression(WEIGHTS, MEANS, COVARIANCES)
QUERIES = np.random.default_rng(4).uniform(-1.5, 1.5, (8, 2))
COMPONENTS = [multivariate_normal(m, c) for m, c in zip(MEANS, COVARIANCES, strict=True)]
INPUTS = [multivariate_normal(m[:2], c[:2, :2]) for m, c in zip(MEANS, COVARIANCES, strict=True)]
ALONE = [_core.GaussianMixtureRegression([1.0], m[None], c[None]) for m, c in zip(MEANS, COVARIANCES, strict=True)]


def joint_density(u, f):
    """Eq. 31."""
    return sum(weight * part.pdf([*u, f]) for weight, part in zip(WEIGHTS, COMPONENTS, strict=True))


def moments(u):
    """Mass, mean and variance of f given u, by quadrature of Eq. 31 alone."""
    mass, first, second = (
        quad(lambda f, k=k: f**k * joint_density(u, f), -15, 15, epsabs=1e-12, limit=200)[0] for k in range(3)
    )
    return mass, first / mass, second / mass - (first / mass) ** 2


def test_eq_31_mixture_fitted_by_em_maximises_its_density():
    """The fitted mixture's log-likelihood is that of Eq. 31, and no random change of a mean raises it."""
    u, y = gear_data()
    fitted = GaussianMixtureRegressor(3, reg_covar=1e-9, tol=1e-8, max_iter=1000, random_state=0).fit(u, y)
    data = np.column_stack([u, y])
    mixture = fitted.mixture_

    def log_likelihood(means):
        density = sum(
            weight * multivariate_normal(mean, covariance).pdf(data)
            for weight, mean, covariance in zip(mixture.weights, means, mixture.covariances, strict=True)
        )
        return np.mean(np.log(density))

    best = log_likelihood(mixture.means)
    reference = GaussianMixture(3, reg_covar=1e-9, tol=1e-8, max_iter=1000, init_params="k-means++", random_state=0)
    scaled = (data - data.mean(axis=0)) / data.std(axis=0)
    assert_allclose(best, reference.fit(scaled).score(scaled) - np.sum(np.log(data.std(axis=0))), rtol=1e-9)
    random = np.random.default_rng(0)
    for _ in range(20):
        assert log_likelihood(mixture.means + 0.02 * data.std(axis=0) * random.normal(size=(3, 3))) < best


def em_step(weights, means, covariances, data):
    """One step of expectation (Eqs. 31, 32) and maximisation by the book: new weights, means, covariances."""
    share = np.stack(
        [w * printed.normal(data, m, c) for w, m, c in zip(weights, means, covariances, strict=True)], axis=1
    )
    share /= share.sum(axis=1, keepdims=True)
    size = share.sum(axis=0)
    new_means = share.T @ data / size[:, None]
    off = data[:, None, :] - new_means
    return size / len(data), new_means, np.einsum("nk,nki,nkj->kij", share, off, off) / size[:, None, None]


def test_eq_31_fitted_mixture_is_a_fixed_point_of_em():
    """Weights, means and covariances are what one more literal step makes of them."""
    u, y = gear_data()
    mixture = GaussianMixtureRegressor(3, reg_covar=1e-9, tol=1e-10, max_iter=5000, random_state=0).fit(u, y).mixture_
    data = np.column_stack([u, y])
    weights, means, covariances = em_step(mixture.weights, mixture.means, mixture.covariances, data)
    spread = data.std(axis=0)
    assert_allclose(weights, mixture.weights, atol=1e-4)
    assert_allclose(means / spread, mixture.means / spread, atol=1e-3)
    size = np.outer(spread, spread)
    assert_allclose(covariances / size, mixture.covariances / size, atol=1e-3)


@pytest.mark.parametrize("n_inputs", [1, 2, 3])
def test_eq_32_densities_as_printed_give_the_same_shares(n_inputs):
    """The printed factor is right for two inputs alone; for any other number it is common to all components."""
    rng = np.random.default_rng(n_inputs)
    weights, means = np.array([0.2, 0.5, 0.3]), rng.uniform(-1, 1, (3, n_inputs + 1))
    half = rng.normal(size=(3, n_inputs + 1, n_inputs + 1))
    covariances = 0.3 * half @ half.transpose(0, 2, 1) + 0.2 * np.eye(n_inputs + 1)
    u = rng.uniform(-2, 2, (20, n_inputs))
    share = np.stack(
        [w * printed.normal(u, m[:-1], c[:-1, :-1]) for w, m, c in zip(weights, means, covariances, strict=True)],
        axis=1,
    )
    core = _core.GaussianMixtureRegression(weights, means, covariances)
    assert_allclose(core.responsibilities(u), share / share.sum(axis=1, keepdims=True), **ALGEBRAIC)
    assert_allclose(core.predict(u)[0], printed.mixture_regression(weights, means, covariances, u), **ALGEBRAIC)


def test_eq_32_printed_normaliser_cancels():
    """1 / (2 pi sqrt|S|) is for two dimensions; for three it is (2 pi)^(1/2) too large in every component alike."""
    points = np.random.default_rng(5).normal(size=(10, 3))
    printed = np.empty((3, len(points)))
    for k, (mean, covariance) in enumerate(zip(MEANS, COVARIANCES, strict=True)):
        x = points - mean
        square = np.sum(x @ np.linalg.inv(covariance) * x, axis=1)
        printed[k] = np.exp(-0.5 * square) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))
        assert_allclose(printed[k] / COMPONENTS[k].pdf(points), np.sqrt(2 * np.pi), rtol=1e-12)
    share = WEIGHTS[:, None] * printed
    exact = WEIGHTS[:, None] * np.stack([part.pdf(points) for part in COMPONENTS])
    assert_allclose(share / share.sum(axis=0), exact / exact.sum(axis=0), **ALGEBRAIC)


@pytest.mark.parametrize("k", range(3))
def test_eqs_33_to_35_conditional_of_one_component(k):
    """p(f | u, k) = p(u, f | k) / p(u | k) is the normal density with the core's mean and variance."""
    mean, variance = ALONE[k].predict(QUERIES)
    for f in (-2.0, 0.3, 1.7):
        ratio = COMPONENTS[k].pdf(np.column_stack([QUERIES, np.full(len(QUERIES), f)])) / INPUTS[k].pdf(QUERIES)
        assert_allclose(norm(mean, np.sqrt(variance)).pdf(f), ratio, **ALGEBRAIC)


def test_eq_36_conditional_of_the_mixture():
    h = MIXTURE.responsibilities(QUERIES)
    parts = [alone.predict(QUERIES) for alone in ALONE]
    for f in (-1.0, 0.5):
        density = sum(h[:, k] * norm(mean, np.sqrt(var)).pdf(f) for k, (mean, var) in enumerate(parts))
        expected = [joint_density(u, f) / moments(u)[0] for u in QUERIES]
        assert_allclose(density, expected, **QUADRATURE)


def test_eq_37_responsibilities():
    share = WEIGHTS * np.stack([part.pdf(QUERIES) for part in INPUTS], axis=1)
    assert_allclose(MIXTURE.responsibilities(QUERIES), share / share.sum(axis=1, keepdims=True), **ALGEBRAIC)


def test_eq_38_mean():
    mean = MIXTURE.predict(QUERIES)[0]
    assert_allclose(mean, [moments(u)[1] for u in QUERIES], **QUADRATURE)
    gmm = GMM(3, priors=WEIGHTS, means=MEANS, covariances=COVARIANCES)
    assert_allclose(mean, gmm.predict(np.arange(2), QUERIES)[:, 0], **ALGEBRAIC)


def test_eq_39_variance_is_total():
    """By quadrature; as printed, sum h^2 S_k, it leaves out the spread of the means and is too small throughout."""
    variance = MIXTURE.predict(QUERIES)[1]
    assert_allclose(variance, [moments(u)[2] for u in QUERIES], **QUADRATURE)
    h = MIXTURE.responsibilities(QUERIES)
    printed = np.sum(h**2 * np.stack([alone.predict(QUERIES)[1] for alone in ALONE], axis=1), axis=1)
    assert np.all(printed < variance)
    assert np.min(printed / variance) < 0.6


# The torque's own standard deviation


def test_predicted_std_is_noise_where_no_third_loop_acts():
    signals = states()
    assert_allclose(model_with(None, []).predicted_std(*signals), 0.5, **ALGEBRAIC)
    model = model_with("deflection", [None, mixture_over((3e-3, 0.03)), None, None, None, None])
    std = model.predicted_std(*signals)
    assert_allclose(np.delete(std, 1, axis=1), 0.5, **ALGEBRAIC)


@pytest.mark.parametrize("make", [mixture_over, rbf_over])
def test_predicted_std_is_the_regressions_own_near_its_data(make):
    regression = make((3e-3, 0.03))
    model = model_with("deflection", [regression] * 6)
    q, dq, _, q_motor, dq_motor, _ = signals = states()
    near = model.evaluate(*signals)[2] & 4 == 0
    assert near.sum() > 5
    for j in range(6):
        u = np.stack([(q_motor - q)[:, j], (dq_motor - dq)[:, j]], axis=1)
        expected = np.sqrt(regression.predict(u)[1])
        assert_allclose(model.predicted_std(*signals)[near, j], expected[near], **ALGEBRAIC)


@pytest.mark.parametrize("make", [mixture_over, rbf_over])
def test_predicted_std_far_away_is_noise_and_the_whole_residual(make):
    """Monte Carlo of the output, inputs unknown: noise squared plus the residual's mean square about zero."""
    regression = make((3e-3, 0.03))
    model = model_with("deflection", [regression] * 6)
    random = np.random.default_rng(0)
    q, dq, ddq = (random.uniform(-1, 1, (3, 6)) for _ in range(3))
    std = model.predicted_std(q, dq, ddq, q + 1e3, dq, ddq)
    assert (model.evaluate(q, dq, ddq, q + 1e3, dq, ddq)[2] & 4 == 4).all()
    if isinstance(regression, _core.NormalisedRbf):
        k = random.integers(0, 7, 400_000)
        f = regression.weights[k] + np.sqrt(regression.variances[k]) * random.normal(size=len(k))
    else:
        k = random.choice(3, 400_000, p=regression.weights / regression.weights.sum())
        f = regression.means[k, 2] + np.sqrt(regression.covariances[k, 2, 2]) * random.normal(size=len(k))
    assert_allclose(std, np.sqrt(0.25 + np.mean(f**2)), rtol=0.01)


def test_predicted_std_is_continuous_while_the_residual_fades():
    regression = _core.NormalisedRbf([[0.0, 0.0], [1e-3, 0.0]], [1e6, 1e2], [5.0, -5.0], [0.2, 0.3])
    model = model_with("deflection", [regression] * 6)
    deflection = np.linspace(0, 1e-2, 2001)[:, None]
    q = np.zeros((2001, 6))
    std = model.predicted_std(q, q, q, q + deflection, q, q)
    assert np.max(np.abs(np.diff(std, axis=0))) < 0.1  # of a step of 4.5 from end to end
    assert std[0, 0] < 0.6 < 5.0 < std[-1, 0]
