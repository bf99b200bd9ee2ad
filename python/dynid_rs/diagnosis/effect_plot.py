"""An effect over the signal that it follows, drawn by matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynid_rs.base.drawing import panels
from dynid_rs.base.units import labelled
from dynid_rs.base.wording import QUANTITY_WORDS
from dynid_rs.diagnosis.wording import SIGNAL_WORDS

if TYPE_CHECKING:
    from dynid_rs.diagnosis.found import FoundEffect


def plot_effect(effect: FoundEffect, ax: Any = None) -> Any:
    """`FoundEffect.plot`."""
    plot = effect.entry.get("plot")
    if not plot or not plot["curve_x"]:
        raise ValueError(
            f"{effect.name} on {', '.join(effect.joints)} is no curve over a signal; its numbers are in parameters"
        )
    panel = panels(1, 1, ax, height=3.0)[0, 0]
    panel.plot(plot["x"], plot["partial"], ".", color="0.6", markersize=3, label="left without this effect")
    if "curve_low" in plot:
        low, high = plot["curve_low"], plot["curve_high"]
        panel.fill_between(plot["curve_x"], low, high, alpha=0.25, linewidth=0, color="C0", label="95 % interval")
    panel.plot(plot["curve_x"], plot["curve"], color="C0", label=effect.name)
    signal = plot["signal"].removesuffix(f"_{plot['joint']}")
    panel.set_xlabel(labelled(SIGNAL_WORDS.get(signal, signal.replace("_", " ")), plot["unit"]))
    quantity = QUANTITY_WORDS.get(plot.get("quantity") or "torque", "torque")
    panel.set_ylabel(labelled(quantity, plot.get("value_unit") or effect.torque_unit))
    panel.set_title(f"{effect.name}, {plot['joint']}", loc="left", fontsize="medium")
    panel.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
    panel.grid(visible=True, alpha=0.3, linewidth=0.6)
    panel.legend(fontsize="small", frameon=False)
    panel.margins(x=0.02)
    shown = [*np.quantile(plot["partial"] or [0.0], [0.002, 0.998]), min(plot["curve"]), max(plot["curve"])]
    span = 0.15 * (max(shown) - min(shown))
    if span > 0:  # a few points far away would press the curve flat
        panel.set_ylim(min(shown) - span, max(shown) + span)
    return panel
