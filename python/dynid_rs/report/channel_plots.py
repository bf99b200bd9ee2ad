"""Curves of what the torque channel does to all torques of a joint: it is late or early, or shows too much.

Their fit cannot be undone column by column, so that ``result.json`` holds no points; the table of residuals does:

    a delay d      shows  -d dtau/dt  too much,     over the rate of the torque,
    a gain 1 + g   shows   g tau      too much,     over the torque itself,

and a point is that and what the model leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.units import torques_told
from dynid_rs.report.plots import moving_rows
from dynid_rs.report.series import thin
from dynid_rs.report.source import Signals, Source

Result = Mapping[str, Any]
Array = NDArray[np.float64]

N_POINTS, N_BINS, LEAST_ROWS = 300, 30, 60
SIZES = {"torque_delay": "delay", "torque_gain": "gain"}
"""Kinds that are drawn here, and the parameter that says their size."""


def with_channel_plots(source: Source) -> dict[str, Any]:
    """Return the result with a plot for every delay and gain of a torque channel that has none."""
    effects = [_drawn(source, entry) for entry in source.result.get("effects") or []]
    return {**source.result, "effects": effects}


def _drawn(source: Source, entry: Result) -> dict[str, Any]:
    size = next((p for p in entry.get("parameters") or [] if p["name"] == SIZES.get(entry["kind"])), None)
    if entry.get("plot") or size is None:
        return dict(entry)
    joints = source.result["joints"]
    curves = [(j, *_curve(source.signals, j, entry["kind"], size["value"])) for j in map(joints.index, entry["joints"])]
    # Of several joints the one on which it stands out most of what is left.
    curves = [curve for curve in curves if curve[1].size >= LEAST_ROWS and np.ptp(curve[1]) > 0]
    if not curves:
        return dict(entry)
    j, over, slope, left = max(curves, key=lambda c: float(np.std(c[2] * c[1])) / max(float(np.std(c[3])), 1e-300))
    unit = torques_told(source.result)[j]
    return {**entry, "plot": _plot(over, slope, left, size, joints[j], unit, entry["kind"])}


def _curve(signals: Signals, j: int, kind: str, size: float) -> tuple[Array, float, Array]:
    """Signal that it is drawn over, torque per signal, and what the model leaves."""
    rows = moving_rows(signals, j)
    tau, left, t = (signals.columns[name] for name in (f"predicted_{j}", f"residual_{j}", "t"))
    if kind == "torque_gain":
        return tau[rows] / (1.0 + size), size, left[rows]
    rates, parts = [], []
    for run in np.unique(signals.run[rows]):
        at = np.flatnonzero(rows & (signals.run == run))
        if at.size < 3:
            continue
        step = np.diff(t[at])
        even = np.abs(step - np.median(step)) < 0.1 * np.median(step)  # no rate across a gap
        rates.append(((tau[at][2:] - tau[at][:-2]) / (t[at][2:] - t[at][:-2]))[even[1:] & even[:-1]])
        parts.append(left[at][1:-1][even[1:] & even[:-1]])
    empty = np.empty(0)
    return np.concatenate([*rates, empty]), -size, np.concatenate([*parts, empty])


def _plot(
    over: Array, slope: float, left: Array, size: Result, joint: str, torque_unit: str, kind: str
) -> dict[str, Any]:
    order = np.argsort(over, kind="stable")
    bins = np.array_split(order, N_BINS)
    middle = np.array([float(over[b].mean()) for b in bins])
    partial = left + slope * over
    few = thin(over.size, partial, N_POINTS)
    plot = {
        "signal": f"tau_rate_{joint}" if kind == "torque_delay" else f"tau_motor_{joint}",
        "unit": f"{torque_unit}/s" if kind == "torque_delay" else torque_unit,
        "joint": joint,
        "x": over[few].tolist(),
        "partial": partial[few].tolist(),
        "curve_x": middle.tolist(),
        "curve": (slope * middle).tolist(),
        "mean": [float(partial[b].mean()) for b in bins],
    }
    if size.get("interval"):
        ends = np.array(size["interval"]) * (slope / size["value"] if size["value"] else 1.0)
        both = np.outer(ends, middle)
        plot |= {"curve_low": both.min(axis=0).tolist(), "curve_high": both.max(axis=0).tolist()}
    return plot
