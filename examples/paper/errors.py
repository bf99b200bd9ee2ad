"""Table 4: errors of every stage on the runs that were learned from and on those that were not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynid_rs import Recording, ThreeLoopIdentifier
from dynid_rs.identification.results import score
from dynid_rs.regression.evaluation import torque_std
from dynid_rs.runs.preprocessing import States

LAW = "paper"
"""Friction's law, Eqs. 9-11; a fit without a friction experiment has another where none is asked for."""
TRAINING = "training"
WLS, FIRST, SECOND, THIRD = "WLS", "first loop", "second loop", "all loops"
"""Weighted least squares; its links with the first loop's friction; both loops; the full method."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """One identification: RMSE in the band, `errors[runs][stage]` (n_joints,), and the torque's deviation per runs."""

    identifier: ThreeLoopIdentifier
    errors: dict[str, dict[str, np.ndarray]]
    torque_std: dict[str, np.ndarray]
    states: dict[str, list[States]]

    def change(self, runs: str, stage: str = THIRD, against: str = WLS) -> np.ndarray:
        """Change of the RMSE, (n_joints,); -0.2 is a fifth less."""
        return self.errors[runs][stage] / self.errors[runs][against] - 1

    @property
    def held_out(self) -> list[str]:
        """Names of the runs that were never fitted."""
        return [name for name in self.errors if name != TRAINING]


def outcome_of(identifier: ThreeLoopIdentifier, held_out: Mapping[str, Sequence[Recording]]) -> Outcome:
    """Score all stages of a fitted identifier."""
    stages = {
        WLS: identifier.baseline_,
        FIRST: identifier.friction_model_,
        SECOND: identifier.model_with([None] * identifier.robot.n_joints),
        THIRD: identifier.model_,
    }
    states = {TRAINING: identifier.raw_runs_}
    states |= {name: [identifier.states(run) for run in runs] for name, runs in held_out.items()}
    errors, std = {}, {}
    for name, runs in states.items():
        scores = {stage: score(model, runs) for stage, model in stages.items()}
        errors[name] = {stage: found.rmse for stage, found in scores.items()}
        std[name] = torque_std(scores[THIRD].comparisons)
    return Outcome(identifier, errors, std, states)
