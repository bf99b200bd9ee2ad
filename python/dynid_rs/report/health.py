"""The health page of `dynid watch`: whether a model still holds, what has changed and when, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynid_rs.base.changes import Change, advice, kind_words
from dynid_rs.base.clock import time_words
from dynid_rs.base.units import unit_text
from dynid_rs.report import page, tables
from dynid_rs.report.explanations import versions
from dynid_rs.report.figures import Figures
from dynid_rs.report.health_changes import changes_table, named
from dynid_rs.report.health_source import Episode, Health, episodes
from dynid_rs.report.health_trend import Axis, axis_of, trends
from dynid_rs.report.sections import alert
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import (
    DASH,
    breakable,
    capital,
    count,
    esc,
    file_names,
    percent,
    plural,
    significant,
    with_code,
)

MOST_NAMED = 3
"""Changes that a sentence names; the others are counted."""


def write_health(path: Path, health: Health) -> Path:
    """Write the page, whole or not at all.

    Raises
    ------
    OSError
        The place cannot be written; the text is a sentence.
    """
    return page.write_page(path, build_health(health))


def build_health(health: Health) -> str:
    """Return the whole page."""
    figures, found, axis = Figures(), episodes(health.runs), axis_of(health.runs, health.row)
    parts = [
        ("changes", "What has changed", changes_table(health, found, axis)),
        ("joints", "Joint by joint", _joints(figures, health, found)),
    ]
    folded = [
        ("runs", "Runs", _runs(health, found, axis)),
        ("settings", "How it was watched", _settings(health)),
        ("findings", "Findings about the data", _findings(health)),
    ]
    body = page.body(_head(health, found), parts, folded, skip="Skip to what has changed")
    return page.shell(title=f"{health.robot} \u2013 health of the torque model", body=body, figures=figures)


def _head(health: Health, found: Sequence[Episode]) -> str:
    rows = (
        ("Does the model still hold?", _verdict(health, found)),
        ("What stands at the end?", _at_the_end(health)),
        ("What to do next?", _next(health, found)),
    )
    answer = "".join(f"<div><dt>{question}</dt><dd>{text}</dd></div>" for question, text in rows)
    return (
        f'<p class="eyebrow">Health of the torque model</p>\n<h1>{esc(health.robot)}</h1>\n'
        f'<dl class="answer">{answer}</dl>\n<p class="note runs">{_extent(health)}</p>\n'
        f"{alert(health.findings, 'findings')}"
    )


def _seconds(health: Health) -> float:
    return sum(len(run.t) for run in health.runs) * health.row


def _extent(health: Health) -> str:
    return f"{plural(len(health.joints), 'joint')}, {plural(len(health.runs), 'run')}, {_duration(_seconds(health))}"


def _duration(seconds: float) -> str:
    unit, word = (1.0, "s") if seconds < 600 else (60.0, "min") if seconds < 18000 else (3600.0, "h")
    return f"{significant(seconds / unit)}\u00a0{word}"


def _is_watched(health: Health) -> bool:
    return any(run.watched.any() for run in health.runs)


def _verdict(health: Health, found: Sequence[Episode]) -> str:
    """One sentence."""
    if not _is_watched(health):
        return "<b>Not known:</b> no joint moved as the model was trained to, so that nothing could be watched."
    kept = _grouped(found)
    if not kept and health.standing:
        stood = "; ".join(named(change) for change in health.standing)
        return (
            f"<b>No:</b> nothing new in {plural(len(health.runs), 'run')}, but what stood before still does: {stood}."
        )
    if not kept:
        passed = f"; {plural(len(found), 'change')} passed again" if found else ""
        return f"<b>Yes:</b> nothing has changed in {plural(len(health.runs), 'run')}{passed}."
    texts = [f"{named(one.now)}{_in_runs(runs)}" for one, runs in kept[:MOST_NAMED]]
    more = len(kept) - len(texts)
    others = f"; {plural(more, 'more change')} below" if more else ""
    changed = len({one.run for one in found if not one.is_withdrawn})
    where = f"in {count(changed)} of {plural(len(health.runs), 'run')} " if len(health.runs) > 1 else ""
    return f"<b>No:</b> {where}something has changed: {'; '.join(texts)}{others}."


def _grouped(found: Sequence[Episode]) -> list[tuple[Episode, int]]:
    """The last change of each kind and place that was not withdrawn, and in how many runs there is one."""
    last: dict[tuple[str, str], Episode] = {}
    runs: dict[tuple[str, str], set[int]] = {}
    for one in found:
        if not one.is_withdrawn:
            place = (one.now.kind, one.now.joint)
            last[place] = one
            runs.setdefault(place, set()).add(one.run)
    return [(one, len(runs[place])) for place, one in last.items()]


def _in_runs(runs: int) -> str:
    return f" (in {plural(runs, 'run')})" if runs > 1 else ""


def _at_the_end(health: Health) -> str:
    last = health.runs[-1]
    where = f"At the end of <code>{esc(last.name)}</code>"
    if not last.watched.any():
        return f"{where}: not known, no joint was watched in it."
    if not health.standing:
        return f"{where}: nothing."
    listed = [f"<b>{named(change)}</b>{_open(change)}" for change in health.standing]
    return f"{where}: {'; '.join(listed)}."


def _open(change: Change) -> str:
    return " (has not settled yet)" if change.said == "named" else ""


def _next(health: Health, found: Sequence[Episode]) -> str:
    """What to do about what stands; else about what has been there."""
    if not _is_watched(health):
        return "Record a run in which the joints move as they did when the model was learned."
    known = list(health.standing) or [one.now for one, _ in _grouped(found)]
    passed = "" if health.standing or not known else "Nothing now; where it comes again: "
    texts = []
    for change in known[:MOST_NAMED]:
        where = "" if change.kind == "load" else f"{breakable(change.joint)}: "
        texts.append(f"{where}{with_code(advice(change.kind, change.size))}")
    texts = list(dict.fromkeys(texts))
    more = len(known) - MOST_NAMED
    link = f' <a href="#changes">{count(more)} more</a>' if more > 0 else ""
    return passed + "<br>".join(texts) + link if texts else "Nothing: go on using the model."


def _joints(figures: Figures, health: Health, found: Sequence[Episode]) -> str:
    rows_of = np.array([len(run.t) for run in health.runs])
    total = max(int(rows_of.sum()), 1)
    watched = sum((run.watched * len(run.t) for run in health.runs), np.zeros(len(health.joints))) / total
    rows = []
    for j, joint in enumerate(health.joints):
        bar = f'<span class="track"><i class="fill after" style="width:{100.0 * watched[j]:.0f}%"></i></span>'
        rows.append(
            [
                breakable(joint),
                cell(percent(float(watched[j]))),
                cell(bar, "strip desk"),
                cell(_number(health.expected[j])),
                cell(_number(_rms(health, j))),
                cell(_number(health.residual[j])),
            ]
        )
    unit = f"<small>{esc(unit_text(health.torque_unit))}</small>"
    head = [
        "Joint",
        "Watched",
        '<th scope="col" class="strip desk"><span class="hidden">as a bar</span></th>',
        f"Expected {unit}",
        "Left / expected <small>all rows</small>",
        "Left / expected <small>at the end</small>",
    ]
    return (
        "<p>What the model leaves of the measured torque, averaged over "
        f"{significant(health.row, 2)}\u00a0s, over the deviation that is expected of it: 1 is usual. What has "
        "settled is expected from then on, so that the curve comes back to zero. A joint that stands, or moves as "
        "the model was not trained to, says nothing: its curve has gaps."
        '<span class="mouse"> Drag to zoom all joints together, double-click to go back; or the keys + \u2212 0 and '
        "the arrows.</span></p>\n"
        f"{table(head, rows, label='Joint by joint')}\n{trends(figures, health, found)}"
    )


def _rms(health: Health, j: int) -> float:
    squares = [run.ratio[np.isfinite(run.ratio[:, j]), j] ** 2 for run in health.runs]
    known = np.concatenate(squares)
    return float(np.sqrt(known.mean())) if known.size else float("nan")


def _number(value: float) -> str:
    return significant(float(value)) if np.isfinite(value) else DASH


def _runs(health: Health, found: Sequence[Episode], axis: Axis) -> str:
    rows = []
    for r, run in enumerate(health.runs):
        own = [one for one in found if one.run == r and not one.is_withdrawn]
        least = int(np.argmin(run.watched))
        rows.append(
            [
                f'<th scope="row"><code>{esc(run.name)}</code></th>',
                cell(esc(time_words(float(run.t[0]) - health.row)) if len(run.t) else DASH, "place"),
                cell(_number(axis.at(r, run.t[0] - health.row)) if len(run.t) else DASH),
                cell(_duration(len(run.t) * health.row)),
                cell(f"{percent(float(run.watched[least]))} <small>{breakable(health.joints[least])}</small>"),
                cell(count(len(own)) if own else DASH),
            ]
        )
    head = ["Run", "Begins", f"On the charts <small>{axis.word}</small>", "Length", "Watched least", "Changes"]
    how = (
        "goes on with what the one before has shown" if health.goes_on else "is watched on its own, from its beginning"
    )
    return f"<p>Every run {how}.</p>" + table(head, rows, label="Runs")


def _settings(health: Health) -> str:
    facts = [
        ("False alarms", f"at most {significant(health.false_alarms_per_day)} per day, of all tests together"),
        ("Tolerated", _tolerated(health)),
        ("What is usual", _usual(health)),
        ("Row", f"{significant(health.row, 2)}\u00a0s: what is left is averaged over it"),
        ("Model", f"{plural(len(health.joints), 'joint')}, torque in {esc(unit_text(health.torque_unit))}"),
        ("Written by", esc(versions())),
    ]
    listed = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in facts)
    return f'<dl class="facts">{listed}</dl>'


def _tolerated(health: Health) -> str:
    units = {"offset": "deviations", "load": unit_text(health.load_unit), "delay": "s", "slip": health.angle_unit}
    texts = []
    for kind, size in health.tolerated.items():
        word = "growth of the error" if kind == "unknown" else kind_words(kind)
        number = f"{significant(size)}\u00a0{units[kind]}" if kind in units else percent(size)
        texts.append(f"{word} {number}")
    return capital(", ".join(texts))


def _usual(health: Health) -> str:
    if health.healthy is None:
        return "the model\u2019s own deviation, lasting two seconds: there was no healthy run"
    return file_names(health.healthy) if health.healthy else "as healthy runs said that settings were made from"


def _findings(health: Health) -> str:
    return tables.findings_table(list(health.findings)) if health.findings else ""
