"""The one linear model under a prior: its evidence and its scores against plain Gaussian algebra, written out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from dynid_rs.regression.linear_model import AT_ONCE, Choice, Known, LinearModel, sign_cost

N, JOINTS, UNKNOWNS = 30, 2, 6
FREE = (-np.inf, np.inf)
PLACES = [np.array([0, 1, 2, 3]), np.array([2, 3, 4, 5])]
"""Two joints that share two unknowns."""


@dataclass(frozen=True, eq=False)
class PlainPrior:
    """Normal around centre * mean with the covariance (width * root)'(width * root)."""

    mean: np.ndarray
    root: np.ndarray

    @property
    def size(self):
        return len(self.mean)

    def rows(self, choice):
        across = np.linalg.inv(choice.width * self.root).T
        log_det = np.linalg.slogdet(self.covariance(choice.width))[1]
        return np.column_stack([across, across @ (choice.centre * self.mean)]), float(log_det)

    def covariance(self, width):
        return width**2 * self.root.T @ self.root


def make(seed=0, n_effective=None):
    """Model, its dense columns (JOINTS, N, UNKNOWNS) and targets (JOINTS, N)."""
    rng = np.random.default_rng(seed)
    prior = PlainPrior(rng.normal(size=UNKNOWNS), rng.normal(size=(UNKNOWNS, UNKNOWNS)))
    dense = np.zeros((JOINTS, N, UNKNOWNS))
    for j, at in enumerate(PLACES):
        dense[j][:, at] = rng.normal(size=(N, len(at)))
    y = dense @ rng.normal(size=UNKNOWNS) + 0.3 * rng.normal(size=(JOINTS, N))
    rows = [np.column_stack([dense[j][:, at], y[j]]) for j, at in enumerate(PLACES)]
    n_effective = np.full(JOINTS, float(N)) if n_effective is None else n_effective
    return LinearModel(rows, PLACES, prior, n_effective, np.full(JOINTS, 1e-9), N), dense, y


NOISE = np.array([12.0, 15.0])
"""Standard deviations far above what is left, so that the least noise holds them where they are."""


def held(model):
    """The same model with its noise held at NOISE: no noise is smaller than the least."""
    return LinearModel(model.rows, model.places, model.prior, model.n_effective, NOISE, model.n_rows, model.n_further)


def marginal(dense, y, prior, width, centre, noise):
    """Logarithm of the density of all rows, every unknown integrated out."""
    C = dense.reshape(-1, dense.shape[-1])
    covariance = C @ prior.covariance(width) @ C.T + np.diag(np.repeat(noise**2, y.shape[1]))
    return multivariate_normal(C @ (centre * prior.mean), covariance).logpdf(y.ravel())


def constant(y):
    """What the evidence leaves out: the same for every model of the same rows."""
    return -0.5 * y.size * np.log(2 * np.pi)


@pytest.mark.parametrize("centre", [0.0, 1.0])
@pytest.mark.parametrize("width", [0.1, 1.0, 10.0])
def test_the_evidence_is_the_marginal_likelihood(width, centre):
    model, dense, y = make()
    fit = held(model).fit(Choice(width, centre), NOISE)
    assert_array_equal(fit.noise, NOISE)
    expected = marginal(dense, y, model.prior, width, centre, NOISE)
    assert fit.evidence + constant(y) == pytest.approx(expected, abs=1e-8)


def test_a_row_that_counts_for_less_tempers_the_likelihood():
    """p(y | x)^k: a Gaussian with variance sigma^2 / k, less what the power of its own constant takes."""
    share = np.array([0.25, 0.5])
    model, dense, y = make(n_effective=share * N)
    fit = held(model).fit(Choice(1.0, 1.0), NOISE)
    expected = marginal(dense, y, model.prior, 1.0, 1.0, NOISE / np.sqrt(share))
    # ln N(sigma / sqrt k) has -ln(sigma / sqrt k) per row where the tempered one has -k ln sigma.
    expected += np.sum(N * np.log(NOISE / np.sqrt(share)) - N * share * np.log(NOISE))
    assert fit.evidence + constant(y) == pytest.approx(expected, abs=1e-8)


