"""Gaussian mixture regression of six joints with ten components: against the library gmr."""

from __future__ import annotations

import numpy as np
from gmr import GMM
from measure import compare

from dynid_rs import _core

N_COMPONENTS = 10


def rows():
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
