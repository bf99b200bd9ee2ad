"""The tables of the report, as HTML. Every text from a file goes through `esc`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base.units import torques_said, torques_told, unit_text
from dynid_rs.report.text import (
    DASH,
    PLUS_MINUS,
    breakable,
    change,
    count,
    esc,
    interval,
    percent,
    ratio,
    significant,
    value_with_error,
    with_unit,
    words,
)

Result = Mapping[str, Any]
_LONG_NAME = 44


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, caption: str = "", kind: str = "", label: str = "Table"
) -> str:
    """HTML table from cells that are HTML already; the first cell of a row is its heading.

    A cell that starts with ``<td`` or ``<th`` is taken as a whole element. What is wider than the page scrolls within
    its own box, which the keyboard reaches under the name `label`.
    """
    body = "".join(f"<tr>{_cells(row)}</tr>\n" for row in rows)
    title = f"<caption>{caption}</caption>" if caption else ""
    headings = "".join(cell if cell.startswith("<th") else f'<th scope="col">{cell}</th>' for cell in head)
    return (
        f'<div class="scroll" tabindex="0" role="group" aria-label="{label}"><table class="{kind}">'
        f"{title}<thead><tr>{headings}</tr></thead>\n"
        f"<tbody>\n{body}</tbody></table></div>"
    )


def _cells(row: Sequence[str]) -> str:
    first, *rest = row
    head = first if first.startswith(("<td", "<th")) else f'<th scope="row">{first}</th>'
    return head + "".join(html if html.startswith("<td") else f"<td>{html}</td>" for html in rest)


def cell(html: str, kind: str = "num") -> str:
    """Table cell from HTML; `kind` names its style."""
    return f'<td class="{kind}">{html}</td>'


def change_cell(after: float | None, wls: float | None) -> str:
    """Table cell: by how much the error fell or rose, in a number, a sign and a colour."""
    share = ratio(after, wls)
    if share is None:
        return cell(DASH)
    if abs(share - 1.0) < 0.005:
        return cell("same", "num soft")
    kind, sign = ("better", "\u25bc") if share < 1.0 else ("worse", "\u25b2")
    return cell(f'<span aria-hidden="true">{sign}</span> {change(after, wls)}', f"num {kind}")


ADDED = " (added)"
"""Behind the name of a coefficient that is no declared one: of what is known, or was found."""


def stages_table(result: Result, stages: Result) -> str:
    """Test error per joint after each loop, in parts of the torque's standard deviation."""
    size = result["rmse"]["test"]["torque_std"]
    loops = ("wls", "friction", "links", "residual")
    rows = []
    for j, joint in enumerate(result["joints"]):
        errors = [stages[loop][j] for loop in loops]
        shares = [cell(percent(ratio(error, size[j]))) for error in errors]
        rows.append([esc(joint), *shares, change_cell(errors[-1], errors[0])])
    head = ["Joint", "Weighted least squares", "1: friction", "2: link dynamics", "3: residual", "All three"]
    return table(head, rows, caption="Error over the torque\u2019s standard deviation", label="Errors loop by loop")


def parameter_table(parameters: Sequence[Result], group_key: str, group_title: str) -> str:
    """Value, error and interval of each parameter; sortable, grey where the interval holds zero."""
    head = [
        f'<th scope="col"><button type="button">{title}</button></th>'
        for title in ("Parameter", group_title, "Value", "Unit", "Std error", "95 % interval", "Rel. error")
    ]
    rows = []
    for p in parameters:
        value, error = value_with_error(p["value"], p.get("std_error"))
        relative = ratio(p.get("std_error"), abs(p["value"]))
        kind = "unsure" if holds_zero(p) else ""
        bounds = p.get("interval")
        rows.append(
            [
                f'<th scope="row" class="{kind}">{_name(p["name"])}{ADDED if p.get("declared") is False else ""}</th>',
                cell(esc(p.get(group_key) or DASH), kind),
                _sortable(value, p["value"], kind),
                cell(esc(unit_text(p.get("unit"))), kind),
                _sortable(PLUS_MINUS + error if p.get("std_error") is not None else DASH, p.get("std_error"), kind),
                _sortable(interval(bounds), bounds[0] if bounds else None, kind),
                _sortable(percent(relative), relative, kind),
            ]
        )
    return table(head, rows, kind="sortable", label="Parameters")


def holds_zero(parameter: Result) -> bool:
    """Whether the 95 % interval of a parameter contains zero."""
    bounds = parameter.get("interval")
    return bounds is not None and bounds[0] <= 0.0 <= bounds[1]


