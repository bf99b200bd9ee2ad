"""docs/measured/fleet.md: marks, what was found by kind and size, intervals, cost, and every arm that was not said
right."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from campaigns.fleet_arms import BANDS, FRICTION, MASS, OFFSET, RATE, ROTOR, SECONDS
from campaigns.fleet_judge import FAR

Figures = dict[str, Any]

NORMAL_FAR = 0.0026998
"""Share of a normal distribution beyond `FAR`."""
PARTS = 3
UNITS = {"friction": "%", "gain": "%", "offset": "% of the effort limit", "load": "kg"}

INTRODUCTION = """# Fleets

Written by `python tests/campaigns/fleet.py --seed {seed} --arms {arms} --odd {odd:g} --page docs/measured/fleet.md`.
Simulated arms of three types (three joints, one encoder), each with runs and motions of its own: two
runs of {seconds:.0f} s at {rate:.0f} Hz to learn from, one to test on. From arm to arm the friction of a joint deviates
by {friction} as a whole and half as much again in every coefficient, masses by {mass} per link, rotors by {rotor},
constant torques by {offset} of the effort limit. A share of {odd:g} is odd in one way: friction, gain, constant torque
of a joint, or a load on the last link, in equal parts; sizes are drawn evenly in their logarithm, from what hides among
the others to what nobody could miss. The product sees robot files and recordings.
"""


def page(found: Figures) -> str:
    """Return the page as Markdown."""
    head = INTRODUCTION.format(
        **found["invocation"],
        seconds=SECONDS,
        rate=RATE,
        friction=_percent(FRICTION),
        mass=_percent(MASS),
        rotor=_percent(ROTOR),
        offset=_percent(OFFSET),
    )
    parts = [
        *(head, "## Marks\n", marks_table(found)),
        *("## By kind and size\n", ABOUT_SIZES, _sizes(found)),
        *("## Intervals and errors\n", ABOUT_INTERVALS, _intervals(found)),
        *("## What was not said right\n", _wrong(found)),
    ]
    return "\n".join(parts)


ABOUT_SIZES = """Each kind in three parts by size. *Named*: called odd. *Right*: the first cause is the right kind in
the right place. *Size off*: median difference of the size that is said (of the right ones) from what was put in; the
arm's own deviation from its type, which nobody can tell from it, is in that.
"""
ABOUT_INTERVALS = """Of arms without anything odd, all quantities of a kind together: how many intervals of 95 % hold
the truth, of the arm alone and pooled with its type, and the pooled estimates' error over those of the arms alone (root
mean square, in standard errors).
"""


def marks_table(found: Figures) -> str:
    """Everything that was promised or asked for, as Markdown."""
    arms, cost, clean = found["arms"], found["cost"], found["clean_fleets"]
    odd = [arm for arm in arms if arm["odd"]]
    named = [arm for arm in arms if arm["said"]]
    hits = [arm for arm in named if arm["odd"]]
    false = len(named) - len(hits)
    large = [arm for arm in odd if arm["odd"]["drawn"] >= edges(arm["odd"]["kind"])[2]]
    far = found["tails"]
    rows = [
        ("arms in one table with one report", f"{len(arms)} identified, {len(found['failed'])} failed"),
        ("seconds per arm, median, of one process", f"{cost['seconds']:.2f}"),
        ("most memory", f"{cost['memory'] / 1e6:.0f} MB"),
        ("size of the report", f"{cost['report_bytes'] / 1e6:.2f} MB"),
        ("false alarms among clean arms", f"{false} of {len(arms) - len(odd)}"),
        (
            "the same promise, on fleets without odd arms",
            f"any arm named in {clean['named']} of {clean['fleets']} drawn fleets of {clean['arms']} arms; "
            f"at most {_percent(clean['false_alarms'])} are promised",
        ),
        (
            f"clean distances beyond {FAR:g} deviations",
            f"{far['beyond']} of {far['n']} ({_percent(far['beyond'] / far['n'], 2)}); "
            f"normal: {_percent(NORMAL_FAR, 2)}",
        ),
        ("precision: named arms that are odd", _share(len(hits), len(named))),
        ("recall: odd arms that are named", _share(len(hits), len(odd))),
        ("recall of the largest third of each kind", _share(sum(arm["said"] for arm in large), len(large))),
        ("right cause, of odd arms that are named", _share(sum(arm["right"] for arm in hits), len(hits))),
        ("a second cause that is not there", f"{sum(arm['more'] for arm in hits)} in {len(hits)} arms"),
        (
            "error on a run that nobody saw, over the torque",
            f"{_percent(found['unseen']['alone'], 3)} alone, {_percent(found['unseen']['pooled'], 3)} pooled, "
            f"better for {_percent(found['unseen']['better'])} of {found['unseen']['n']} arms",
        ),
    ]
    return _table(("mark", "reached"), rows)


def edges(kind: str) -> list[float]:
    """Borders of the parts by size."""
    least, most = BANDS[kind]
    return [least * (most / least) ** (k / PARTS) for k in range(PARTS + 1)]


def _sizes(found: Figures) -> str:
    rows = []
    for kind in BANDS:
        borders = edges(kind)
        factor = 1.0 if kind == "load" else 100.0
        for low, high in pairwise(borders):
            cases = [arm for arm in found["arms"] if arm["odd"] and arm["odd"]["kind"] == kind]
            cases = [arm for arm in cases if low <= arm["odd"]["drawn"] <= high]
            named, right = sum(arm["said"] for arm in cases), [arm for arm in cases if arm["right"]]
            off = [abs(_said_size(arm) / arm["odd"]["size"] - 1) for arm in right]
            rows.append(
                (
                    {"offset": "constant torque"}.get(kind, kind),
                    f"{factor * low:.3g} to {factor * high:.3g} {UNITS[kind]}",
                    str(len(cases)),
                    _share(named, len(cases)),
                    _share(len(right), named),
                    _percent(float(np.median(off))) if off else "-",
                )
            )
    return _table(("kind", "size", "arms", "named", "right", "size off"), rows)


def _said_size(arm: Figures) -> float:
    cause = arm["causes"][0]
    return float(cause["change"] if arm["odd"]["kind"] in ("friction", "gain") else cause["size"])


def _intervals(found: Figures) -> str:
    names = {"base": "base parameters", "friction": "friction", "offset": "constant torque"}
    rows = [
        (names[kind], str(own["n"]), _percent(own["alone"], 1), _percent(own["pooled"], 1), f"{own['error']:.2f}")
        for kind, own in found["coverage"].items()
    ]
    return _table(("quantity", "number", "alone", "pooled", "error, pooled over alone"), rows)


def _wrong(found: Figures) -> str:
    lines = [f"* {name}: {message}" for name, message in found["failed"]]
    for arm in found["arms"]:
        said = ", ".join(f"{cause['kind']} of {cause['place']}" for cause in arm["causes"]) or "nothing"
        truth = "nothing" if arm["odd"] is None else f"{arm['odd']['kind']} of {arm['odd']['place']}"
        size = "" if arm["odd"] is None else f" ({arm['odd']['size']:+.3g})"
        if arm["said"] and (not arm["right"] or arm["more"]):
            lines.append(f"* {arm['name']}, {arm['type']}: put in {truth}{size}, said {said}")
    missed = sum(1 for arm in found["arms"] if arm["odd"] and not arm["said"])
    lines.append(f"* {missed} odd arms are not named at all; the table above says of which size.")
    return "\n".join([*lines, ""])


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole}"


def _percent(part: float, digits: int = 0) -> str:
    return f"{100 * part:.{digits}f} %"


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join(["| " + " | ".join(line) + " |" for line in lines] + [""])
