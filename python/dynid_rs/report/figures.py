"""Figures of the page: what stands on which axis, and the arrays that they share.

A figure is a list of panels over one another, a panel a list of series. Colours are names that ``charts.js`` looks up
in the style sheet, so that they follow the light or dark scheme; arrays are names that stand once, as base64, in a
pool. Texts are drawn on a canvas or set as text, never as markup.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
Series = dict[str, Any]
Panel = dict[str, Any]


def series(kind: str, x: str, color: str, name: str, **more: Any) -> Series:
    """One series: `kind` is line, points, band, bars or whiskers; `x`, `y`, `low`, `high` are names of arrays."""
    return {"kind": kind, "x": x, "color": color, "name": name, **more}


def panel(x: str, y: str, drawn: list[Series], *, height: int, **more: Any) -> Panel:
    """One panel: labels of its axes with their units, its series, its height in pixels."""
    return {"x": x, "y": y, "series": drawn, "height": height, **more}


def label(quantity: str, unit: str) -> str:
    """Axis label: a quantity and its unit, which may be none."""
    return f"{quantity} [{unit}]" if unit else quantity


@dataclass
class Figures:
    """Figures of the page, and the arrays they share."""

    figures: dict[str, dict[str, Any]] = field(default_factory=dict)
    arrays: dict[str, str] = field(default_factory=dict)

    def array(self, key: str, values: Array) -> str:
        """Put `values` into the pool as little-endian float32 and return their name."""
        with np.errstate(over="ignore"):
            short = np.asarray(values, dtype="<f4")
        self.arrays[key] = base64.b64encode(short.tobytes()).decode("ascii")
        return key

    def add(self, key: str, panels: list[Panel], kind: str = "") -> None:
        """Add one figure; `kind` ``"time"`` links its zoom with the others of that kind."""
        self.figures[key] = {"panels": panels, "kind": kind}

    def to_json(self) -> str:
        """JSON that cannot end the script element it stands in."""
        text = json.dumps({"figures": self.figures, "arrays": self.arrays}, allow_nan=False, separators=(",", ":"))
        return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def place(key: str, aria_label: str, *, kind: str = "", numbers: bool = True) -> str:
    """HTML of where a figure is drawn, what it reads at the cursor, and its numbers; `aria_label` is escaped."""
    table = (
        f'<details class="numbers" data-of="{key}"><summary>Numbers of this chart</summary></details>'
        if numbers
        else ""
    )
    return (
        f'<div class="plot {kind}" data-figure="{key}" tabindex="0" role="group" aria-roledescription="chart" '
        f'aria-label="{aria_label}"></div>\n<output class="readout" aria-live="off"></output>{table}'
    )
