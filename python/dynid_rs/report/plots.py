"""Figures from the samples: torque over time, friction over velocity, and whether the residual is noise."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.units import torques_told, unit_text
from dynid_rs.base.wording import is_friction
from dynid_rs.report.figures import Array, Figures, Series, label, panel, series
from dynid_rs.report.series import autocorrelation, binned_mean, envelope, thin
from dynid_rs.report.source import Signals, Source
from dynid_rs.report.text import words

# Bytes of base64 that all time plots together, and all clouds together, may take.
_TIME_BUDGET = 550_000
_CLOUD_BUDGET = 9_000
_MAX_RUNS = 4
_POINTS = (200, 3000)
_CLOUD_POINTS = (250, 1200)
_N_BINS = 60
_MAX_LAG = 2.0
_N_HISTOGRAM_BINS = 41
_TERM_COLORS = {
    "rigid_body": "green",
    "friction": "orange",
    "rotor_inertia": "purple",
    "torque_offset": "brown",
    "residual_term": "sky",
}
_SPARE_COLORS = ("yellow", "green", "purple", "sky", "orange", "brown")
BEFORE = "residual_before"
"""Column: what the declared model left, where effects were added to it."""
_TERM_WORDS = {
    "rigid_body": "rigid body",
    "residual_term": "residual term (third loop)",
    "friction_hysteresis2": "friction hysteresis (added)",  # beside the declared one
    BEFORE: "residual before",
}


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


def moving_rows(signals: Signals, j: int) -> NDArray[np.bool_]:
    """Pick the shown samples in which joint `j` moves, as its errors do; all of them in tables that do not say it."""
    moves = signals.columns.get(f"moves_{j}")
    return shown_rows(signals) if moves is None else shown_rows(signals) & (moves != 0)


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
    units = [unit_text(unit) for unit in torques_told(source.result)]
    for j in range(len(joints)):
        shown = [term for term in terms if f"{term}_{j}" in signals.columns]
        figures.add(f"time-{j}", _time_panels(j, shown, colors, before, units[j]), "time")
    return TimePlots(
        tuple(signals.run_names[run] for run in runs[:n_shown]), len(runs), terms, before, max_points, shortened
    )


def _time_panels(
    j: int, terms: Sequence[str], colors: Mapping[str, str], before: Sequence[str], unit: str
) -> list[dict[str, Any]]:
    """Torque above, what is left of it below; terms are off until they are asked for."""

    def line(term: str, color: str, width: float, *, off: bool = False) -> Series:
        more = {"y": f"{{run}}/{j}/{term}", "term": term, "width": width, "off": off}
        return series("line", "{run}/t", color, term_words(term), **more)

    torque = [line("measured", "measured", 2.6)]
    torque += [line(term, colors[term], 1.3, off=True) for term in terms]
    torque += [line("predicted", "blue", 1.3)]
    left = [line(term, "faint", 1.3) for term in before] + [line("residual", "red", 1.1)]
    return [
        panel("", label("torque", unit), torque, height=200),
        panel("time [s]", label("residual", unit), left, height=130),
    ]


def add_velocity_plots(figures: Figures, source: Source) -> tuple[int, int]:
    """Friction and residual over joint velocity, one figure per joint; most points and most samples of a joint."""
    signals, result = source.signals, source.result
    joints, most = result["joints"], 0
    max_points = int(np.clip(_CLOUD_BUDGET / len(joints), *_CLOUD_POINTS))
    units = [unit_text(unit) for unit in torques_told(result)]
    for j, joint in enumerate(joints):
        picked = np.flatnonzero(moving_rows(signals, j))
        most = max(most, picked.size)
        dq, residual = signals.columns[f"dq_{j}"][picked], signals.columns[f"residual_{j}"][picked]
        friction = _friction(signals, j)[picked]
        few = thin(picked.size, residual, max_points)
        x = figures.array(f"v/{j}/dq", dq[few])
        data = figures.array(f"v/{j}/data", (friction + residual)[few])
        left = figures.array(f"v/{j}/residual", residual[few])
        speed = label("joint velocity", unit_text(velocity_unit(result, joint)))
        above = [
            series("points", x, "cloud", "measured", y=data, size=3, quiet=True),
            _mean_line(figures, f"v/{j}/friction", dq, friction, "blue", "friction"),
        ]
        below = [
            series("points", x, "cloud", "residual", y=left, size=3, quiet=True),
            _mean_line(figures, f"v/{j}/mean", dq, residual, "red", "mean residual"),
        ]
        figures.add(
            f"velocity-{j}",
            [
                panel("", label("friction", units[j]), above, height=180),
                panel(speed, label("residual", units[j]), below, height=140),
            ],
        )
    return min(max_points, most), most


def _friction(signals: Signals, j: int) -> Array:
    """All that brakes joint `j`: a model may hold several laws of friction, as a diagnosis makes them."""
    names = [name for name in signals.columns if name.endswith(f"_{j}") and is_friction(name.removesuffix(f"_{j}"))]
    total: Array = sum((signals.columns[name] for name in names), np.zeros_like(signals.columns["t"]))
    return total


def _mean_line(figures: Figures, key: str, x: Array, y: Array, color: str, name: str) -> Series:
    centre, mean = binned_mean(x, y, _N_BINS)
    places = figures.array(key + "/x", centre)
    return series("line", places, color, name, y=figures.array(key + "/y", mean), width=2)


def add_noise_plots(figures: Figures, source: Source) -> None:
    """Autocorrelation and distribution of the residual, one figure per joint."""
    signals = source.signals
    rows = shown_rows(signals)
    units = [unit_text(unit) for unit in torques_told(source.result)]
    runs = [np.flatnonzero(rows & (signals.run == run)) for run in np.unique(signals.run[rows])]
    steps = [np.median(np.diff(signals.columns["t"][run])) for run in runs if run.size > 1]
    step = float(np.median(steps)) if steps else 1.0
    longest = max(run.size for run in runs)
    n_lags = int(np.clip(_MAX_LAG / max(step, 1e-9), 2, max(2, min(longest // 2, 400))))
    for j in range(len(source.result["joints"])):
        residual, moving = signals.columns[f"residual_{j}"], moving_rows(signals, j)
        correlation = autocorrelation([_at_rest_nothing(residual[run], moving[run]) for run in runs], n_lags)
        values = residual[moving]
        lags = figures.array("lag", np.arange(n_lags) * step)
        memory = series("line", lags, "red", "autocorrelation", y=figures.array(f"n/{j}/acf", correlation))
        panels = [panel("lag [s]", "autocorrelation", [memory], height=140, range=[-1.05, 1.05])]
        figures.add(f"noise-{j}", panels + _distribution(figures, j, values, units[j]))


def _at_rest_nothing(residual: Array, moving: NDArray[np.bool_]) -> Array:
    """A residual (n,) about its mean where the joint moves, and zero elsewhere, which adds nothing to any lag."""
    centre = float(residual[moving].mean()) if moving.any() else 0.0
    return np.where(moving, residual - centre, 0.0)


def _distribution(figures: Figures, j: int, values: Array, unit: str) -> list[dict[str, Any]]:
    std = float(values.std()) if values.size else 0.0
    if std == 0.0:
        return []
    centre = float(values.mean())
    edges = np.linspace(centre - 4.0 * std, centre + 4.0 * std, _N_HISTOGRAM_BINS + 1)
    density = np.histogram(np.clip(values, edges[0], edges[-1]), edges, density=True)[0] * std
    normal = statistics.NormalDist(centre, std)
    smooth = np.linspace(edges[0], edges[-1], 61)
    bell = np.asarray([normal.pdf(float(x)) for x in smooth]) * std
    middles = figures.array(f"n/{j}/bin", 0.5 * (edges[1:] + edges[:-1]))
    drawn = [
        series("bars", middles, "red-soft", "residual", y=figures.array(f"n/{j}/density", density)),
        series(
            "line",
            figures.array(f"n/{j}/bell/x", smooth),
            "ink",
            "normal",
            y=figures.array(f"n/{j}/bell/y", bell),
            width=1.2,
            dash=True,
        ),
    ]
    return [panel(label("residual", unit), "density \u00d7 std", drawn, height=140)]
