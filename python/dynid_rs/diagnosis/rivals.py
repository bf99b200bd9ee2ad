"""What else a torque may be: another kind at its joints, or a function of its angle that has no name.

    own    =  ln BF of the torque as it is named        averaged over the shapes of its kind, beside all other names
    rival  =  ln BF of another kind, or of a function   in its place
    told   if own > rival + ln 19 for every rival

A name is asked for beside the names before it; what it is told from is asked once more when all of them are in. Where
the name is not told, its torque is kept, for it predicts, and it is either one or the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis, Place, shaped_as
from dynid_rs.diagnosis.shapes import polished
from dynid_rs.diagnosis.trials import WITHIN_REACH, Value, evidence
from dynid_rs.model.placed import PlacedEffect


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
    here = [s for s in catalogue.grid() if s.joints == h.joints and (s.kind, s.joints) not in belief.named]
    rivals, _ = evidence(beside, catalogue.of(here), catalogue)
    for place, rival in rivals.items():
        if abs(rival.value - own.value) < WITHIN_REACH:  # so near that the gaps of the grid could decide
            finer = valued(beside, catalogue, polished(beside, catalogue, rival.hypothesis))
            rivals[place] = max(rival, finer, key=lambda value: value.value)
    return Contest(beside, own, rivals)


def valued(beside: Beside, catalogue: Catalogue, h: Hypothesis) -> Value:
    """Evidence of one shape, less what it costs: as many as the grid has are as likely beforehand."""
    value, columns = beside.evidence_for(h)
    n_shapes = sum((s.kind, s.joints) == h.place for s in catalogue.grid())
    return Value(value - float(np.log(max(1, n_shapes))), h, columns)


def weigh_rivals(belief: Belief) -> None:
    """Give every torque the ties, and the rivals that are refuted, that it has beside all other names."""
    for effect, columns in zip(belief.setup.effects, belief.places(), strict=True):
        place = (effect.kind, effect.joints)
        if place not in belief.named:
            continue  # believed from the beginning
        against = contest(belief, effect, columns)
        odds = {p: v.value - against.own.value for p, v in against.rivals.items() if v.value > SURE}
        ties = tuple((p, d) for p, d in odds.items() if d > -SURE)
        refuted = tuple((p, d) for p, d in odds.items() if d <= -SURE)
        belief.named[place] = replace(belief.named[place], ties=ties, refuted=refuted)
