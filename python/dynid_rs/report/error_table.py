"""The error table: the page in one glance. Every text from a file goes through `esc`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.report.tables import cell, change_cell, table
from dynid_rs.report.text import DASH, breakable, esc, interval, percent, ratio, significant, unit_text

Result = Mapping[str, Any]
_STRIP_WIDTH, _STRIP_HEIGHT, _STRIP_MARGIN = 200, 24, 6


def error_table(result: Result) -> str:
    """Errors on the test runs per joint: baseline, three loops, effects where there are any, floor."""
    test, unit, joints = result["rmse"]["test"], result["torque_unit"], result["joints"]
    n = len(joints)
    stds, floors = test["torque_std"], test.get("floor") or [None] * n
    intervals = test.get("after_interval") or [None] * n
    with_effects = has_effects(result)
    scale = _strip_scale(result)
    said_unit = f"<small>{esc(unit_text(unit))}</small>"
    head = [
        "Joint",
        f"Torque std {said_unit}",
        f"Weighted least squares {said_unit}",
        f"Three loops {said_unit}",
    ]
    head += [f"With effects {said_unit}"] if with_effects else []
    head += [
        f"95 % interval {said_unit}",
        f"Floor {said_unit}",
        "Against least squares",
        "Against the floor",
        '<th scope="col" class="strip-head">Error in % of torque std' + _strip_axis(scale) + "</th>",
    ]
    rows = []
    for j, joint in enumerate(joints):
        std, wls, before, after = stds[j], test["wls"][j], test["before"][j], test["after"][j]
        row = [breakable(joint), cell(significant(std)), _error_cell(wls, std)]
        row += [_error_cell(before, std)] if with_effects else []
        row += [_error_cell(after, std, "main"), cell(interval(intervals[j]), "num soft")]
        row += [
            _error_cell(floors[j], std),
            change_cell(after, wls),
            _floor_cell(after, intervals[j], floors[j]),
        ]
        row += [cell(_strip(std, wls, after, intervals[j], floors[j], scale), "strip")]
        rows.append(row)
    return table(head, rows, kind="errors")


def has_effects(result: Result) -> bool:
    """Whether the model after differs from the three loops."""
    test = result["rmse"]["test"]
    return bool(result.get("effects")) or test["after"] != test["before"]


def at_floor(after: float | None, bounds: Sequence[float] | None, floor: float | None) -> bool | None:
    """Whether the floor lies within the interval of the error; None where that is not known."""
    if after is None or floor is None:
        return None
    return (bounds[0] if bounds else after) <= floor


def _error_cell(value: float | None, std: float | None, kind: str = "") -> str:
    share = f'<span class="soft">{percent(ratio(value, std))}</span>'
    return cell(f'<span class="pair"><span>{significant(value)}</span>{share}</span>', f"num {kind}".strip())


def _floor_cell(after: float | None, bounds: Sequence[float] | None, floor: float | None) -> str:
    reached = at_floor(after, bounds, floor)
    if reached is None or after is None or floor is None:
        return cell(DASH)
    if reached:
        return cell('<span aria-hidden="true">\u25cf</span> at the floor', "num better")
    times = ratio(after, floor)
    return cell(DASH if times is None else f"{significant(times, 2)} times")


def _strip_scale(result: Result) -> float:
    """Right end of the strips, a ratio: the largest error shown, rounded up to a readable number."""
    test = result["rmse"]["test"]
    shown = [
        share
        for key in ("wls", "after")
        for value, std in zip(test[key], test["torque_std"], strict=True)
        if (share := ratio(value, std)) is not None
    ]
    top = max(shown, default=0.1)
    steps = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0)
    return next((step for step in steps if step >= top), top)


def _strip_axis(scale: float) -> str:
    return (
        f'<span class="strip-axis" aria-hidden="true"><span>0</span><span>{percent(scale / 2)}</span>'
        f"<span>{percent(scale)}</span></span>"
    )


def _strip(
    std: float | None,
    wls: float | None,
    after: float | None,
    bounds: Sequence[float] | None,
    floor: float | None,
    scale: float,
) -> str:
    """Draw one row on a line: floor as a band, baseline hollow, model filled, interval as a bar."""

    def x(value: float) -> float:
        share = min(1.0, max(0.0, value / (std or 1.0) / scale))
        return round(_STRIP_MARGIN + share * (_STRIP_WIDTH - 2 * _STRIP_MARGIN), 1)

    if std is None or std <= 0.0:
        return ""
    zero, middle = x(0.0), _STRIP_HEIGHT / 2
    marks = [f'<line class="rule" x1="{zero}" x2="{x(scale * std)}" y1="{middle}" y2="{middle}"/>']
    if floor is not None:
        marks.append(f'<rect class="floor" x="{zero}" y="4" width="{round(x(floor) - zero, 1)}" height="16"/>')
    if wls is not None and after is not None:
        marks.append(f'<line class="link" x1="{x(wls)}" x2="{x(after)}" y1="{middle}" y2="{middle}"/>')
    if bounds is not None:
        marks.append(f'<line class="bar" x1="{x(bounds[0])}" x2="{x(bounds[1])}" y1="{middle}" y2="{middle}"/>')
    if wls is not None:
        marks.append(f'<circle class="baseline" cx="{x(wls)}" cy="{middle}" r="4"/>')
    if after is not None:
        marks.append(f'<circle class="model" cx="{x(after)}" cy="{middle}" r="4.5"/>')
    return (
        f'<svg viewBox="0 0 {_STRIP_WIDTH} {_STRIP_HEIGHT}" width="{_STRIP_WIDTH}" height="{_STRIP_HEIGHT}" '
        f'role="img" aria-label="least squares {percent(ratio(wls, std))}, model '
        f"{percent(ratio(after, std))}, "
        f'floor {percent(ratio(floor, std))}">{"".join(marks)}</svg>'
    )
