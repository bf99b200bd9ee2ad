"""Figures from the result: how well each parameter is known, and how the loops settled."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.report.figures import Figures
from dynid_rs.report.tables import holds_zero
from dynid_rs.report.text import plot_text, ratio, significant, with_unit


def add_parameter_plot(figures: Figures, key: str, parameters: Sequence[Mapping[str, Any]], group_key: str) -> bool:
    """Dot and whisker of each parameter relative to its value; False where none has an interval."""
    known = [p for p in parameters if _relative(p)]
    if not known:
        return False
    traces = []
    for unsure in (False, True):
        at = [k for k, p in enumerate(known) if holds_zero(p) == unsure]
        ends = [_relative(known[k]) for k in at]
        color = "$faint" if unsure else "$blue"
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": at,
                "y": [100] * len(at),
                "hovertemplate": "%{text}<extra></extra>",
                "text": [_parameter_hover(known[k], group_key) for k in at],
                "marker": {"color": color, "size": 6, "symbol": "circle-open" if unsure else "circle"},
                "error_y": {
                    "type": "data",
                    "symmetric": False,
                    "array": [high - 100 for _, high in ends],
                    "arrayminus": [100 - low for low, _ in ends],
                    "color": color,
                    "thickness": 1.0 if unsure else 1.6,
                    "width": 3,
                },
            }
        )
    groups = [str(p.get(group_key) or "") for p in known]
    starts = [k for k, group in enumerate(groups) if k == 0 or group != groups[k - 1]]
    middles = [(a + b - 1) / 2 for a, b in zip(starts, [*starts[1:], len(groups)], strict=True)]
    layout = {
        "xaxis": {
            "tickvals": middles,
            "ticktext": {"text": [plot_text(_short(groups[k])) for k in starts]},
            "range": [-0.8, len(known) - 0.2],
            "showgrid": False,
        },
        "yaxis": {
            "range": [-55, 255],
            "title": {"text": "% of the estimate"},
            "zeroline": True,
            "tickvals": [0, 50, 100, 150, 200],
        },
        "shapes": [
            {
                "type": "line",
                "x0": k - 0.5,
                "x1": k - 0.5,
                "yref": "paper",
                "y0": 0,
                "y1": 1,
                "line": {"color": "$grid", "width": 1},
            }
            for k in starts[1:]
        ],
    }
    figures.add(key, traces, layout)
    return True


def _relative(p: Mapping[str, Any]) -> list[float]:
    """Interval in % of the value, low end first; empty where that says nothing."""
    if not p.get("interval") or p["value"] == 0.0:
        return []
    ends = sorted(100.0 * (bound / p["value"]) for bound in p["interval"])
    return ends if all(map(math.isfinite, ends)) else []


def _short(name: str) -> str:
    return name if len(name) <= 22 else name[:21] + "\u2026"


def _parameter_hover(p: Mapping[str, Any], group_key: str) -> str:
    low, high = p["interval"]
    name = p["name"] if len(p["name"]) <= 60 else p["name"][:58] + "\u2026"
    group = f"{plot_text(p[group_key])}<br>" if p.get(group_key) else ""
    value = with_unit(significant(p["value"], 4), p.get("unit"))
    return f"{group}<b>{plot_text(name)}</b><br>{plot_text(value)}<br>{significant(low)} to {significant(high)}"


def add_history_plot(figures: Figures, result: Mapping[str, Any]) -> bool:
    """Training error after every loop of every pass, relative to the first; False with fewer than two."""
    steps = [
        (f"{step.get('iteration') or k}: {loop}", after[loop])
        for k, step in enumerate(result.get("history") or [], 1)
        for after in [step.get("rmse_train_after") or {}]
        for loop in ("friction", "links", "residual")
        if after.get(loop)
    ]
    if len(steps) < 2:
        return False
    colors = ("$blue", "$orange", "$green", "$purple", "$red", "$sky", "$brown")
    traces = []
    for j, joint in enumerate(result["joints"]):
        errors = [errors[j] for _, errors in steps]
        shares = [share for error in errors if (share := ratio(error, errors[0])) is not None]
        if len(shares) < len(errors):
            continue
        traces.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "x": [name for name, _ in steps],
                "y": [100.0 * share for share in shares],
                "name": plot_text(_short(joint)),
                "showlegend": True,
                "marker": {"size": 5},
                "line": {
                    "color": colors[j % len(colors)],
                    "width": 1.5,
                    "dash": ("solid", "dash")[j // len(colors) % 2],
                },
                "hovertemplate": "%{y:.1f} %",
            }
        )
    layout = {
        "hovermode": "x unified",
        "showlegend": True,
        "xaxis": {"title": {"text": "pass: loop"}, "type": "category"},
        "yaxis": {"title": {"text": "training error [% of the first]"}},
    }
    if traces:
        figures.add("history", traces, layout)
    return bool(traces)
