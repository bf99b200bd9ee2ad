"""Figures of effects and of what is left: the measured data, the effect's own curve, its interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dynid_rs.base.units import torques_told
from dynid_rs.report.axes import axis_labels, readable
from dynid_rs.report.figures import Figures, panel, place, series
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import esc, interval, significant

Result = Mapping[str, Any]

MOST_ROWS = 12
"""Rows of the table behind a curve."""


def curve(figures: Figures, key: str, plot: Result | None, result: Result, name: str, where: str = "") -> str:
    """Add the figure of one effect; HTML of its place with the table behind it, or nothing without a plot.

    `name` of what is drawn, as plain text; `where`: the joint, where a family has several.
    """
    if not plot or not (plot["x"] or plot.get("curve_x")):
        return ""
    units = dict(zip(result["joints"], torques_told(result), strict=True))
    plot = readable(plot, units.get(str(plot.get("joint")), str(result["torque_unit"])))
    x, y = axis_labels(plot, result["joints"])
    drawn = [*_points(figures, key, plot), *_line(figures, key, plot)]
    figures.add(key, [panel(x, y, drawn, height=250)])
    label = f"{name}{f' on {where}' if where else ''}: {y} over {x}. {_summary(plot)}"
    return place(key, esc(label), numbers=False) + _table(plot, x, y)


def _points(figures: Figures, key: str, plot: Result) -> list[dict[str, Any]]:
    n = min(len(plot["x"]), len(plot["partial"]))
    if n == 0:
        return []
    x, y = np.asarray(plot["x"][:n], dtype=float), np.asarray(plot["partial"][:n], dtype=float)
    order = np.argsort(x, kind="stable")
    at, values = figures.array(f"{key}/x", x[order]), figures.array(f"{key}/y", y[order])
    return [series("points", at, "cloud", "measured", y=values, size=4, quiet=True)]


def _line(figures: Figures, key: str, plot: Result) -> list[dict[str, Any]]:
    if not plot.get("curve_x") or not plot.get("curve"):
        return []
    m = min(len(plot["curve_x"]), len(plot["curve"]))
    at = np.asarray(plot["curve_x"][:m], dtype=float)
    order = np.argsort(at, kind="stable")

    def array(name: str) -> str:
        return figures.array(f"{key}/{name}", np.asarray(plot[name][:m], dtype=float)[order])

    x, drawn = figures.array(f"{key}/curve/x", at[order]), []
    if len(plot.get("curve_low") or []) >= m <= len(plot.get("curve_high") or []):
        drawn.append(series("band", x, "blue-soft", "interval", low=array("curve_low"), high=array("curve_high")))
    if len(plot.get("mean") or []) >= m:
        drawn.append(series("points", x, "ink", "measured", y=array("mean"), size=5))
    drawn.append(series("line", x, "blue", "effect", y=array("curve"), width=2.5))
    return drawn


def _summary(plot: Result) -> str:
    values = plot.get("curve") or plot["partial"]
    over = plot.get("curve_x") or plot["x"]
    return (
        f"From {significant(min(values))} to {significant(max(values))}, "
        f"between {significant(min(over))} and {significant(max(over))}."
    )


def _table(plot: Result, x: str, y: str) -> str:
    """Some points of the curve as numbers."""
    at, values = plot.get("curve_x") or [], plot.get("curve") or []
    if not at:
        return ""
    n = min(len(at), len(values))
    rows = sorted({round(k * (n - 1) / max(1, min(n, MOST_ROWS) - 1)) for k in range(min(n, MOST_ROWS))})
    means = plot.get("mean")
    bounds = [plot.get("curve_low"), plot.get("curve_high")]
    body = [
        [
            f'<th scope="row" class="num">{significant(at[k])}</th>',
            *([cell(significant(means[k]))] if means else []),
            cell(significant(values[k]), "num main"),
            *([cell(interval([bounds[0][k], bounds[1][k]]), "num soft")] if bounds[0] and bounds[1] else []),
        ]
        for k in rows
    ]
    head = [esc(x), *(["Measured, mean"] if means else []), f"Effect: {esc(y)}"]
    head += ["95 % interval"] if bounds[0] and bounds[1] else []
    shown = table(head, body, kind="tight", label="Numbers of this chart")
    return f'<details class="numbers"><summary>Numbers of this chart</summary>{shown}</details>'


def key(plots: Sequence[Result | None]) -> str:
    """HTML of what the marks in the curves mean, for all of them at once."""
    known = [plot for plot in plots if plot]
    marks = []
    if any(plot["x"] for plot in known):
        marks.append('<li><i class="dot cloud"></i>measured less the rest of the model, some samples</li>')
    if any(plot.get("mean") for plot in known):
        marks.append('<li><i class="dot"></i>their mean</li>')
    marks.append('<li><i class="stroke"></i>the effect</li>')
    if any(plot.get("curve_low") for plot in known):
        marks.append('<li><i class="band"></i>95 % interval</li>')
    return f'<ul class="key" aria-label="Key of the curves">{"".join(marks)}</ul>'
