"""Names that only describe together what nothing in the catalogue is: none of them is there, however well they fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dynid_rs.diagnosis.dead_point import KIND as CYLINDER
from dynid_rs.diagnosis.one_cylinder import PATCHES
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


@dataclass(frozen=True, eq=False)
class Nameless:
    """Effects that stay in the model although none of them is the cause: as one, they are told as unknown.

    Parameters
    ----------
    effects : sequence of PlacedEffect
        On one joint.
    depends_on : sequence of dict
        Signals of what they describe, the entries of `result.json`.
    note : str
        What it is; which names describe it is said behind.
    """

    effects: Sequence[PlacedEffect]
    depends_on: Sequence[dict[str, Any]]
    note: str


def nameless_patchworks(effects: Sequence[PlacedEffect], joint_names: Sequence[str]) -> list[Nameless]:
    """Every patchwork as one function of the position that has no name."""
    return [
        Nameless(
            group,
            [{"signal": f"q_{joint_names[group[0].joints[0]]}", "strength": 1.0, "direct": True}],
            "a function of the joint's position that nothing in the catalogue is by itself",
        )
        for group in patchworks(effects)
    ]


def as_unknown(
    entries: Sequence[tuple[PlacedEffect, dict[str, Any]]], nameless: Sequence[Nameless]
) -> list[dict[str, Any]]:
    """Entries of the list of effects, with one in the place of each nameless group.

    Its torque stays in the model: it is right where the data are, and says nothing of the cause.
    """
    told = list(entries)
    for group in nameless:
        own = [(effect, entry) for effect, entry in told if any(effect is other for other in group.effects)]
        if not own:
            continue
        kept, first = max(own, key=lambda pair: pair[1]["evidence"] or 0.0)
        words = ", ".join(sorted({effect.kind.replace("_", " ") for effect, _ in own}))
        unknown = {
            **first,
            **{key: own[0][1][key] for key in ("rmse_train_before", "rmse_test_before")},
            **{key: own[-1][1][key] for key in ("rmse_train_after", "rmse_test_after")},
            "kind": "unknown",
            "parameters": [],
            "ties": [],
            "depends_on": list(group.depends_on),
            "note": f"{group.note}; in the model {words} is what comes near",
        }
        others = [effect for effect, _ in own if effect is not kept]
        told = [
            (effect, unknown if effect is kept else entry)
            for effect, entry in told
            if not any(effect is other for other in others)
        ]
    return [entry for _, entry in told]
