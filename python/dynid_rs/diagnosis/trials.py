"""What a name has to stand: evidence at its place, parts of the data that were left out, halves of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.beside import Beside, places_of
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis, Place
from dynid_rs.diagnosis.shapes import polished
from dynid_rs.regression.linear_model import Columns

BoolArray = NDArray[np.bool_]

N_BLOCKS = 8
"""Parts of the data, in order of time: left out one by one, and halved."""
N_HALVES, FIRST_IN = 16, 11
"""Random halves of the parts, and in how many a name has to come first on its joint: by chance half of them would do in
one of ten."""
LEAST_GAIN = 0.01
"""Part of some joint's left-out error that a name has to take off; an effect of a third of the noise takes 4 %."""
SHORTLIST = 12
"""Places whose evidence is computed with the noise estimated anew in a step; screening orders them."""
HOPELESS, WITHIN_REACH = -2.0, 10.0
"""Screened evidence below which a place is not looked at again in a round, and nats by which a finer shape may raise
it."""


@dataclass(frozen=True, eq=False)
class Value:
    """Evidence of a place: its best hypothesis, the columns in their likeliest size."""

    value: float
    hypothesis: Hypothesis
    columns: Columns


def evidence(
    beside: Beside, hypotheses: Sequence[Hypothesis], catalogue: Catalogue
) -> tuple[dict[Place, Value], list[Hypothesis]]:
    """Logarithm of the Bayes factor of the places that screening puts first, averaged over their shapes.

    Also the hypotheses of all places that are not hopeless: those that may yet pass beside what is named next.
    """
    from scipy.special import logsumexp

    screened = np.array([score.value for score in beside.screened(hypotheses)])
    places = places_of(hypotheses)
    order = sorted(places, key=lambda place: -float(screened[places[place]].max()))
    values = {}
    for place in order[:SHORTLIST]:
        at = places[place]
        best = at[int(np.argmax(screened[at]))]
        if not np.isfinite(screened[best]):
            continue
        value, columns = beside.evidence_for(hypotheses[best])
        averaged = value + float(logsumexp(screened[at] - screened[best]) - np.log(len(at)))
        values[place] = Value(averaged, hypotheses[best], columns)
        if len(at) > 1 and -WITHIN_REACH < averaged < WITHIN_REACH and place not in catalogue.finer:
            # A grid may miss a narrow best; one shape of so many is then its price.
            finer = catalogue.finer.setdefault(place, polished(beside, catalogue, hypotheses[best]))
            value, columns = beside.evidence_for(finer)
            if value - float(np.log(len(at))) > averaged:
                values[place] = Value(value - float(np.log(len(at))), finer, columns)
    kept = {place for place, at in places.items() if screened[at].max() > HOPELESS}
    return values, [h for h in hypotheses if h.place in kept]


def blocks(n_rows: int) -> list[BoolArray]:
    """Parts of the rows in order of time, (n_rows,) each."""
    edges = np.linspace(0, n_rows, N_BLOCKS + 1).astype(int)
    at = np.arange(n_rows)
    return [(at >= first) & (at < last) for first, last in pairwise(edges)]


def helps(before: Beside, after: Beside, joints: Sequence[int], parts: Sequence[BoolArray]) -> bool:
    """Whether parts that were left out are not predicted worse on the joints it acts on, by more than chance.

    Chance: one standard error of the difference over the parts. At the prior that suits it some joint's error has to
    fall by `LEAST_GAIN`: less is of no use, however certain. What it does to other joints through the links that they
    share is judged when all names are in.
    """
    own = list(joints)
    with_it = after.model.left_out(after.best, parts)[:, own]
    without = before.model.left_out(before.best, parts)[:, own]
    lost = (with_it - without) @ before.best.weights[own] ** 2
    alike = next(fit for fit in before.fits if fit.choice == after.best.choice)
    at_that_prior = before.model.left_out(alike, parts)[:, own].sum(axis=0)
    gain = 1 - np.sqrt(with_it.sum(axis=0) / np.maximum(at_that_prior, 1e-300))
    return bool(lost.sum() < np.sqrt(len(parts)) * lost.std(ddof=1) and gain.max() > LEAST_GAIN)


def is_stable(beside: Beside, best: Value, rivals: Sequence[Value], parts: Sequence[BoolArray]) -> bool:
    """Whether no rival on its joints refutes the name in most halves of the data."""
    rng = np.random.default_rng(0)
    hypotheses = [best.hypothesis, *(rival.hypothesis for rival in rivals)]
    first = 0
    for _ in range(N_HALVES):
        half = np.any([parts[k] for k in rng.choice(N_BLOCKS, N_BLOCKS // 2, replace=False)], axis=0)
        scores = beside.within(half).screened([_within(h, half) for h in hypotheses])
        values = [score.value for score in scores]
        first += values[0] > max(values) - SURE
    return first >= FIRST_IN


def _within(hypothesis: Hypothesis, kept: BoolArray) -> Hypothesis:
    return replace(hypothesis, columns={j: part[kept] for j, part in hypothesis.columns.items()})
