"""What a diagnosis means, in plain words: the verdict, and which experiment would tell more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dynid_rs.base.mattering import matters
from dynid_rs.base.numbers import interval as interval_said
from dynid_rs.base.numbers import percent, significant
from dynid_rs.base.units import plain_unit
from dynid_rs.base.wording import (
    ANOTHER_FUNCTION,
    before_words,
    concluded,
    in_families,
    is_better,
    kind_words,
    kinds_said,
    other_places,
    under_words,
)

Result = Mapping[str, Any]

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
NOT_WORSE = 1.02
"""Mean ratio of the errors after and before up to which effects have done no harm."""
CONSEQUENCE = "residual_exceeds_torque"
"""What any error in the data ends in: its cause is said first, where one was found."""
WORSE = 1.05
"""Ratio of the errors after and before from which a joint is said to be worse."""

SIGNAL_WORDS = {
    "q": "position",
    "q_motor": "motor position",
    "dq": "speed",
    "dq_motor": "motor speed",
    "ddq": "acceleration",
    "ddq_motor": "motor acceleration",
    "tau_link": "load",
    "tau_motor": "motor torque",
    "t": "time",
    "temperature": "temperature",
    "way": "way since the motion turned round",
    "angle_in_cycle": "angle within one cycle",
    "stage_speed": "speed of the shared stage",
    "column": "torque per unit of its coefficient",
}
"""What a signal is called on an axis."""
_EXPERIMENTS = {
    "q": "move {joint} slowly and steadily through its whole range, there and back",
    "q_motor": "move {joint} slowly and steadily through its whole range, there and back",
    "dq": "move {joint} at some ten constant speeds in both directions (`dynid excite --friction`)",
    "dq_motor": "move {joint} at some ten constant speeds in both directions (`dynid excite --friction`)",
    "ddq": "move {joint} with short, strong accelerations about one place",
    "ddq_motor": "move {joint} with short, strong accelerations about one place",
    "tau_link": "repeat a run with a known payload on the flange",
    "tau_motor": "repeat a run with a known payload on the flange",
    "t": "record one motion again and again for half an hour from a cold start",
    "temperature": "record one motion again and again for half an hour from a cold start",
    "deflection": "record with both encoders while {joint} is loaded and unloaded slowly",
}
"""What would tell more about a leftover that depends on a signal."""


def named(entry: Result, joints: Sequence[str]) -> str:
    """An effect and its place, in words; `joints` are all joints of the robot."""
    places = list(entry["joints"])
    kinds = kinds_words(entry)
    if len(places) == len(joints) > 2:
        return f"{kinds} of the whole robot"
    return f"{kinds} on " + ", or on ".join(map(_listed, [places, *other_places(entry)]))


def kinds_words(entry: Result) -> str:
    """What an effect is: its kind, ``A or B``, or unknown."""
    return " or ".join(kind_words(kind) for kind in kinds_said(entry) or [entry["kind"]])


def effect_words(entry: Result, joints: Sequence[str], *, intervals: bool = False) -> str:
    """An effect, its place and its numbers; `joints` are all joints of the robot."""
    numbers = ", ".join(numbers_words(entry, intervals=intervals))
    under = under_words(entry, joints)
    depends = "" if kinds_said(entry) else _depends(entry)
    return named(entry, joints) + depends + (f" {under}" if under else "") + (f": {numbers}" if numbers else "")


def numbers_told(entry: Result) -> list[Result]:
    """Numbers of an effect that mean something by themselves.

    Of one without a name none, for they are those of the law that stands in for it; a side is said by the neighbour's
    name.
    """
    own = entry.get("parameters") or () if kinds_said(entry) else ()
    return [number for number in own if number["name"] != "side"]


def numbers_words(entry: Result, *, intervals: bool = False) -> list[str]:
    """The numbers of an effect that are told, each with its joint where they are of several."""
    told = numbers_told(entry)
    several = len({number.get("joint") for number in told} - {None}) > 1
    return [number_words(number, interval=intervals, of_joint=several) for number in told]


def number_words(number: Result, *, interval: bool = False, of_joint: bool = False) -> str:
    """A number of an effect with its unit, and its joint and its 95 % interval where they are asked for and known."""
    of = f" of {number['joint']}" if of_joint and number.get("joint") else ""
    unit = f" {plain_unit(number['unit'])}".rstrip()
    bounds = number.get("interval") if interval else None
    span = "" if bounds is None else f" ({interval_said(bounds)})"
    return f"{number['name']}{of} {significant(number['value'])}{unit}{span}"


def tie_words(tie: Result, joints: Sequence[str]) -> str:
    """Say what an effect is not told apart from, and the command that designs a run which would."""
    how = f": {tie['separate']}" if tie.get("separate") else ", and no motion can" if tie.get("same_torque") else ""
    return f"not told apart from {named(tie, joints)}{how}"


def unexplained_words(entry: Result) -> str:
    """What is left of a joint's error, and what it depends on."""
    return f"unexplained on {entry['joint']}: {percent(entry['share'])} of the error's power{_depends(entry)}"


