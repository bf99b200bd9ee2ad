"""The search: names that the data ask for, one rule for all of them, until nothing more passes.

    ln BF(kind, place)  =  evidence of the best shape beside everything else, averaged over the shapes of the grid
    named               if  ln BF - ln(kinds x places)  >  ln 19, and it holds on parts of the data

A name is at posterior odds of 19 to 1. It holds on parts if parts that were left out are predicted better with it, on
no joint worse, and if it comes first on its joint in most halves of the data (Meinshausen and Buehlmann 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside, places_of
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis, Place, Shaped, shaped_as
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shapes import polished
from dynid_rs.diagnosis.structural import KINDS, structural_hypotheses, undone, value_of
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import own_columns
from dynid_rs.regression.linear_model import Columns, sign_cost
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SURE = float(np.log(19.0))
"""Logarithm of the posterior odds at which a hypothesis is named: 95 %."""
N_BLOCKS = 8
"""Parts of the data, in order of time: left out one by one, and halved."""
N_HALVES, FIRST_IN = 16, 11
"""Random halves of the parts, and in how many a name has to come first on its joint: by chance half of them would do in
one of ten."""
HARM = 1.02
"""No joint's left-out error may grow by this factor."""
LEAST_GAIN = 0.01
"""Part of some joint's left-out error that a name has to take off; an effect of a third of the noise takes 4 %."""
REFUTED = 2.0
"""Standard errors by which a coefficient has the wrong sign: one in forty by chance."""
SHORTLIST = 12
"""Places whose evidence is computed with the noise estimated anew in a step; screening orders them."""
HOPELESS, WITHIN_REACH = -2.0, 10.0
"""Screened evidence below which a place is not looked at again in a round, and nats by which a finer shape may raise
it."""
MOST_ROUNDS, MOST_A_ROUND = 6, 12
"""Rounds of naming and refitting, and names in a round."""
SETTLED_AFTER = 1
"""Rounds in which the shapes of what was found are searched once more."""
SETTLING = 3
"""Refits in which geometry, clocks and encoders that were accepted settle; each brings them ten times closer."""


@dataclass(frozen=True, eq=False)
class Named:
    """A hypothesis that passed: its logarithmic odds, and others that explain the same, as well or worse."""

    hypothesis: Hypothesis
    log_odds: float
    ties: tuple[tuple[Place, float], ...] = ()
    refuted: tuple[tuple[Place, float], ...] = ()


@dataclass(eq=False)
class Search:
    """What is believed so far: the setup, its fit, and why each name is there."""

    setup: Setup
    fit: ThreeLoopIdentifier
    catalogue: Catalogue
    named: dict[Place, Named] = field(default_factory=dict)
    mounting: Place | None = None
    steps: list[tuple[str, Place, FloatArray]] = field(default_factory=list)

    def believe_mounting(self, odds: float) -> None:
        """Name the mounting that the search began with; its angles stand in the setup's robot."""
        place = ("gravity_tilt", tuple(range(self.setup.robot.n_joints)))
        (h,) = structural_hypotheses(self.fit, self.setup, ["gravity_tilt"])
        self.named[place] = Named(h, odds)
        self.mounting = place

    def left(self) -> FloatArray:
        """RMS that the fit leaves on its training rows, (n_joints,)."""
        covariance: FloatArray = np.sqrt(np.diag(self.fit.links_.covariance_))
        return covariance


