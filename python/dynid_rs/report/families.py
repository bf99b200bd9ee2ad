"""Effects as families: one entry per name, whatever the number of joints; those that matter, and the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dynid_rs.base.mattering import changes, matters, measured
from dynid_rs.base.wording import family_of, kinds_said, other_places
from dynid_rs.report.axes import signal_words
from dynid_rs.report.text import capital, join_words, short_names, words

Result = Mapping[str, Any]


@dataclass(frozen=True)
class Member:
    """One effect of a family: whether it matters (`base/mattering.py`), where it lowers an error most, by how much."""

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
    def places(self) -> list[Sequence[str]]:
        """Joints on which they act, and where these data do not tell, those on which they may."""
        return [self.joints, *other_places(self.members[0].entry)]

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
    grouped: dict[tuple[Any, ...], list[Member]] = {}
    for member in members:
        grouped.setdefault(family_of(member.entry), []).append(member)
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


def where_of(family: Family, result: Result) -> str:
    """Where a family acts: `A3 and A4`, `A3 and A4, or A2 and A4` where it is either."""
    return ", or ".join(where(joints, result) for joints in family.places)


def said(family: Family, result: Result) -> str:
    """A family in a sentence: its name and where it acts; an unknown one with what it depends on."""
    text = f"{family.name} on {where_of(family, result)}"
    if not family.unknown:
        return text
    signals = [d["signal"] for m in family.members for d in m.entry.get("depends_on") or [] if d.get("direct", True)]
    short = dict(zip(result["joints"], short_names(result["joints"]), strict=True))
    named = list(dict.fromkeys(signal_words(signal, result["joints"], short) for signal in signals))
    return f"{text} (follows the {join_words(named)})" if 0 < len(named) <= 2 else text


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    return capital(text).rstrip(".") + "."


def _member(result: Result, entry: Result, rank: int) -> Member:
    own = changes(result, entry) if measured(entry) and not entry.get("above_band") else []
    change = min(((joint, change) for joint, change, _ in own), key=lambda one: one[1], default=None)
    return Member(entry, rank, matters(result, entry), change)
