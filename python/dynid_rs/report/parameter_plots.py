"""Figures from the result: how well each parameter is known, and how the loops settled."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dynid_rs.report.figures import Figures, panel, series
from dynid_rs.report.tables import holds_zero
from dynid_rs.report.text import ratio, short_names

_COLORS = ("blue", "orange", "green", "purple", "red", "sky", "brown")


def add_parameter_plot(figures: Figures, key: str, parameters: Sequence[Mapping[str, Any]], group_key: str) -> bool:
    """Dot and whisker of each parameter relative to its value; False where none has an interval."""
    known = [p for p in parameters if _relative(p)]
    if not known:
        return False
    drawn = []
    for unsure in (False, True):
        at = [k for k, p in enumerate(known) if holds_zero(p) == unsure]
        if not at:
            continue
        ends = np.array([_relative(known[k]) for k in at])
        name, color = ("cannot be told from zero", "faint") if unsure else ("known", "blue")
        x = figures.array(f"{key}/{name}/x", np.array(at, dtype=float))
        low, high = (figures.array(f"{key}/{name}/{end}", ends[:, side]) for side, end in enumerate(("low", "high")))
        drawn.append(series("whiskers", x, color, name, low=low, high=high, width=1.0 if unsure else 2.0))
        middle = figures.array(f"{key}/{name}/y", np.full(len(at), 100.0))
        drawn.append(series("points", x, color, name, y=middle, size=6, quiet=True))
    groups = [str(p.get(group_key) or "") for p in known]
    starts = [k for k, group in enumerate(groups) if k == 0 or group != groups[k - 1]]
    middles = [(a + b - 1) / 2 for a, b in zip(starts, [*starts[1:], len(groups)], strict=True)]
    names = short_names([groups[k] for k in starts])
    step = -(-len(names) // 10)
    ticks = [[at, _short(name)] for at, name in list(zip(middles, names, strict=True))[::step]]
    sizes = {"range": [-55, 255], "xrange": [-0.8, len(known) - 0.2]}
    figures.add(key, [panel("", "% of the estimate", drawn, height=220, ticks=ticks, **sizes)])
    return True


def _relative(p: Mapping[str, Any]) -> list[float]:
    """Interval in % of the value, low end first; empty where that says nothing."""
    if not p.get("interval") or p["value"] == 0.0:
        return []
    ends = sorted(100.0 * (bound / p["value"]) for bound in p["interval"])
    return ends if all(map(math.isfinite, ends)) else []


def _short(name: str) -> str:
    return name if len(name) <= 14 else name[:13] + "\u2026"


def add_history_plot(figures: Figures, result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Training error after every loop of every pass, relative to the first; colour and joint of every line drawn."""
    steps = [
        (f"{step.get('iteration') or k}", after[loop])
        for k, step in enumerate(result.get("history") or [], 1)
        for after in [step.get("rmse_train_after") or {}]
        for loop in ("friction", "links", "residual")
        if after.get(loop)
    ]
    if len(steps) < 2:
        return []
    x, drawn, key = figures.array("history/x", np.arange(len(steps), dtype=float)), [], []
    for j, joint in enumerate(result["joints"]):
        errors = [errors[j] for _, errors in steps]
        shares = [share for error in errors if (share := ratio(error, errors[0])) is not None]
        if len(shares) < len(errors):
            continue
        color = _COLORS[j % len(_COLORS)]
        y = figures.array(f"history/{j}", 100.0 * np.array(shares))
        drawn.append(series("line", x, color, joint, y=y, dash=bool(j // len(_COLORS) % 2)))
        key.append((color, joint))
    passes = [k for k, (name, _) in enumerate(steps) if k == 0 or name != steps[k - 1][0]]
    ticks = [[k, steps[k][0]] for k in passes[:: -(-len(passes) // 12)]]
    if drawn:
        figures.add("history", [panel("pass", "error [% of the first]", drawn, height=220, ticks=ticks)])
    return key
