"""Table 2: what the two objectives reach on an arm, beside the paper's own trajectory played on it."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import tables

from dynid_rs import FourierExcitation, RobotModel, _core
from dynid_rs.excitation import Merit
from dynid_rs.excitation.merit import merit_of

OBJECTIVES = ("condition", "block")
"""The condition number of the regressor alone, and Eq. 14."""


@dataclass(frozen=True, eq=False)
class Designs:
    """Designed trajectories of one arm: objective -> one per seed, what each took [s], and Table 3 on the arm."""

    robot: RobotModel
    found: dict[str, list[FourierExcitation]]
    seconds: dict[str, list[float]]
    paper: Merit

    def conditions(self, objective: str) -> np.ndarray:
        """Condition number of the base regressor, one per seed."""
        return np.array([design.condition_number_ for design in self.found[objective]])

    def median(self, objective: str) -> FourierExcitation:
        """The design of the middle seed, by condition number."""
        order = np.argsort(self.conditions(objective))
        return self.found[objective][order[(len(order) - 1) // 2]]


def design(robot: RobotModel, seeds: int, **options: int) -> Designs:
    """Design with both objectives and every seed: Table 1, 5 harmonics, 20 s, 200 samples."""
    found: dict[str, list[FourierExcitation]] = {name: [] for name in OBJECTIVES}
    seconds: dict[str, list[float]] = {name: [] for name in OBJECTIVES}
    for objective in OBJECTIVES:
        for seed in range(seeds):
            began = time.perf_counter()
            excitation = FourierExcitation(
                5, tables.DURATION, tables.RATE, criterion=objective, random_state=seed, **options
            )
            found[objective].append(excitation.fit(robot, tables.table_1()))
            seconds[objective].append(time.perf_counter() - began)
    base = robot.base_parameters()
    blocks = _core.Excitation(robot, base.pivots)
    paper = merit_of(tables.table_3(), robot, base, blocks, tables.sampling_times())
    return Designs(robot, found, seconds, paper)
