"""The landing page's picture: what the tutorial's diagnosis takes off, drawn from its result.

docs/index.md shows it; it is drawn anew at every build, in the colours of light and of dark pages.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pyarrow.parquet as pq
from matplotlib.figure import Figure
from sphinx.application import Sphinx

FOUND = Path("places") / "tutorial" / "index" / "found"
INKS = {"before_after": ("#1f2933", "#9aa5b1", "#0b6e6e"), "before_after_dark": ("#d9dee4", "#6b7683", "#4fd1c5")}
"""File: colours of words, of what was before, of what is after."""


def draw(found: Path, path: Path, inks: tuple[str, str, str]) -> None:
    """Draw what is left on the joint of the first effect in time, and the error of every joint."""
    result = json.loads((found / "result.json").read_text(encoding="utf-8"))
    words, old, new = inks
    joints, errors = result["joints"], result["rmse"]["test"]
    worst = joints.index(result["effects"][0]["joints"][0])
    table = pq.read_table(found / "residuals.parquet")
    rows = np.array(table["set"].to_pylist()) == "test"
    t = table["t"].to_numpy()[rows]
    style = {"font.size": 9, "svg.fonttype": "path", "svg.hashsalt": "dynid"}
    style |= {f"{name}.color": words for name in ("xtick", "ytick")} | {"text.color": words, "axes.labelcolor": words}
    with mpl.rc_context(style):
        figure = Figure(figsize=(8.6, 2.9), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
        for column, ink, label in ((f"residual_before_{worst}", old, "before"), (f"residual_{worst}", new, "after")):
            values = table[column].to_numpy()[rows]
            left.plot(t - t[0], values, color=ink, linewidth=1.1, label=label)
        left.set(xlabel="time [s]", ylabel=f"torque left on {joints[worst]} [N m]", xlim=(0, float(t[-1] - t[0])))
        place, scale = np.arange(len(joints)), 100 / np.array(errors["torque_std"])
        for shift, key, ink, label in ((-0.2, "before", old, "before"), (0.2, "after", new, "after")):
            right.bar(place + shift, np.array(errors[key]) * scale, 0.38, color=ink, label=label)
        right.hlines(np.array(errors["floor"]) * scale, place - 0.42, place + 0.42, color=words, label="floor", lw=1.2)
        right.set(xticks=place, xticklabels=[name.removeprefix("joint_") for name in joints], xlabel="joint")
        right.set(ylabel="error on an unseen run [% of torque]")
        right.legend(frameon=False)
        for axes in (left, right):
            axes.spines[["top", "right"]].set_visible(False)
            axes.spines[["left", "bottom"]].set_color(old)
            axes.patch.set_alpha(0)
        figure.savefig(path, transparent=True, metadata={"Date": None})


def write(app: Sphinx, failure: Exception | None) -> None:
    """Draw it beside the site's other static files."""
    if failure is None and app.builder.format == "html":
        for name, inks in INKS.items():
            draw(Path(app.doctreedir) / FOUND, Path(app.outdir) / "_static" / f"{name}.svg", inks)


def setup(app: Sphinx) -> dict[str, Any]:
    """Draw when everything is built."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True}
