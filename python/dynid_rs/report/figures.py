"""Figures of the page as plain plotly traces and layouts, and the arrays they share.

They are dictionaries: importing ``plotly.graph_objects`` costs more than the whole report. Colours are names
that start with ``$`` and are looked up in the style sheet by ``page.js``, so that they follow the light or
dark scheme; arrays are names that start with ``@`` and stand once, as base64, in a pool. Texts from files may
only stand under ``text`` and ``name``, which ``page.js`` never looks up, and are escaped, because plotly
reads markup in them.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
Figure = dict[str, Any]


@dataclass
class Figures:
    """Figures of the page, and the arrays they share."""

    figures: dict[str, Figure] = field(default_factory=dict)
    arrays: dict[str, str] = field(default_factory=dict)

    def array(self, key: str, values: Array) -> str:
        """Put `values` into the pool as little-endian float32 and return their name."""
        with np.errstate(over="ignore"):
            short = np.asarray(values, dtype="<f4")
        self.arrays[key] = base64.b64encode(short.tobytes()).decode("ascii")
        return "@" + key

    def add(self, key: str, traces: list[Figure], layout: Figure, kind: str = "") -> None:
        """Add one figure; `kind` ``"time"`` links its zoom with the others of that kind."""
        self.figures[key] = {"traces": traces, "layout": layout, "kind": kind}

    def to_json(self) -> str:
        """JSON that cannot end the script element it stands in."""
        text = json.dumps({"figures": self.figures, "arrays": self.arrays}, allow_nan=False, separators=(",", ":"))
        return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
