"""Gaussian mixtures side by side with their peers, in one process, alternating, one thread each.

EM against scikit-learn (same start, same number of iterations, k-means++ in neither), the whole fit, and mixture
regression in batch against gmr. Processor time, median and range over the rounds: `python benches/em.py`.
"""

from __future__ import annotations

import os

os.environ["RAYON_NUM_THREADS"] = "1"

import statistics
import time
import warnings

import numpy as np
from gmr import GMM
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture
from threadpoolctl import threadpool_limits

from dynid_rs import GaussianMixtureRegressor, _core
from dynid_rs.identification.mixture import start_of

ROUNDS = 7
ITERATIONS = 30
SIZES = [(2_000, 5), (2_000, 10), (20_000, 10), (20_000, 20), (200_000, 10)]
QUERIES = (1_000, 10_000, 100_000)
SHORTEST = 0.02
"""Repeat what takes less than this [s], so that a clock's tick does not count."""


class FromStart(GaussianMixture):
    """scikit-learn's iterations alone: the start is given."""

    start: tuple[np.ndarray, ...]

    def _initialize_parameters(self, X, random_state, xp=None):
        from sklearn.mixture._gaussian_mixture import _compute_precision_cholesky

        self.weights_, self.means_, self.covariances_ = self.start
        self.precisions_cholesky_ = _compute_precision_cholesky(self.covariances_, "full")


def seconds(function):
    """Processor time of one call."""
    repeats = 1
    while True:
        start = time.process_time()
        for _ in range(repeats):
            function()
        taken = time.process_time() - start
        if taken > SHORTEST:
            return taken / repeats
        repeats *= 4


def row(what, ours, theirs, remark=""):
    """Print medians and the ratio with its range over the rounds."""
    pairs = [(seconds(ours), seconds(theirs)) for _ in range(ROUNDS)]
    mine, other = (statistics.median(times) for times in zip(*pairs, strict=True))
    ratios = sorted(theirs / ours for ours, theirs in pairs)
    spread = f"{statistics.median(ratios):6.1f} x ({ratios[0]:.1f}-{ratios[-1]:.1f})"
    print(f"{what:<38} {1e3 * mine:9.3f} ms {1e3 * other:10.2f} ms  {spread}  {remark}", flush=True)


def samples(n, k, rng):
    centres = 2 * rng.normal(size=(k, 3))
    x = centres[rng.integers(k, size=n)] + 0.6 * rng.normal(size=(n, 3)) @ (np.eye(3) + 0.2)
    return (x - x.mean(axis=0)) / x.std(axis=0)


def from_start(x, k):
    """The same steps of EM by both, as two functions."""
    settings = {"tol": 0.0, "max_iter": ITERATIONS, "reg_covar": 1e-4, "init_params": "k-means++", "random_state": 0}
    theirs = FromStart(k, **settings)
    theirs.start = start_of(GaussianMixture(k, **settings), x)

    def ours():
        return _core.fit_mixture(x, *theirs.start, reg_covar=1e-4, tol=0.0, max_iter=ITERATIONS)

    def reference():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            return theirs.fit(x)

    assert len(ours()[3]) == reference().n_iter_ == ITERATIONS
    return ours, reference


def em(n, k, rng):
    ours, theirs = from_start(samples(n, k, rng), k)
    off = abs(ours()[3][-1] - theirs().lower_bound_)
    row(f"EM, {n} samples, {k} components", ours, theirs, f"log-likelihoods differ by {off:.0e}")


def whole_fit(n, k, rng):
    x = samples(n, k, rng)
    by = {
        solver: GaussianMixtureRegressor(k, max_iter=ITERATIONS, tol=0.0, random_state=0, solver=solver)
        for solver in ("fused", "scikit-learn")
    }
    row(
        f"whole fit, {n} samples, {k} components",
        *(lambda regressor=regressor: regressor.fit(x[:, :2], x[:, 2]) for regressor in by.values()),
    )


def regression(n, rng):
    x = samples(20_000, 10, rng)
    regressor = GaussianMixtureRegressor(10, random_state=0).fit(x[:, :2], x[:, 2])
    mixture = regressor.mixture_
    gmm = GMM(10, priors=mixture.weights, means=mixture.means, covariances=mixture.covariances)
    u = samples(n, 10, rng)[:, :2]
    off = np.abs(mixture.predict(u)[0] - gmm.predict(np.arange(2), u)[:, 0]).max()
    row(
        f"regression, {n} queries, 10 components",
        lambda: mixture.predict(u),
        lambda: gmm.predict(np.arange(2), u),
        f"means differ by {off:.0e}; ours gives variances too",
    )


def main():
    warnings.simplefilter("ignore", ConvergenceWarning)
    rng = np.random.default_rng(0)
    with threadpool_limits(limits=1):
        for n, k in SIZES:
            em(n, k, rng)
        whole_fit(20_000, 10, rng)
        for n in QUERIES:
            regression(n, rng)


if __name__ == "__main__":
    main()
