"""Names that hide each other: a gain and a spring on one joint, a hysteresis and a cylinder, a spring and a coupling.

A name passes beside those before it. Where two are missing, what one of them leaves is the other: it remembers itself,
the rows are worth little, parts of the data tell each of them otherwise, and neither passes first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.belief import Belief, Named
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.holding import holds, shares
from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.rivals import is_one_cause
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.structural import KINDS
from dynid_rs.diagnosis.trials import Asked, Value, evidence
from dynid_rs.diagnosis.unexplained import lacks

FloatArray = NDArray[np.float64]


def hidden(belief: Belief, asked: Asked) -> list[Named]:
    """Two names that hide each other, or none, where of what was `asked` beside what is believed nothing passed.

    A pair is at posterior odds of 19 to 1 among all pairs of kinds and places, for what the two say only together: what
    they say alone counts for nothing. Beside the other each has to hold as any name does, in its grid's shape.
    """
    pairs = _pairs(belief, asked)
    for first, second in sorted(pairs, key=lambda pair: -pair[0].value - pair[1].value):
        both = [_beside(belief, *pair, asked) for pair in ((first, second), (second, first))]
        sure = all(
            value.value > asked.need and holds(belief, at, value, rivals, asked.need) for value, at, rivals in both
        )
        if sure and not _stand_in(belief, both[0][0], both[1][0], asked.log_places):
            return [Named(value.hypothesis, value.value - asked.log_places) for value, _, _ in both]
    return []


def _pairs(belief: Belief, asked: Asked) -> list[tuple[Value, Value]]:
    """Names and what they uncover on their joints: a second one that says more beside them than alone."""
    beside, pairs = belief.beside, dict[frozenset[Place], tuple[Value, Value]]()
    alone = np.maximum(_scores(beside, asked.open_), 0.0)
    for first in (value for value in asked.values.values() if value.value > 0):
        after = beside.with_columns(first.columns)
        here = [k for k, h in enumerate(asked.open_) if _may_hide(h, first.hypothesis)]
        risen = _scores(after, [asked.open_[k] for k in here]) - alone[:, here]
        best = [(asked.open_[here[int(np.argmax(row))]].place, float(row.max())) for row in risen if len(here)]
        for place in dict.fromkeys(place for place, more in best if more > asked.need):
            if frozenset((first.hypothesis.place, place)) in pairs:
                continue
            found, _ = evidence(after, [h for h in asked.open_ if h.place == place])
            for second in found.values():
                said = max(_said_alone(beside, asked, second), 0.0)
                if second.value - said > asked.need + asked.log_places:
                    pairs[frozenset((first.hypothesis.place, place))] = first, second
    return list(pairs.values())


def _said_alone(beside: Beside, asked: Asked, second: Value) -> float:
    """What the second one of a pair says without the first, in this shape or in its best."""
    place, own = second.hypothesis.place, beside.evidence_for(second.hypothesis)[0]
    return max(own, asked.values[place].value) if place in asked.values else own


def _scores(beside: Beside, hypotheses: Sequence[Hypothesis]) -> FloatArray:
    """Scores to second order with rows worth what they are, and as if each said something new, (2, n_hypotheses)."""
    if not hypotheses:
        return np.zeros((2, 0))
    screened, hoped = beside.screened_and_hoped_for(hypotheses)
    return np.array([[score.value for score in screened], hoped])


def _may_hide(h: Hypothesis, other: Hypothesis) -> bool:
    """Whether two act at the same joints, or a torque at one of the two that share another one.

    Across joints every unknown torque has two that make it up; a change of the structure reaches every joint.
    """
    one, two = set(h.joints), set(other.joints)
    shared = not {h.kind, other.kind} & KINDS.keys() and (one < two or two < one)
    return h.place != other.place and (one == two or shared)


def _stand_in(belief: Belief, one: Value, other: Value, log_places: float) -> bool:
    """Whether either stands in for what has no name: beside a function that both leave it is less likely than not."""
    after = belief.beside.with_columns(one.columns).with_columns(other.columns)
    for j in one.hypothesis.place[1]:
        left = lacks(belief.catalogue, after, j)
        if left is None:
            continue
        for own, at in ((one, other), (other, one)):
            beside = belief.beside.with_columns(left.columns).with_columns(at.columns)
            if beside.evidence_for(own.hypothesis)[0] < log_places:
                return True
    return False


def _beside(belief: Belief, one: Value, other: Value, asked: Asked) -> tuple[Value, Beside, list[Value]]:
    """A name beside another one: its evidence there, the model it is added to, and its rivals."""
    at = belief.beside.with_columns(other.columns)
    here = [h for h in asked.open_ if h.place != other.hypothesis.place and shares(h, one.hypothesis)]
    values = evidence(at, here)[0]
    own = values.pop(one.hypothesis.place, replace(one, value=-np.inf))
    return own, at, [v for v in values.values() if not is_one_cause(own.hypothesis.kind, v.hypothesis.kind)]
