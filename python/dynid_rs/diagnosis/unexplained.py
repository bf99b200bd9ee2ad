"""What is left and has no name: which signals tell it on parts that were left out, by the rule of the search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import SURE, p_value
from dynid_rs.base.threads import side_by_side
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.trials import blocks
from dynid_rs.diagnosis.waves import Signal, of_signal, signal_sets, waves

BoolArray = NDArray[np.bool_]

LOOKED_AT = 3
"""Sets of signals of a joint that are looked at closely; screening orders them."""


def unexplained(found: Belief) -> list[dict[str, Any]]:
    """Entries of `unexplained` in `result.json`: one per joint whose residual some signals still tell."""
    parts, names = blocks(found.beside.model.n_rows), found.setup.robot.joint_names
    entries = []
    for j in range(len(names)):
        sets = list(signal_sets(len(names), j))
        hypotheses = side_by_side(partial(_waves, found.catalogue, j), sets)
        scores = _screened(found, j, hypotheses)
        tries = [(found.beside.evidence_for(hypotheses[k])[0], k) for k in np.argsort(scores)[-LOOKED_AT:].tolist()]
        value, best = max(tries)
        log_odds = value - float(np.log(len(sets) * len(names)))
        share = _share(found, j, hypotheses[best], parts)
        if log_odds < SURE or share <= 0:
            continue
        alone = [max(scores[k] for k, other in enumerate(sets) if other == (signal,)) for signal in sets[best]]
        entries.append(
            {
                "joint": names[j],
                "share": min(share, 1.0),
                "p_value": p_value(log_odds),
                "depends_on": [
                    {
                        "signal": f"{name}_{names[k]}",
                        "strength": float(np.clip(own / max(scores[best], 1e-300), 0.0, 1.0)),
                        "direct": True,
                    }
                    for (name, k), own in zip(sets[best], alone, strict=True)
                ],
            }
        )
    return entries


def _waves(catalogue: Catalogue, j: int, signals: Sequence[Signal]) -> Hypothesis:
    return waves(catalogue, j, [of_signal(signal) for signal in signals])


def _screened(found: Belief, j: int, hypotheses: Sequence[Hypothesis]) -> list[float]:
    """Scores that order waves on joint j: as if its rows were independent, for how much they are worth is not known."""
    model, best = found.beside.model, found.beside.best
    worth = model.n_effective.copy()
    worth[j] = model.counted[j].sum()
    model = replace(model, n_effective=worth)
    fit = model.fit(best.choice, best.noise)
    columns, bounds = [h.columns for h in hypotheses], [h.bounds for h in hypotheses]
    return [score.value for score in model.screen(fit, columns, bounds, hypotheses[0].sizes)]


def _share(found: Belief, j: int, h: Hypothesis, parts: Sequence[BoolArray]) -> float:
    """Part of joint j's power on parts that were left out which waves take off."""
    beside = found.beside
    after = beside.with_columns(beside.evidence_for(h)[1])
    without, left = (float(b.model.left_out(b.best, parts)[:, j].sum()) for b in (beside, after))
    return 1 - left / max(without, 1e-300)