def _depends(entry: Result) -> str:
    signals = ", ".join(f"{d['signal']} ({d['strength']:.2f})" for d in entry.get("depends_on") or ())
    return f", depends on {signals}" if signals else ""


def explained_share(result: Result) -> float | None:
    """Part of the error's power above the floor that the effects took away, joints alike; None without a floor.

    Joints count by the part of their own error that could be explained.
    """
    test = result["rmse"]["test"]
    seen = [j for j, floor in enumerate(test["floor"]) if floor is not None and test["before"][j] > 0]
    before, after, floor = (np.array([test[key][j] for j in seen]) for key in ("before", "after", "floor"))
    floor = np.minimum(floor, before)  # an estimate may lie above what is there
    possible = float(np.sum(1 - (floor / before) ** 2))
    if possible <= 0:
        return None
    return float(np.clip(np.sum(1 - (np.maximum(after, floor) / before) ** 2) / possible, 0, 1))


def not_worse(result: Result) -> bool:
    """Whether the model with effects beats the simple baseline and does no worse than the declared model."""
    test = result["rmse"]["test"]
    before, after = (np.maximum(test[key], 1e-300) for key in ("before", "after"))
    return is_better(dict(result)) and float(np.mean(np.log(after / before))) <= float(np.log(NOT_WORSE))


def verdict(result: Result) -> str:
    """One to three sentences for an engineer who has a minute."""
    errors = [f for f in result["data"]["findings"] if f["severity"] == "error"]
    if errors:
        first = min(errors, key=lambda f: f["code"] == CONSEQUENCE)
        rest = "" if concluded(result) else " Nothing is concluded before that is mended."
        return f"Look at the data first: {first['message']}.{rest}"
    joints, found = result["joints"], [e for e in result["effects"] if kinds_said(e)]
    if result["nothing_to_add"]:
        return f"Nothing to add: {_against_floor(result)}{_unseen(result)}"
    if not found:
        change = f" {_change(result)}" if result["effects"] else ""
        leaves = f"what the {before_words(result)} leaves"
        return f"Nothing in the catalogue of effects explains {leaves}.{change}{_left(result)}"
    large, small = ([e for e in found if matters(result, e) == wanted] for wanted in (True, False))
    explained = f"{_explained(result, large)} {_names_said(large, joints)}. " if large else ""
    return f"{explained}{_of_no_use(small, joints, more=bool(large))}{_change(result)}{_left(result)}"


def _explained(result: Result, found: Sequence[Result]) -> str:
    share = explained_share(result)
    lacked = f"what the {before_words(result)} lacked"
    what = lacked if share is None else f"{100 * share:.0f} % of what could be explained"
    return f"{_counted(found)} {'explain' if len(found) > 1 else 'explains'} {what}:"


def _of_no_use(found: Sequence[Result], joints: Sequence[str], *, more: bool) -> str:
    """Effects that are there, but that nobody would miss, as the report folds them away."""
    if not found:
        return ""
    who, lower = _counted(found, "more " if more else ""), "lower" if len(found) > 1 else "lowers"
    return f"{who} {lower} no error by more than the noise: {_names_said(found, joints)}. "


def _counted(found: Sequence[Result], which: str = "") -> str:
    number = NUMBERS[len(found)] if len(found) < len(NUMBERS) else str(len(found))
    return f"{number.capitalize()} {which}effect{'s' if len(found) > 1 else ''}"


def _names_said(found: Sequence[Result], joints: Sequence[str]) -> str:
    """Effects and their places, each name once."""
    return "; ".join(named(family, joints) for family in in_families(found))


