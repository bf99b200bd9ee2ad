"""The landing page's picture: what the tutorial's diagnosis takes off, drawn from its result.

docs/index.md shows it; it is drawn anew at every build, in the colours of light and of dark pages.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pyarrow.parquet as pq
from matplotlib.figure import Figure
from sphinx.application import Sphinx

FOUND = Path("places") / "tutorial" / "index" / "found"
INKS = {"light": ("#1f2933", "#9aa5b1", "#0b6e6e"), "dark": ("#d9dee4", "#6b7683", "#4fd1c5")}
"""Colours of words, of what was before, of what is after."""


def draw(found: Path, folder: Path, theme: str) -> None:
    """Draw what is left on the joint of the first effect in time, and the error of every joint: two files."""
    result = json.loads((found / "result.json").read_text(encoding="utf-8"))
    words, old, new = INKS[theme]
    joints, errors = result["joints"], result["rmse"]["test"]
    worst = joints.index(result["effects"][0]["joints"][0])
    table = pq.read_table(found / "residuals.parquet")
    rows = np.array(table["set"].to_pylist()) == "test"
    t = table["t"].to_numpy()[rows]
    with _axes(folder / f"in_time_{theme}.svg", 5.2, words, old) as axes:
        for column, ink in ((f"residual_before_{worst}", old), (f"residual_{worst}", new)):
            axes.plot(t - t[0], table[column].to_numpy()[rows], color=ink, linewidth=1.1)
        axes.set(xlabel="time [s]", ylabel=f"torque left on {joints[worst]} [N m]", xlim=(0, float(t[-1] - t[0])))
    place, scale = np.arange(len(joints)), 100 / np.array(errors["torque_std"])
    with _axes(folder / f"by_joint_{theme}.svg", 3.4, words, old) as axes:
        for shift, key, ink in ((-0.2, "before", old), (0.2, "after", new)):
            axes.bar(place + shift, np.array(errors[key]) * scale, 0.38, color=ink, label=key)
        axes.hlines(np.array(errors["floor"]) * scale, place - 0.42, place + 0.42, color=words, label="floor", lw=1.2)
        axes.set(xticks=place, xticklabels=[name.removeprefix("joint_") for name in joints], xlabel="joint")
        axes.set(ylabel="error, unseen run [% of torque]")
        axes.legend(frameon=False)


@contextmanager
def _axes(path: Path, width: float, words: str, lines: str) -> Iterator[Any]:
    """Axes on no ground of their own, written as a picture in the end."""
    style = {"font.size": 9, "svg.fonttype": "path", "svg.hashsalt": "dynid"}
    style |= {f"{name}.color": words for name in ("xtick", "ytick")} | {"text.color": words, "axes.labelcolor": words}
    with mpl.rc_context(style):
        figure = Figure(figsize=(width, 2.9), layout="constrained")
        axes = figure.subplots()
        yield axes
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set_color(lines)
        axes.patch.set_alpha(0)
        figure.savefig(path, transparent=True, metadata={"Date": None})


def write(app: Sphinx, failure: Exception | None) -> None:
    """Draw it beside the site's other static files."""
    if failure is None and app.builder.format == "html":
        for theme in INKS:
            draw(Path(app.doctreedir) / FOUND, Path(app.outdir) / "_static", theme)


def setup(app: Sphinx) -> dict[str, Any]:
    """Draw when everything is built."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True}
