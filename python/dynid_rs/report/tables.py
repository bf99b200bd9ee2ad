"""The tables of the report, as HTML. Every text from a file goes through `esc`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.report.text import (
    DASH,
    PLUS_MINUS,
    count,
    esc,
    interval,
    percent,
    ratio,
    significant,
    unit_text,
    value_with_error,
    with_unit,
    words,
)

Result = Mapping[str, Any]
_LONG_NAME = 44
_STRIP_WIDTH, _STRIP_HEIGHT, _STRIP_MARGIN = 200, 24, 6


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, caption: str = "", kind: str = "") -> str:
    """HTML table from cells that are HTML already; the first cell of a row is its heading.

    A cell that starts with ``<td`` or ``<th`` is taken as a whole element.
    """
    body = "".join(f"<tr>{_cells(row)}</tr>\n" for row in rows)
    title = f"<caption>{caption}</caption>" if caption else ""
    headings = "".join(cell if cell.startswith("<th") else f'<th scope="col">{cell}</th>' for cell in head)
    return (
        f'<div class="scroll" tabindex="0"><table class="{kind}">{title}<thead><tr>{headings}</tr></thead>\n'
        f"<tbody>\n{body}</tbody></table></div>"
    )


def _cells(row: Sequence[str]) -> str:
    first, *rest = row
    head = first if first.startswith(("<td", "<th")) else f'<th scope="row">{first}</th>'
    return head + "".join(cell if cell.startswith("<td") else f"<td>{cell}</td>" for cell in rest)


def error_table(result: Result) -> str:
    """Errors on the test runs per joint: baseline, three loops, effects where there are any, floor."""
    test, unit, joints = result["rmse"]["test"], result["torque_unit"], result["joints"]
    n = len(joints)
    stds, floors = test["torque_std"], test.get("floor") or [None] * n
    intervals = test.get("after_interval") or [None] * n
    with_effects = has_effects(result)
    scale = _strip_scale(result)
    said_unit = f"<small>{esc(unit_text(unit))}</small>"
    head = ["Joint", f"Torque std {said_unit}", f"Weighted least squares {said_unit}", f"Three loops {said_unit}"]
    head += [f"With effects {said_unit}"] if with_effects else []
    head += [f"95 % interval {said_unit}", f"Floor {said_unit}", "Against least squares", "Above the floor",
             '<th scope="col" class="strip-head">Error in % of torque std' + _strip_axis(scale) + "</th>"]
    rows = []
    for j, joint in enumerate(joints):
        std, wls, before, after = stds[j], test["wls"][j], test["before"][j], test["after"][j]
        row = [esc(joint), f'<td class="num">{significant(std)}</td>', _error_cell(wls, std)]
        row += [_error_cell(before, std)] if with_effects else []
        row += [_error_cell(after, std, "main"), f'<td class="num soft">{interval(intervals[j])}</td>']
        row += [_error_cell(floors[j], std), _change_cell(after, wls), _floor_cell(after, intervals[j], floors[j])]
        row += [f'<td class="strip">{_strip(std, wls, after, intervals[j], floors[j], scale)}</td>']
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
    return (
        f'<td class="num {kind}"><span class="pair"><span>{significant(value)}</span>'
        f'<span class="soft">{percent(ratio(value, std))}</span></span></td>'
    )


def _change_cell(after: float | None, wls: float | None) -> str:
    share = ratio(after, wls)
    if share is None:
        return f'<td class="num">{DASH}</td>'
    kind, sign, word = ("better", "\u25bc", "less") if share < 1.0 else ("worse", "\u25b2", "more")
    if abs(share - 1.0) < 0.005:
        return '<td class="num soft">same</td>'
    return f'<td class="num {kind}"><span aria-hidden="true">{sign}</span> {percent(abs(share - 1.0))} {word}</td>'


def _floor_cell(after: float | None, bounds: Sequence[float] | None, floor: float | None) -> str:
    reached = at_floor(after, bounds, floor)
    if reached is None or after is None or floor is None:
        return f'<td class="num">{DASH}</td>'
    if reached:
        return '<td class="num better"><span aria-hidden="true">\u25cf</span> at the floor</td>'
    excess = ratio(after - floor, floor)
    return f'<td class="num">{DASH if excess is None else percent(excess, signed=True)}</td>'


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
    """Draw one row's errors on a line: floor as a filled band, baseline hollow, model filled, interval as a bar."""

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
        f'role="img" aria-label="least squares {percent(ratio(wls, std))}, model {percent(ratio(after, std))}, '
        f'floor {percent(ratio(floor, std))}">{"".join(marks)}</svg>'
    )


