"""Effects as families: one entry per name, whatever the number of joints, and which of them matter.

An effect matters if it lowers the error of a joint by more than the noise: the 95 % interval of the change on test runs
lies below zero there. What was not measured on its own (a change of what the model is made of) matters, for nothing
says that it does not; what lies above the band in which errors are compared does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dynid_rs.base.wording import kinds_said
from dynid_rs.report.axes import signal_words
from dynid_rs.report.text import capital, join_words, short_names, words

Result = Mapping[str, Any]


@dataclass(frozen=True)
class Member:
    """One effect of a family; `matters` as above, `change` of the error of `joint` where it lowers it most."""

    entry: Result
    rank: int
    matters: bool
    change: tuple[str, float] | None


@dataclass(frozen=True)
class Family:
    """Effects of one name; `unknown` without any."""

    name: str
    members: tuple[Member, ...]

    @property
    def joints(self) -> list[str]:
        """Where its members act, each joint once."""
        return list(dict.fromkeys(joint for member in self.members for joint in member.entry["joints"]))

    @property
    def unknown(self) -> bool:
        """Whether no name holds."""
        return self.name == UNKNOWN


UNKNOWN = "unknown effect"


def families(result: Result) -> tuple[list[Family], list[Family]]:
    """Those that matter, in the order of their first effect, and those that do not."""
    members = [_member(result, entry, k + 1) for k, entry in enumerate(result.get("effects") or [])]
    return _grouped(m for m in members if m.matters), _grouped(m for m in members if not m.matters)


def _grouped(members: Any) -> list[Family]:
    grouped: dict[tuple[str, ...], list[Member]] = {}
    for member in members:
        kinds = tuple(sorted(kinds_said(member.entry)))
        grouped.setdefault(kinds, []).append(member)
    return [Family(effect_name(own[0].entry), tuple(own)) for own in grouped.values()]


def effect_name(entry: Result) -> str:
    """`stribeck`; `stribeck or torque ripple` of one that is either; `unknown effect` of one without a name."""
    return join_words([words(kind) for kind in kinds_said(entry)], "or") or UNKNOWN


def where(joints: Sequence[str], result: Result) -> str:
    """Joints as short as they can be said; `the whole robot` where there are all of several."""
    if len(joints) == len(result["joints"]) > 2:
        return "the whole robot"
    short = dict(zip(result["joints"], short_names(result["joints"]), strict=True))
    return join_words([short.get(joint, joint) for joint in joints])


def said(family: Family, result: Result) -> str:
    """A family in a sentence: its name and where it acts; an unknown one with what it depends on."""
    text = f"{family.name} on {where(family.joints, result)}"
    if not family.unknown:
        return text
    signals = [d["signal"] for m in family.members for d in m.entry.get("depends_on") or [] if d.get("direct", True)]
    short = dict(zip(result["joints"], short_names(result["joints"]), strict=True))
    named = list(dict.fromkeys(signal_words(signal, result["joints"], short) for signal in signals))
    return f"{text} (follows the {join_words(named)})" if 0 < len(named) <= 2 else text


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    return capital(text).rstrip(".") + "."


def measured(entry: Result) -> bool:
    """Whether its own share of the error on test runs was measured."""
    before, after = entry.get("rmse_test_before") or [], entry.get("rmse_test_after") or []
    return bool(before) and before != after


def _member(result: Result, entry: Result, rank: int) -> Member:
    if entry.get("above_band"):
        return Member(entry, rank, False, None)
    if not measured(entry):
        return Member(entry, rank, True, None)
    before, after = entry["rmse_test_before"], entry["rmse_test_after"]
    names = result["joints"] if len(after) == len(result["joints"]) else entry["joints"]
    bounds = entry.get("rmse_test_change_interval") or [None] * len(after)
    after_bounds = dict(zip(result["joints"], result["rmse"]["test"].get("after_interval") or [], strict=False))
    changes, matters = [], False
    for joint, old, new, pair in zip(names, before, after, bounds, strict=False):
        if joint not in entry["joints"] or old <= 0.0:
            continue
        changes.append((joint, new / old - 1.0))
        if pair is not None:
            matters |= pair[1] < 0.0
        else:  # the wider interval, of the error itself, where none of the change can be said
            own = after_bounds.get(joint)
            matters |= new < old and (own is None or own[1] < old)
    return Member(entry, rank, matters, min(changes, key=lambda change: change[1], default=None))
