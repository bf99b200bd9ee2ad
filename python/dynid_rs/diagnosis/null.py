"""What chance alone would give: noise with the residual's own memory that knows nothing of any effect.

Samples are correlated, so a score is compared with its spread over copies of the noise: Gaussian, with the residual's
spectrum, smoothed, and made up for what the fit has taken away. (Phase-randomised copies of the residual itself keep
every line as it happened to be, and the lines that the declared model has emptied stay empty: where a candidate lives
on a few of those, chance looks ten times rarer than it is.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import ABSORBED, Beside, line_power

FloatArray = NDArray[np.float64]

N_COPIES = 240
"""Copies; the spread of a score is then known to 5 %, which the F distribution accounts for."""
LEAST_LINES = 40.0
"""Spectral lines that are averaged, those counted out that the fit has taken."""
FINE_BINS = 64
"""Stretches of the spectrum, which are joined until they hold enough lines."""
TAIL = 0.05
"""Part of the copies, those with the least p values, that tells how many tests the candidates are worth."""
MOST_TAKEN = 0.9
"""A stretch of which the fit has taken more than this part of the noise says no more than this."""


def noise_copies(beside: Beside, left: FloatArray, n_copies: int = N_COPIES, random_state: int = 0) -> FloatArray:
    """Copies (n_joints, n_rows, n_copies) of the noise in `left` (n_rows, n_joints), what a model leaves."""
    from scipy.fft import irfft

    rng = np.random.default_rng(random_state)
    taken = beside.leverage
    n_rows, n_joints = left.shape
    copies = np.empty((n_joints, n_rows, n_copies))
    spectra = [_spectrum(left[:, j], taken[j], beside.blocks) for j in range(n_joints)]
    correlation = np.atleast_2d(np.corrcoef(left.T)) if n_joints > 1 else np.eye(1)
    values, vectors = np.linalg.eigh(np.nan_to_num(correlation, nan=0.0) + 1e-9 * np.eye(n_joints))
    mix = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    for block in beside.blocks:
        n = block.stop - block.start
        frequency = np.arange(n // 2 + 1) / n
        white = rng.standard_normal((n_joints, len(frequency), n_copies)) + 1j * rng.standard_normal(
            (n_joints, len(frequency), n_copies)
        )
        white = np.tensordot(mix, white, axes=1)
        for j in range(n_joints):
            density = np.interp(frequency, *spectra[j])
            copies[j, block] = irfft(white[j] * np.sqrt(density * n / 2)[:, None], n, axis=0)
    return copies


def _spectrum(left: FloatArray, taken: Sequence[FloatArray], blocks: Sequence[slice]) -> tuple[FloatArray, FloatArray]:
    """Frequencies [1/row] and mean power of the noise's lines: the residual's over the part that the fit has left."""
    power, share, count = np.zeros(FINE_BINS), np.zeros(FINE_BINS), np.zeros(FINE_BINS)
    for lines, gone, block in zip(line_power(left, blocks), taken, blocks, strict=True):
        bins = np.minimum((np.arange(len(lines)) * 2 * FINE_BINS) // (block.stop - block.start), FINE_BINS - 1)
        power += np.bincount(bins, lines, FINE_BINS)
        share += np.bincount(bins, gone, FINE_BINS)
        count += np.bincount(bins, minlength=FINE_BINS)
    centres, density = [], []
    first = 0
    for k in range(FINE_BINS):
        held = slice(first, k + 1)
        counted, missing = float(count[held].sum()), float(share[held].sum())
        if counted - missing >= LEAST_LINES or (k == FINE_BINS - 1 and counted > 0):
            centres.append((first + k + 1) / (4 * FINE_BINS))
            density.append(float(power[held].sum()) / max(counted - missing, (1 - MOST_TAKEN) * counted))
            first = k + 1
    return np.array(centres), np.array(density)


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
    copies = noise_copies(beside, after, n_copies)
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
    """How many independent candidates the given ones are worth: by the least p value that chance gives.

    Candidates overlap widely, so that Bonferroni's correction by their number would throw power away.

    Parameters
    ----------
    groups : sequence of (columns, groups of columns)
        Columns {joint: (n_rows, K)} and which of them belong to one candidate.
    """
    from scipy.stats import f

    # The spread of a score comes from the first half, the least p from copies that it has not seen.
    copies = noise_copies(beside, beside.residual, 2 * n_copies, random_state=1)
    weights = beside.weights**2
    absorbed = beside.imitated_scores(copies)
    farthest: dict[int, FloatArray] = {}
    for columns, slices in groups:
        imitated, gram, _ = beside.products(columns)
        scores = sum(weights[j] * (C.T @ copies[j]) for j, C in columns.items()) - imitated.T @ absorbed
        scores = np.asarray(scores)
        own = np.diag(gram) - np.sum(imitated**2, axis=0)
        clear = own > ABSORBED * np.diag(gram)
        for group in slices:
            part = scores[group][clear[group]]
            if not len(part):
                continue
            part = part / np.sqrt(np.mean(part[:, :n_copies] ** 2, axis=1, keepdims=True))
            values, vectors = np.linalg.eigh(part[:, :n_copies] @ part[:, :n_copies].T / n_copies)
            good = values > 1e-6 * values[-1]
            distance = np.sum((vectors[:, good].T @ part[:, n_copies:]) ** 2 / values[good, None], axis=0)
            k = int(good.sum())
            farthest[k] = np.maximum(farthest.get(k, distance), distance)
    p = [f.sf(distance * (n_copies - k) / (k * n_copies), k, n_copies - k) for k, distance in farthest.items()]
    # Candidates that overlap part in the tail, so that is where they are counted.
    return max(1.0, float(-np.log1p(-TAIL) / np.quantile(np.min(p, axis=0), TAIL)))
