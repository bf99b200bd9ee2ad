"""The search: names that the data ask for, one rule for all of them, until nothing more passes.

    ln BF(kind, place)  =  evidence of the best shape beside everything else, averaged over the shapes of the grid
    named               if  ln BF - ln(kinds x places)  >  ln 19, and it holds on parts of the data

A name is at posterior odds of 19 to 1. It holds on parts if parts that were left out are not predicted worse with it on
the joints it acts on. Where no name passes alone, two that hide each other are asked together (`hidden.py`), and then
the likeliest torque beside a fit with it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hidden import hidden
from dynid_rs.diagnosis.holding import holds, shares
from dynid_rs.diagnosis.one_clock import share_a_clock
from dynid_rs.diagnosis.open_questions import OpenQuestions
from dynid_rs.diagnosis.rivals import is_one_cause
from dynid_rs.diagnosis.settling import settle
from dynid_rs.diagnosis.setup import Setup, believed
from dynid_rs.diagnosis.shaped import Place, shaped_as
from dynid_rs.diagnosis.shapes import polished
from dynid_rs.diagnosis.standing import backward, harmless, sized
from dynid_rs.diagnosis.structural import REFITTED
from dynid_rs.diagnosis.trials import Asked, Value, blocks, evidence, helps, whole_runs
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.runs.recording import Recording

MOST_ROUNDS, MOST_A_ROUND = 6, 12
"""Rounds of naming and refitting, and names in a round."""
FALLEN = 0.5
"""A joint whose noise falls below this part waits until friction's shapes, which are linear near themselves only, are
fitted again; so does one whose structure changes."""


def search(
    setup: Setup,
    train: Sequence[Recording],
    fit: ThreeLoopIdentifier,
    *,
    mounting_odds: float = 0.0,
    after: OpenQuestions | None = None,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Belief:
    """Find what the model lacks on training runs.

    Parameters
    ----------
    setup : Setup
        What is believed at the beginning.
    train : sequence of Recording
        Training runs.
    fit : ThreeLoopIdentifier
        Of the setup to these runs.
    mounting_odds : float
        Logarithmic odds of the setup's mounting, where that is another one than declared: it is a name, which turns
        to where it is likeliest before anything else is asked.
    after : OpenQuestions, optional
        What an earlier diagnosis of some of these runs named and left open: only that is asked, and checked.
    """
    belief = Belief.in_declared(setup, train, fit)
    if mounting_odds:
        belief.believe_mounting(mounting_odds)
    if after is not None:
        on_progress("what was settled")
        belief.only, belief.n_places = after.may_pass, after.n_places
        belief.adopt(believed(setup, after.setup), dict(after.named))
        backward(belief, SURE)
    look(belief, on_progress)
    return belief


def look(belief: Belief, on_progress: Callable[[str], None], *, once_more: bool = False) -> None:
    """Find what is missing beside what is believed already.

    `once_more`: names and their shapes have settled, and stay as they are where nothing is missing and no name goes.
    """
    believed_before = set(belief.named)
    name(belief, on_progress)
    if once_more and set(belief.named) == believed_before and not backward(belief, SURE):
        return
    if merge(belief):
        backward(belief)
        name(belief, on_progress)  # beside another kind another one may be missing
    settle(belief)
    backward(belief, SURE)
    sized(belief)
    harmless(belief)


def name(belief: Belief, on_progress: Callable[[str], None]) -> None:
    """Rounds of naming, until nothing passes."""
    refused: set[Place] = set()
    for _ in range(MOST_ROUNDS):
        on_progress(f"{len(belief.named)} effects so far" if belief.named else "looking for effects")
        found, asked = forward(belief, refused)
        pair = [] if found else hidden(belief, asked)
        if found or pair:
            accept(belief, found or pair, refused, together=bool(pair))
        elif not on_trial(belief, asked, refused):
            return
        share_a_clock(belief)
        refused |= backward(belief)  # they would only come and go again, in the place of what else may be there


def accept(belief: Belief, found: list[Named], refused: set[Place], *, together: bool = False) -> list[Named]:
    """Believe names, `together` all of them or none; which those were.

    A change of structure is linear near what it changes only: changes after which the data are less probable are
    `refused`.
    """
    before = belief.kept
    belief.accept(found)
    moved = [named for named in found if named.hypothesis.kind in REFITTED]
    if not moved or belief.is_likelier_than(before):
        return found
    belief.restore(before)
    refused |= {named.hypothesis.place for named in moved}
    found = [] if together else [named for named in found if named not in moved]
    if found:
        belief.accept(found)
    return found


def on_trial(belief: Belief, asked: Asked, refused: set[Place]) -> bool:
    """Believe the likeliest torque that does not pass, if it passes beside a fit with it; whether it did.

    Columns made of a fitted torque lack what the fit without the name has lost of it, and what they leave remembers
    that: where torque was cut off, the rows of a run of 23 s were worth thirteen samples.
    """
    likely = [v for v in asked.values.values() if v.value > SURE and v.hypothesis.kind in CATALOGUE]
    if not likely:
        return False
    tried, before = max(likely, key=lambda v: v.value), belief.kept
    place = tried.hypothesis.place
    belief.accept([Named(tried.hypothesis, tried.value - asked.log_places)])
    beside = belief.beside.without(belief.by_place()[place])
    others = (refused | belief.named.keys()) - {place}
    open_ = [h for h in belief.hypotheses() if h.place not in others]
    again = Asked(evidence(beside, open_)[0], open_, asked.log_places)
    best = _first_to_hold(belief, beside, again, set())
    if best is not None and best.hypothesis.place == place:
        belief.named[place] = replace(belief.named[place], log_odds=best.value - asked.log_places)
        return True
    belief.restore(before)
    refused.add(place)
    return False


def forward(belief: Belief, never: Collection[Place] = ()) -> tuple[list[Named], Asked]:
    """Names that pass, one after the other, each beside those before it; none of `never`.

    Also what was asked last, of which none passed.
    """
    open_ = [h for h in belief.hypotheses() if h.place not in belief.named and h.place not in never]
    beside, log_places = belief.beside, float(np.log(belief.n_sought(open_)))
    found: list[Named] = []
    doubted = set[Place]()
    while True:
        values, open_ = evidence(beside, open_)
        asked = Asked(values, open_, log_places)
        best = _first_to_hold(belief, beside, asked, doubted) if len(found) < MOST_A_ROUND else None
        if best is None:
            return found, asked
        named, rivals = best.hypothesis, _rivals(asked, best)
        told = {v.hypothesis.place: v.value - best.value for v in rivals if v.value > asked.need}
        before, beside = beside.best, beside.with_columns(best.columns)
        settled = beside.best.noise > FALLEN * before.noise
        if named.kind in REFITTED:
            settled[list(named.columns)] = False
        if told:
            still = {
                v.hypothesis.place: beside.evidence_for(v.hypothesis)[0] for v in rivals if v.hypothesis.place in told
            }
            told = {p: d for p, d in told.items() if still[p] < asked.need}
        ties = tuple((p, d) for p, d in told.items() if d > -SURE)
        others = tuple((p, d) for p, d in told.items() if d <= -SURE)
        found.append(Named(named, best.value - log_places, ties, refuted=others))
        gone = {named.place, *(p for p, _ in ties)}
        open_ = [h for h in open_ if h.place not in gone and all(settled[j] for j in h.columns)]


def _first_to_hold(belief: Belief, beside: Beside, asked: Asked, doubted: set[Place]) -> Value | None:
    """Return the most probable name that passes and holds, in its own shape; `doubted` are those that do not hold."""
    passing = [v for v in asked.values.values() if v.value > asked.need and v.hypothesis.place not in doubted]
    for best in sorted(passing, key=lambda v: -v.value):
        unlike = [v for v in _rivals(asked, best) if not is_one_cause(best.hypothesis.kind, v.hypothesis.kind)]
        # Its own shape: what a grid's leaves of an effect looks like the next one.
        shaped = polished(beside, belief.catalogue, best.hypothesis)
        own = replace(best, hypothesis=shaped, columns=beside.evidence_for(shaped)[1])
        # A grid's shape that is not quite the effect's holds on fewer parts, the likeliest one where little tells it.
        if any(holds(belief, beside, tried, unlike, asked.need) for tried in (best, own)):
            return own
        doubted.add(best.hypothesis.place)
    return None


def _rivals(asked: Asked, best: Value) -> list[Value]:
    """What may be the cause in its place: what acts on one of its joints."""
    place = best.hypothesis.place
    return [v for v in asked.values.values() if v.hypothesis.place != place and shares(v.hypothesis, best.hypothesis)]


def merge(belief: Belief) -> bool:
    """One kind in the place of two on the same joints, where it is more probable than both; whether there was one.

    Each name has had to pass against all kinds and places, so two of them pay for one name more.
    """
    parts, runs, changed = blocks(belief.phase), whole_runs(belief.phase, belief.run_lengths), False
    log_places = float(np.log(belief.catalogue.n_places))
    for now in combinations([(effect.kind, effect.joints) for effect in belief.setup.effects], 2):
        own = belief.by_place()
        if now[0][1] != now[1][1] or not set(now) <= set(own) & set(belief.named):
            continue
        one, two = (shaped_as(e) for place in now for e in belief.setup.effects if (e.kind, e.joints) == place)
        others = belief.beside.without([column for place in now for column in own[place]])
        first, second = belief.catalogue.of([one, two])
        value, columns = others.evidence_for(first)
        both = value + others.with_columns(columns).evidence_for(second)[0]
        taken = belief.named.keys() - set(now)  # one of the two, in another shape, may do for both
        here = [s for s in belief.catalogue.grid if s.joints == one.joints and (s.kind, s.joints) not in taken]
        values, _ = evidence(others, belief.catalogue.of(here))
        best = max(values.values(), key=lambda value: value.value, default=None)
        if best is None:
            continue
        alone = polished(others, belief.catalogue, best.hypothesis)
        value, columns = others.evidence_for(alone)
        after = others.with_columns(columns)
        if value < both - log_places or not helps(others, after, belief.reach(alone), parts, runs):
            continue
        belief.merge(now, alone, value - log_places)
        changed = True
    return changed
