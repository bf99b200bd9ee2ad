"""What is left over what is expected, joint by joint over all runs: bins that hide no extreme, and marks at changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.clock import is_wall_clock
from dynid_rs.report.figures import Figures, panel, place, series
from dynid_rs.report.health_source import Array, Episode, Health, HealthRun
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import breakable, capital, esc, percent, plural, significant, typeset

EXPECTED = 1.96
"""Of rows of a normal distribution 95 % lie within so many deviations."""
_BUDGET = 700_000
"""Bytes of base64 that the curves of all joints may take together."""
_BINS = (200, 3000)
_MOST_MARKED = 60
"""More beginnings of runs would hide the curves."""
_FAR, _NEAR = 40.0, 8.0
"""Where something lies further out than the one [deviations], a second panel shows what lies within the other."""
_LARGEST = 1e9
_TABLE_ROWS = 20
COLORS = {"named": "red", "settled": "green", "withdrawn": "faint"}


@dataclass(frozen=True)
class Axis:
    """One axis of time for all runs.

    Attributes
    ----------
    order : tuple of int
        Runs as they stand on it; those without a row do not.
    offsets : tuple of float
        What is added to the times of each run [s].
    unit : float
        Seconds in its unit.
    label : str
        With the unit.
    word : str
        The unit.
    is_clock : bool
        Whether it shows the time of day.
    """

    order: tuple[int, ...]
    offsets: tuple[float, ...]
    unit: float
    label: str
    word: str
    is_clock: bool

    def at(self, run: int, t: Any) -> Any:
        """Where times of a run stand."""
        return (t + self.offsets[run]) / self.unit


def axis_of(runs: Sequence[HealthRun], row: float) -> Axis:
    """The clock on the wall where every run has it and none begins before another ends; else one after the other."""
    drawn = [r for r, run in enumerate(runs) if len(run.t)]
    by_clock = sorted(drawn, key=lambda r: float(runs[r].t[0]))
    ends = [(float(runs[r].t[0]), float(runs[r].t[-1])) for r in by_clock]
    if ends and all(map(is_wall_clock, (t for pair in ends for t in pair))) and _apart(ends):
        first, span = ends[0][0], ends[-1][1] - ends[0][0]
        whole, unit, word = (86400.0, 3600.0, "h") if span >= 7200.0 else (3600.0, 60.0, "min")
        zero = math.floor(first / whole) * whole
        label = f"time [{word} since {datetime.fromtimestamp(zero, UTC):%Y-%m-%d %H:%M} UTC]"
        return Axis(tuple(by_clock), (-zero,) * len(runs), unit, label, word, True)
    offsets, total = [], 0.0
    for run in runs:
        offsets.append(total + row - float(run.t[0]) if len(run.t) else total)
        total += float(run.t[-1] - run.t[0]) + row if len(run.t) else 0.0
    unit, word = (1.0, "s") if total < 600.0 else (60.0, "min") if total < 18000.0 else (3600.0, "h")
    label = f"time, run after run [{word}]" if len(drawn) > 1 else f"time since the start [{word}]"
    return Axis(tuple(drawn), tuple(offsets), unit, label, word, False)


def _apart(ends: Sequence[tuple[float, float]]) -> bool:
    return all(before[1] <= after[0] for before, after in pairwise(ends))


@dataclass(frozen=True, eq=False)
class Bins:
    """All runs in bins of equally many rows, NaN where a run begins.

    Attributes
    ----------
    x : ndarray (m,)
        In the axis' unit, never falling.
    mean, low, high : ndarray (m, n_joints)
        Of the rows in which a joint was watched; NaN where there is none.
    between : ndarray of bool (m,)
        Where a run begins.
    rows : int
        Most rows in a bin.
    begins : tuple of float
        Where runs after the first begin.
    """

    x: Array
    mean: Array
    low: Array
    high: Array
    between: NDArray[np.bool_]
    rows: int
    begins: tuple[float, ...]


def binned(runs: Sequence[HealthRun], axis: Axis, row: float, most: int) -> Bins:
    """Put at most about `most` bins on the axis, of every run at least one."""
    n = sum(len(run.t) for run in runs)
    parts: list[tuple[Array, ...]] = []
    begins, largest = [], 1
    for r in axis.order:
        run = runs[r]
        m = min(len(run.t), max(1, round(most * len(run.t) / n)))
        edges = np.linspace(0, len(run.t), m + 1).astype(np.intp)
        first, last = edges[:-1], edges[1:] - 1
        if parts:
            begins.append(float(axis.at(r, run.t[0] - row)))
            parts.append((np.array(begins[-1:]), *[np.full((1, run.ratio.shape[1]), np.nan)] * 3))
        largest = max(largest, int(np.diff(edges).max()))
        parts.append((axis.at(r, 0.5 * (run.t[first] + run.t[last])), *_reduced(run.ratio, first)))
    x, mean, low, high = (np.concatenate(part) for part in zip(*parts, strict=True))
    between = np.concatenate([np.full(part[0].size, k % 2 == 1) for k, part in enumerate(parts)])
    return Bins(np.maximum.accumulate(x), mean, low, high, between, largest, tuple(begins))


def _reduced(ratio: Array, first: Any) -> tuple[Array, Array, Array]:
    """Mean, smallest and largest of rows from each `first` to the next; NaN are passed over."""
    short = np.clip(ratio, -_LARGEST, _LARGEST)
    known = np.isfinite(short)
    number = np.add.reduceat(known, first, axis=0, dtype=np.float64)
    total = np.add.reduceat(np.where(known, short, 0.0), first, axis=0)
    mean = np.divide(total, number, out=np.full(total.shape, np.nan), where=number > 0)
    return mean, np.fmin.reduceat(short, first, axis=0), np.fmax.reduceat(short, first, axis=0)


def trends(figures: Figures, health: Health, found: Sequence[Episode]) -> str:
    """Add one chart per joint; HTML of their key and places, or of why there is none."""
    axis = axis_of(health.runs, health.row)
    if not axis.order:
        return "<p>No run is long enough for one row.</p>"
    n = len(health.joints)
    bins = binned(health.runs, axis, health.row, int(np.clip(_BUDGET / (16 * n), *_BINS)))
    figures.array("h/x", bins.x)
    band = np.full(bins.x.size, EXPECTED)
    band[bins.between] = np.nan
    figures.array("h/band/low", -band)
    figures.array("h/band/high", band)
    marked = bins.begins if len(bins.begins) <= _MOST_MARKED else ()
    begins = [{"x": x, "color": "axis", "dash": True} for x in marked]
    cells = ""
    for j, joint in enumerate(health.joints):
        own = [one for one in found if "load" in (one.now.kind, one.named.kind) or joint in _places(one)]
        marks = [*begins, *(mark for one in own for mark in _marks(one, axis))]
        figures.add(f"trend-{j}", _panels(figures, bins, j, marks, axis.label), "time")
        cells += _cell(health, bins, axis, j, own)
    return f'{_key(bins, found)}<div class="grid long">{cells}</div>'


def _places(one: Episode) -> tuple[str, str]:
    return one.named.joint, one.now.joint


def _marks(one: Episode, axis: Axis) -> list[dict[str, Any]]:
    said = [one.named] if one.outcome in (None, one.named) else [one.named, one.now]
    return [
        {"x": float(axis.at(one.run, change.t)), "color": COLORS[change.said], "text": str(one.number)}
        for change in said
    ]


def _panels(figures: Figures, bins: Bins, j: int, marks: list[dict[str, Any]], label: str) -> list[dict[str, Any]]:
    mean = figures.array(f"h/{j}/mean", bins.mean[:, j])
    drawn = [series("band", "h/x", "blue-soft", "expected", low="h/band/low", high="h/band/high", quiet=True)]
    if bins.rows > 1:
        low, high = figures.array(f"h/{j}/low", bins.low[:, j]), figures.array(f"h/{j}/high", bins.high[:, j])
        drawn.append(series("whiskers", "h/x", "cloud", "rows from", low=low, high=high, width=1.2))
    drawn += [
        series("line", "h/x", "blue", "expected", y=f"h/band/{end}", width=0.8, dash=True, quiet=True)
        for end in ("low", "high")
    ]
    # Points beside the line: a bin between two gaps has no line.
    drawn.append(series("line", "h/x", "blue", "mean" if bins.rows > 1 else "left over expected", y=mean, width=1.3))
    drawn.append(series("points", "h/x", "blue", "mean", y=mean, size=2.5, quiet=True))
    least, most = _ends(bins, j)
    reach = 0.06 * (most - least)
    wide = [least - reach, most + reach]
    if max(-least, most) < _FAR:
        return [panel(label, "left / expected", drawn, height=170, range=wide, marks=marks)]
    return [
        panel("", "left / expected", drawn, height=150, range=wide, marks=marks),
        panel(label, "closer", drawn, height=150, range=[-_NEAR, _NEAR], marks=marks),
    ]


def _ends(bins: Bins, j: int) -> tuple[float, float]:
    """Range of a chart, which holds every row and somewhat more than the band."""
    known = bins.low[np.isfinite(bins.low[:, j]), j], bins.high[np.isfinite(bins.high[:, j]), j]
    return float(np.min(known[0], initial=-3.0)), float(np.max(known[1], initial=3.0))


def _cell(health: Health, bins: Bins, axis: Axis, j: int, own: Sequence[Episode]) -> str:
    joint, known = health.joints[j], np.isfinite(bins.mean[:, j])
    rows = sum(len(run.t) for run in health.runs)
    part = sum(float(run.watched[j]) * len(run.t) for run in health.runs) / max(rows, 1)
    said = f"watched {percent(part)}, {plural(len(own), 'change') if own else 'no change'}"
    spoken = f"{joint}: what is left over what is expected, over {axis.label}; {said}"
    if not known.any():
        return (
            f"<figure><figcaption><h3>{breakable(joint)}</h3><span>not watched</span></figcaption>"
            '<p class="note">It never moved as the model was trained to.</p></figure>\n'
        )
    least, most = float(bins.low[known, j].min()), float(bins.high[known, j].max())
    spoken += f"; rows from {significant(least)} to {significant(most)}"
    return (
        f"<figure><figcaption><h3>{breakable(joint)}</h3><span>{said}, from {significant(least)} to "
        f"{significant(most)}</span></figcaption>"
        f"{place(f'trend-{j}', esc(spoken), kind='wide', numbers=False)}{_numbers(bins, axis, j)}</figure>\n"
    )


def _numbers(bins: Bins, axis: Axis, j: int) -> str:
    """Some bins as a table, the extreme ones among them."""
    known = np.flatnonzero(np.isfinite(bins.mean[:, j]))
    some = known[np.linspace(0, known.size - 1, min(known.size, _TABLE_ROWS)).astype(np.intp)]
    extremes = known[[bins.low[known, j].argmin(), bins.high[known, j].argmax()]]
    rows = [
        [
            f'<th scope="row" class="num">{typeset(f"{bins.x[k]:.6g}")}</th>',
            *(cell(significant(float(values[k, j]))) for values in (bins.mean, bins.low, bins.high)),
        ]
        for k in np.unique(np.concatenate([some, extremes]))
    ]
    head = [esc(capital(axis.label)), "Mean", "Smallest", "Largest"]
    shown = table(head, rows, kind="tight", label="Numbers of this chart")
    return f'<details class="numbers"><summary>Numbers of this chart</summary>{shown}</details>'


def _key(bins: Bins, found: Sequence[Episode]) -> str:
    marks = ['<li><i class="stroke"></i>mean of what is left over what is expected</li>']
    if bins.rows > 1:
        marks.append('<li><i class="stroke tall" style="border-color:var(--cloud)"></i>smallest to largest row</li>')
    marks.append('<li><i class="band"></i>expected: 95 % of rows lie here</li>')
    said = {change.said for one in found for change in (one.named, one.now)}
    for word, color in COLORS.items():
        if word in said:
            marks.append(f'<li><i class="stroke tall" style="border-color:var(--{color})"></i>change {word}</li>')
    if 0 < len(bins.begins) <= _MOST_MARKED:
        marks.append('<li><i class="stroke tall dashed"></i>next run</li>')
    return f'<ul class="key" aria-label="Key of the charts">{"".join(marks)}</ul>\n'