def test_the_unknowns_and_their_covariance_are_those_of_bayes():
    model, dense, y = make()
    fit = held(model).fit(Choice(0.7, 1.0), NOISE)
    across, _ = model.prior.rows(Choice(0.7, 1.0))
    A = np.concatenate([*(dense / NOISE[:, None, None]), across[:, :-1]])
    b = np.concatenate([*(y / NOISE[:, None]), across[:, -1]])
    assert_allclose(fit.x, np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-9)
    assert_allclose(fit.covariance, np.linalg.inv(A.T @ A), rtol=1e-8, atol=1e-12)
    for j, left in enumerate(fit.residual):
        assert_allclose(left, y[j] - dense[j] @ fit.x, atol=1e-10)
    assert_allclose(fit.weights, 1 / NOISE)


def test_where_some_unknowns_are_known_the_others_are_those_of_least_squares_beside_them():
    model, dense, y = make()
    choice = Choice(0.7, 1.0)
    across, _ = model.prior.rows(choice)
    A = np.concatenate([*(dense / NOISE[:, None, None]), across[:, :-1]])
    b = np.concatenate([*(y / NOISE[:, None]), across[:, -1]])
    known = Known(np.array([0.4, -1.2]), np.array([0, 3]))
    beside, others = held(model).fit(choice, NOISE).given(known), [1, 2, 4, 5]
    assert_array_equal(beside.x[known.places], known.x)
    left = b - A[:, known.places] @ known.x
    assert_allclose(beside.x[others], np.linalg.lstsq(A[:, others], left, rcond=None)[0], rtol=1e-8)
    assert_allclose(beside.left(0), y[0] - dense[0] @ beside.x, atol=1e-10)


def test_the_noise_is_the_most_probable_one():
    """MacKay's fixed point is where the evidence is greatest over the noise, to the 1 % at which its search ends."""
    model, dense, y = make(3)
    fit = model.fit(Choice(1.0, 0.0), np.ones(JOINTS))
    best = marginal(dense, y, model.prior, 1.0, 0.0, fit.noise)
    assert fit.evidence + constant(y) == pytest.approx(best, abs=1e-8)
    for j in range(JOINTS):
        for factor in (0.9, 1.1):
            other = fit.noise.copy()
            other[j] *= factor
            assert marginal(dense, y, model.prior, 1.0, 0.0, other) < best


def test_unknowns_that_nothing_holds_stay_at_zero():
    model, _, _ = make()
    gone = model.without([(0, 0)]).fit(Choice(1.0, 0.0), NOISE)
    assert np.all(np.isfinite(gone.x))

    class Partly(PlainPrior):
        def rows(self, choice):
            return np.eye(2, UNKNOWNS + 1, 4), 0.0  # holds the last two only

    bare = LinearModel([part[:, 2:] for part in model.rows], [PLACES[0][2:], PLACES[1][2:]], model.prior,
                       model.n_effective, NOISE, N)  # fmt: skip
    free = LinearModel(bare.rows, bare.places, Partly(model.prior.mean, model.prior.root), bare.n_effective, NOISE, N)
    assert_array_equal(free.fit(Choice(1.0, 0.0), NOISE).x[:2], 0.0)


def test_a_noise_that_is_known_stays():
    """The same as a fit that ends there, whatever is left."""
    model, dense, y = make(3)
    for noise in (np.array([0.05, 4.0]), NOISE):
        fit = model.at(Choice(1.0, 0.0), noise)
        assert_array_equal(fit.noise, noise)
        assert fit.evidence + constant(y) == pytest.approx(marginal(dense, y, model.prior, 1.0, 0.0, noise), abs=1e-7)


def hypotheses(rng):
    """One on a joint alone, one of two columns, one across both joints."""
    return [
        {0: rng.normal(size=(N, 1))},
        {1: rng.normal(size=(N, 2))},
        {0: rng.normal(size=(N, 1)), 1: rng.normal(size=(N, 1))},
    ]


def test_the_score_is_the_difference_of_log_evidences():
    model, dense, y = make(1)
    model = held(model)
    fit = model.fit(Choice(1.0, 1.0), NOISE)
    tried = hypotheses(np.random.default_rng(5))
    bounds = [np.tile(FREE, (next(iter(columns.values())).shape[1], 1)) for columns in tried]
    for columns, score in zip(tried, model.screen(fit, tried, bounds), strict=True):
        beside = model.beside(columns).fit(Choice(1.0, 1.0), NOISE)
        assert score.value == pytest.approx(beside.evidence - fit.evidence, abs=1e-8)
        width = next(iter(columns.values())).shape[1]
        further = np.zeros((JOINTS, N, width))
        for j, part in columns.items():
            further[j] = part
        whole = np.concatenate([dense, further], axis=2)
        root = np.eye(UNKNOWNS + width)
        root[:UNKNOWNS, :UNKNOWNS] = model.prior.root
        wide = PlainPrior(np.append(model.prior.mean, np.zeros(width)), root)
        expected = marginal(whole, y, wide, 1.0, 1.0, NOISE) - marginal(dense, y, model.prior, 1.0, 1.0, NOISE)
        assert score.value == pytest.approx(expected, abs=1e-8)


