"""What chance alone would give: copies of the residual that keep its memory and know nothing of any effect.

Samples are correlated, so a score is compared with its spread over phase-randomised copies of what is left (Theiler et
al. 1992, Physica D 58): same spectrum, same correlation between joints, no relation to the motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import ABSORBED, Beside

FloatArray = NDArray[np.float64]

N_COPIES = 240
"""Copies; the spread of a score is then known to 5 %, which the F distribution accounts for."""


def phase_randomised(
    residual: FloatArray, blocks: Sequence[slice], n_copies: int = N_COPIES, random_state: int = 0
) -> FloatArray:
    """Copies (n_joints, n_rows, n_copies) of `residual` (n_rows, n_joints), every block by itself."""
    from scipy.fft import irfft, rfft

    rng = np.random.default_rng(random_state)
    n_rows, n_joints = residual.shape
    copies = np.empty((n_joints, n_rows, n_copies))
    for block in blocks:
        part = residual[block]
        n = len(part)
        lines = rfft(part, axis=0)
        turns = rng.uniform(0.0, 2 * np.pi, (len(lines), n_copies))
        turns[0] = np.pi * rng.integers(0, 2, n_copies)
        if n % 2 == 0:
            turns[-1] = np.pi * rng.integers(0, 2, n_copies)
        rotation = np.cos(turns) + 1j * np.sin(turns)
        for j in range(n_joints):
            copies[j, block] = irfft(lines[:, j, None] * rotation, n, axis=0)
    return copies


def p_value(
    beside: Beside,
    columns: Mapping[int, FloatArray],
    after: FloatArray,
    free: NDArray[np.bool_],
    *,
    n_searched: int = 0,
    n_copies: int = N_COPIES,
) -> float:
    """Probability that chance gives a score as large as this, one candidate alone.

    Parameters
    ----------
    columns : {joint: (n_rows, k)}
        Of the candidate.
    after : ndarray (n_rows, n_joints)
        What is left with the candidate: its own null, for before it the residual holds the effect itself.
    free : ndarray (k,)
        Coefficients that were fitted, not held at a bound.
    n_searched : int
        Shape parameters that were chosen on the same rows: to first order each is one more coefficient.
    """
    from scipy.stats import f

    if not free.any():
        return 1.0
    own = beside.own_part(columns)
    # What the fit has taken away of the noise is missing in its residual.
    copies = phase_randomised(after, beside.blocks, n_copies) * beside.blown_up[:, None, None]
    weights = beside.weights**2
    scores = sum(weights[j] * (own[j][:, free].T @ copies[j]) for j in range(beside.n_joints))
    score = sum(weights[j] * (own[j][:, free].T @ beside.residual[:, j]) for j in range(beside.n_joints))
    scores, score = np.atleast_2d(np.asarray(scores)), np.asarray(score)
    spread = np.sqrt(np.mean(scores**2, axis=1))
    scores, score = scores / spread[:, None], score / spread
    values, vectors = np.linalg.eigh(scores @ scores.T / scores.shape[1])
    good = values > 1e-6 * values[-1]
    k = int(good.sum())
    distance = float(np.sum((vectors[:, good].T @ score) ** 2 / values[good]))
    k += n_searched
    return float(f.sf(distance * (n_copies - k) / (k * n_copies), k, n_copies - k))


def effective_tests(
    beside: Beside, groups: Sequence[tuple[Mapping[int, FloatArray], Sequence[slice]]], n_copies: int = N_COPIES
) -> float:
    """How many independent candidates the given ones are worth: one over their mean least p under chance, less one.

    Candidates overlap widely, so that Bonferroni's correction by their number would throw power away.

    Parameters
    ----------
    groups : sequence of (columns, groups of columns)
        Columns {joint: (n_rows, K)} and which of them belong to one candidate.
    """
    from scipy.stats import chi2

    copies = phase_randomised(beside.residual, beside.blocks, n_copies, random_state=1)
    weights = beside.weights**2
    absorbed = beside.imitated_scores(copies)
    least = np.ones(n_copies)
    for columns, slices in groups:
        imitated, gram, _, _ = beside.products(columns)
        scores = sum(weights[j] * (C.T @ copies[j]) for j, C in columns.items()) - imitated.T @ absorbed
        scores = np.asarray(scores)
        own = np.diag(gram) - np.sum(imitated**2, axis=0)
        clear = own > ABSORBED * np.diag(gram)
        for group in slices:
            part = scores[group][clear[group]]
            if not len(part):
                continue
            part = part / np.sqrt(np.mean(part**2, axis=1, keepdims=True))
            values, vectors = np.linalg.eigh(part @ part.T / n_copies)
            good = values > 1e-6 * values[-1]
            distance = np.sum((vectors[:, good].T @ part) ** 2 / values[good, None], axis=0)
            least = np.minimum(least, chi2.sf(distance, int(good.sum())))
    return max(1.0, float(1 / np.mean(least) - 1))
