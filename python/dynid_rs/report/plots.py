"""Figures from the samples: torque over time, friction over velocity, and whether the residual is noise."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.report.figures import Array, Figure, Figures
from dynid_rs.report.series import autocorrelation, binned_mean, envelope, thin
from dynid_rs.report.source import Signals, Source
from dynid_rs.report.text import plot_text, unit_text, words

# Bytes of base64 that all time plots together, and all clouds together, may take.
_TIME_BUDGET = 2_000_000
_CLOUD_BUDGET = 14_000
_MAX_RUNS = 6
_POINTS = (600, 4000)
_CLOUD_POINTS = (250, 1500)
_N_BINS = 60
_MAX_LAG = 2.0
_N_HISTOGRAM_BINS = 41
_TERM_COLORS = {
    "rigid_body": "$green",
    "friction": "$orange",
    "rotor_inertia": "$purple",
    "torque_offset": "$brown",
    "residual_term": "$sky",
}
_SPARE_COLORS = ("$yellow", "$green", "$purple", "$sky", "$orange", "$brown")
BEFORE = "residual_before"
"""Column: what the declared model left, where effects were added to it."""
_TERM_WORDS = {"rigid_body": "rigid body", "residual_term": "residual term (third loop)", BEFORE: "residual before"}


@dataclass(frozen=True)
class TimePlots:
    """What the time plots show, for the words around them."""

    run_names: tuple[str, ...]
    n_runs: int
    terms: tuple[str, ...]
    before: tuple[str, ...]
    n_points: int
    shortened: bool


def terms_of(signals: Signals, n_joints: int) -> tuple[str, ...]:
    """Names of the torque terms in the table that are not zero throughout, in the order of its columns."""
    other = {"measured", "predicted", "residual", BEFORE, "q", "dq", "moves"}
    names: dict[str, bool] = {}
    for column, values in signals.columns.items():
        name, _, index = column.rpartition("_")
        if index.isdecimal() and int(index) < n_joints and name not in other and bool(values.any()):
            names[name] = True
    return tuple(names)


def term_words(term: str) -> str:
    """Name of a term as people say it."""
    return _TERM_WORDS.get(term, words(term))


def term_colors(terms: Sequence[str]) -> dict[str, str]:
    """Colour of each term; the ones that are not built in take turns."""
    spare = iter(_SPARE_COLORS * (1 + len(terms) // len(_SPARE_COLORS)))
    return {term: _TERM_COLORS.get(term) or next(spare) for term in terms}


def shown_rows(signals: Signals) -> NDArray[np.bool_]:
    """Pick the samples of the test runs; all samples where there is no test run."""
    return signals.is_test if signals.is_test.any() else np.ones_like(signals.is_test)


def velocity_unit(result: Mapping[str, Any], joint: str) -> str:
    """Return rad/s, or what the friction shape of this joint says (m/s for a prismatic joint)."""
    shapes = (result.get("parameters") or {}).get("friction_shape") or []
    return next((s["unit"] for s in shapes if s["joint"] == joint and s.get("unit")), "rad/s")


def add_time_plots(figures: Figures, source: Source) -> TimePlots:
    """Measured and predicted torque, each term and the residual over time, one figure per joint."""
    signals, joints = source.signals, source.result["joints"]
    rows = shown_rows(signals)
    runs = list(dict.fromkeys(signals.run[rows].tolist()))
    terms = terms_of(signals, len(joints))
    before = (BEFORE,) if f"{BEFORE}_0" in signals.columns else ()
    names = ("measured", "predicted", *terms, *before, "residual")
    n_shown = min(len(runs), _MAX_RUNS)
    fitting = _TIME_BUDGET / (16 / 3 * n_shown * (len(joints) * len(names) + 1))
    max_points = int(np.clip(fitting, *_POINTS))
    shortened = False
    for r, run in enumerate(runs[:n_shown]):
        picked = np.flatnonzero(rows & (signals.run == run))
        t = signals.columns["t"][picked]
        keys = [(j, name) for j in range(len(joints)) for name in names if f"{name}_{j}" in signals.columns]
        values = np.column_stack([signals.columns[f"{name}_{j}"][picked] for j, name in keys])
        shortened |= t.size > max_points
        # Time since the start: float32 keeps no milliseconds of a Unix time.
        short_t, short = envelope(t - t[0], values, max_points)
        figures.array(f"{r}/t", short_t)
        for k, (j, name) in enumerate(keys):
            figures.array(f"{r}/{j}/{name}", short[:, k])
    colors = term_colors(terms)
    for j in range(len(joints)):
        shown = [term for term in terms if f"{term}_{j}" in signals.columns]
        figures.add(
            f"time-{j}", _time_traces(j, shown, colors, before), _time_layout(source.result["torque_unit"]), "time"
        )
    return TimePlots(
        tuple(signals.run_names[run] for run in runs[:n_shown]), len(runs), terms, before, max_points, shortened
    )


def _time_traces(j: int, terms: Sequence[str], colors: Mapping[str, str], before: Sequence[str]) -> list[Figure]:
    looks = [("measured", "measured", {"color": "$measured", "width": 2.6}, "y", True)]
    looks += [(term, term_words(term), {"color": colors[term], "width": 1.3}, "y", False) for term in terms]
    looks += [("predicted", "predicted", {"color": "$blue", "width": 1.3}, "y", True)]
    looks += [(term, term_words(term), {"color": "$faint", "width": 1.3}, "y2", True) for term in before]
    looks += [("residual", "residual", {"color": "$red", "width": 1.1}, "y2", True)]
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": "@{run}/t",
            "y": f"@{{run}}/{j}/{key}",
            "meta": key,
            "text": "",
            "name": plot_text(name),
            "line": line,
            "yaxis": axis,
            "visible": visible,
            "hovertemplate": "%{y:.4~g}",
        }
        for key, name, line, axis, visible in looks
    ]


def _time_layout(torque_unit: str) -> Figure:
    unit = plot_text(unit_text(torque_unit))
    return {
        "hovermode": "x unified",
        "xaxis": {
            "anchor": "y2",
            "title": {"text": "time [s]"},
            "hoverformat": ".2f",
            "unifiedhovertitle": {"text": "%{x} s"},
        },
        "yaxis": {"domain": [0.36, 1.0], "title": {"text": f"torque [{unit}]"}},
        "yaxis2": {"domain": [0.0, 0.27], "title": {"text": f"residual [{unit}]"}, "nticks": 4},
    }


def add_velocity_plots(figures: Figures, source: Source) -> tuple[int, int]:
    """Friction and residual over joint velocity, one figure per joint; returns points shown and samples."""
    signals, result = source.signals, source.result
    joints = result["joints"]
    picked = np.flatnonzero(shown_rows(signals))
    max_points = int(np.clip(_CLOUD_BUDGET / len(joints), *_CLOUD_POINTS))
    unit = plot_text(unit_text(result["torque_unit"]))
    for j, joint in enumerate(joints):
        dq, residual = signals.columns[f"dq_{j}"][picked], signals.columns[f"residual_{j}"][picked]
        friction = signals.columns.get(f"friction_{j}", np.zeros_like(signals.columns["t"]))[picked]
        few = thin(picked.size, residual, max_points)
        x = figures.array(f"v/{j}/dq", dq[few])
        cloud = {
            "type": "scatter",
            "mode": "markers",
            "x": x,
            "hoverinfo": "skip",
            "marker": {"size": 3, "color": "$measured", "opacity": 0.55},
        }
        speed = f"{plot_text(unit_text(velocity_unit(result, joint)))}"
        hover = "%{y:.3~g} " + unit + " at %{x:.3~g} " + speed + "<extra></extra>"
        traces: list[Figure] = [
            {**cloud, "y": figures.array(f"v/{j}/data", (friction + residual)[few])},
            _mean_line(figures, f"v/{j}/friction", dq, friction, "$blue", hover),
            {**cloud, "y": figures.array(f"v/{j}/residual", residual[few]), "yaxis": "y2"},
            {**_mean_line(figures, f"v/{j}/mean", dq, residual, "$red", hover), "yaxis": "y2"},
        ]
        layout = {
            "xaxis": {"anchor": "y2", "title": {"text": f"joint velocity [{speed}]"}, "zeroline": True},
            "yaxis": {"domain": [0.42, 1.0], "title": {"text": f"friction [{unit}]"}},
            "yaxis2": {"domain": [0.0, 0.32], "title": {"text": f"residual [{unit}]"}, "nticks": 4},
        }
        figures.add(f"velocity-{j}", traces, layout)
    return min(max_points, picked.size), picked.size


def _mean_line(figures: Figures, key: str, x: Array, y: Array, color: str, hover: str) -> Figure:
    centre, mean = binned_mean(x, y, _N_BINS)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": figures.array(key + "/x", centre),
        "hovertemplate": hover,
        "y": figures.array(key + "/y", mean),
        "line": {"color": color, "width": 2},
    }


def add_noise_plots(figures: Figures, source: Source) -> None:
    """Autocorrelation and distribution of the residual, one figure per joint."""
    signals = source.signals
    rows = shown_rows(signals)
    unit = plot_text(unit_text(source.result["torque_unit"]))
    runs = [np.flatnonzero(rows & (signals.run == run)) for run in np.unique(signals.run[rows])]
    steps = [np.median(np.diff(signals.columns["t"][run])) for run in runs if run.size > 1]
    step = float(np.median(steps)) if steps else 1.0
    longest = max(run.size for run in runs)
    n_lags = int(np.clip(_MAX_LAG / max(step, 1e-9), 2, max(2, min(longest // 2, 400))))
    for j in range(len(source.result["joints"])):
        residual = signals.columns[f"residual_{j}"]
        correlation = autocorrelation([residual[run] for run in runs], n_lags)
        values = residual[rows]
        traces = [
            {
                "type": "scatter",
                "mode": "lines",
                "x": figures.array("lag", np.arange(n_lags) * step),
                "fill": "tozeroy",
                "y": figures.array(f"n/{j}/acf", correlation),
                "line": {"color": "$red", "width": 1.5},
                "fillcolor": "$red-soft",
                "hovertemplate": "%{y:.2f} after %{x:.2f} s<extra></extra>",
            },
            *_distribution(figures, j, values, unit),
        ]
        layout = {
            "xaxis": {"domain": [0.0, 0.46], "title": {"text": "lag [s]"}, "nticks": 4},
            "yaxis": {"range": [-1.05, 1.05], "title": {"text": "autocorrelation"}, "zeroline": True},
            "xaxis2": {
                "domain": [0.58, 1.0],
                "anchor": "y2",
                "title": {"text": f"residual [{unit}]"},
                "nticks": 4,
            },
            "yaxis2": {"anchor": "x2", "showticklabels": False, "rangemode": "tozero", "title": {"text": ""}},
            "bargap": 0.0,
        }
        figures.add(f"noise-{j}", traces, layout)


def _distribution(figures: Figures, j: int, values: Array, unit: str) -> list[Figure]:
    std = float(values.std())
    if std == 0.0:
        return []
    centre = float(values.mean())
    edges = np.linspace(centre - 4.0 * std, centre + 4.0 * std, _N_HISTOGRAM_BINS + 1)
    density = np.histogram(np.clip(values, edges[0], edges[-1]), edges, density=True)[0]
    normal = statistics.NormalDist(centre, std)
    smooth = np.linspace(edges[0], edges[-1], 61)
    bell = np.asarray([normal.pdf(float(x)) for x in smooth])
    return [
        {
            "type": "bar",
            "x": figures.array(f"n/{j}/bin", 0.5 * (edges[1:] + edges[:-1])),
            "xaxis": "x2",
            "yaxis": "y2",
            "y": figures.array(f"n/{j}/density", density),
            "marker": {"color": "$red-soft", "line": {"width": 0}},
            "hovertemplate": "around %{x:.3~g} " + unit + "<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": figures.array(f"n/{j}/bell/x", smooth),
            "xaxis": "x2",
            "yaxis": "y2",
            "y": figures.array(f"n/{j}/bell/y", bell),
            "line": {"color": "$ink", "width": 1.2, "dash": "dot"},
            "hoverinfo": "skip",
        },
    ]