def _name(name: str) -> str:
    """Show sums of many link parameters by their first terms; they unfold on a click."""
    if len(name) <= _LONG_NAME:
        return esc(name)
    head = name[:_LONG_NAME].rpartition(" ")[0] or name[:_LONG_NAME]
    rest = name[len(head) :]
    return f'<details class="name"><summary>{esc(head)} \u2026</summary>{esc(rest.strip())}</details>'


def _sortable(text: str, value: float | None, kind: str) -> str:
    key = "" if value is None else f' data-value="{float(value)!r}"'
    return f'<td class="num {kind}"{key}>{text}</td>'


def findings_table(findings: Sequence[Result]) -> str:
    """List what is known about the data, the worst first."""
    order = {"error": 0, "warning": 1, "info": 2}
    signs = {"error": "\u2716 error", "warning": "\u25b2 warning", "info": "\u2139 info"}
    rows = []
    for f in sorted(findings, key=lambda finding: order.get(finding["severity"], 1)):
        severity = f["severity"] if f["severity"] in order else "warning"
        place = [f.get("file"), f.get("column")]
        span = f.get("rows") or []
        if len(span) == 2:  # half-open from 0; people count from 1, as the sentence does
            first, last = count(span[0] + 1), count(span[1])
            place.append(f"row {last}" if first == last else f"rows {first} to {last}")
        size = "" if f.get("value") is None else with_unit(significant(f["value"]), f.get("unit"))
        rows.append(
            [
                f'<th scope="row" class="badge {severity}">{signs[severity]}</th>',
                cell(esc(f["message"]), "text"),
                cell("<br>".join(esc(part) for part in place if part), "place"),
                cell(esc(size)),
                cell(esc(words(f.get("code") or "")), "soft"),
            ]
        )
    return table(["Severity", "What", "Where", "Size", "Kind"], rows, label="Findings")


def residual_table(result: Result, residual: Result, kept: Sequence[bool]) -> str:
    """Test error without and with the third loop, per joint."""
    unit, joints = torques_said(torques_told(result)), result["joints"]
    unknown = [None] * len(joints)
    without, used = residual.get("rmse_test_without") or unknown, residual.get("rmse_test_with") or unknown
    components = residual.get("n_components") or unknown
    said = f"<small>{esc(unit_text(unit))}</small>"
    rows = [
        [
            breakable(joint),
            cell(significant(without[j])),
            cell(significant(used[j])),
            change_cell(used[j], without[j]),
            cell(count(components[j])),
            cell("\u25cf kept", "better word") if kept[j] else cell("\u25cb left out", "soft word"),
        ]
        for j, joint in enumerate(joints)
    ]
    head = ["Joint", f"Without {said}", f"With {said}", "Change", "Components", "Decision"]
    return table(head, rows, kind="tight", label="Third loop")


def delay_table(result: Result, delay: Result) -> str:
    """Delay between the two encoder channels of each joint, in milliseconds where it is given in seconds."""
    factor, unit = (1e3, "ms") if delay.get("unit", "s") == "s" else (1.0, delay["unit"])
    bounds = delay.get("interval") or [None] * len(result["joints"])
    rows = [
        [
            breakable(joint),
            cell(significant(None if value is None else factor * value)),
            cell(interval(pair and [factor * bound for bound in pair]), "num soft"),
        ]
        for joint, value, pair in zip(result["joints"], delay["value"], bounds, strict=True)
    ]
    said = f"<small>{esc(unit_text(unit))}</small>"
    return table(["Joint", f"Delay {said}", f"95 % interval {said}"], rows, label="Delays")


def shape_table(shapes: Sequence[Result]) -> str:
    """Where friction turns from one direction to the other, and how; what no joint's law has is left out."""
    thresholds = any(s.get("velocity_threshold") for s in shapes)
    sharpness = any(s.get("sharpness") for s in shapes)
    rows = [
        [
            esc(s["joint"]),
            *([cell(significant(s.get("velocity_threshold")))] if thresholds else []),
            cell(significant(s.get("transition_width"))),
            esc(unit_text(s.get("unit"))),
            *([cell(significant(s.get("sharpness")))] if sharpness else []),
        ]
        for s in shapes
    ]
    head = ["Joint", *(["Velocity threshold"] if thresholds else []), "Transition width", "Unit"]
    head += ["Sharpness"] if sharpness else []
    return table(head, rows, label="Shape of friction")
