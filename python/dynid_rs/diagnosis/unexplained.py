"""What is left and has no name: which signals tell it on parts that were left out, by the rule of the search."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import SURE, p_value
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import USUAL, Hypothesis, standardised
from dynid_rs.diagnosis.trials import blocks

FloatArray = NDArray[np.float64]
Signal = tuple[str, int]

N_WAVES = 5
"""Waves of a signal within its range that a function of it is made of."""
SIGNALS = ("q", "dq_motor", "ddq_motor", "tau_link")
"""Signals that what is left may depend on, of any joint."""


def unexplained(found: Belief) -> list[dict[str, Any]]:
    """Entries of `unexplained` in `result.json`: one per joint whose residual some signals still tell."""
    beside = found.beside
    parts, names = blocks(beside.model.n_rows), found.setup.robot.joint_names
    entries = []
    for j in range(len(names)):
        sets = list(_sets(found, j))
        hypotheses = [_hypothesis(found, j, signals) for signals in sets]
        scores = [score.value for score in beside.screened(hypotheses)]
        best = int(np.argmax(scores))
        if scores[best] - float(np.log(len(sets) * len(names))) < SURE:
            continue
        value, columns = beside.evidence_for(hypotheses[best])
        without = beside.model.left_out(beside.best, parts)[:, j].sum()
        after = beside.with_columns(columns)
        share = 1 - float(after.model.left_out(after.best, parts)[:, j].sum() / max(without, 1e-300))
        if share <= 0:
            continue
        alone = [max(scores[k] for k, other in enumerate(sets) if other == (signal,)) for signal in sets[best]]
        entries.append(
            {
                "joint": names[j],
                "share": min(share, 1.0),
                "p_value": p_value(value - float(np.log(len(sets) * len(names)))),
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


def _sets(found: Belief, j: int) -> Iterator[tuple[Signal, ...]]:
    """Single signals of any joint, and pairs with a signal of joint j's own."""
    n = found.setup.robot.n_joints
    single = [(name, k) for name in SIGNALS for k in range(n)]
    yield from ((signal,) for signal in single)
    for pair in combinations(single, 2):
        if all(k == j for _, k in pair) or (pair[0][0] == pair[1][0] == "q" and j in (pair[0][1], pair[1][1])):
            yield pair


def _hypothesis(found: Belief, j: int, signals: tuple[Signal, ...]) -> Hypothesis:
    """Waves of a signal, or of two and of their sum and difference, on joint j."""
    parts = []
    for states in found.catalogue.runs:
        scaled = []
        for name, k in signals:
            values = [np.asarray(getattr(s, name))[:, k] for s in found.catalogue.runs]
            low, high = min(x.min() for x in values), max(x.max() for x in values)
            scaled.append(np.pi * (np.asarray(getattr(states, name))[:, k] - low) / max(high - low, 1e-300))
        if len(scaled) == 2:
            scaled += [scaled[0] + scaled[1], scaled[0] - scaled[1]]
        waves = [np.cos(m * u) for u in scaled for m in range(1, N_WAVES + 1)]
        parts.append(states.in_band(np.stack(waves, axis=1)))
    columns = np.concatenate(parts)
    torque = np.sqrt(np.mean(found.fit.observations_.blocks[0].rows[j][:, -1] ** 2))
    size = np.sqrt(np.mean(columns**2, axis=0))
    unit = USUAL * torque / np.where(size > 0, size, 1.0)
    width = columns.shape[1]
    free = np.tile([-np.inf, np.inf], (width, 1))
    names = tuple(f"wave_{k}" for k in range(width))
    return Hypothesis(
        "unknown", (j,), names, ("1",) * width, standardised({j: columns}, unit), unit, free, lambda setup, _: setup
    )
