"""Gaussian mixtures of ten components: EM against scikit-learn, regression against the library gmr."""

from __future__ import annotations

import numpy as np
from em import ITERATIONS, from_start, samples
from gmr import GMM
from measure import compare
from threadpoolctl import threadpool_limits

from dynid_rs import _core

N_COMPONENTS = 10


def rows(large: bool):
    """Goals G10 and G11."""
    for n_samples in (2_000, 20_000, 200_000) if large else (2_000,):
        with threadpool_limits(limits=1):
            yield iterations(n_samples)
    yield from regression()


def iterations(n_samples):
    """The same number of steps from the same start, to the same log-likelihood."""
    ours, theirs = from_start(samples(n_samples, N_COMPONENTS, np.random.default_rng(0)), N_COMPONENTS)
    off = abs(ours()[3][-1] - theirs().lower_bound_)
    assert off < 1e-9, off
    return compare(
        "G10",
        f"{ITERATIONS} steps of EM, {n_samples:,} samples, {N_COMPONENTS} components",
        ours,
        "scikit-learn",
        theirs,
        limit=70,
        rounds=5,
        note=f"log-likelihoods per sample differ by {off:.0e}",
    )


def regression():
    """Goal G11."""
    rng = np.random.default_rng(0)
    weights = np.full(N_COMPONENTS, 1 / N_COMPONENTS)
    means = rng.uniform(-1, 1, (N_COMPONENTS, 3))
    root = rng.uniform(-0.5, 0.5, (N_COMPONENTS, 3, 3)) + np.eye(3)
    covariances = root @ root.transpose(0, 2, 1)
    ours = _core.GaussianMixtureRegression(weights, means, covariances)
    peer = GMM(N_COMPONENTS, weights, means, covariances)
    u = rng.uniform(-1, 1, (10_000, 2))
    index = np.array([0, 1])
    np.testing.assert_allclose(ours.predict(u)[0], peer.predict(index, u)[:, 0], rtol=1e-9, atol=1e-12)
    yield compare(
        "G11",
        "mixture regression of 10,000 points, per point (ours with variances)",
        lambda: ours.predict(u),
        "gmr",
        lambda: peer.predict(index, u),
        per=len(u),
        limit=60,
    )
    one = u[:1]
    yield compare(
        "G11",
        "mixture regression of one point from Python",
        lambda: ours.predict(one),
        "gmr",
        lambda: peer.predict(index, one),
    )
