"""What the health page is made of: runs that were watched, and how."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.changes import FROZEN, Change

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HealthRun:
    """One run.

    Attributes
    ----------
    name : str
        For the reader.
    t : ndarray (n_rows,)
        Time at the end of every row, on the run's clock [s].
    ratio : ndarray (n_rows, n_joints)
        What is left over what is expected of it; NaN where a joint was not watched.
    changes : tuple of Change
        In the order in which they were said.
    """

    name: str
    t: Array
    ratio: Array
    changes: tuple[Change, ...]

    @property
    def watched(self) -> Array:
        """Part of the run in which each joint was watched (n_joints,)."""
        return np.isfinite(self.ratio).mean(axis=0) if len(self.t) else np.zeros(self.ratio.shape[1])


@dataclass(frozen=True, eq=False)
class Health:
    """Everything on the page.

    Attributes
    ----------
    robot, torque_unit : str
        Of the model; the unit as a heading says it.
    joints : tuple of str
        Along the chain.
    runs : sequence of HealthRun
        In the order in which they were given, at least one.
    standing : tuple of Change
        What stands at the end of the last run.
    expected : ndarray (n_joints,)
        Usual deviation of a row [torque unit]; NaN where no row was.
    residual : ndarray (n_joints,)
        Root mean square of `ratio` at the end of the last run; NaN where a joint was not watched in it.
    row : float
        Time over which what is left is averaged [s].
    false_alarms_per_day : float
        That are put up with.
    tolerated : mapping of str to float
        Per kind, in that kind's measure.
    healthy : tuple of str, optional
        Names of the runs that said what is usual; empty where a file of settings said it, None where nothing did.
    findings : sequence of mappings
        About the data, as `Finding.to_json` gives them.
    angle_unit : str
        Of positions: rad, m, or `rad or m` where joints turn and slide.
    load_unit : str
        Of loads, as their changes have it.
    goes_on : bool
        Whether every run was watched with what the one before it had shown.
    """

    robot: str
    torque_unit: str
    joints: tuple[str, ...]
    runs: Sequence[HealthRun]
    standing: tuple[Change, ...]
    expected: Array
    residual: Array
    row: float
    false_alarms_per_day: float
    tolerated: Mapping[str, float]
    healthy: tuple[str, ...] | None
    findings: Sequence[Mapping[str, Any]]
    angle_unit: str = "rad"
    load_unit: str = "kg"
    goes_on: bool = False


@dataclass(frozen=True)
class Episode:
    """A change from its name to what became of it.

    Attributes
    ----------
    number : int
        On the page, from 1.
    run : int
        In which run.
    named : Change
        As it was said first.
    outcome : Change, optional
        What became of it, which may have another name; None where the run ended before.
    """

    number: int
    run: int
    named: Change
    outcome: Change | None

    @property
    def now(self) -> Change:
        """What was said last of it."""
        return self.outcome or self.named

    @property
    def is_withdrawn(self) -> bool:
        """Whether it is none after all."""
        return self.now.said == "withdrawn"


def episodes(runs: Sequence[HealthRun]) -> list[Episode]:
    """Changes of all runs in the order in which they were named, each with what became of it.

    Of two names in a row the first was left open; frozen channels, each joint's its own, are open beside anything else.
    """
    found: list[Episode] = []
    for r, run in enumerate(runs):
        open_: dict[str, int] = {}
        for change in run.changes:
            place = change.joint if change.kind == FROZEN else ""
            at = open_.get(place)
            if change.said == "named" or at is None:
                open_[place] = len(found)
                outcome = None if change.said == "named" else change
                found.append(Episode(len(found) + 1, r, change, outcome))
            else:
                found[at] = replace(found[at], outcome=change)
            if change.said == "withdrawn" or (change.said == "settled" and change.kind != FROZEN):
                del open_[place]
    return found
