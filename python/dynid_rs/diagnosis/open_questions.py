"""What a diagnosis leaves open, and all that is known about it: what the next experiment is designed from.

    ties    two kinds at a place that explain the data alike, one of which has the name
    edges   kinds at places that are neither believed nor refuted: posterior odds above 1:19, or evidence for them
    laws    of an angle, named or likely, that any function of it does as well as (`any_function.py`)
    silent  kinds at places that the runs say nothing of, for them or against: one of them may be what is missed

Beside them stands how much the runs say about every unknown: the precision of declared coefficients and of everything
that is asked, as one matrix, rows of a new motion add to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.any_function import own_angle, rival_functions
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.beside import Beside, places_of
from dynid_rs.diagnosis.candidates import SHAPES, Candidate, alive, width_of
from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.rivals import Contest, valued
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.diagnosis.trials import Value, evidence
from dynid_rs.diagnosis.waves import Argument, same_angles
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.regression.columns import Plan
from dynid_rs.regression.linear_model import Columns, LinearModel

FloatArray = NDArray[np.float64]

MOST = 10
"""Questions that are kept, the most open first: what is the eleventh can wait for the next diagnosis."""
SILENT = 10
"""Silent places that are kept, those first that independent rows would speak for."""
UNKNOWABLE = 1e-12
"""Precision of an unknown, over the greatest, below which nothing is known of it: it has no column."""


@dataclass(frozen=True)
class Answer:
    """A kind at a place with the shapes that it may have: candidates by their numbers, with how probable each is.

    The likeliest comes first; without any, nothing is there.
    """

    candidates: tuple[int, ...] = ()
    weights: tuple[float, ...] = ()


@dataclass(frozen=True)
class Question:
    """Which of two answers is right: a kind at a place, or another one, or any function of its angle, or nothing.

    `log_odds` of the first against the other after all runs so far.
    """

    first: Answer
    second: Answer
    log_odds: float

    @property
    def candidates(self) -> tuple[int, ...]:
        """Of both answers."""
        return self.first.candidates + self.second.candidates

    @property
    def is_open(self) -> bool:
        """Whether neither answer is sure."""
        return abs(self.log_odds) <= SURE


@dataclass(frozen=True, eq=False)
class OpenQuestions:
    """What is open, and what is known.

    Parameters
    ----------
    setup : Setup
        What is believed.
    named : tuple of (Place, float)
        Names with their logarithmic odds: what is settled, and what has ties.
    plan, links, about
        Columns of the declared model and of what was found, their coefficients, and the inertials behind them.
    cutoff, rate : float
        Of the band and of the runs' grid [Hz].
    two_encoders : bool
        Whether the runs showed links and motors apart: what a gear yields is seen then.
    torque_unit : str
        Of the runs.
    unit : float
        Torque unit per N m of the first joint.
    weights : ndarray (n_joints,)
        Of a row of each joint: root of the independent samples that it is worth, over its noise.
    noise : ndarray (n_joints,)
        Of a row of each joint, its standard deviation [torque unit].
    known : ndarray (n_columns, n_columns)
        Precision of the declared unknowns of the plan: of the model as it is, beside which nothing stands.
    precision : ndarray (n, n)
        Of the declared unknowns, then of every candidate's coefficients over their units, beside whatever else the
        diagnosis thinks possible (friction's other shapes, gears that yield).
    candidates, questions
        What is asked.
    may_pass : frozenset of Place
        Kinds at places that the runs do not speak against: further runs may name them.
    n_places : int
        How many were sought: what a name has to be more probable than.
    """

    setup: Setup
    named: tuple[tuple[Place, float], ...]
    plan: Plan
    links: LinkDynamicsIdentifier
    about: About
    cutoff: float
    rate: float
    two_encoders: bool
    torque_unit: str
    unit: float
    weights: FloatArray
    noise: FloatArray
    known: FloatArray
    precision: FloatArray
    candidates: tuple[Candidate, ...]
    questions: tuple[Question, ...]
    may_pass: frozenset[Place]
    n_places: int

    def at(self, candidate: int) -> NDArray[np.intp]:
        """Places of a candidate's coefficients in the precision, those of its shape behind its own."""
        return np.arange(self._edges[candidate], self._edges[candidate + 1])

    def covariance(self) -> FloatArray:
        """Of the declared unknowns (n_columns, n_columns); zero where the runs and the prior say nothing."""
        at = self.declared()
        scale = 1 / np.sqrt(np.diag(self.known)[at])
        covariance = np.zeros_like(self.known)
        alike = np.linalg.pinv(self.known[np.ix_(at, at)] * np.outer(scale, scale), rcond=1e-12, hermitian=True)
        covariance[np.ix_(at, at)] = alike * np.outer(scale, scale)
        return covariance

    @cached_property
    def _edges(self) -> NDArray[np.intp]:
        return self.plan.n_columns + np.cumsum([0, *(width_of(c) for c in self.candidates)])

    def declared(self, without: Sequence[int] = ()) -> NDArray[np.intp]:
        """Places of the declared unknowns that something is known of, but for some."""
        diagonal = np.diag(self.precision)[: self.plan.n_columns]
        kept = diagonal > UNKNOWABLE * diagonal.max()
        kept[list(without)] = False
        return np.flatnonzero(kept)


def open_questions(
    belief: Belief, contests: Mapping[Place, Contest], without_name: Mapping[Place, Argument]
) -> OpenQuestions:
    """Collect what a finished search leaves open.

    Parameters
    ----------
    belief : Belief
        What is believed.
    contests : mapping
        Every torque that was found against what may stand in its place (`rivals.settle_rivals`).
    without_name : mapping
        Those that any function does as well as (`misfit.nameless`, which also tells names that are open).
    """
    fit, setup = belief.fit, belief.setup
    candidates: list[Candidate] = []
    columns: list[Columns] = []
    questions: list[Question] = []

    def put(found: Sequence[tuple[Candidate, Columns, float]], instead_of: Sequence[int] = ()) -> Answer:
        first = len(candidates)
        for candidate, own, _ in found:
            candidates.append(replace(candidate, instead_of=tuple(instead_of)))
            columns.append(own)
        return Answer(tuple(range(first, len(candidates))), tuple(weight for _, _, weight in found))

    def add(value: Value, model: Beside, instead_of: Sequence[int] = (), most: int = SHAPES) -> Answer:
        return put(alive(belief.catalogue, value, model, most), instead_of)

    def of_angle(kind: str, j: int) -> bool:
        return kind in CATALOGUE and bool(same_angles(kind, j, setup.robot.n_joints)[0])

    def own(place: Place) -> Answer:
        if place not in answers:
            against = contests[place]
            answers[place] = add(against.own, against.beside, [at for _, at in own_places[place]])
        return answers[place]

    def ask_of_functions(answer: Answer, against: Contest) -> None:
        """If it is there, it will have to be told from any function too."""
        kind, (j, *_) = against.own.hypothesis.place
        if of_angle(kind, j) and len(questions) < MOST:
            functions, odds = rival_functions(belief.catalogue, kind, j, against)
            if abs(odds) <= SURE:
                questions.append(Question(answer, put(functions), odds))

    answers: dict[Place, Answer] = {}
    own_places = belief.by_place()
    ties = _ties(belief, contests)
    for asked in ties:
        if len(questions) >= MOST:
            break
        against = contests[asked.place]
        first = own(asked.place)
        second = add(against.rivals[asked.other], against.beside, [at for _, at in own_places[asked.place]])
        questions.append(Question(first, second, asked.log_odds))
        ask_of_functions(second, replace(against, own=against.rivals[asked.other]))
    open_laws = {p: own_angle(p[1][0]) for p, named in belief.named.items() if named.another_function is not None}
    for (kind, joints), argument in {**open_laws, **without_name}.items():
        if argument == own_angle(joints[0]) and of_angle(kind, joints[0]) and len(questions) < MOST:
            functions, odds = rival_functions(belief.catalogue, kind, joints[0], contests[kind, joints])
            # What is told in its place, and yet does not do beside a function: as likely as not.
            questions.append(Question(own((kind, joints)), put(functions), odds if odds <= SURE else 0.0))
    open_ = [h for h in belief.hypotheses() if h.place not in belief.named]
    n_places = belief.n_sought(open_)
    edges, may_pass = _edges(belief, open_, float(np.log(n_places)))
    edges = edges[: MOST - len(questions)]
    for value, log_odds in edges:
        if len(questions) >= MOST:
            break
        first = add(value, belief.beside)
        questions.append(Question(first, Answer(), log_odds))
        if log_odds >= 0.0:
            own_value = valued(belief.beside, belief.catalogue, value.hypothesis)
            ask_of_functions(first, Contest(belief.beside, own_value, {}))
    asked_already = {value.hypothesis.place for value, _ in edges}
    silent = [h for h in may_pass if h.place not in asked_already]
    for value, log_odds in _silent(belief.beside, silent, float(np.log(n_places))):
        questions.append(Question(add(value, belief.beside, most=1), Answer(), log_odds))
    return OpenQuestions(
        setup,
        tuple((place, named.log_odds) for place, named in belief.named.items()),
        fit.observations_.plan,
        fit.links_,
        About.of(fit),
        fit.band_.cutoff,
        fit.rate_,
        any(states.two_encoders for states in fit.runs_),
        fit.torque_unit_,
        _unit(fit),
        belief.beside.best.weights,
        belief.beside.best.noise,
        *_precisions(belief.beside, columns),
        tuple(candidates),
        tuple(questions),
        frozenset(h.place for h in may_pass) | {tie.other for tie in ties},
        n_places,
    )


@dataclass(frozen=True)
class _Tie:
    """A name and another place that explains the same, with the odds of the name against it."""

    place: Place
    other: Place
    log_odds: float


def _ties(belief: Belief, contests: Mapping[Place, Contest]) -> list[_Tie]:
    """Ties of all names that stand for a torque, the most open first."""
    found = [
        _Tie(place, other, -odds)
        for place, named in belief.named.items()
        for other, odds in named.ties
        if place in contests and other in contests[place].rivals and other not in named.same
    ]
    return sorted(found, key=lambda tie: abs(tie.log_odds))


def _edges(
    belief: Belief, open_: Sequence[Hypothesis], log_places: float
) -> tuple[list[tuple[Value, float]], list[Hypothesis]]:
    """Places that are neither believed nor refuted, the most open first, each with its posterior logarithmic odds.

    Also the hypotheses at all places that the runs do not speak against.
    """
    ties = {other for named in belief.named.values() for other, _ in named.ties}
    values, may_pass = evidence(belief.beside, [h for h in open_ if h.place not in ties])
    odds = [(value, value.value - log_places) for value in values.values()]
    # What is likely and yet has no name did not hold on parts of the data: as likely as not.
    edges = [(value, min(own, 0.0)) for value, own in odds if own > -SURE or value.value > 0]
    return sorted(edges, key=lambda pair: -pair[1]), may_pass


def _silent(beside: Beside, left: Sequence[Hypothesis], log_places: float) -> list[tuple[Value, float]]:
    """Places of `left`, which the runs say nothing of, with their posterior logarithmic odds."""
    if not left:
        return []
    hoped, places = np.array(beside.hoped_for(left)), places_of(left)
    first = sorted(places, key=lambda place: -float(hoped[places[place]].max()))[:SILENT]
    found = []
    for place in first:
        h = left[places[place][int(np.argmax(hoped[places[place]]))]]
        value, columns = beside.evidence_for(h)
        found.append((Value(value, h, columns), min(value, 0.0) - log_places))
    return found


def _unit(fit: ThreeLoopIdentifier) -> float:
    posterior = fit.links_.posterior_
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    return posterior.prior.unit


def _precisions(beside: Beside, columns: Sequence[Columns]) -> tuple[FloatArray, FloatArray]:
    """Precision of the declared unknowns alone; of them and of candidates, what else stands beside being anything."""
    model, fit = beside.model.beside(*columns), beside.best
    whole = information(model, fit.weights)
    n = model.prior.size
    rows = model.prior.rows(fit.choice)[0][:, :-1]
    whole[:n, :n] += rows.T @ rows
    whole[n:, n:] += np.eye(model.n_further)  # they are standard normal
    known = whole[:n, :n].copy()
    further = np.arange(n, n + beside.model.n_further)
    kept = np.delete(np.arange(len(whole)), further)
    across = whole[np.ix_(further, kept)]
    left: FloatArray = whole[np.ix_(kept, kept)] - across.T @ np.linalg.solve(whole[np.ix_(further, further)], across)
    return known, left


def information(model: LinearModel, weights: FloatArray) -> FloatArray:
    """What rows say of all unknowns, (n, n), each joint's rows with its weight."""
    whole = np.zeros((model.size, model.size))
    for gram, at, weight in zip(model.grams, model.places, weights, strict=True):
        whole[np.ix_(at, at)] += weight**2 * gram[:-1, :-1]
    return whole