def test_of_several_sizes_the_best_counts():
    model = held(make(1)[0])
    fit = model.fit(Choice(1.0, 1.0), NOISE)
    (columns,) = hypotheses(np.random.default_rng(6))[:1]
    sizes = (0.1, 1.0, 10.0)
    (best,) = model.screen(fit, [columns], [np.array([FREE])], sizes)
    single = [
        model.beside({j: size * part for j, part in columns.items()}).fit(Choice(1.0, 1.0), NOISE).evidence
        for size in sizes
    ]
    assert best.value == pytest.approx(max(single) - fit.evidence, abs=1e-8)
    assert best.size == sizes[int(np.argmax(single))]


def test_many_hypotheses_at_once_are_scored_as_one_by_one():
    model = held(make(2)[0])
    fit = model.fit(Choice(1.0, 0.0), NOISE)
    rng = np.random.default_rng(7)
    tried = [hypotheses(rng)[k % 3] for k in range(AT_ONCE + 5)]
    bounds = [np.tile(FREE, (next(iter(columns.values())).shape[1], 1)) for columns in tried]
    together = [score.value for score in model.screen(fit, tried, bounds)]
    alone = [model.screen(fit, [columns], [held_to])[0].value for columns, held_to in zip(tried, bounds, strict=True)]
    assert_allclose(together, alone, rtol=1e-10)


@pytest.mark.parametrize(("bounds", "sign"), [((0.0, np.inf), 1.0), ((-np.inf, 0.0), -1.0)])
def test_a_coefficient_of_one_sign_has_half_a_normal_as_its_prior(bounds, sign):
    """The score of a single column against the integral over the half line, numerically."""
    model, _, _ = make(1)
    model = held(model)
    fit = model.fit(Choice(1.0, 1.0), NOISE)
    for columns in ({0: part} for part in np.random.default_rng(8).normal(size=(4, N, 1))):
        (score,) = model.screen(fit, [columns], [np.array([bounds])])

        def evidence_at(c, columns=columns):
            """Density of the rows less c times the column, over that without it."""
            rows = [part.copy() for part in model.rows]
            rows[0][:, -1] -= c * columns[0][:, 0]
            moved = LinearModel(rows, model.places, model.prior, model.n_effective, NOISE, N)
            return np.exp(moved.fit(Choice(1.0, 1.0), NOISE).evidence - fit.evidence)

        total, _ = quad(lambda c: 2 * norm.pdf(c) * evidence_at(sign * c), 0.0, 8.0)
        assert score.value == pytest.approx(np.log(total), abs=1e-6)


def test_the_sign_s_cost():
    assert sign_cost(np.array([3.0, -2.0]), np.array([FREE, FREE])) == 0.0
    z = np.array([0.5, -1.5])
    expected = np.log(2 * norm.cdf(0.5)) + np.log(2 * norm.cdf(1.5))
    assert sign_cost(z, np.array([[0.0, np.inf], [-np.inf, 0.0]])) == pytest.approx(expected)


def test_a_column_that_the_model_has_already_is_worth_nothing_under_a_wide_prior():
    """What the model can imitate of a hypothesis is not its own: it costs its prior, and gains nothing."""
    model = held(make(4)[0])
    fit = model.fit(Choice(1e4, 0.0), NOISE)
    columns = {j: part[:, [list(at).index(2)]] for j, (part, at) in enumerate(zip(model.rows, PLACES, strict=True))}
    (score,) = model.screen(fit, [columns], [np.array([FREE])])
    assert abs(score.value) < 1e-3


def test_without_a_joint_s_columns_their_unknowns_stay_elsewhere():
    model, dense, y = make()
    shared = 2
    fit = held(model.without([(0, shared)])).fit(Choice(1.0, 1.0), NOISE)
    cut = dense.copy()
    cut[0][:, shared] = 0.0
    assert fit.evidence + constant(y) == pytest.approx(marginal(cut, y, model.prior, 1.0, 1.0, NOISE), abs=1e-8)


