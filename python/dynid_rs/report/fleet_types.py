"""What arms of one type share: every quantity's mean and deviation, and where the arms lie, the odd ones marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.changes import kind_words
from dynid_rs.base.units import unit_text
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import breakable, count, esc, percent, plural, significant

REACH, BINS = 8.0, 32
"""Deviations that a picture shows, to either side, and its bars."""
WIDTH, HEIGHT, FLOOR = 200, 30, 24
"""Of a picture [px], and where its bars stand."""
MOST_MARKED = 40
"""Odd arms that a picture marks; more are told by none of them."""

Section = tuple[str, str, str]


def types_section(answer: Mapping[str, Any], quantities: Mapping[str, NDArray[Any]]) -> list[Section]:
    """One section per type: key, title, HTML."""
    if answer["pooling"] is None:
        return []
    odd = {row["name"]: row["causes"] for row in answer["robots"] if row["odd"] == "yes"}
    sections = []
    for number, one in enumerate(answer["pooling"]["types"]):
        rows = quantities["type"] == one["name"]
        own = {key: column[rows] for key, column in quantities.items()}
        sections.append((f"type-{number}", f"Type {esc(one['name'])}", _type(one, own, odd)))
    return sections


def _type(one: Mapping[str, Any], own: Mapping[str, NDArray[Any]], odd: Mapping[str, Sequence[Any]]) -> str:
    n = one["n_arms"]
    body = []
    for k, quantity in enumerate(one["quantities"]):
        part = slice(k * n, (k + 1) * n)
        marked = [
            (name, far) for name, far in zip(own["arm"][part], own["deviations"][part], strict=True) if name in odd
        ]
        body.append(
            [
                f'<th scope="row">{_name(quantity)}</th>',
                cell(breakable(quantity["place"]), "place"),
                *_size(quantity),
                cell(_picture(own["deviations"][part], marked, quantity), "picture"),
            ]
        )
    named = sum(name in odd for name in own["arm"][:n])
    said = (
        f"{plural(n, 'arm')}, {count(named)} odd."
        if one["judged"]
        else f"{plural(n, 'arm')}: too few to name odd ones."
    )
    head = [
        "Quantity",
        "Where",
        "Type\u2019s mean",
        "Arms deviate by",
        f"Arms <small>in deviations, {REACH:.0f} to either side; \u25cf odd arms</small>",
    ]
    return f"<p>{said}</p>\n" + table(head, body, label=f"Type {esc(one['name'])}")


def _name(quantity: Mapping[str, Any]) -> str:
    kind = quantity["kind"]
    if kind in ("base", "coefficient"):
        name = quantity["name"]
        first, _, rest = name.partition(" ")
        short = first if kind == "base" else name.replace("_", " ")
        return f'<abbr title="{esc(name)}">{esc(short)} \u2026</abbr>' if rest else esc(short)
    if kind == "friction":
        return f"friction <small>at {significant(quantity['at'], 2)}\u00a0{quantity['at_unit']}</small>"
    return "error on test runs" if kind == "error" else esc(kind_words(kind))


def _size(quantity: Mapping[str, Any]) -> list[str]:
    mean, deviation = quantity["mean"], quantity["deviation"]
    nothing = "" if deviation else cell("<small>less than is seen</small>")
    if quantity["kind"] == "error":  # logarithms
        return [cell(percent(float(np.exp2(mean / np.log(2))))), nothing or cell(percent(deviation))]
    if quantity["kind"] == "gain":
        return [cell("1"), nothing or cell(percent(deviation))]
    unit = unit_text(quantity["unit"])
    if nothing:
        return [cell(f"{significant(mean)}\u00a0{unit}"), nothing]
    relative = f" <small>{percent(deviation / abs(mean))}</small>" if abs(mean) > 3 * deviation else ""
    return [cell(f"{significant(mean)}\u00a0{unit}"), cell(f"{significant(deviation, 2)}\u00a0{unit}{relative}")]


def _picture(deviations: NDArray[Any], marked: Sequence[tuple[str, float]], quantity: Mapping[str, Any]) -> str:
    """SVG: bars where the arms are, dots where the odd ones are, those beyond the edge on it."""
    counts, _ = np.histogram(np.clip(deviations, -REACH, REACH), BINS, (-REACH, REACH))
    step, top = WIDTH / BINS, max(int(counts.max()), 1)
    bars = "".join(
        f"M{k * step:.1f} {FLOOR}v-{FLOOR * number / top:.1f}h{step - 1:.1f}V{FLOOR}z"
        for k, number in enumerate(counts)
        if number
    )
    far = sorted(marked, key=lambda pair: -abs(pair[1]))[:MOST_MARKED]
    dots = "".join(
        f'<circle cx="{_across(value):.0f}" cy="{FLOOR + 3}" r="2.5"><title>{esc(name)}: {value:.1f}</title></circle>'
        for name, value in far
        if abs(value) > 3
    )
    label = f"{len(deviations)} arms, {sum(abs(value) > 3 for _, value in marked)} odd ones beyond 3 deviations"
    return (
        f'<svg class="spread" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" role="img" '
        f'aria-label="{label}"><path d="{bars}"/><line x1="0" x2="{WIDTH}" y1="{FLOOR}" y2="{FLOOR}"/>{dots}</svg>'
    )


def _across(value: float) -> float:
    return float(np.clip((value + REACH) / (2 * REACH) * WIDTH, 3, WIDTH - 3))
