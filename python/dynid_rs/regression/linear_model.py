"""One linear model of all joints under a prior, and the one score that everything is decided by.

Rows of joint j are ``y_j = M_j x + noise`` of standard deviation sigma_j; a row counts as k_j of an independent
sample. The prior is ``x ~ N(mean, (P'P)^-1)``. With ``w_j^2 = k_j / sigma_j^2`` and ``H = sum_j w_j^2 M_j'M_j + P'P``
the logarithm of the evidence, every unknown integrated out, is

    ln Z = - sum_j (k_j n ln sigma_j + w_j^2 |r_j|^2 / 2) - |P (x - mean)|^2 / 2 - ln det(S) / 2 - ln det(H) / 2

up to a constant that all models of the same rows share. sigma_j is estimated anew for each model (MacKay's fixed point,
``sigma_j^2 = k_j |r_j|^2 / (k_j n - gamma_j)`` with gamma_j the directions that joint j determines).

A hypothesis adds columns C whose coefficients are standard normal beforehand; its score is ln Z with them less ln Z
without. `screen` gives it to second order at the model's own noise, for thousands of hypotheses at once:

    U = chol(H)^-1 M'C      S = C'C - U'U + I      b = S^-1 C'r      ln BF = b'S b / 2 - ln det(S) / 2

Nothing is fitted to the residual alone: what the model can imitate of C is in U. A coefficient that physics holds to
one sign has half of a normal as its prior, so needing the other sign costs ``ln 2 Phi(b / s)``, s its standard
deviation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Columns = Mapping[int, FloatArray]
"""Joint to its rows (n_rows, k) of a hypothesis; joints that are left out have zeros."""

MOST_STEPS, CHANGE = 12, 1e-2
"""Steps of the noise's fixed point, and its relative change at which they stop."""
MOST_TAKEN = 0.9
"""At most this part of a joint's independent samples counts as used up by the unknowns."""
ROUNDING = 1e-12
"""Relative precision that every direction has beside its own, so that rounding cannot make H indefinite."""
AT_ONCE = 400
"""Hypotheses that are screened in one product; more would only take more memory."""


class Choice(NamedTuple):
    """Which of a family of priors: chosen by the evidence.

    `width` of the inertials' prior, its `centre` (1: the robot file, 0: none), the size of friction's `bends`: what its
    directions differ in and its higher orders; and the size of constant torques, `offsets`.
    """

    width: float = 1.0
    centre: float = 0.0
    bends: float = 0.05
    offsets: float = 0.3