def search(
    setup: Setup,
    train: Sequence[Recording],
    fit: ThreeLoopIdentifier | None = None,
    *,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Search:
    """Find what the model lacks on training runs.

    Parameters
    ----------
    setup : Setup
        What is believed at the beginning.
    train : sequence of Recording
        Training runs.
    fit : ThreeLoopIdentifier, optional
        Of the setup to these runs.
    """
    fit = fitted(setup, train) if fit is None else fit
    state, declared = Search(setup, fit, Catalogue(fit)), Beside.of(fit)
    for _ in range(MOST_ROUNDS):
        on_progress(f"{len(state.named)} effects so far" if state.named else "looking for effects")
        found = forward(state)
        if not found:
            break
        accept(state, found, train)
        dropped = backward(state, setup, train)
        if {named.hypothesis.place for named in found} <= dropped:
            break  # all that was added is gone again: the next round would only do the same
    settle(state, train)
    backward(state, setup, train)
    harmless(state, declared, setup, train)
    return state


def settle(state: Search, train: Sequence[Recording]) -> None:
    """Shapes once more, each beside all others: friction and what turns round with it settle in turn."""
    for _ in range(SETTLED_AFTER):
        beside, before = Beside.of(state.fit), state.setup.effects
        moved = []
        for effect, places in zip(before, places_in(state), strict=True):
            others = beside.without(places)
            (h,) = state.catalogue.of([shaped_as(effect)])
            h = polished(others, state.catalogue, h)
            moved.append(Shaped(h.kind, h.joints, h.shape).placed())
            state.named[h.place] = replace(state.named[h.place], hypothesis=h)
        if tuple(moved) == before:
            return
        state.setup = replace(state.setup, effects=tuple(moved))
        refit(state, train)


def places_in(state: Search) -> list[list[tuple[int, int]]]:
    """Joint and place among the fit's unknowns of every coefficient of every torque term of the setup."""
    if not state.setup.effects:
        return []
    plan, columns = state.fit.observations_.plan, own_columns(state.setup.effects, 0)
    first = plan.friction[1].start - 1 - max(column for places in columns for _, column in places)
    return [[(j, plan.n_base + j * plan.n_own + first + column) for j, column in places] for places in columns]


def harmless(state: Search, declared: Beside, setup: Setup, train: Sequence[Recording]) -> None:
    """Take out names until no joint is predicted worse than by the declared model, on parts that were left out.

    Worse: by more than `HARM`, and by more than one standard error of the difference over the parts. The least certain
    name that reaches the joint goes first.
    """
    parts = blocks(declared.model.n_rows)
    without = declared.model.left_out(declared.best, parts)
    while state.named:
        beside = Beside.of(state.fit)
        if beside.model.n_rows != declared.model.n_rows:
            return  # another clock has other rows: nothing to compare row by row
        lost = beside.model.left_out(beside.best, parts) - without
        ratio = np.sqrt(1 + lost.sum(axis=0) / np.maximum(without.sum(axis=0), 1e-300))
        clear = lost.sum(axis=0) > np.sqrt(len(parts)) * lost.std(axis=0, ddof=1)
        harmed = np.flatnonzero((ratio > HARM) & clear)
        guilty = [n for n in state.named.values() if set(reach(n.hypothesis, state)) & set(harmed.tolist())]
        if not guilty:
            return
        remove(state, min(guilty, key=lambda named: named.log_odds).hypothesis.place, setup)
        refit(state, train)


def remove(state: Search, place: Place, declared: Setup) -> None:
    """Take a name out of the setup; a change of structure goes back to where `declared` has it."""
    kind, joints = place
    state.setup = replace(state.setup, effects=tuple(e for e in state.setup.effects if (e.kind, e.joints) != place))
    if kind in KINDS:
        state.setup = undone(state.setup, declared, kind, joints)
    state.steps.append(("dropped", place, state.left()))
    del state.named[place]


def fitted(setup: Setup, train: Sequence[Recording]) -> ThreeLoopIdentifier:
    """Declared model and what was found."""
    return setup.identifier(residual=None).fit([setup.corrected(recording) for recording in train])


def refitted(setup: Setup, fit: ThreeLoopIdentifier, train: Sequence[Recording]) -> ThreeLoopIdentifier:
    """Fit again after a change of the setup; friction's shapes stay near those of `fit`."""
    friction = SmoothFrictionIdentifier((fit.friction_.transition_width_, fit.friction_.sharpness_))
    identifier = setup.identifier(residual=None, friction=friction)
    return identifier.fit([setup.corrected(recording) for recording in train])


def forward(state: Search) -> list[Named]:
    """Names that pass, one after the other, each beside those before it."""
    open_ = [h for h in hypotheses_of(state) if h.place not in state.named]
    beside = Beside.of(state.fit)
    n_places = len(places_of(open_))
    need = SURE + float(np.log(n_places))
    parts = blocks(beside.model.n_rows)
    found: list[Named] = []
    refused: set[Place] = set()
    for _ in range(MOST_A_ROUND):
        open_ = [h for h in open_ if h.place not in refused]
        values, open_ = evidence(beside, open_, state.catalogue)
        passing = sorted((v for v in values.values() if v.value > need), key=lambda v: -v.value)
        if not passing:
            break
        best = passing[0]
        place = best.hypothesis.place
        after = beside.with_columns(best.columns)
        rivals = [v for v in values.values() if v.hypothesis.place != place and shares(v.hypothesis, best.hypothesis)]
        if not (helps(beside, after, reach(best.hypothesis, state), parts) and is_stable(beside, best, rivals, parts)):
            refused.add(place)
            continue
        told = {v.hypothesis.place: v.value - best.value for v in rivals if v.value > need}
        beside = after
        if told:
            still = {v.hypothesis.place: beside.evidence_for(v.hypothesis)[0] for v in rivals}
            told = {p: d for p, d in told.items() if still[p] < need}
        ties = tuple((p, d) for p, d in told.items() if d > -SURE)
        others = tuple((p, d) for p, d in told.items() if d <= -SURE)
        found.append(Named(best.hypothesis, best.value - float(np.log(n_places)), ties, others))
        refused |= {place, *(p for p, _ in ties)}
    return found


def hypotheses_of(state: Search) -> list[Hypothesis]:
    """Everything that is sought, of the catalogue and of the structure."""
    return [*state.catalogue.hypotheses(), *structural_hypotheses(state.fit, state.setup)]


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
        averaged = value + float(np.log(np.mean(np.exp2((screened[at] - screened[best]) / np.log(2.0)))))
        values[place] = Value(averaged, hypotheses[best], columns)
        if len(at) > 1 and -WITHIN_REACH < averaged < WITHIN_REACH and place not in catalogue.finer:
            # A grid may miss a narrow best; one shape of so many is then its price.
            finer = catalogue.finer.setdefault(place, polished(beside, catalogue, hypotheses[best]))
            value, columns = beside.evidence_for(finer)
            if value - float(np.log(len(at))) > averaged:
                values[place] = Value(value - float(np.log(len(at))), finer, columns)
    kept = {place for place, at in places.items() if screened[at].max() > HOPELESS}
    return values, [h for h in hypotheses if h.place in kept]


def shares(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses act on a common joint, so that one may explain what the other does."""
    return bool(set(one.columns) & set(other.columns))


def blocks(n_rows: int) -> list[BoolArray]:
    """Parts of the rows in order of time, (n_rows,) each."""
    edges = np.linspace(0, n_rows, N_BLOCKS + 1).astype(int)
    at = np.arange(n_rows)
    return [(at >= first) & (at < last) for first, last in pairwise(edges)]


def reach(hypothesis: Hypothesis, state: Search) -> list[int]:
    """Joints whose torque a hypothesis changes: its own, or all where it changes the links that they share."""
    return list(range(state.setup.robot.n_joints)) if hypothesis.kind in KINDS else sorted(hypothesis.columns)


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


def accept(state: Search, found: Sequence[Named], train: Sequence[Recording]) -> None:
    """Put names into the setup, fit everything again, shapes and structure included."""
    beside = Beside.of(state.fit)
    for named in found:
        h = polished(beside, state.catalogue, named.hypothesis)
        columns = beside.evidence_for(h)[1]
        beside = beside.with_columns(columns)
        state.setup = h.accept(state.setup, coefficients(h, columns, beside))
        state.named[h.place] = replace(named, hypothesis=h)
    refit(state, train)
    for named in found:
        state.steps.append(("added", named.hypothesis.place, state.left()))


def coefficients(h: Hypothesis, columns: Columns, beside: Beside) -> FloatArray:
    """Coefficients of the last hypothesis in the model, in their own units."""
    j = next(iter(columns))
    size = np.linalg.norm(columns[j]) / max(float(np.linalg.norm(h.columns[j])), 1e-300)
    x: FloatArray = beside.best.x[-len(h.unit) :] * size * h.unit
    return x


def refit(state: Search, train: Sequence[Recording]) -> None:
    """Fit everything again; geometry, clocks and encoders that were accepted move to where they belong."""
    state.fit = refitted(state.setup, state.fit, train)
    structural = {place for place in state.named if place[0] in KINDS and place[0] != "torque_gain"}
    kinds = {kind for kind, _ in structural}
    for _ in range(SETTLING if structural else 0):
        beside, moved = Beside.of(state.fit), False
        for h in structural_hypotheses(state.fit, state.setup, sorted(kinds)):
            if h.place in structural:
                beside = beside.with_columns(h.columns)
                x = coefficients(h, h.columns, beside)
                std = np.sqrt(np.diag(beside.best.covariance)[-len(h.unit) :]) * h.unit
                moved = moved or bool(np.any(np.abs(x) > 0.1 * std))
                state.setup = h.accept(state.setup, x)
        if not moved:
            break
        state.fit = refitted(state.setup, state.fit, train)
    state.catalogue = Catalogue(state.fit, state.catalogue)


def backward(state: Search, declared: Setup, train: Sequence[Recording]) -> set[Place]:
    """Take out names that have become less likely than not beside all others; which those were."""
    dropped: set[Place] = set()
    while True:
        values = standing(state)
        weakest = min(values, key=lambda place: values[place], default=None)
        if weakest is None or values[weakest] > 0:
            return dropped
        remove(state, weakest, declared)
        refit(state, train)
        dropped.add(weakest)


def standing_structure(state: Search, beside: Beside) -> dict[Place, float]:
    """Logarithmic odds of the changes of structure, by the density of their posterior at none (Savage and Dickey).

    ``ln BF = v' S^-1 v / 2 + ln(det S / det S_0) / 2``: value v, its covariance S beside everything, its prior's S_0.
    """
    kinds = sorted({kind for kind, _ in state.named if kind in KINDS and kind != "torque_gain"})
    n_places = len(places_of(state.catalogue.hypotheses()))
    odds = {}
    for h in structural_hypotheses(state.fit, state.setup, kinds):
        if h.place not in state.named or h.place == state.mounting:
            continue
        size = max(h.sizes)
        after = beside.with_columns({j: size * part for j, part in h.columns.items()})
        value = value_of(state.setup, h.kind, h.joints)
        width, unit = len(value), size * h.unit[: len(value)]
        at = slice(len(after.best.x) - len(h.unit), len(after.best.x) - len(h.unit) + width)
        S = after.best.covariance[at, at]
        z = (value + after.best.x[at] * unit) / unit
        factor = 0.5 * float(z @ np.linalg.solve(S, z)) + 0.5 * float(np.linalg.slogdet(S)[1])
        odds[h.place] = factor - float(np.log(n_places))
    return odds


def standing(state: Search) -> dict[Place, float]:
    """Logarithmic odds of every name of the setup beside all others."""
    beside = Beside.of(state.fit)
    odds = standing_structure(state, beside)
    if not state.setup.effects:
        return odds
    n_places = len({(s.kind, s.joints) for s in state.catalogue.grid()})
    best = beside.best
    std = np.sqrt(np.diag(best.covariance))
    for effect, places in zip(state.setup.effects, places_in(state), strict=True):
        less = beside.without(places)
        at = [place for _, place in places]
        (h,) = state.catalogue.of([shaped_as(effect)])
        z = best.x[at] / std[at]
        # A coefficient that physics does not allow refutes the name, however well it fits.
        refuted = np.any((h.bounds[:, 0] == 0) & (z < -REFUTED)) or np.any((h.bounds[:, 1] == 0) & (z > REFUTED))
        value = best.evidence - less.best.evidence + sign_cost(z, h.bounds)
        odds[h.place] = -np.inf if refuted else value - float(np.log(n_places))
    return odds
