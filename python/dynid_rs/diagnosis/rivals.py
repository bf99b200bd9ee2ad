"""What else a torque may be: another kind at its joints, or a function of its angle that has no name.

    own    =  ln BF of the torque as it is named        averaged over the shapes of its kind, beside all other names
    rival  =  ln BF of another kind, or of a function   in its place
    told   if own > rival + ln 19 for every rival

A name is asked for beside the names before it; what it is told from is asked once more when all of them are in. Where
the name is not told, it is either one or the other, and the torque of the likelier one is kept, for it predicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.candidates import cell, distance, size_of, with_slopes
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.settling import settle
from dynid_rs.diagnosis.shaped import Place, Shaped, shaped_as
from dynid_rs.diagnosis.shapes import polished
from dynid_rs.diagnosis.trials import Value, blocks, evidence, helps, whole_runs
from dynid_rs.diagnosis.waves import SIZES
from dynid_rs.excitation.named import NamedEffect
from dynid_rs.excitation.separation import Separation
from dynid_rs.excitation.shapes import ShapedEffect
from dynid_rs.model.placed import PlacedEffect
from dynid_rs.regression.linear_model import sign_cost

SOME_SECONDS = 10.0
"""Length of the motion along which two places of a kind are compared: whatever is enough for some periods of it."""
WITHIN_REACH = 10.0
"""Nats within which a shape between the grid's may decide between a torque and a rival."""
LIMITS = {"load_dependent_friction": "load_hysteresis"}
"""Kinds that are others with a length of nothing: the same cause, and where the two are ties, no other one."""


@dataclass(frozen=True, eq=False)
class Contest:
    """A torque and what may stand in its place: the model without it, its own evidence there, that of other kinds."""

    beside: Beside
    own: Value
    rivals: dict[Place, Value]


def contest(belief: Belief, effect: PlacedEffect, columns: Sequence[tuple[int, int]]) -> Contest:
    """A torque, whose coefficients stand at `columns`, against every kind at its joints that has no name there."""
    catalogue, beside = belief.catalogue, belief.beside.without(columns)
    (h,) = catalogue.of([shaped_as(effect)])
    own = valued(beside, catalogue, h)
    taken = belief.named.keys() | {(e.kind, e.joints) for e in belief.setup.effects}
    here = [s for s in catalogue.grid if _competes(s, h) and (s.kind, s.joints) not in taken]
    rivals, _ = evidence(beside, catalogue.of(here))
    for place, rival in rivals.items():
        if rival.value > own.value - WITHIN_REACH:  # so near that the gaps of the grid could decide
            rivals[place] = valued(beside, catalogue, polished(beside, catalogue, rival.hypothesis))
    return Contest(beside, own, rivals)


def _competes(s: Shaped, h: Hypothesis) -> bool:
    """Whether a kind at a place may be what another is: at the same joints, or the same force at one of two joints.

    Inertia that couples parallel axes 3 and 4 is the same as less of it between 2 and 4, with more in link and rotor 4.
    """
    return s.joints == h.joints or (len(h.joints) > 1 and s.kind == h.kind and bool({*s.joints} & {*h.joints}))


def valued(beside: Beside, catalogue: Catalogue, h: Hypothesis) -> Value:
    """Evidence of a kind, `h` its best shape: averaged over the shapes around that and over its grid, alike beforehand.

    Between the grid's values lies a shape that suits the noise too, so one that was looked for there has its price: the
    part of its cell of the grid that the data leave, by its slopes.

    Rivals are compared where samples are worth the same to both, as many as to the model that has the torque, and under
    the same sizes beforehand: a kind that expects more than there is would lose to a function for that alone.
    """
    from scipy.special import logsumexp

    _, columns = beside.evidence_for(replace(h, sizes=SIZES))
    best, width = beside.with_columns(columns).best, len(h.unit)
    z = best.x[-width:] / np.sqrt(np.diag(best.covariance)[-width:])
    sized = replace(h, unit=size_of(h, columns) * h.unit)
    wide = with_slopes(catalogue, sized, best.x[-width:], columns, spread=cell)
    after = best if wide is columns else beside.with_columns(wide).best
    value = after.evidence - beside.best.evidence + float(sign_cost(z, h.bounds))
    shapes = [s for s in catalogue.grid if (s.kind, s.joints) == h.place]
    if shapes:
        own = Shaped(h.kind, h.joints, h.shape)
        nearest = min(shapes, key=lambda s: distance(s, own))
        others = catalogue.of([s for s in shapes if s != nearest])
        scores = [score.value for score in beside.screened([h, *others])]
        value += float(logsumexp(scores) - scores[0] - np.log(len(shapes)))
    return Value(value, h, columns)


