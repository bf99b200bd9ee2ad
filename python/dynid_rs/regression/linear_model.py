"""One linear model of all joints under a prior, and the one score that everything is decided by.

Rows of joint j are ``y_j = M_j x + noise`` of standard deviation sigma_j; a row counts as k_j of an independent
sample. The prior is ``x ~ N(mean, (P'P)^-1)``. With ``w_j^2 = k_j / sigma_j^2`` and ``H = sum_j w_j^2 M_j'M_j + P'P``
the logarithm of the evidence, every unknown integrated out, is

    ln Z = - sum_j (k_j n ln sigma_j + w_j^2 |r_j|^2 / 2) - |P (x - mean)|^2 / 2 - ln det(S) / 2 - ln det(H) / 2

up to a constant that all models of the same rows share. sigma_j is estimated anew for each model (MacKay's fixed point,
``sigma_j^2 = k_j |r_j|^2 / (k_j n - gamma_j)`` with gamma_j the directions that joint j determines; `_core.likeliest`).

A hypothesis adds columns C whose coefficients are standard normal beforehand; its score is ln Z with them less ln Z
without. `screen` gives it to second order at the model's own noise, for thousands of hypotheses at once:

    U = W M'C, W'W = H^-1      S = C'C - U'U + I      b = S^-1 C'r      ln BF = b'S b / 2 - ln det(S) / 2

Nothing is fitted to the residual alone: what the model can imitate of C is in U. A coefficient that physics holds to
one sign has half of a normal as its prior, so needing the other sign costs ``ln 2 Phi(b / s)``, s its standard
deviation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Columns = Mapping[int, FloatArray]
"""Joint to its rows (n_rows, k) of a hypothesis; joints that are left out have zeros."""

AT_ONCE = 240
"""Columns of hypotheses that are screened in one product; more would only take more memory."""


class Choice(NamedTuple):
    """Which of a family of priors: chosen by the evidence.

    `width` of the inertials' prior, its `centre` (1: the robot file, 0: none), and the size of friction's `bends`:
    what its directions differ in and its higher orders.
    """

    width: float = 1.0
    centre: float = 0.0
    bends: float = 0.05


class Known(NamedTuple):
    """Unknowns that are known: `x` (n,) at `places` (n,)."""

    x: FloatArray
    places: NDArray[np.intp]


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

    `x` (n,); `noise` (n_joints,) sigma_j; `evidence` ln Z; `whitener` W (n, n) with ``W'W = H^-1``; `weights`
    (n_joints,) w_j.
    """

    model: LinearModel
    choice: Choice
    x: FloatArray
    noise: FloatArray
    weights: FloatArray
    evidence: float
    whitener: FloatArray

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the unknowns, (n, n)."""
        covariance: FloatArray = self.whitener.T @ self.whitener
        return covariance

    @cached_property
    def residual(self) -> list[FloatArray]:
        """What the fit leaves of every joint, (n_rows,) each."""
        return [self.left(j) for j in range(len(self.noise))]

    def given(self, known: Known) -> Fit:
        """All other unknowns as they are most probable beside those that are known.

        ``x_o + S_ok S_kk^-1 (k - x_k)``: the mean of a normal given a part of it, S its covariance.
        """
        at, S = known.places, self.covariance
        x = self.x + S[:, at] @ np.linalg.solve(S[np.ix_(at, at)], known.x - self.x[at])
        x[at] = known.x
        return replace(self, x=x)

    def left(self, j: int) -> FloatArray:
        """What the fit leaves of joint j, (n_rows,)."""
        part, at = self.model.rows[j], self.model.places[j]
        left: FloatArray = part[:, -1] - part[:, :-1] @ self.x[at]
        return left


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
    grams : list of ndarray (k_j + 1, k_j + 1), optional
        ``[M_j | y_j]'[M_j | y_j]`` per joint, where they are known already.
    counted : list of ndarray of bool (n_rows,), optional
        Rows of every joint that say something, where they are known already: those of a joint at rest are zero.
    phase : ndarray (n_rows,), optional
        Of the motion at every row: rows of the same number show the same again. No two do by default.
    """

    rows: list[FloatArray]
    places: list[NDArray[np.intp]]
    prior: Prior
    n_effective: FloatArray
    least_noise: FloatArray
    n_rows: int
    n_further: int = 0
    grams: list[FloatArray] = None  # type: ignore[assignment]
    counted: list[BoolArray] = None  # type: ignore[assignment]
    phase: NDArray[np.int64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        # The class is frozen.
        if self.grams is None:
            object.__setattr__(self, "grams", [part.T @ part for part in self.rows])
        if self.counted is None:
            object.__setattr__(self, "counted", [np.any(part, axis=1) for part in self.rows])
        if self.phase is None:
            object.__setattr__(self, "phase", np.arange(len(self.rows[0])))  # factors stand for any number of rows

    def fit(self, choice: Choice, noise: FloatArray) -> Fit:
        """Most probable unknowns; the noise is searched from `noise` (n_joints,)."""
        return fits([(self, choice, noise)])[0]

    def at(self, choice: Choice, noise: FloatArray) -> Fit:
        """Most probable unknowns at a noise that is known."""
        return fits([(self, choice, noise)], noise_is_known=True)[0]

    def beside(self, *hypotheses: Columns) -> LinearModel:
        """Return the model with hypotheses among its unknowns, in this order."""
        edges = self.size + np.cumsum([0, *(next(iter(columns.values())).shape[1] for columns in hypotheses)])
        rows, places, grams = list(self.rows), list(self.places), list(self.grams)
        for j, (part, at) in enumerate(zip(self.rows, self.places, strict=True)):
            here = [h for h, columns in enumerate(hypotheses) if j in columns]
            if not here:
                continue
            new = np.concatenate([hypotheses[h][j] for h in here], axis=1) * self.counted[j][:, None]
            k, width = len(at), new.shape[1]
            order = np.r_[:k, k + 1 : k + 1 + width, k]
            cross = part.T @ new
            grams[j] = np.block([[grams[j], cross], [cross.T, new.T @ new]])[np.ix_(order, order)]
            rows[j] = np.concatenate([part[:, :-1], new, part[:, -1:]], axis=1)
            places[j] = np.concatenate([at, *(np.arange(edges[h], edges[h + 1]) for h in here)])
        return replace(self, rows=rows, places=places, grams=grams, n_further=int(edges[-1]) - self.prior.size)

    def without(self, columns: Sequence[tuple[int, int]]) -> LinearModel:
        """Return the model without columns, named by joint and place among all unknowns."""
        rows, places, grams = list(self.rows), list(self.places), list(self.grams)
        for j in {j for j, _ in columns}:
            kept = ~np.isin(places[j], [at for joint, at in columns if joint == j])
            both = np.append(kept, True)
            rows[j], places[j], grams[j] = rows[j][:, both], places[j][kept], grams[j][np.ix_(both, both)]
        return replace(self, rows=rows, places=places, grams=grams)

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
        outs = [[part[rows] for part in self.rows] for rows in map(_as_slice, blocks)]
        others = [
            replace(self, grams=[gram - part.T @ part for gram, part in zip(self.grams, out, strict=True)])
            for out in outs
        ]
        solved = fits([(model, fit.choice, fit.noise) for model in others], noise_is_known=True)
        yield from zip(outs, (own.x for own in solved), strict=True)

    def screen(
        self, fit: Fit, hypotheses: Sequence[Columns], bounds: Sequence[FloatArray], sizes: Sequence[float] = (1.0,)
    ) -> list[Score]:
        """Second-order scores beside `fit`; `bounds` (k, 2) of the coefficients.

        `sizes`: standard deviations of the coefficients that are tried, the best of which counts.
        """
        return self.screen_beside([fit], hypotheses, bounds, sizes)[0]

    def screen_beside(
        self,
        fits: Sequence[Fit],
        hypotheses: Sequence[Columns],
        bounds: Sequence[FloatArray],
        sizes: Sequence[float] = (1.0,),
    ) -> list[list[Score]]:
        """`screen` beside each of several fits of this model, whose products with the hypotheses they share."""
        scored: list[list[Score]] = [[] for _ in fits]
        group = np.cumsum([len(own) for own in bounds]) // AT_ONCE
        edges = [0, *(np.flatnonzero(np.diff(group)) + 1).tolist(), len(hypotheses)] if hypotheses else []
        for part in (slice(first, last) for first, last in pairwise(edges)):
            for own, more in zip(scored, self._screen(fits, hypotheses[part], bounds[part], sizes), strict=True):
                own += more
        return scored

    def _screen(
        self,
        fits: Sequence[Fit],
        hypotheses: Sequence[Columns],
        bounds: Sequence[FloatArray],
        sizes: Sequence[float],
    ) -> list[list[Score]]:
        widths = np.array([next(iter(columns.values())).shape[1] for columns in hypotheses])
        edges = np.cumsum([0, *widths])
        cross = np.zeros((len(fits), self.size, int(edges[-1])))
        moment = np.zeros((len(fits), int(edges[-1])))
        squares = [np.zeros((len(fits), width, width)) for width in widths]
        for j, counted in enumerate(self.counted):
            here = [h for h, columns in enumerate(hypotheses) if j in columns]
            if not here:
                continue
            own = [hypotheses[h][j] for h in here]
            if not counted.all():
                own = [columns * counted[:, None] for columns in own]
            at = np.concatenate([np.arange(edges[h], edges[h + 1]) for h in here])
            together = own[0] if len(own) == 1 else np.concatenate(own, axis=1)
            weights = np.array([fit.weights[j] ** 2 for fit in fits])
            cross[:, self.places[j][:, None], at] += weights[:, None, None] * (self.rows[j][:, :-1].T @ together)
            moment[:, at] += weights[:, None] * (np.array([fit.residual[j] for fit in fits]) @ together)
            for h, columns in zip(here, own, strict=True):
                squares[h] += weights[:, None, None] * (columns.T @ columns)
        taken = np.array([fit.whitener @ own for fit, own in zip(fits, cross, strict=True)])
        scores = np.empty((len(sizes), len(fits), len(hypotheses)))
        for width in np.unique(widths):
            alike = np.flatnonzero(widths == width)
            at = edges[alike, None] + np.arange(width)
            U = np.moveaxis(taken[:, :, at], 2, 1)
            S = np.stack([squares[h] for h in alike], axis=1) - np.swapaxes(U, 2, 3) @ U
            held = np.array([bounds[h] for h in alike.tolist()])
            scores[:, :, alike] = _values(S, moment[:, at], held, np.array(sizes))
        best = np.argmax(scores, axis=0)
        highest = np.max(scores, axis=0)
        return [
            [Score(value, sizes[k]) for value, k in zip(own, of, strict=True)]
            for own, of in zip(highest.tolist(), best.tolist(), strict=True)
        ]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.prior.size + self.n_further


def fits(models: Sequence[tuple[LinearModel, Choice, FloatArray]], *, noise_is_known: bool = False) -> list[Fit]:
    """Fits of several models side by side, each with its prior and the noise that its search begins with."""
    held = [_normal_equations(model.prior, choice) for model, choice, _ in models]
    found = _core.likeliest(
        [
            (m.grams, m.places, m.size, P, moment, noise, m.n_effective, m.least_noise, float(m.n_rows), noise_is_known)
            for (m, _, noise), (P, moment, _, _) in zip(models, held, strict=True)
        ]
    )
    solved = []
    for (m, choice, _), (_, _, square, log_det), own in zip(models, held, found, strict=True):
        x, noise, power, distance, whitener, log_det_H = own
        share = m.n_effective / m.n_rows
        evidence = -float(np.sum(m.n_effective * np.log(noise) + share * power / (2 * noise**2)))
        evidence -= (square + distance + log_det + log_det_H) / 2
        solved.append(Fit(m, choice, x, noise, np.sqrt(share) / noise, evidence, whitener))
    return solved


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


def _as_slice(rows: BoolArray) -> slice | BoolArray:
    """The same rows as a slice, which copies nothing, where they follow each other."""
    found = np.flatnonzero(rows)
    follow = len(found) and found[-1] - found[0] == len(found) - 1
    return slice(int(found[0]), int(found[-1]) + 1) if follow else rows


def _values(own: FloatArray, moment: FloatArray, bounds: FloatArray, sizes: FloatArray) -> FloatArray:
    """Second-order scores (n_sizes, ..., n) from what is the hypotheses' own of their Gram matrices (..., n, k, k).

    `moment` (..., n, k): ``C'r``; `bounds` (n, k, 2).
    """
    sizes = sizes.reshape(-1, *[1] * own.ndim)
    S = sizes**2 * own + np.eye(own.shape[-1])
    values, vectors = np.linalg.eigh(S) if own.shape[-1] > 1 else (S[..., 0], np.ones_like(S))
    # Below one lies rounding: the model imitates all of that direction.
    values = np.maximum(values, 1.0)
    along = np.squeeze(np.swapaxes(vectors, -1, -2) @ (sizes * moment[..., None]), -1)
    b = np.squeeze(vectors @ (along / values)[..., None], -1)
    std = np.sqrt(np.squeeze(vectors**2 @ (1 / values)[..., None], -1))
    gain = 0.5 * np.sum(along**2 / values, axis=-1) - 0.5 * np.sum(np.log(values), axis=-1)
    scores: FloatArray = gain + sign_cost(b / std, bounds)
    return scores


def sign_cost(z: FloatArray, bounds: FloatArray) -> FloatArray:
    """``sum ln 2 Phi(z)`` over the coefficients (..., k) that physics holds to one sign, z in standard deviations."""
    from scipy.special import log_ndtr

    signs = np.where(bounds[..., 0] == 0.0, 1.0, np.where(bounds[..., 1] == 0.0, -1.0, 0.0))
    # Without a sign 2 Phi(0) is one.
    cost: FloatArray = np.sum(np.log(2.0) + log_ndtr(signs * z), axis=-1)
    return cost
