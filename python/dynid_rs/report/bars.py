"""Before and after as one bar chart: errors on the test runs per joint, all on one scale.

The chart is a list of HTML elements whose widths are percentages: it needs no script, its numbers are text, and it is
as wide as the page. The table behind it has every number of the terminal's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base.units import torques_said, torques_told, unit_text
from dynid_rs.base.wording import against_reference, before_words
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import (
    DASH,
    breakable,
    change,
    esc,
    interval,
    percent,
    percent_interval,
    ratio,
    significant,
)

Result = Mapping[str, Any]

OFF_SCALE = 2.0
"""A bar of weighted least squares that is so many times as long as all others is cut, and says so."""


def bar_chart(result: Result) -> str:
    """HTML: weighted least squares, declared and after, per joint, with interval and floor, and the table behind."""
    rows, scale = _rows(result), _scale(result)
    parts = "".join(_joint(row, result, scale) for row in rows)
    marks = f"<span>0</span><span>{percent(scale / 2)}</span><span>{percent(scale)}</span>"
    axis = f'<div class="bar-axis" aria-hidden="true">{marks}</div>'
    return (
        f'<figure class="bars"><figcaption>{_key(result)}</figcaption>\n<ul>{parts}</ul>\n{axis}</figure>\n'
        f'<details class="behind"><summary>All numbers of this chart</summary>{_table(result, rows)}</details>'
    )


def with_effects(result: Result) -> bool:
    """Whether the model after differs from the declared one."""
    test = result["rmse"]["test"]
    return bool(result.get("effects")) or test["after"] != test["before"]


def models(result: Result) -> list[tuple[str, str, str]]:
    """Models that are compared: key of their errors, style of their bar, name."""
    diagnosed = result.get("steps") is not None
    if with_effects(result):
        middle = [("before", "before", before_words(result))]
        last = "with the effects found" if diagnosed else "with effects"
    else:
        middle, last = [], before_words(result) if diagnosed else "three loops"
    return [("wls", "wls", "weighted least squares"), *middle, ("after", "after", last)]


def _rows(result: Result) -> list[dict[str, Any]]:
    test, n, units = result["rmse"]["test"], len(result["joints"]), torques_told(result)
    columns = {
        key: test.get(key) or [None] * n
        for key in (
            "torque_std",
            "wls",
            "before",
            "after",
            "after_interval",
            "floor",
            "change_interval",
            "before_interval",
            "floor_interval",
        )
    }
    return [
        {"joint": joint, "unit": units[j], **{key: values[j] for key, values in columns.items()}}
        for j, joint in enumerate(result["joints"])
    ]


def _scale(result: Result) -> float:
    """Right end of all bars, a part of the torque's standard deviation that reads well."""
    test, n = result["rmse"]["test"], len(result["joints"])

    def largest(key: str) -> float:
        shares = (ratio(v, s) for v, s in zip(test.get(key) or [None] * n, test["torque_std"], strict=True))
        return max((share for share in shares if share is not None), default=0.0)

    ends = [
        share
        for pair, std in zip(test.get("after_interval") or [None] * n, test["torque_std"], strict=True)
        if pair and (share := ratio(pair[1], std)) is not None
    ]
    own = max([largest("before"), largest("after"), largest("floor"), *ends])
    wls = largest("wls")
    top = max(own, wls) if wls <= OFF_SCALE * own or own == 0.0 else own
    steps = (0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1, 0.12, 0.16, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2, 1.6, 2.0, 3.0)
    return next((step for step in steps if step >= top), top) or 1.0


def _joint(row: Result, result: Result, scale: float) -> str:
    """One joint: its name, a bar per model, and by how much the error changed."""
    std, unit = row["torque_std"], unit_text(row["unit"])
    bars = "".join(
        f'<div class="bar-row"><span class="bar-name">{name}</span>'
        f'<span class="track">{_bar(row, key, style, scale)}</span>'
        f'<span class="bar-value"><b>{percent(ratio(row[key], std))}</b> '
        f'<span class="soft">{significant(row[key])}\u00a0{esc(unit)}</span></span></div>'
        for key, style, name in models(result)
    )
    return f'<li><div class="bar-joint"><h3>{breakable(row["joint"])}</h3>{_change(row, result)}</div>{bars}</li>\n'


