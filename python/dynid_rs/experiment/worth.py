"""What an experiment is worth: how likely it settles each open question, and how much it tells, in nats.

Between two answers about coefficients b, each a mixture of the shapes that its kind may have, Gaussian after the runs
so far (nothing is there: b = 0), rows of precision D for b give the sufficient statistic ``y = D^(1/2) b + e``, e
standard normal:

    with a shape          y ~ N(D^(1/2) m, I + D^(1/2) V D^(1/2))
    log odds afterwards   L = L_0 + ln p(y | 1) - ln p(y | 2)
    settled rightly       if L passes ln 19 towards the true one
    told                  H(p_0) + E[ln p(y)]       p(y) of the true one (Lindley 1956; Box and Hill 1967)

Expectations are means over the same draws of e for every motion, so a search sees a smooth function.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.along import Told
from dynid_rs.diagnosis.open_questions import OpenQuestions, Question

FloatArray = NDArray[np.float64]
Whole = NDArray[np.intp]

N_DRAWS = 128
"""Draws of each expectation, half of them mirrored: a chance is known within some four percent."""
RARELY = 0.05
"""Chance that an error exceeds the noise by more than is said."""
RIDGE = 1e-10
"""Precision that is added to every unknown, over its own: rounding."""


@dataclass(frozen=True, eq=False)
class Chance:
    """Of one question, after an experiment.

    Parameters
    ----------
    log_odds : float
        Now, of the first answer against the other.
    first, second : float
        Chance that the answer is settled as the first if that is true, as the other if that is.
    right, wrong : float
        Chance that it is settled rightly, and wrongly, whichever is true.
    told : float
        Nats.
    """

    log_odds: float
    first: float
    second: float
    right: float
    wrong: float
    told: float


@dataclass(frozen=True, eq=False)
class _Shape:
    """One shape of an answer: its weight, and mean (k,) and covariance (k, k) of all coefficients in question."""

    weight: float
    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class _Held:
    """A question as the runs leave it.

    Places of its coefficients and of what stands beside them, their precision, and the shapes of both answers.
    """

    beside: Whole
    at: Whole
    now: FloatArray
    answers: tuple[list[_Shape], list[_Shape]]
    log_odds: float


class Worth:
    """Expected answers to questions.

    Parameters
    ----------
    asked : OpenQuestions
        What is asked.
    questions : sequence of Question
        Which of it.
    domain : ndarray (n_joints, m, m)
        Mean square of each joint's row over its noise, of motions within the limits: where predictions will be wanted.
    """

    def __init__(self, asked: OpenQuestions, questions: Sequence[Question], domain: FloatArray) -> None:
        self.asked, self.questions, self.domain = asked, tuple(questions), domain
        self._row = np.tensordot((asked.weights * asked.noise) ** 2, domain, axes=1)
        self._held = [_held(asked, question) for question in questions]
        self._declared = asked.declared()
        self._draws = [_draws(len(held.at)) for held in self._held]

    def chances(self, told: Told) -> list[Chance]:
        """Of every question, after an experiment."""
        return [self._chance(held, e, told) for held, e in zip(self._held, self._draws, strict=True)]

    def doubt(self, told: Told | None = None) -> float:
        """What the model does not know of a row within the limits, in nats: ``ln det(I + P^-1 G) / 2``."""
        known, scale = self._known(told)
        wanted = self._wanted(self._row, scale)
        return 0.5 * float(np.linalg.slogdet(known + wanted)[1] - np.linalg.slogdet(known)[1])

    def excess(self, told: Told | None = None) -> FloatArray:
        """By how much the error within the limits exceeds the noise at most, as a share of it, (n_joints,).

        That holds 19 times of 20. What is wrong of a row x of joint j is ``x'd``, d of the covariance ``P^-1``. Its
        mean square ``d'G_j d`` is a sum of squares with the mean ``tr A``, ``A = P^-1 G_j``, and the variance
        ``2 tr A^2``, like chi-squared of ``(tr A)^2 / tr A^2`` degrees of freedom (Satterthwaite 1946). The root mean
        square error is ``sqrt(1 + d'G_j d)`` times the noise.
        """
        from scipy.special import chdtri

        known, scale = self._known(told)
        inverse = np.linalg.inv(known)
        most = np.zeros(len(self.domain))
        for j, own in enumerate(self.domain):
            A = inverse @ self._wanted(own, scale)
            mean, square = float(np.trace(A)), float(np.sum(A * A.T))
            if mean > 0 and square > 0:
                most[j] = square / mean * chdtri(mean**2 / square, RARELY)
        excess: FloatArray = np.sqrt(1 + most) - 1
        return excess

    def _known(self, told: Told | None) -> tuple[FloatArray, FloatArray]:
        """Precision of the declared unknowns over the units that the runs so far give them, and these units."""
        at = self._declared
        now = self.asked.known[np.ix_(at, at)]
        precision = now if told is None else now + told.declared[np.ix_(at, at)]
        scale = 1 / np.sqrt(np.diag(now))
        return precision * np.outer(scale, scale) + RIDGE * np.eye(len(at)), scale

    def _wanted(self, squares: FloatArray, scale: FloatArray) -> FloatArray:
        wanted: FloatArray = squares[np.ix_(self._declared, self._declared)] * np.outer(scale, scale)
        return wanted

    def nats(self, told: Told) -> float:
        """All that an experiment tells: which answers are right, and what a row within the limits will be."""
        return sum(chance.told for chance in self.chances(told)) + self.doubt() - self.doubt(told)

    def _chance(self, held: _Held, draws: FloatArray, told: Told) -> Chance:
        from scipy.special import expit, log_expit

        more = _own(self.asked.precision + told.unknowns, held.beside, held.at) - held.now
        values, vectors = np.linalg.eigh((more + more.T) / 2)
        root = np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T, dtype=np.float64)
        answers = [[_seen(shape, root) for shape in answer] for answer in held.answers]
        first, second = (
            [(shape.weight, self._odds(held, shape.mean + draws @ shape.spread.T, answers)) for shape in answer]
            for answer in answers
        )
        p = float(expit(held.log_odds))
        right = _mean(first, lambda odds: odds > SURE), _mean(second, lambda odds: odds < -SURE)
        wrong = _mean(first, lambda odds: odds < -SURE), _mean(second, lambda odds: odds > SURE)
        known = p * _mean(first, log_expit) + (1 - p) * _mean(second, lambda odds: log_expit(-odds))
        either = [p * one + (1 - p) * other for one, other in (right, wrong)]
        now = float(entropy(np.array(held.log_odds)))
        return Chance(held.log_odds, right[0], right[1], either[0], either[1], now + known)

    @staticmethod
    def _odds(held: _Held, y: FloatArray, answers: Sequence[Sequence[_Seen]]) -> FloatArray:
        """Logarithmic odds of the first answer after each y (n_draws, k)."""
        return held.log_odds + _density(y, answers[0]) - _density(y, answers[1])


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a shape makes of the statistic y, whose covariance is `spread @ spread.T`.

    Mean (k,), `spread` (k, k), its inverse, and the logarithm of weight over the root of the covariance's determinant.
    """

    weight: float
    mean: FloatArray
    spread: FloatArray
    unspread: FloatArray
    log_weight: float


def _seen(shape: _Shape, root: FloatArray) -> _Seen:
    spread = np.asarray(np.linalg.cholesky(np.eye(len(root)) + root @ shape.covariance @ root), dtype=np.float64)
    unspread = np.asarray(np.linalg.inv(spread), dtype=np.float64)
    log_weight = float(np.log(max(shape.weight, 1e-300)) - np.sum(np.log(np.diag(spread))))
    return _Seen(shape.weight, root @ shape.mean, spread, unspread, log_weight)


def _density(y: FloatArray, shapes: Sequence[_Seen]) -> FloatArray:
    """Logarithm of an answer's density of every y (n_draws, k), but for what all answers share."""
    parts: FloatArray = np.empty((len(shapes), len(y)))
    for part, shape in zip(parts, shapes, strict=True):
        z = (y - shape.mean) @ shape.unspread.T
        part[:] = shape.log_weight - 0.5 * np.einsum("ij,ij->i", z, z)
    # scipy's logsumexp takes longer to look at its arguments than this does for all of them.
    density: FloatArray = np.logaddexp.reduce(parts, axis=0)
    return density


def _mean(cases: Sequence[tuple[float, FloatArray]], of: Callable[[FloatArray], NDArray[Any]]) -> float:
    """Over the draws of every shape, and over the shapes."""
    return float(sum(weight * np.mean(of(odds)) for weight, odds in cases))


def _held(asked: OpenQuestions, question: Question) -> _Held:
    """A question as the runs leave it."""
    spots = [asked.at(k) for k in question.candidates]
    at = np.concatenate(spots)
    beside = asked.declared(asked.candidates[question.candidates[0]].instead_of)
    nothing = _Shape(1.0, np.zeros(len(at)), np.zeros((len(at), len(at))))
    shapes: list[list[_Shape]] = []
    first, n = 0, 0
    for answer in (question.first, question.second):
        own = []
        for number, weight in zip(answer.candidates, answer.weights, strict=True):
            mean, covariance = np.zeros(len(at)), np.zeros((len(at), len(at)))
            here = slice(first, first + len(spots[n]))
            likeliest = asked.candidates[number].mean
            mean[first : first + len(likeliest)] = likeliest  # its shape's are where they are by definition
            known = _own(asked.precision, beside, spots[n])
            known = known + RIDGE * np.diag(np.diag(known))
            covariance[here, here] = np.linalg.inv(known)
            own.append(_Shape(weight, mean, covariance))
            first, n = first + len(spots[n]), n + 1
        shapes.append(own or [nothing])
    return _Held(beside, at, _own(asked.precision, beside, at), (shapes[0], shapes[1]), question.log_odds)


def _own(precision: FloatArray, beside: Whole, at: Whole) -> FloatArray:
    """Precision of the unknowns `at` when those `beside` may be anything that the rows allow."""
    from scipy.linalg import cho_factor, cho_solve

    inner = precision[np.ix_(beside, beside)]
    scale = 1 / np.sqrt(np.diag(inner))
    across = precision[np.ix_(beside, at)] * scale[:, None]
    known = cho_factor(inner * np.outer(scale, scale) + RIDGE * np.eye(len(beside)), check_finite=False)
    left: FloatArray = precision[np.ix_(at, at)] - across.T @ cho_solve(known, across, check_finite=False)
    return left


def _draws(k: int) -> FloatArray:
    """Standard normal draws (n_draws, k), always the same, each with its mirror image."""
    e = np.random.default_rng(0).standard_normal((N_DRAWS // 2, k))
    return np.concatenate([e, -e])


def entropy(log_odds: FloatArray) -> FloatArray:
    """Of two answers with these odds, in nats."""
    from scipy.special import entr, expit

    both: FloatArray = entr(expit(log_odds)) + entr(expit(-log_odds))
    return both
