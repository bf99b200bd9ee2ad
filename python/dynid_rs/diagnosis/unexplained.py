"""What is left and has no name: which signals tell it on parts that were left out, by the rule of the search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dynid_rs.base.odds import SURE, p_value
from dynid_rs.base.threads import side_by_side
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.standing import standing
from dynid_rs.diagnosis.trials import blocks
from dynid_rs.diagnosis.waves import Signal, of_signal, signal_sets, waves
from dynid_rs.regression.linear_model import Columns

LOOKED_AT = 3
"""Sets of signals of a joint that are looked at closely; screening orders them."""


@dataclass(frozen=True, eq=False)
class Left:
    """A function of signals without a name that joint `joint` still lacks, on parts that were left out.

    `columns` (n_rows, n_waves) in their likeliest size; `log_odds` against all sets of signals at all joints [nats];
    `share` of the joint's power there is its own; `alone`: the scores of its signals one by one, over its own.
    """

    joint: int
    signals: tuple[Signal, ...]
    columns: Columns
    log_odds: float
    share: float
    alone: tuple[float, ...]


def stood_in(found: Belief) -> list[Left]:
    """Take out names that only stood in for what has no name, the least likely first; return what is left then.

    A name has passed against other names and against nothing. What none of them is (a fluid that takes a joint along
    with another's speed) makes the nearest of them likely all the same; beside a function that does tell it, it is no
    more probable than none.
    """
    none = -float(np.log(found.catalogue.n_places))
    while True:
        left = unexplained(found)
        joints = {one.joint for one in left}
        odds = standing(found, [one.columns for one in left]) if left else {}
        within = [p for p, own in found.named.items() if p in odds and joints & {*found.reach(own.hypothesis)}]
        weakest = min(within, key=lambda place: odds[place], default=None)
        if weakest is None or odds[weakest] > none:
            return left
        found.remove(weakest)


def unexplained(found: Belief) -> list[Left]:
    """Functions of signals that still tell what joints lack; at most one a joint."""
    left = [lacks(found.catalogue, found.beside, j) for j in range(found.setup.robot.n_joints)]
    return [one for one in left if one is not None]


def lacks(catalogue: Catalogue, beside: Beside, j: int) -> Left | None:
    """The function of signals that still tells what joint j lacks beside a model, if there is one."""
    sets, n = list(signal_sets(catalogue.fit.robot.n_joints, j)), catalogue.fit.robot.n_joints
    hypotheses = side_by_side(partial(_waves, catalogue, j), sets)
    scores = _screened(beside, j, hypotheses)
    tries = [(*beside.evidence_for(hypotheses[k]), k) for k in np.argsort(scores)[-LOOKED_AT:].tolist()]
    value, columns, best = max(tries, key=lambda tried: tried[0])
    log_odds = value - float(np.log(len(sets) * n))
    share = _share(beside, j, columns)
    if log_odds < SURE or share <= 0:
        return None
    alone = [max(scores[k] for k, other in enumerate(sets) if other == (signal,)) for signal in sets[best]]
    of_all = tuple(float(np.clip(own / max(scores[best], 1e-300), 0.0, 1.0)) for own in alone)
    return Left(j, sets[best], columns, log_odds, share, of_all)


def unexplained_entries(left: Sequence[Left], names: Sequence[str]) -> list[dict[str, Any]]:
    """Entries of `unexplained` in `result.json`: one per joint whose residual some signals still tell."""
    return [
        {
            "joint": names[one.joint],
            "share": min(one.share, 1.0),
            "p_value": p_value(one.log_odds),
            "depends_on": [
                {"signal": f"{name}_{names[k]}", "strength": alone, "direct": True}
                for (name, k), alone in zip(one.signals, one.alone, strict=True)
            ],
        }
        for one in left
    ]


def _waves(catalogue: Catalogue, j: int, signals: Sequence[Signal]) -> Hypothesis:
    return waves(catalogue, j, [of_signal(signal) for signal in signals])


def _screened(beside: Beside, j: int, hypotheses: Sequence[Hypothesis]) -> list[float]:
    """Scores that order waves on joint j: as if its rows were independent, for how much they are worth is not known."""
    model, best = beside.model, beside.best
    worth = model.n_effective.copy()
    worth[j] = model.counted[j].sum()
    model = replace(model, n_effective=worth)
    fit = model.fit(best.choice, best.noise)
    columns, bounds = [h.columns for h in hypotheses], [h.bounds for h in hypotheses]
    return [score.value for score in model.screen(fit, columns, bounds, hypotheses[0].sizes)]


def _share(beside: Beside, j: int, columns: Columns) -> float:
    """Part of joint j's power on parts that were left out which waves take off."""
    parts, after = blocks(beside.model.phase), beside.with_columns(columns)
    without, left = (float(b.model.left_out(b.best, parts)[:, j].sum()) for b in (beside, after))
    return 1 - left / max(without, 1e-300)