class Prior(Protocol):
    """What is known of the unknowns beforehand; hashable."""

    @property
    def size(self) -> int:
        """Number of unknowns."""

    def rows(self, choice: Choice) -> tuple[FloatArray, float]:
        """Rows ``[P | P mean]`` (n_used, n + 1) and ``ln det(S)``."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Most probable unknowns of a model at one prior.

    `x` (n,); `noise` (n_joints,) sigma_j; `evidence` ln Z; `root` (n, n) the lower Cholesky factor of H; `residual` per
    joint (n_rows,); `weights` (n_joints,) w_j.
    """

    choice: Choice
    x: FloatArray
    noise: FloatArray
    weights: FloatArray
    evidence: float
    root: FloatArray
    residual: list[FloatArray]

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the unknowns, (n, n)."""
        inverse = _inverse_of(self.root)
        covariance: FloatArray = inverse.T @ inverse
        return covariance


@dataclass(frozen=True, eq=False)
class Score:
    """Second-order score of a hypothesis, and the size of its prior at which it is greatest."""

    value: float
    size: float


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Rows of all joints and the prior of their common unknowns.

    Parameters
    ----------
    rows : list of ndarray (n_rows, k_j + 1)
        Columns of joint j, its target last.
    places : list of ndarray (k_j,)
        Places of the columns among all unknowns.
    prior : Prior
        Of all unknowns before `n_further`; those are standard normal.
    n_effective : ndarray (n_joints,)
        Independent samples that a joint's rows are worth, ``k_j n``.
    least_noise : ndarray (n_joints,)
        No noise is smaller: rounding.
    n_rows : int
        Rows per joint, or what factors in their place stand for.
    n_further : int
        Unknowns of hypotheses that were put beside the model.
    """

    rows: list[FloatArray]
    places: list[NDArray[np.intp]]
    prior: Prior
    n_effective: FloatArray
    least_noise: FloatArray
    n_rows: int
    n_further: int = 0

    @cached_property
    def grams(self) -> list[FloatArray]:
        """``[M_j | y_j]'[M_j | y_j]`` per joint."""
        return [part.T @ part for part in self.rows]

    @cached_property
    def counted(self) -> list[BoolArray]:
        """Rows of every joint that say something, (n_rows,): those of a joint at rest are zero."""
        return [np.any(part, axis=1) for part in self.rows]

    @cached_property
    def _wide(self) -> tuple[FloatArray, FloatArray]:
        """``M_j'M_j`` (n_joints, n, n) and ``M_j'y_j`` (n_joints, n) among all unknowns."""
        size = self._size()
        wide, moments = np.zeros((len(self.rows), size, size)), np.zeros((len(self.rows), size))
        for j, (gram, at) in enumerate(zip(self.grams, self.places, strict=True)):
            wide[j][np.ix_(at, at)] = gram[:-1, :-1]
            moments[j, at] = gram[:-1, -1]
        return wide, moments

    def fit(self, choice: Choice, noise: FloatArray) -> Fit:
        """Most probable unknowns; the noise is searched from `noise` (n_joints,)."""
        held = self._held(choice)
        share = self.n_effective / self.n_rows
        for _ in range(MOST_STEPS):
            weights = np.sqrt(share) / noise
            root, x = self._solve(held, weights)
            power = np.array([_power(gram, x[at]) for gram, at in zip(self.grams, self.places, strict=True)])
            inverse = _inverse_of(root)
            taken = [
                w**2 * float(np.sum((inverse[:, at] @ gram[:-1, :-1]) * inverse[:, at]))
                for w, gram, at in zip(weights, self.grams, self.places, strict=True)
            ]
            left = np.maximum(self.n_effective - taken, (1 - MOST_TAKEN) * self.n_effective)
            update = np.maximum(np.sqrt(share * power / left), self.least_noise)
            change = float(np.max(np.abs(update / noise - 1)))
            noise = update
            if change < CHANGE:
                break
        return self.at(choice, noise)  # hypotheses are scored beside the very solution of these weights

    def at(self, choice: Choice, noise: FloatArray) -> Fit:
        """Most probable unknowns at a noise that is known."""
        held = self._held(choice)
        share = self.n_effective / self.n_rows
        weights = np.sqrt(share) / noise
        root, x = self._solve(held, weights)
        power = np.array([_power(gram, x[at]) for gram, at in zip(self.grams, self.places, strict=True)])
        precision, moment, square, log_det = held
        distance = square - 2 * float(moment @ x) + float(x @ precision @ x)
        evidence = -float(np.sum(self.n_effective * np.log(noise) + share * power / (2 * noise**2)))
        evidence -= (distance + log_det) / 2 + float(np.sum(np.log(np.diag(root))))
        residual = [part[:, -1] - part[:, :-1] @ x[at] for part, at in zip(self.rows, self.places, strict=True)]
        return Fit(choice, x, noise, weights, evidence, root, residual)

    def beside(self, columns: Columns) -> LinearModel:
        """Return the model with a hypothesis among its unknowns."""
        width = next(iter(columns.values())).shape[1]
        new = self._size() + np.arange(width)
        rows, places = [], []
        for j, (part, at) in enumerate(zip(self.rows, self.places, strict=True)):
            if j in columns:
                new_columns = columns[j] * self.counted[j][:, None]
                part = np.concatenate([part[:, :-1], new_columns, part[:, -1:]], axis=1)
                at = np.concatenate([at, new])
            rows.append(part)
            places.append(at)
        return replace(self, rows=rows, places=places, n_further=self.n_further + width)

    def without(self, columns: Sequence[tuple[int, int]]) -> LinearModel:
        """Return the model without columns, named by joint and place among all unknowns."""
        rows, places = list(self.rows), list(self.places)
        for j in {j for j, _ in columns}:
            kept = ~np.isin(places[j], [at for joint, at in columns if joint == j])
            rows[j], places[j] = rows[j][:, np.append(kept, True)], places[j][kept]
        return replace(self, rows=rows, places=places)

    def within(self, kept: BoolArray) -> LinearModel:
        """Return the model of some of the rows, (n_rows,)."""
        rows = [part[kept] for part in self.rows]
        shares = [float(counted[kept].sum()) / max(int(counted.sum()), 1) for counted in self.counted]
        n_effective = self.n_effective * np.maximum(shares, 1e-9)
        return replace(self, rows=rows, n_effective=n_effective, n_rows=int(kept.sum()))

    def left_out(self, fit: Fit, blocks: Sequence[BoolArray]) -> FloatArray:
        """Power per block and joint, (n_blocks, n_joints), when a block is predicted from the others."""
        power = np.zeros((len(blocks), len(self.rows)))
        for k, (out, x) in enumerate(self._without_each(fit, blocks)):
            power[k] = [
                np.sum((part[:, -1] - part[:, :-1] @ x[at]) ** 2) for part, at in zip(out, self.places, strict=True)
            ]
        return power

    def solved_without(self, fit: Fit, blocks: Sequence[BoolArray]) -> FloatArray:
        """Unknowns from the rows outside each block, (n_blocks, n), at the weights and the prior of `fit`."""
        return np.array([x for _, x in self._without_each(fit, blocks)])

    def _without_each(self, fit: Fit, blocks: Sequence[BoolArray]) -> Iterator[tuple[list[FloatArray], FloatArray]]:
        """Rows of each block, and the unknowns from all others."""
        held = self._held(fit.choice)
        for block in blocks:
            out = [part[block] for part in self.rows]
            grams = [gram - part.T @ part for gram, part in zip(self.grams, out, strict=True)]
            yield out, self._solve(held, fit.weights, grams)[1]

    def screen(
        self, fit: Fit, hypotheses: Sequence[Columns], bounds: Sequence[FloatArray], sizes: Sequence[float] = (1.0,)
    ) -> list[Score]:
        """Second-order scores beside `fit`; `bounds` (k, 2) of the coefficients.

        `sizes`: standard deviations of the coefficients that are tried, the best of which counts.
        """
        scored: list[Score] = []
        for first in range(0, len(hypotheses), AT_ONCE):
            part = slice(first, first + AT_ONCE)
            scored += self._screen(fit, hypotheses[part], bounds[part], sizes)
        return scored

    def _screen(
        self, fit: Fit, hypotheses: Sequence[Columns], bounds: Sequence[FloatArray], sizes: Sequence[float]
    ) -> list[Score]:
        from scipy.linalg import solve_triangular

        widths = [next(iter(columns.values())).shape[1] for columns in hypotheses]
        edges = np.cumsum([0, *widths])
        cross, moment = np.zeros((len(fit.root), int(edges[-1]))), np.zeros(int(edges[-1]))
        squares = [np.zeros((width, width)) for width in widths]
        for j, weight in enumerate(fit.weights):
            here = [h for h, columns in enumerate(hypotheses) if j in columns]
            if not here:
                continue
            at = np.concatenate([np.arange(edges[h], edges[h + 1]) for h in here])
            row_weight = weight * self.counted[j][:, None]
            weighted = [row_weight * hypotheses[h][j] for h in here]
            together = np.concatenate(weighted, axis=1)
            cross[np.ix_(self.places[j], at)] += weight * (self.rows[j][:, :-1].T @ together)
            moment[at] += weight * (together.T @ fit.residual[j])
            for h, columns in zip(here, weighted, strict=True):
                squares[h] += columns.T @ columns
        taken = solve_triangular(fit.root, cross, lower=True)
        scores = [Score(-np.inf, sizes[0])] * len(hypotheses)
        for width in set(widths):
            alike = [h for h, own in enumerate(widths) if own == width]
            at = edges[:-1][alike, None] + np.arange(width)
            U = np.moveaxis(taken[:, at], 1, 0)
            own = np.array([squares[h] for h in alike]) - np.swapaxes(U, 1, 2) @ U
            held = np.array([bounds[h] for h in alike])
            for size in sizes:
                values = _values(own, moment[at], held, size)
                for h, value in zip(alike, values, strict=True):
                    if value > scores[h].value:
                        scores[h] = Score(float(value), size)
        return scores

    def _size(self) -> int:
        return self.prior.size + self.n_further

    def _held(self, choice: Choice) -> tuple[FloatArray, FloatArray, float, float]:
        """The prior's precision, moment, square and ``ln det(S)``; unknowns that it does not hold stay at zero."""
        own, pulled, square, log_det = _normal_equations(self.prior, choice)
        n = len(own)
        size = n + self.n_further
        precision, moment = np.eye(size), np.zeros(size)
        precision[:n, :n], moment[:n] = own, pulled
        unheld = np.flatnonzero(np.diag(precision) == 0)
        precision[unheld, unheld] = 1.0
        return precision, moment, square, log_det

    def _solve(
        self,
        held: tuple[FloatArray, FloatArray, float, float],
        weights: FloatArray,
        grams: Sequence[FloatArray] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Cholesky factor of H, and the most probable unknowns."""
        from scipy.linalg import cho_solve

        squares = weights**2
        if grams is None:
            wide, moments = self._wide
            precision = held[0] + np.tensordot(squares, wide, 1)
            moment = held[1] + squares @ moments
        else:
            precision, moment = held[0].copy(), held[1].copy()
            for w, gram, at in zip(squares, grams, self.places, strict=True):
                precision[np.ix_(at, at)] += w * gram[:-1, :-1]
                moment[at] += w * gram[:-1, -1]
        # At unit diagonal the factor loses no digits to the units of the unknowns.
        scale = 1 / np.sqrt(np.diag(precision))
        scaled = precision * np.outer(scale, scale)
        scaled.flat[:: len(scaled) + 1] += ROUNDING
        root = np.linalg.cholesky(scaled)
        x = scale * cho_solve((root, True), scale * moment)
        # Once more on what is left: H has the square of the columns' condition.
        x = x + scale * cho_solve((root, True), scale * (moment - precision @ x))
        return root / scale[:, None], x


_OF_PRIORS: WeakKeyDictionary[Prior, dict[Choice, tuple[FloatArray, FloatArray, float, float]]] = WeakKeyDictionary()
"""Normal equations of priors, which all models under them share."""


def _normal_equations(prior: Prior, choice: Choice) -> tuple[FloatArray, FloatArray, float, float]:
    """``P'P``, ``P'P mean``, ``|P mean|^2`` and ``ln det(S)``."""
    known = _OF_PRIORS.setdefault(prior, {})
    if choice not in known:
        rows, log_det = prior.rows(choice)
        P, target = rows[:, :-1], rows[:, -1]
        known[choice] = P.T @ P, P.T @ target, float(target @ target), log_det
    return known[choice]


def _power(gram: FloatArray, x: FloatArray) -> float:
    """``|y - M x|^2``."""
    signed = np.append(-x, 1.0)
    return max(float(signed @ gram @ signed), 0.0)


def _inverse_of(root: FloatArray) -> FloatArray:
    from scipy.linalg.lapack import dtrtri

    inverse: FloatArray = dtrtri(root, lower=1)[0]
    return inverse


def _values(own: FloatArray, moment: FloatArray, bounds: FloatArray, size: float) -> FloatArray:
    """Second-order scores (n,) from what is the hypotheses' own of their Gram matrices, and their moments ``C'r``."""
    S = size**2 * own + np.eye(own.shape[1])
    values, vectors = np.linalg.eigh(S)
    # Below one lies rounding: the model imitates all of that direction.
    values = np.maximum(values, 1.0)
    along = np.einsum("nij,ni->nj", vectors, size * moment)
    b = np.einsum("nij,nj->ni", vectors, along / values)
    std = np.sqrt(np.einsum("nij,nj->ni", vectors**2, 1 / values))
    gain = 0.5 * np.sum(along**2 / values, axis=1) - 0.5 * np.sum(np.log(values), axis=1)
    scores: FloatArray = gain + sign_cost(b / std, bounds)
    return scores


def sign_cost(z: FloatArray, bounds: FloatArray) -> FloatArray:
    """``sum ln 2 Phi(z)`` over the coefficients (..., k) that physics holds to one sign, z in standard deviations."""
    from scipy.special import log_ndtr

    signs = np.where(bounds[..., 0] == 0.0, 1.0, np.where(bounds[..., 1] == 0.0, -1.0, 0.0))
    # Without a sign 2 Phi(0) is one.
    cost: FloatArray = np.sum(np.log(2.0) + log_ndtr(signs * z), axis=-1)
    return cost