def effects_table(result: Result) -> str:
    """What was found beyond the declared model."""
    unit = result["torque_unit"]
    rows = []
    for rank, effect in enumerate(result["effects"], 1):
        parameters = "<br>".join(
            f"{esc(p['name'])} = {esc(with_unit(significant(p['value']), p.get('unit')))}"
            f' <span class="soft">({interval(p.get("interval"))})</span>'
            for p in effect.get("parameters") or []
        )
        ties = "<br>".join(
            esc(words(tie["kind"])) + (f" ({esc(', '.join(tie['joints']))})" if tie.get("joints") else "")
            for tie in effect.get("ties") or []
        )
        rows.append(
            [esc(words(effect["kind"])), esc(", ".join(effect["joints"])), parameters or DASH,
             _before_after(effect, result["joints"]), significant(effect.get("p_value"), 2), ties or DASH,
             f'<td class="num">{significant(effect.get("rank") or rank, 1)}</td>']
        )  # fmt: skip
    said = f"<small>{esc(unit_text(unit))}</small>"
    return table(["Effect", "Joints", "Parameters (95 % interval)", f"Test error {said}", "p", "Cannot be told from", "Rank"],
                 rows)  # fmt: skip


def _before_after(effect: Result, all_joints: Sequence[str]) -> str:
    """Before and after per joint of the effect; the arrays follow either all joints or the effect's own."""
    before, after = effect.get("rmse_test_before") or [], effect.get("rmse_test_after") or []
    names = all_joints if len(before) == len(all_joints) else effect["joints"]
    return "<br>".join(
        f'<span class="soft">{esc(joint)}</span> {significant(old)} \u2192 <b>{significant(new)}</b>'
        for joint, old, new in zip(names, before, after, strict=False)
        if joint in effect["joints"]
    ) or DASH


def parameter_table(parameters: Sequence[Result], group_key: str, group_title: str) -> str:
    """Value, error and interval of each parameter; sortable, grey where the interval holds zero."""
    head = [f'<th scope="col"><button type="button">{title}</button></th>'
            for title in ("Parameter", group_title, "Value", "Unit", "Std error", "95 % interval", "Rel. error")]  # fmt: skip
    rows = []
    for p in parameters:
        value, error = value_with_error(p["value"], p.get("std_error"))
        relative = ratio(p.get("std_error"), abs(p["value"]))
        kind = "unsure" if holds_zero(p) else ""
        bounds = p.get("interval")
        rows.append(
            [f'<th scope="row" class="{kind}">{_name(p["name"])}</th>', f'<td class="{kind}">{esc(p.get(group_key) or DASH)}</td>',
             _sortable(value, p["value"], kind), f'<td class="{kind}">{esc(unit_text(p.get("unit")))}</td>',
             _sortable(PLUS_MINUS + error if p.get("std_error") is not None else DASH, p.get("std_error"), kind),
             _sortable(interval(bounds), bounds[0] if bounds else None, kind),
             _sortable(percent(relative), relative, kind)]
        )  # fmt: skip
    return table(head, rows, kind="sortable")


def holds_zero(parameter: Result) -> bool:
    """Whether the 95 % interval of a parameter contains zero."""
    bounds = parameter.get("interval")
    return bounds is not None and bounds[0] <= 0.0 <= bounds[1]


def _name(name: str) -> str:
    """Sums of many link parameters are shown by their first terms and unfold on a click."""
    if len(name) <= _LONG_NAME:
        return esc(name)
    head = name[:_LONG_NAME].rpartition(" ")[0] or name[:_LONG_NAME]
    rest = name[len(head) :]
    return f'<details class="name"><summary>{esc(head)} \u2026</summary>{esc(rest.strip())}</details>'


def _sortable(text: str, value: float | None, kind: str) -> str:
    key = "" if value is None else f' data-value="{float(value)!r}"'
    return f'<td class="num {kind}"{key}>{text}</td>'


