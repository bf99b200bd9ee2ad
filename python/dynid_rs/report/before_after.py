"""Errors before and after a diagnosis, joint by joint, with intervals and the floor. Every text goes through `esc`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.report.error_table import at_floor
from dynid_rs.report.tables import cell, change_cell, table
from dynid_rs.report.text import breakable, esc, interval, percent, ratio, significant, unit_text

Result = Mapping[str, Any]
_WIDTH, _HEIGHT, _MARGIN = 240, 34, 6
_BAR = 9


def before_after_table(result: Result) -> str:
    """One row per joint: errors on the test runs before and after, interval, floor, change, and all of it as bars."""
    test, unit, n = result["rmse"]["test"], result["torque_unit"], len(result["joints"])
    unknown = [None] * n
    bounds, floors = test.get("after_interval") or unknown, test.get("floor") or unknown
    changes = test.get("change_interval") or unknown
    floor_bounds, before_bounds = test.get("floor_interval") or unknown, test.get("before_interval") or unknown
    scale = _scale(test, bounds)
    said = f"<small>{esc(unit_text(unit))}</small>"
    head = [
        "Joint",
        f"Weighted least squares {said}",
        f"Before {said}",
        f"After {said}",
        f"95 % interval {said}",
        f"Floor {said}",
        "Change <small>95 % interval</small>",
        f'<th scope="col" class="strip-head wide">Error, in % of the error before{_axis(scale)}</th>',
    ]
    rows = []
    for j, joint in enumerate(result["joints"]):
        std, before, after, floor = test["torque_std"][j], test["before"][j], test["after"][j], floors[j]
        rows.append(
            [
                breakable(joint),
                _pair(test["wls"][j], std, None),
                _pair(before, std, before_bounds[j]),
                _pair(after, std, None, "main"),
                cell(interval(bounds[j]), "num soft"),
                _floor(after, bounds[j], floor, floor_bounds[j]),
                change_cell(after, before, changes[j]),
                cell(_bars(before, after, bounds[j], floor, scale), "strip"),
            ]
        )
    return table(head, rows, kind="errors")


def key() -> str:
    """HTML: what the marks in the bars mean."""
    marks = (
        ('<rect class="before" y="5" width="18" height="8"/>', "before: the declared model"),
        ('<rect class="after" y="5" width="18" height="8"/>', "after: with the effects"),
        ('<line class="whisker" x1="1" x2="17" y1="9" y2="9"/>', "its 95 % interval"),
        ('<rect class="floor" width="12" height="18"/><line class="floor-line" x1="12" x2="12" y2="18"/>', "floor"),
    )
    items = "".join(
        f'<li><svg width="18" height="18" viewBox="0 0 18 18" aria-hidden="true">{mark}</svg> {word}</li>'
        for mark, word in marks
    )
    return f'<ul class="key" aria-label="Key">{items}</ul>'


def _pair(value: float | None, std: float | None, bounds: Sequence[float] | None, kind: str = "") -> str:
    """Table cell: an error and its share of the torque's spread; its interval where the mouse rests."""
    title = "" if bounds is None else f' title="95 % interval {esc(interval(bounds))}"'
    share = f'<span class="soft">{percent(ratio(value, std))}</span>'
    return cell(f'<span class="pair"{title}><span>{significant(value)}</span>{share}</span>', f"num {kind}".strip())


def _floor(
    after: float | None, bounds: Sequence[float] | None, floor: float | None, floor_bounds: Sequence[float] | None
) -> str:
    title = "" if floor_bounds is None else f' title="95 % interval {esc(interval(floor_bounds))}"'
    mark = ' <span class="better" title="the error reaches it">\u25cf</span>' if at_floor(after, bounds, floor) else ""
    return cell(f"<span{title}>{significant(floor)}</span>{mark}", "num soft")


def _scale(test: Result, bounds: Sequence[Sequence[float] | None]) -> float:
    """Right end of the bars over the error before: 1, or what the worst joint needs."""
    shares = [
        share
        for before, after, pair in zip(test["before"], test["after"], bounds, strict=True)
        for value in (after, pair[1] if pair else None)
        if (share := ratio(value, before)) is not None
    ]
    return next((step for step in (1.0, 1.2, 1.5) if step >= max([0.0, *shares])), 2.0)


def _axis(scale: float) -> str:
    marks = "".join(f"<span>{percent(scale * part)}</span>" for part in (0.5, 1.0))
    return f'<span class="strip-axis" aria-hidden="true"><span>0</span>{marks}</span>'


def _bars(
    before: float | None, after: float | None, bounds: Sequence[float] | None, floor: float | None, scale: float
) -> str:
    """Draw the row: floor as a band behind, before above, after with its interval below."""
    if before is None or before <= 0.0:
        return ""

    def x(value: float) -> float:
        share = min(1.0, max(0.0, value / before / scale))
        return round(_MARGIN + share * (_WIDTH - 2 * _MARGIN), 1)

    zero, marks = x(0.0), []
    if floor is not None:
        marks.append(f'<rect class="floor" x="{zero}" y="0" width="{round(x(floor) - zero, 1)}" height="{_HEIGHT}"/>')
    top, low = 5, _HEIGHT - 5 - _BAR
    marks.append(f'<rect class="before" x="{zero}" y="{top}" width="{round(x(before) - zero, 1)}" height="{_BAR}"/>')
    if after is not None:
        width = round(x(after) - zero, 1)
        marks.append(f'<rect class="after" x="{zero}" y="{low}" width="{width}" height="{_BAR}"/>')
    if bounds is not None:
        y = low + _BAR / 2
        left, right = x(bounds[0]), x(bounds[1])
        marks.append(f'<line class="whisker" x1="{left}" x2="{right}" y1="{y}" y2="{y}"/>')
        marks += [f'<line class="whisker" x1="{end}" x2="{end}" y1="{y - 4}" y2="{y + 4}"/>' for end in (left, right)]
    if floor is not None:
        marks.append(f'<line class="floor-line" x1="{x(floor)}" x2="{x(floor)}" y1="0" y2="{_HEIGHT}"/>')
    label = f"after {percent(ratio(after, before))} of before, floor {percent(ratio(floor, before))}"
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" height="{_HEIGHT}" role="img" '
        f'aria-label="{label}">{"".join(marks)}</svg>'
    )