def _bar(row: Result, key: str, style: str, scale: float) -> str:
    share = ratio(row[key], row["torque_std"])
    if share is None:
        return ""

    def at(value: float | None) -> float:
        part = ratio(value, row["torque_std"]) or 0.0
        return round(100.0 * min(1.0, max(0.0, part / scale)), 2)

    cut = " cut" if share > scale else ""
    marks = f'<i class="fill {style}{cut}" style="width:{at(row[key])}%"></i>'
    if key == "after" and row["after_interval"]:
        low, high = map(at, row["after_interval"])
        marks += f'<i class="whisker" style="left:{low}%;width:{round(high - low, 2)}%"></i>'
    if row["floor"] is not None:
        marks += f'<i class="floor" style="left:{at(row["floor"])}%"></i>'
    return marks


def _change(row: Result, result: Result) -> str:
    """By how much the error changed, in a colour only where its interval leaves no doubt."""
    base, against = ("before", "declared") if with_effects(result) else ("wls", "least squares")
    against = "the reference" if base == "before" and against_reference(result) else against
    share = ratio(row["after"], row[base])
    if share is None:
        return ""
    bounds = row["change_interval"] if base == "before" else None
    sure = bounds is not None and (bounds[0] > 0 or bounds[1] < 0)
    style = ("better" if share < 1 else "worse") if sure else "soft"
    sign = "\u25bc" if share < 1 else "\u25b2"
    doubt = f' <span class="soft">({percent_interval(bounds)})</span>' if bounds else ""
    said = f'{change(row["after"], row[base])} <span class="soft">against {against}</span>'
    return f'<span class="change {style}"><span aria-hidden="true">{sign}</span> {said}{doubt}</span>'


def _key(result: Result) -> str:
    marks = [f'<li><i class="fill {style}"></i>{name}</li>' for _, style, name in models(result)]
    test = result["rmse"]["test"]
    if any(test.get("after_interval") or []):
        marks.append('<li><i class="whisker"></i>95 % interval</li>')
    if any(floor is not None for floor in test.get("floor") or []):
        marks.append('<li><i class="floor"></i>noise, estimated: no model goes far below</li>')
    return f'<ul class="key" aria-label="Key">{"".join(marks)}</ul>'


def _table(result: Result, rows: Sequence[Result]) -> str:
    said = f"<small>{esc(unit_text(torques_said(torques_told(result))))}</small>"
    last = models(result)[-1][2]
    head = ["Joint", f"Torque std {said}", f"Weighted least squares {said}"]
    before = "Reference" if against_reference(result) else "Declared"
    head += [f"{before} {said}", f"95 % interval {said}"] if with_effects(result) else []
    head += [f"{last[0].upper()}{last[1:]} {said}", f"95 % interval {said}"]
    head += ["Change", "95 % interval"] if with_effects(result) else ["Against least squares"]
    head += [f"Floor {said}", f"95 % interval {said}"]
    body = []
    for row in rows:
        std = row["torque_std"]
        line = [breakable(row["joint"]), cell(significant(std)), _error(row["wls"], std)]
        if with_effects(result):
            line += [_error(row["before"], std), cell(interval(row["before_interval"]), "num soft")]
        line += [_error(row["after"], std, "main"), cell(interval(row["after_interval"]), "num soft")]
        if with_effects(result):
            line += [
                cell(change(row["after"], row["before"])),
                cell(percent_interval(row["change_interval"]), "num soft"),
            ]
        else:
            line += [cell(change(row["after"], row["wls"]))]
        mark = f" {AT_FLOOR}" if at_floor(row["after"], row["after_interval"], row["floor"]) else ""
        line += [cell(f"{significant(row['floor'])}{mark}"), cell(interval(row["floor_interval"]), "num soft")]
        body.append(line)
    return table(head, body, kind="errors", label="Errors on the test runs")


AT_FLOOR = '<span class="better" title="the error reaches it">\u25cf<span class="hidden"> reached</span></span>'


def at_floor(after: float | None, bounds: Sequence[float] | None, floor: float | None) -> bool | None:
    """Whether the floor lies within the interval of the error; None where that is not known."""
    if after is None or floor is None:
        return None
    return (bounds[0] if bounds else after) <= floor


def above_floor(result: Result) -> bool:
    """Whether the error of some joint ends above its noise, as far as its interval tells."""
    return any(at_floor(row["after"], row["after_interval"], row["floor"]) is False for row in _rows(result))


def _error(value: float | None, std: float | None, kind: str = "") -> str:
    share = f'<span class="soft">{percent(ratio(value, std))}</span>' if value is not None else DASH
    return cell(f'<span class="pair"><span>{significant(value)}</span>{share}</span>', f"num {kind}".strip())