def test_what_is_put_beside_and_taken_away_again_leaves_the_model():
    """All that stays is an unknown without columns, standard normal: nothing to the evidence."""
    model = held(make()[0])
    beside = model.beside({0: np.random.default_rng(0).normal(size=(N, 2))})
    assert beside.n_further == 2
    assert_array_equal(beside.places[1], model.places[1])
    back = beside.without([(0, UNKNOWNS), (0, UNKNOWNS + 1)])
    one, other = model.fit(Choice(1.0, 0.0), NOISE), back.fit(Choice(1.0, 0.0), NOISE)
    assert other.evidence == pytest.approx(one.evidence, abs=1e-9)
    assert_allclose(other.x, np.append(one.x, [0.0, 0.0]), atol=1e-10)


def test_left_out_blocks_are_predicted_by_fits_to_the_others():
    model = held(make(2)[0])
    fit = model.fit(Choice(0.5, 1.0), NOISE)
    blocks = [np.arange(N) // 10 == k for k in range(3)]
    power = model.left_out(fit, blocks)
    for k, block in enumerate(blocks):
        rows, part = [own[~block] for own in model.rows], np.mean(~block)
        others = LinearModel(rows, model.places, model.prior, part * model.n_effective, model.least_noise, 2 * N // 3)
        others = held(others).fit(Choice(0.5, 1.0), NOISE)
        assert_array_equal(others.noise, NOISE)
        for j, (part, at) in enumerate(zip(model.rows, PLACES, strict=True)):
            left = part[block, -1] - part[block][:, :-1] @ others.x[at]
            assert power[k, j] == pytest.approx(left @ left, rel=1e-8)


def test_a_model_of_factors_is_the_model_of_their_rows():
    model, _, _ = make(2)
    factors = [np.linalg.qr(part, mode="r") for part in model.rows]
    reduced = LinearModel(factors, model.places, model.prior, model.n_effective, model.least_noise, N)
    one, other = (m.fit(Choice(1.0, 0.0), np.ones(JOINTS)) for m in (model, reduced))
    assert other.evidence == pytest.approx(one.evidence, abs=1e-8)
    assert_allclose(other.x, one.x, rtol=1e-8)
    assert_allclose(other.noise, one.noise, rtol=1e-8)


def test_units_of_the_unknowns_change_nothing():
    """A prior and columns in other units: the same evidence, up to the determinant that both priors carry alike."""
    model = held(make(2)[0])
    units = 10.0 ** np.array([-9, 6, 0, 3, -6, 9])
    prior = PlainPrior(model.prior.mean / units, model.prior.root / units)
    rows = [np.column_stack([p[:, :-1] * units[at], p[:, -1]]) for p, at in zip(model.rows, PLACES, strict=True)]
    other = LinearModel(rows, PLACES, prior, model.n_effective, NOISE, N).fit(Choice(1.0, 1.0), NOISE)
    one = model.fit(Choice(1.0, 1.0), NOISE)
    assert_allclose(other.x * units, one.x, rtol=1e-6, atol=1e-9)
    assert other.evidence == pytest.approx(one.evidence, abs=1e-5)


def test_unknowns_without_a_block_are_those_of_the_other_rows():
    model, dense, y = make(seed=5)
    fit = model.fit(Choice(1.0, 1.0), np.ones(JOINTS))
    block = np.arange(N) < 10
    (x,) = model.solved_without(fit, [block])
    C = dense[:, ~block].reshape(-1, UNKNOWNS)
    weights = np.repeat(fit.weights**2, (~block).sum())
    precision = np.linalg.inv(model.prior.covariance(1.0))
    normal = C.T @ (weights[:, None] * C) + precision
    assert_allclose(x, np.linalg.solve(normal, C.T @ (weights * y[:, ~block].ravel()) + precision @ model.prior.mean))


def test_factors_of_many_rows_take_no_memory_for_each():
    """A billion rows behind them: nothing is as long as that."""
    model, _, _ = make()
    factors = [np.linalg.qr(part, mode="r") for part in model.rows]
    wide = LinearModel(factors, model.places, model.prior, model.n_effective, model.least_noise, 1_000_000_000)
    assert [len(wide.phase), len(wide.counted[0])] == [len(factors[0])] * 2