def settle_rivals(belief: Belief) -> dict[Place, Contest]:
    """Put kinds that are likelier beside all other names in their places, where they hold; the contests of those then.

    A name that came before others was the likeliest without them. Of two that tie the likelier one predicts, and goes
    on beyond the motion that was seen.
    """
    asked = set[tuple[Place, Place]]()
    while True:
        contests = weigh_rivals(belief)
        likelier = {place: _likelier(belief, place, contests[place]) for place in belief.named if place in contests}
        pairs = [(place, v) for place, v in likelier.items() if v and (place, v.hypothesis.place) not in asked]
        if not pairs:
            return contests
        place, rival = pairs[0]
        new, before, gain = rival.hypothesis.place, belief.kept, rival.value - contests[place].own.value
        asked.add((place, new))
        belief.merge([place], rival.hypothesis, belief.named[place].log_odds + gain)
        settle(belief)
        now = weigh_rivals(belief)[new]
        if place in now.rivals and now.rivals[place].value > now.own.value:  # not with everything fitted again
            belief.restore(before)


def _likelier(belief: Belief, place: Place, against: Contest) -> Value | None:
    """The likeliest rival of a name, of another cause at its joints, if it is likelier than that and holds on parts."""
    kind, joints = place
    asked = {other for other in against.rivals if other[1] == joints and not is_one_cause(kind, other[0])}
    rivals = [against.rivals[other] for other in (asked if belief.only is None else asked & belief.only)]
    best = max(rivals, key=lambda rival: rival.value, default=against.own)
    if best.value <= max(against.own.value, SURE):
        return None
    parts, runs = blocks(belief.phase), whole_runs(belief.phase, belief.run_lengths)
    after = against.beside.with_columns(best.columns)
    return best if helps(against.beside, after, belief.reach(best.hypothesis), parts, runs) else None


def weigh_rivals(belief: Belief) -> dict[Place, Contest]:
    """Give every name of a torque the ties, and the refuted rivals, that it has beside all others; all contests."""
    contests = {}
    for effect, columns in zip(belief.setup.effects, belief.places(), strict=True):
        place = (effect.kind, effect.joints)
        against = contests[place] = contest(belief, effect, columns)
        if place not in belief.named:
            continue  # believed from the beginning
        odds = {p: v.value - against.own.value for p, v in against.rivals.items() if v.value > SURE}
        ties = tuple((p, d) for p, d in odds.items() if d > -SURE)
        refuted = tuple((p, d) for p, d in odds.items() if d <= -SURE)
        same = tuple(p for p, _ in ties if _same_torque(belief, place, p))
        belief.named[place] = replace(belief.named[place], ties=ties, same=same, refuted=refuted)
    return contests


def _same_torque(belief: Belief, place: Place, other: Place) -> bool:
    """Whether no motion tells two places of a kind apart; two kinds differ in their formula."""
    if place[0] != other[0]:
        return False
    robot = belief.setup.robot
    one, another = (ShapedEffect.of(NamedEffect(*at), robot) for at in (place, other))
    return Separation(robot, robot.base_parameters(), one, another, SOME_SECONDS).is_hopeless


def is_one_cause(kind: str, other: str) -> bool:
    """Whether two kinds are the same in physics, so that not to tell them apart leaves no cause open."""
    return kind == other or LIMITS.get(kind) == other or LIMITS.get(other) == kind


def is_one_or_another(place: Place, named: Named) -> bool:
    """Whether something that is another cause, or elsewhere, explains the same as a name."""
    kind, joints = place
    return any(at != joints or not is_one_cause(kind, other) for (other, at), _ in named.ties)
