"""An effect over the signal that it follows, drawn by matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynid_rs.base.drawing import panels
from dynid_rs.base.units import labelled
from dynid_rs.diagnosis.wording import SIGNAL_WORDS

if TYPE_CHECKING:
    from dynid_rs.diagnosis.found import FoundEffect


def plot_effect(effect: FoundEffect, ax: Any = None) -> Any:
    """`FoundEffect.plot`."""
    plot = effect.entry.get("plot")
    if not plot or not plot["x"]:
        raise ValueError(
            f"{effect.name} on {', '.join(effect.joints)} is no curve over a signal; its numbers are in parameters"
        )
    panel = panels(1, 1, ax, height=3.0)[0, 0]
    panel.plot(plot["x"], plot["partial"], ".", color="0.6", markersize=3, label="left without this effect")
    panel.plot(plot["curve_x"], plot["curve"], color="C0", label=effect.name)
    signal = plot["signal"].removesuffix(f"_{plot['joint']}")
    panel.set_xlabel(labelled(SIGNAL_WORDS.get(signal, signal.replace("_", " ")), plot["unit"]))
    panel.set_ylabel(labelled("torque", effect.torque_unit))
    panel.set_title(f"{effect.name}, {plot['joint']}", loc="left", fontsize="medium")
    panel.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
    panel.grid(visible=True, alpha=0.3, linewidth=0.6)
    panel.legend(fontsize="small", frameon=False)
    panel.margins(x=0.02)
    low, high = np.quantile(plot["partial"], [0.002, 0.998])
    span = 0.15 * (high - low)
    if span > 0:
        panel.set_ylim(min(low, min(plot["curve"])) - span, max(high, max(plot["curve"])) + span)
    return panel
