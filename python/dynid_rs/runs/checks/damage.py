"""Damage of runs that are fitted from Python: said there, as every command says it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from weakref import WeakKeyDictionary

from dynid_rs.base.errors import DamageWarning
from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks import check_recording, is_damage
from dynid_rs.runs.checks.limits import Limited
from dynid_rs.runs.recording import Recording

_KNOWN: WeakKeyDictionary[Recording, dict[tuple[float, ...], list[Finding]]] = WeakKeyDictionary()
"""Of runs that were looked at, by the robot's limits: a diagnosis fits the same ones many times."""


def warn_of_damage(runs: Sequence[Recording], robot: Limited) -> None:
    """Warn whoever called the caller of what is damaged in runs of a robot, a `DamageWarning` for each finding."""
    limits = (*robot.lower, *robot.upper)
    for run in runs:
        known = _KNOWN.setdefault(run, {})
        if limits not in known:
            known[limits] = [finding for finding in check_recording(run, robot) if is_damage(finding)]
        for finding in known[limits]:
            warnings.warn(f"{run.name}: {finding.message}", DamageWarning, stacklevel=3)