def next_experiments(result: Result) -> list[str]:
    """Sentences: what to record next, the most telling first."""
    said: dict[str, None] = {}
    for entry in result["effects"]:
        for tie in (tie for tie in entry["ties"] if not tie.get("same_torque")):
            own = {"kind": entry.get("told_as", entry["kind"]), "joints": entry["joints"]}
            pair = f"{named(own, result['joints'])} and {named(tie, result['joints'])}"
            if tie["kind"] == ANOTHER_FUNCTION:
                differ = "differ beyond the positions that the runs have shown; one that goes there decides"
                said[f"{_sentence(pair)} {differ}."] = None
                continue
            how = f": `{tie['separate']}` designs the motion that does" if tie.get("separate") else ""
            said[f"{_sentence(pair)} explain the data equally well; a run that separates them would decide{how}."] = (
                None
            )
    for entry in result["unexplained"]:
        direct = [d for d in entry["depends_on"] if d.get("direct", True)]
        for signal in (d["signal"] for d in sorted(direct, key=lambda d: -d["strength"])[:1]):
            wish = _experiment(signal, entry["joint"], result["joints"])
            if wish:
                said[f"What is left on {entry['joint']} depends on {signal}: {wish}."] = None
    codes = {f["code"] for f in result["data"]["findings"]}
    if result["unexplained"] and any(f.get("column") == "q_motor" for f in _missing(result)):
        said["Record motor and link positions: what the gears do would show between them."] = None
    if "test_part_chosen" in codes:
        said["Record a second run with another motion: what was found would be tested on more than its own run."] = None
    return list(said)


def _experiment(signal: str, joint: str, joints: Sequence[str]) -> str | None:
    """What to do for a leftover on `joint` that depends on `signal`, the name of a signal with its joint behind it."""
    name = signal
    for other in sorted(joints, key=len, reverse=True):
        if signal.endswith(f"_{other}"):
            name, joint = signal.removesuffix(f"_{other}"), other
            break
    wish = _EXPERIMENTS.get(name)
    return None if wish is None else wish.format(joint=joint)


def _missing(result: Result) -> list[Result]:
    return [f for f in result["data"]["findings"] if f["code"] == "signal_missing"]


def _change(result: Result) -> str:
    """By how much the error on unseen runs changed, smallest and largest over the joints."""
    test = result["rmse"]["test"]
    ratios = [b / a - 1 for a, b in zip(test["before"], test["after"], strict=True) if a > 0]
    if not ratios:
        return "On unseen runs there is no error to compare."
    low, high = (percent(ratio, signed=True) for ratio in (min(ratios), max(ratios)))  # as in the table of the joints
    pairs = zip(result["joints"], test["before"], test["after"], strict=True)
    worse = [joint for joint, before, after in pairs if after > WORSE * before > 0]
    than = f" It is worse on {_listed(worse)}." if worse else ""
    if low == high:
        return f"On unseen runs the error changes by {low} on every joint.{than}"
    return f"On unseen runs the error changes by {low} to {high}, joint by joint.{than}"


def _left(result: Result) -> str:
    """What stays unexplained, and where."""
    left = sorted(result["unexplained"], key=lambda entry: -entry["share"])
    if not left:
        return ""
    worst = left[0]
    signals = [d["signal"] for d in worst["depends_on"] if d.get("direct", True)][:2]
    on = f", depending on {_listed(signals)}" if signals else ""
    others = f" (and less on {_listed([entry['joint'] for entry in left[1:]])})" if len(left) > 1 else ""
    return f" Unknown: {100 * worst['share']:.0f} % of the error's power on {worst['joint']} is not noise{on}{others}."


def _against_floor(result: Result) -> str:
    test, joints = result["rmse"]["test"], result["joints"]
    # Where no interval can be said, the error itself is compared.
    rows = zip(joints, test["after"], test["after_interval"], test["floor"], strict=True)
    above = [
        joint
        for joint, after, interval, floor in rows
        if floor is not None and (after if interval is None else interval[0]) > floor
    ]
    if not above:
        return f"on runs that it has not seen the {before_words(result)} leaves no more than the noise."
    return (
        f"what the {before_words(result)} leaves on {_listed(above)} is above the floor, but it depends on no signal "
        "strongly enough to be told from chance."
    )


def _unseen(result: Result) -> str:
    """Kinds that the data could not have shown."""
    kinds = [
        f["message"].split(" cannot be told without")[0] for f in _missing(result) if "told without" in f["message"]
    ]
    return f" Not testable with these signals: {'; '.join(kinds)}." if kinds else ""


def _listed(items: Sequence[str]) -> str:
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]