def findings_table(findings: Sequence[Result]) -> str:
    """What is known about the data, the worst first."""
    order = {"error": 0, "warning": 1, "info": 2}
    signs = {"error": "\u2716 error", "warning": "\u25b2 warning", "info": "\u2139 info"}
    rows = []
    for f in sorted(findings, key=lambda finding: order.get(finding["severity"], 1)):
        severity = f["severity"] if f["severity"] in order else "warning"
        place = [f.get("file"), f.get("column")]
        span = f.get("rows") or []
        if len(span) == 2:
            place.append(f"rows {count(span[0])} to {count(span[1])}")
        size = "" if f.get("value") is None else with_unit(significant(f["value"]), f.get("unit"))
        rows.append(
            [f'<th scope="row" class="badge {severity}">{signs[severity]}</th>',
             f'<td class="text">{esc(f["message"])}</td>',
             f'<td class="place">{"<br>".join(esc(part) for part in place if part)}</td>',
             f'<td class="num">{esc(size)}</td>', f'<td class="soft">{esc(words(f.get("code") or ""))}</td>']
        )  # fmt: skip
    return table(["Severity", "What", "Where", "Size", "Kind"], rows)


def residual_table(result: Result, residual: Result, kept: Sequence[bool]) -> str:
    """Test error without and with the third loop, per joint."""
    unit, joints = result["torque_unit"], result["joints"]
    unknown = [None] * len(joints)
    without, used = residual.get("rmse_test_without") or unknown, residual.get("rmse_test_with") or unknown
    components = residual.get("n_components") or unknown
    said = f"<small>{esc(unit_text(unit))}</small>"
    rows = [
        [esc(joint), f'<td class="num">{significant(without[j])}</td>', f'<td class="num">{significant(used[j])}</td>',
         _change_cell(used[j], without[j]), f'<td class="num">{count(components[j])}</td>',
         '<td class="better word">\u25cf kept</td>' if kept[j] else '<td class="soft word">\u25cb left out</td>']
        for j, joint in enumerate(joints)
    ]  # fmt: skip
    return table(["Joint", f"Without {said}", f"With {said}", "Change", "Components", "Decision"], rows)


def delay_table(result: Result, delay: Result) -> str:
    """Delay between the two encoder channels of each joint, in milliseconds where it is given in seconds."""
    factor, unit = (1e3, "ms") if delay.get("unit", "s") == "s" else (1.0, delay["unit"])
    bounds = delay.get("interval") or [None] * len(result["joints"])
    rows = [
        [esc(joint), f'<td class="num">{significant(None if value is None else factor * value)}</td>',
         f'<td class="num soft">{interval(pair and [factor * bound for bound in pair])}</td>']
        for joint, value, pair in zip(result["joints"], delay["value"], bounds, strict=True)
    ]  # fmt: skip
    said = f"<small>{esc(unit_text(unit))}</small>"
    return table(["Joint", f"Delay {said}", f"95 % interval {said}"], rows)


def shape_table(shapes: Sequence[Result]) -> str:
    """Where friction turns from one direction to the other."""
    rows = [
        [esc(s["joint"]), f'<td class="num">{significant(s.get("velocity_threshold"))}</td>',
         f'<td class="num">{significant(s.get("transition_width"))}</td>', esc(unit_text(s.get("unit")))]
        for s in shapes
    ]  # fmt: skip
    return table(["Joint", "Velocity threshold", "Transition width", "Unit"], rows)


def unexplained_table(result: Result) -> str:
    """What the model leaves, and the signals it depends on."""
    rows = [
        [esc(u["joint"]), f'<td class="num">{percent(u.get("share"))}</td>',
         f'<td class="text">{"; ".join(_dependence(d) for d in u.get("depends_on") or []) or "no single signal"}</td>']
        for u in result["unexplained"]
    ]  # fmt: skip
    return table(["Joint", "Share of the error", "Depends on"], rows)


def _dependence(depends: Result) -> str:
    strength = "" if depends.get("strength") is None else f' <span class="soft">({significant(depends["strength"], 2)})</span>'
    return f"{esc(depends['signal'])}{strength}"
