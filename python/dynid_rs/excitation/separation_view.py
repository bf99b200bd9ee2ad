"""How well two effects are told apart, as HTML for the page of plots and as sentences for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import esc, percent, significant

Section = Mapping[str, Any]

SMALL_GAIN = 1.2
"""Below it the exciting trajectory does as well."""


def sentences(separation: Section) -> list[str]:
    """What was reached, effect by effect."""
    said = []
    a, b = (entry["effect"] for entry in separation["effects"])
    gain = separation["gain"]
    verb = "tells" if gain >= SMALL_GAIN else "hardly tells"
    better = (
        "" if gain >= SMALL_GAIN else "; the exciting trajectory does as well, and only wider limits would do better"
    )
    said.append(
        f"this motion {verb} {a} and {b} apart better than the exciting trajectory: {gain:.3g} times the power{better}"
    )
    for entry in separation["effects"]:
        before, after = entry["before"], entry["after"]
        said.append(
            f"{entry['effect']}: {100 * before['left']:.2g} % of its torque could not be imitated, now "
            f"{100 * after['left']:.2g} % (of what it is on the exciting trajectory)"
        )
    return said


def section(separation: Section) -> str:
    """HTML: what nothing imitates of each effect, on the exciting trajectory and on this one, as bars and numbers."""
    top = max(e[when]["left"] for e in separation["effects"] for when in ("before", "after")) or 1.0
    rows = []
    for entry in separation["effects"]:
        other = next(e["effect"] for e in separation["effects"] if e is not entry)
        for when, words in (("before", "exciting trajectory"), ("after", "this one")):
            figures = entry[when]
            width = round(100 * figures["left"] / top, 1)
            bar = f'<span class="track"><i class="fill {when}" style="width:{width}%"></i></span>'
            shape = ", ".join(f"{name} {significant(value)}" for name, value in figures["best_imitator"].items())
            rows.append(
                [
                    esc(entry["effect"]),
                    cell(words, "word"),
                    cell(percent(figures["left"]), "num main"),
                    cell(bar, "strip"),
                    cell(percent(figures["left_by_declared"]), "num soft"),
                    cell(esc(f"{other.split(':')[0]} {shape}".strip()), "text"),
                ]
            )
    head = ["Effect", "Motion", "Not imitated", "as a bar", "by the declared model alone", "Best imitator"]
    return (
        f"<p>This motion tells the two effects apart with <b>{significant(separation['gain'])} times the power</b> of "
        "the exciting trajectory within the same limits (geometric mean of both directions). The numbers are "
        "amplitudes: the part of an effect\u2019s torque that neither the declared model nor any shape of the other "
        "effect can imitate, in the band of the fit, over the effect\u2019s own on the exciting trajectory.</p>\n"
        f"{table(head, rows, label='Separation of the effects')}"
    )
