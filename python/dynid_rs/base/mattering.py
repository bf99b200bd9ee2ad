"""Which effects matter: what terminal and report say first.

An effect matters if it lowers the error of a joint by more than the noise: the 95 % interval of the change on test runs
lies below zero there. What was not measured on its own (a change of what the model is made of) matters, for nothing
says that it does not; what lies above the band in which errors are compared does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Result = Mapping[str, Any]


def measured(entry: Result) -> bool:
    """Whether its own share of the error on test runs was measured."""
    before, after = entry.get("rmse_test_before") or [], entry.get("rmse_test_after") or []
    return bool(before) and before != after


def matters(result: Result, entry: Result) -> bool:
    """Whether an effect lowers some joint's error by more than the noise."""
    if entry.get("above_band"):
        return False
    return not measured(entry) or any(lowers for _, _, lowers in changes(result, entry))


def changes(result: Result, entry: Result) -> list[tuple[str, float, bool]]:
    """Joint, relative change of its error, and whether that is lower by more than the noise, where an effect acts."""
    before, after = entry.get("rmse_test_before") or [], entry.get("rmse_test_after") or []
    names = result["joints"] if len(after) == len(result["joints"]) else entry["joints"]
    bounds = entry.get("rmse_test_change_interval") or [None] * len(after)
    after_bounds = dict(zip(result["joints"], result["rmse"]["test"].get("after_interval") or [], strict=False))
    found = []
    for joint, old, new, pair in zip(names, before, after, bounds, strict=False):
        if joint not in entry["joints"] or old <= 0.0:
            continue
        if pair is not None:
            lowers = pair[1] < 0.0
        else:  # the wider interval, of the error itself, where none of the change can be said
            own = after_bounds.get(joint)
            lowers = new < old and (own is None or own[1] < old)
        found.append((joint, new / old - 1.0, bool(lowers)))
    return found
