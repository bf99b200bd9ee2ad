"""Formulas exactly as the double-encoder paper prints them, sample by sample; nothing of the package is used."""

import numpy as np


def friction(dq, threshold, eps, k):
    """Eqs. 9-11 at speeds dq (n,): (n,). `k` in the order of `FRICTION_NAMES`; superscripts are indices."""
    torques = []
    for v in dq:
        s = np.tanh(v / eps)
        if v >= 0:
            coulomb = k[0] * s * (s + 1) / 2
            viscous = k[2] * (s + 1) / 2 * v + k[4] * v**2 + k[6] * v**3
        else:
            coulomb = k[1] * s * (1 - s) / 2
            viscous = k[3] * (1 - s) / 2 * v + k[5] * v**2 + k[7] * v**3
        torques.append(coulomb if abs(v) < threshold else coulomb + viscous)
    return np.array(torques)


def friction_columns(dq, threshold, eps):
    """The same per coefficient: (n, 8)."""
    return np.stack([friction(dq, threshold, eps, unit) for unit in np.eye(8)], axis=1)


def normal(x, mean, covariance):
    """Eq. 32 at points x (n, d): (n,). The factor 1 / (2 pi) is that of two dimensions, whatever d is."""
    off = x - mean
    square = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
    return np.exp(-0.5 * square) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))


def mixture_regression(weights, means, covariances, u):
    """Eqs. 34, 37 and 38 at inputs u (n, d): conditional mean (n,)."""
    d = u.shape[1]
    share, mean = np.zeros((2, len(u), len(weights)))
    for k in range(len(weights)):
        centre, within = means[k][:d], covariances[k][:d, :d]
        share[:, k] = weights[k] * normal(u, centre, within)
        mean[:, k] = means[k][d] + (u - centre) @ np.linalg.inv(within) @ covariances[k][:d, d]
    return np.sum(share * mean, axis=1) / np.sum(share, axis=1)
