"""A guess at which column is which signal, from names and units alone; `dynid init` holds it against the numbers."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from dynid_rs.runs.readers.config import ColumnRule
from dynid_rs.runs.readers.units import unit_in_name, unit_of
from dynid_rs.runs.readers.words import meanings, roles, words_of

_AXES = (
    ("S", "L", "U", "R", "B", "T"),
    ("S", "L", "E", "U", "R", "B", "T"),
    ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"),
    ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3"),
    ("waist", "shoulder", "elbow", "forearm", "wrist", "flange"),
)
"""Names of axes where they have no numbers: Yaskawa's letters, Universal Robots' words."""
_BY_UNIT = {
    "angle": "position",
    "velocity": "velocity",
    "torque": "torque",
    "current": "current",
    "percent": "torque",
    "temperature": "temperature",
}
_SIGNAL = {
    ("position", "link"): "q",
    ("position", "motor"): "q_motor",
    ("position", "reference"): "q_reference",
    ("velocity", "link"): "dq",
    ("velocity", "motor"): "dq_motor",
    ("acceleration", "link"): "ddq",
    ("torque", "link"): "tau",
    ("torque", "motor"): "tau",
    ("current", "link"): "current",
    ("current", "motor"): "current",
    ("temperature", "link"): "temperature",
    ("temperature", "motor"): "temperature",
}


@dataclass(frozen=True)
class Family:
    """Columns that differ in one place only, one for every joint of the arm, in chain order."""

    columns: tuple[str, ...]
    rule: str | tuple[str, ...]
    form: str
    """The name with a dash where the joint stands."""
    beyond: str = ""
    """The column of one joint more than the arm has; empty where there is none."""


@dataclass
class Guess:
    """Rules that names suggest, and what remains open.

    `columns`: as in `dynid.toml`; `time`: candidates, best first; `others`: families that were not taken, by why;
    `doubts`: what to look at; `questions`: what has to be answered before the columns are used; `moved`: signals of
    motors that are read as those of the links, by which ones they are then.
    """

    columns: dict[str, ColumnRule] = field(default_factory=dict)
    time: tuple[str, ...] = ()
    others: dict[str, str] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)
    moved: dict[str, str] = field(default_factory=dict)


def guess(names: Sequence[str], joints: Sequence[str], units: Mapping[str, str], known: Collection[str] = ()) -> Guess:
    """Guess which columns hold what.

    Parameters
    ----------
    names : sequence of str
        Columns of the file.
    joints : sequence of str
        The arm's joints in chain order.
    units : mapping of str to str
        Units that the file gives, by column.
    known : collection of str
        Signals whose columns are known already: where the positions are, no others are taken for them.
    """
    found = Guess(time=_times(names))
    options: dict[str, list[tuple[int, Family]]] = {}
    nameless = []
    for family in families([name for name in names if name not in found.time[:1]], joints):
        kind = _kind(family, units)
        if isinstance(kind, str):
            said = roles(family.form)
            worth = 4 * ("actual" in said) - 2 * ("motor" in said and kind in ("tau", "current")) + _plain(family)
            options.setdefault(kind, []).append((worth, family))
        elif kind is None:
            nameless.append(family)
        else:
            found.others[family.form] = kind[0]
    plain = [family for family in nameless if "name" not in words_of(family.form)]
    has_positions = "q" in options or "q" in known
    if not has_positions and plain:
        options["q"] = [(0, plain[0])]
        nameless.remove(plain[0])
    elif not has_positions and "q_motor" in options:
        for link, motor in (("q", "q_motor"), ("dq", "dq_motor")):
            if link not in options and link not in known and motor in options:
                options[link] = options.pop(motor)
                found.moved[motor] = link
                found.columns[motor] = None  # its usual names would take these columns once more
        found.doubts.append(
            "the only positions are the motors': they are read as those of the links; if they are the motors' own "
            'turns, give [gear] ratio, and apply_to = ["q", "dq"]'
        )
    named = [family for family in nameless if "name" in words_of(family.form)]
    for family in named:
        found.questions.append(
            f"{family.form} names the joints of each column, in the order of its message and not of the arm's chain, "
            "and cannot be read from this format; list the columns under [columns] in the order of the chain, or write "
            "the run as CSV, JSON lines or Parquet, whose names are read"
        )
    for family in nameless:
        found.others[family.form] = "its name does not say what it is"
    for signal, rivals in options.items():
        rivals.sort(key=lambda rival: -rival[0])
        taken = rivals[0][1]
        found.columns[signal] = taken.rule
        if taken.beyond:
            found.doubts.append(
                f"{taken.beyond} is there too, of a joint more than the arm has: {', '.join(taken.columns)} were taken "
                "for its joints, so check that the file's first joints are the arm's"
            )
        for _, other in rivals[1:]:
            found.others[other.form] = f"{rivals[0][1].form} was taken for {signal}"
        if len(rivals) > 1 and rivals[0][0] == rivals[1][0]:
            found.doubts.append(
                f"{rivals[0][1].form} and {rivals[1][1].form} may both be {signal}; the first was taken"
            )
    return found


def families(names: Sequence[str], joints: Sequence[str]) -> list[Family]:
    """Families of columns with one member for every joint, in the order of the file."""
    n = len(joints)
    found: dict[tuple[str, ...], Family] = {}
    there = set(names)
    for name in names:
        for head, tail, rule_field, members in _forms(name, joints):
            columns = tuple(f"{head}{member}{tail}" for member in members[:n])
            if len(columns) == n and set(columns) <= there and len(set(columns)) == n:
                form = f"{head}-{tail}"
                after = f"{head}{members[n]}{tail}" if len(members) > n else ""
                beyond = after if after in there else ""
                plain = rule_field is not None and not beyond and not {"{", "}"} & set(head + tail)
                rule: str | tuple[str, ...] = f"{head}{rule_field}{tail}" if plain else columns
                found.setdefault(columns, Family(columns, rule, form, beyond))
    # Of families that share columns (q1_2 by either number), the first stays.
    taken: set[str] = set()
    kept = []
    for family in found.values():
        if not taken & set(family.columns):
            kept.append(family)
            taken |= set(family.columns)
    return kept


def _forms(name: str, joints: Sequence[str]) -> list[tuple[str, str, str | None, list[str]]]:
    """Ways to read a name as that of the first joint: what is before and behind it, its field, all members."""
    ways: list[tuple[str, str, str | None, list[str]]] = []
    n = len(joints)
    if joints[0] in name and len(joints[0]) > 1:
        head, _, tail = name.partition(joints[0])
        ways.append((head, tail, "{joint}", list(joints)))
    for digits in re.finditer(r"\d+", name):
        first, width = int(digits[0]), len(digits[0])
        if first in (0, 1):
            members = [str(first + k).zfill(width) for k in range(n + 1)]
            field_of = None if width > 1 else ("{i}", "{n}")[first]
            ways.append((name[: digits.start()], name[digits.end() :], field_of, members))
    for axes in _AXES:
        if 3 <= n <= len(axes):
            for place in re.finditer(rf"(?<![A-Za-z]){axes[0]}(?![A-Za-z])", name, re.IGNORECASE):
                case = str.upper if place[0].isupper() else str.lower if place[0].islower() else str.capitalize
                in_case = [case(axis) for axis in axes]
                ways.append((name[: place.start()], name[place.end() :], None, in_case))
    return ways


def _kind(family: Family, units: Mapping[str, str]) -> str | tuple[str] | None:
    """Signal of a family; None where nothing says, a tuple with the reason where it is none that is read."""
    said = roles(family.form)
    for role, why in (("error", "a difference, not a measurement"), ("model", "a model's or a limit, no measurement")):
        if role in said:
            return (why,)
    word = units.get(family.columns[0]) or unit_in_name(family.columns[0])
    unit = None if word is None else unit_of(word)
    by_unit = None if unit is None else _BY_UNIT.get(unit[0])
    by_name = meanings(family.form) - {"time"}
    in_percent = unit is not None and unit[0] == "percent"
    if by_unit is not None and by_unit not in by_name and not (in_percent and "current" in by_name):
        by_name = {by_unit}  # an effort in ampere is a current
    if not by_name:
        return None
    meaning = next(
        m for m in ("temperature", "torque", "current", "acceleration", "velocity", "position") if m in by_name
    )
    if meaning == "torque" and "current" in by_name:
        meaning = "current"
    if "reference" in said:
        # A torque or current that was asked for is the controller's own model.
        return "q_reference" if meaning == "position" else ("what was asked for, not measured",)
    side = "motor" if "motor" in said else "link"
    signal = _SIGNAL.get((meaning, side))
    return ("there is no such signal",) if signal is None else signal


def _plain(family: Family) -> int:
    """One for the shorter of two names: `q` before `q_filtered_raw`."""
    return -(len(family.form) // 8)


def _times(names: Sequence[str]) -> tuple[str, ...]:
    """Columns that may be the time, the likeliest first."""
    found = []
    for place, name in enumerate(names):
        if meanings(name) == {"time"} and not {"error", "model"} & roles(name):
            unit = unit_in_name(name)
            found.append((-(name.lower() in ("t", "time", "timestamp")), unit is None, place, name))
    return tuple(name for *_, name in sorted(found))
