"""What is left and has no name: which signals tell it on parts that were left out, by the rule of the search."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid_rs.base.odds import SURE, p_value
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.trials import blocks
from dynid_rs.diagnosis.waves import signal_sets, wave_hypothesis


def unexplained(found: Belief) -> list[dict[str, Any]]:
    """Entries of `unexplained` in `result.json`: one per joint whose residual some signals still tell."""
    beside = found.beside
    parts, names = blocks(beside.model.n_rows), found.setup.robot.joint_names
    entries = []
    for j in range(len(names)):
        sets = list(signal_sets(found, j))
        hypotheses = [wave_hypothesis(found, j, signals) for signals in sets]
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
