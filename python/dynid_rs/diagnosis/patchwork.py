"""Several names for one function of a joint's position: none of them is there, however well they fit together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dynid_rs.diagnosis.one_cylinder import PATCHES
from dynid_rs.diagnosis.valleys import KIND as CYLINDER
from dynid_rs.placed import PlacedEffect

FEWEST_TEETH = 6.0
"""A ripple of fewer cycles per turn than this is no gear's."""


def patchworks(effects: Sequence[PlacedEffect]) -> list[list[PlacedEffect]]:
    """Effects of one joint's position, where a cylinder needs a spring or a slow wave beside it; joint by joint."""
    groups: dict[int, list[PlacedEffect]] = {}
    for effect in effects:
        if effect.kind == CYLINDER or (effect.kind in PATCHES and not _has_teeth(effect)):
            groups.setdefault(effect.joints[0], []).append(effect)
    return [group for group in groups.values() if len(group) > 1 and any(e.kind == CYLINDER for e in group)]


def _has_teeth(effect: PlacedEffect) -> bool:
    return effect.kind == "torque_ripple" and dict(effect.shape)["cycles"][0] >= FEWEST_TEETH


def as_unknown(
    entries: Sequence[dict[str, Any]], effects: Sequence[PlacedEffect], joint_names: Sequence[str]
) -> list[dict[str, Any]]:
    """Entries of the list of effects with every patchwork as one function of the position that has no name.

    Its torque stays in the model: it is right where the data are, and says nothing of the cause.
    """
    told = list(entries)
    for group in patchworks(effects):
        name = joint_names[group[0].joints[0]]
        kinds = {effect.kind for effect in group}
        own = [e for e in told if e["kind"] in kinds and e["joints"] == [name]]
        if len(own) < len(group):
            continue
        first = max(own, key=lambda entry: entry["evidence"] or 0.0)
        words = ", ".join(sorted(kind.replace("_", " ") for kind in kinds))
        unknown = {
            **first,
            **{key: own[0][key] for key in ("rmse_train_before", "rmse_test_before")},
            **{key: own[-1][key] for key in ("rmse_train_after", "rmse_test_after")},
            "kind": "unknown",
            "parameters": [],
            "ties": [],
            "depends_on": [{"signal": f"q_{name}", "strength": 1.0, "direct": True}],
            "note": f"a function of the joint's position that nothing in the catalogue is by itself; in the model "
            f"{words} describe it together",
        }
        told = [unknown if e is first else e for e in told if e is first or not any(e is o for o in own)]
    return told
