"""Effects that were found and what is left, each with its plot. Every text from a file goes through `esc`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dynid_rs.base.wording import kinds_said
from dynid_rs.report.figures import Figure, Figures
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import (
    DASH,
    NBSP,
    breakable,
    esc,
    interval,
    join_words,
    percent,
    plot_text,
    significant,
    unit_text,
    with_unit,
    words,
)

Result = Mapping[str, Any]

LEAST_P = 1e-9
"""Smaller ones are not told apart."""


def effect_cards(figures: Figures, result: Result) -> str:
    """One card per effect, most useful first."""
    return "".join(_effect(figures, result, entry, k) for k, entry in enumerate(result.get("effects") or []))


def _effect(figures: Figures, result: Result, entry: Result, k: int) -> str:
    joints = ", ".join(breakable(joint) for joint in entry["joints"])
    whole = len(entry["joints"]) == len(result["joints"]) > 2
    name = " or ".join(_named(kind) for kind in kinds_said(entry) or [entry["kind"]])
    place = "whole robot" if whole else joints
    share = entry.get("share_explained")
    facts = [_p(entry["p_value"])] if entry.get("p_value") is not None else []
    facts += [f"explains {percent(share)} of what could be explained"] if share is not None else []
    note = f'<p class="note">{esc(entry["note"])}</p>' if entry.get("note") else ""
    text = (
        f'<h3><span class="rank">{k + 1}</span>{esc(_capital(name))}'
        f' <span class="soft">on {place}</span></h3>\n'
        f'<p class="note">{"; ".join(facts)}</p>\n'
        f"{_parameters(entry)}{_errors(result, entry)}{note}{_neighbours(entry)}{_depends(entry)}"
    )
    drawn = _plot(figures, f"effect-{k}", entry.get("plot"), result["torque_unit"], name)
    caption = "<figcaption><span>Dots: what the model without this effect leaves; line: the effect</span></figcaption>"
    figure = f"<figure>{caption}{drawn}</figure>" if drawn else ""
    return f'<article class="effect">\n<div>{text}</div>\n{figure}</article>\n'


def _parameters(entry: Result) -> str:
    several = len(entry["joints"]) > 1
    rows = [
        [
            esc(words(p["name"])) + (f" ({esc(p['joint'])})" if several and p.get("joint") else ""),
            cell(esc(with_unit(significant(p["value"]), p.get("unit"))), "num main"),
            cell(_interval(p.get("interval")), "num soft"),
        ]
        for p in entry.get("parameters") or []
    ]
    return table(["Parameter", "Value", "95 % interval"], rows, kind="tight") if rows else ""


def _errors(result: Result, entry: Result) -> str:
    """Test error before and after this effect, on the joints that it acts on."""
    before, after = entry.get("rmse_test_before") or [], entry.get("rmse_test_after") or []
    bounds = entry.get("rmse_test_after_interval")
    names = result["joints"] if len(after) == len(result["joints"]) else entry["joints"]
    rows = [
        [
            breakable(joint),
            cell(significant(old)),
            cell(significant(new), "num main"),
            *([cell(_interval(pair), "num soft")] if bounds else []),
        ]
        for joint, old, new, pair in zip(names, before, after, bounds or [None] * len(after), strict=False)
        if joint in entry["joints"]
    ]
    said = f"<small>{esc(unit_text(result['torque_unit']))}</small>"
    head = [f"Test error {said}", "Without", "With", *(["95 % interval"] if bounds else [])]
    return table(head, rows, kind="tight") if rows else ""


def _neighbours(entry: Result) -> str:
    """What it was told apart from, and what it was not."""
    apart = [_apart(other, entry["joints"]) for other in entry.get("told_apart_from") or []]
    body = f"<p><b>Told apart from</b> {join_words(apart)}.</p>\n" if apart else ""
    for tie in entry.get("ties") or []:
        where = _where(tie, entry["joints"])
        errors = tie.get("rmse_test_after") or []
        with_it = f" (test error {' / '.join(significant(e) for e in errors)})" if 0 < len(errors) <= 2 else ""
        how = f" To separate them:<br><code>{esc(tie['separate'])}</code>" if tie.get("separate") else ""
        body += (
            f'<p class="tie"><b>Not told apart from {esc(_named(tie["kind"]))}</b>{where}, which explains the data '
            f"equally well{with_it}.{how}</p>\n"
        )
    return body


def _p(value: float) -> str:
    """What a p-value says; how far below certainty it lies says nothing more."""
    if value < LEAST_P:
        return f"p{NBSP}<{NBSP}{significant(LEAST_P, 1)}"
    return f"p{NBSP}={NBSP}{significant(value, 2)}"


def _interval(bounds: Sequence[float] | None) -> str:
    """An interval with as many digits as its ends need to differ."""
    texts = (interval(bounds, digits) for digits in range(3, 8))
    return next((text for text in texts if bounds is None or len(set(text.split(" to "))) > 1), interval(bounds))


def _where(other: Result, joints: Sequence[str]) -> str:
    """Where it acts, if that is not where the effect itself does."""
    places = other.get("joints") or []
    return f" on {esc(', '.join(places))}" if places and list(places) != list(joints) else ""


def _apart(other: Result, joints: Sequence[str]) -> str:
    where, sure = _where(other, joints), ""
    if other.get("p") is not None:
        sure = _p(other["p"])
    elif other.get("log_evidence") is not None:
        sure = f"log evidence {significant(other['log_evidence'], 2)}"
    return f"{esc(_named(other['kind']))}{where}" + (f' <span class="soft">({sure})</span>' if sure else "")


def _depends(entry: Result) -> str:
    return _dependence(entry["depends_on"]) if entry.get("depends_on") else ""


def leftovers(figures: Figures, result: Result) -> str:
    """One card per joint on which something stays that is not noise."""
    return "".join(_leftover(figures, result, entry, k) for k, entry in enumerate(result.get("unexplained") or []))


def _leftover(figures: Figures, result: Result, entry: Result, k: int) -> str:
    facts = [f"{percent(entry.get('share'))} of the error\u2019s power is not noise"]
    facts += [_p(entry["p_value"])] if entry.get("p_value") is not None else []
    term = entry.get("term") or {}
    said = ""
    if term.get("kept") is not None:
        with_it = term.get("rmse_test_with")
        error = "" if with_it is None else f" (test error with it {significant(with_it)})"
        decision = "pays on runs left out and is in the model" if term["kept"] else "did not pay on runs left out"
        said = f"<p>A data-driven term on these signals {decision}{error}.</p>"
    text = (
        f'<h3>{esc(entry["joint"])} <span class="soft">unknown</span></h3>\n'
        f'<p class="note">{"; ".join(facts)}</p>\n{_dependence(entry.get("depends_on") or [])}{said}'
    )
    drawn = _plot(figures, f"left-{k}", entry.get("plot"), result["torque_unit"], f"what is left on {entry['joint']}")
    caption = "<figcaption><span>What is left, over the signal that it depends on most</span></figcaption>"
    figure = f"<figure>{caption}{drawn}</figure>" if drawn else ""
    return f'<article class="effect">\n<div>{text}</div>\n{figure}</article>\n'


def _dependence(depends: Any) -> str:
    """Strengths as bars, direct dependence told from what only comes along."""
    if not depends:
        return "<p>It depends on no single signal that is known.</p>"
    top = max((abs(d.get("strength") or 0.0) for d in depends), default=0.0) or 1.0
    rows = []
    for d in depends:
        strength, direct = d.get("strength"), d.get("direct", True)
        width = round(120 * abs(strength or 0.0) / top)
        bar = f'<svg width="120" height="10" aria-hidden="true"><rect class="{"after" if direct else "before"}"'
        bar += f' width="{width}" height="10"/></svg>'
        rows.append(
            [
                esc(d["signal"]),
                cell(DASH if strength is None else significant(strength, 2)),
                cell(bar, "strip"),
                cell("directly" if direct else "through the others", "word" if direct else "soft word"),
            ]
        )
    return table(["Depends on", "Strength", "", "How"], rows, kind="tight")


def sentences(items: Any) -> str:
    """HTML list of sentences; what stands between backticks is a command."""
    return "<ul>" + "".join(f"<li>{_with_code(item)}</li>" for item in items) + "</ul>"


def _with_code(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", esc(text))


def _named(kind: str) -> str:
    return words(kind.replace("_dependent_", "-dependent "))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _plot(figures: Figures, name: str, plot: Result | None, torque_unit: str, label: str) -> str:
    """Add the figure of a partial residual over its signal; HTML of its place, or nothing without one."""
    if not plot or not plot["x"]:
        return ""
    n = min(len(plot["x"]), len(plot["partial"]))
    unit, torque = plot_text(unit_text(plot.get("unit"))), plot_text(unit_text(torque_unit))
    traces: list[Figure] = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": figures.array(f"{name}/x", np.asarray(plot["x"][:n], dtype=float)),
            "y": figures.array(f"{name}/y", np.asarray(plot["partial"][:n], dtype=float)),
            "marker": {"size": 4, "color": "$measured", "opacity": 0.6},
            "hoverinfo": "skip",
        }
    ]
    if plot.get("curve_x") and plot.get("curve"):
        m = min(len(plot["curve_x"]), len(plot["curve"]))
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": figures.array(f"{name}/curve/x", np.asarray(plot["curve_x"][:m], dtype=float)),
                "y": figures.array(f"{name}/curve/y", np.asarray(plot["curve"][:m], dtype=float)),
                "line": {"color": "$blue", "width": 2.5},
                "hovertemplate": "%{y:.3~g} " + torque + " at %{x:.3~g} " + unit + "<extra></extra>",
            }
        )
    signal = plot_text(plot["signal"]) + (f" [{unit}]" if unit else "")
    layout = {
        "xaxis": {"title": {"text": signal}},
        "yaxis": {"title": {"text": f"torque [{torque}]"}, "zeroline": True},
    }
    figures.add(name, traces, layout)
    return f'<div class="plot" data-figure="{name}" role="img" aria-label="{esc(label)}"></div>'
