"""The page of `dynid fleet`: how many arms, which are odd and why, all arms in one table, what arms of a type share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.changes import advice, kind_words
from dynid_rs.report import page
from dynid_rs.report.explanations import versions
from dynid_rs.report.figures import Figures
from dynid_rs.report.fleet_types import types_section
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import (
    DASH,
    breakable,
    count,
    esc,
    join_words,
    percent,
    plural,
    significant,
    typeset,
    with_code,
)

Row = Mapping[str, Any]

MOST_NAMED = 3
"""Odd arms that the first screen names; the others are counted."""
CAUSES = {"base": "an inertial parameter", "coefficient": "a coefficient", "error": "an error without a name"}
"""Kinds of causes as people say them, where `kind_words` does not."""
UNKNOWN = "Look at its data and its report: no named change explains it."
"""What to do about a cause without a name."""


def write_fleet_page(path: Path, answer: Mapping[str, Any], quantities: Mapping[str, NDArray[Any]]) -> Path:
    """Write the page, whole or not at all, from the content of `fleet.json` and of `quantities.parquet`.

    Raises
    ------
    OSError
        The place cannot be written; the text is a sentence.
    """
    return page.write_page(path, build_fleet_page(answer, quantities))


def build_fleet_page(answer: Mapping[str, Any], quantities: Mapping[str, NDArray[Any]]) -> str:
    """Return the whole page."""
    rows = answer["robots"]
    odd = sorted((row for row in rows if row["odd"] == "yes"), key=lambda row: -row["deviations"])
    parts = [
        ("odd", "Odd arms", _odd(odd, answer)),
        ("arms", "All arms", _arms(rows)),
    ]
    folded = [
        *types_section(answer, quantities),
        ("failed", "Not identified", _failed(rows)),
        ("settings", "How arms are compared", _settings(answer)),
    ]
    body = page.body(_head(answer, odd), parts, folded, skip="Skip to the odd arms")
    return page.shell(title=f"Fleet of {answer['n_robots']} arms", body=body, figures=Figures())


def _head(answer: Mapping[str, Any], odd: Sequence[Row]) -> str:
    rows = answer["robots"]
    types = Counter(row["type"] for row in rows if row["type"] is not None)
    questions = (
        ("Which arms are odd?", _which(answer, odd)),
        ("Why?", _why(odd)),
        ("How sure is that?", _sure(answer, rows)),
    )
    told = "".join(f"<div><dt>{question}</dt><dd>{text}</dd></div>" for question, text in questions if text)
    listed = ", ".join(f"{esc(name)} ({count(number)})" for name, number in types.most_common())
    left = [f"{count(answer['failed'])} could not be identified" if answer["failed"] else ""]
    left.append(f"{count(answer['no'])} have data or a model that is not to be trusted" if answer["no"] else "")
    note = "; ".join(text for text in (listed, *left) if text)
    kinds = f" of {plural(len(types), 'type')}" if types else ""
    return (
        f'<p class="eyebrow">Fleet</p>\n<h1>{plural(answer["n_robots"], "arm")}{kinds}</h1>\n'
        f'<dl class="answer">{told}</dl>\n<p class="note runs">{note}</p>\n'
    )


def _which(answer: Mapping[str, Any], odd: Sequence[Row]) -> str:
    known = _compared(answer)
    if not known:
        return "<b>Not known:</b> there are too few arms of one type to compare them."
    if not odd:
        return f"<b>None</b> of {plural(known, 'arm')} that could be compared."
    named = "<br>".join(f"<b>{breakable(row['name'])}</b> {_sentences(row)}" for row in odd[:MOST_NAMED])
    more = len(odd) - MOST_NAMED
    link = f'<br><a href="#odd">{plural(more, "more arm")}</a>' if more > 0 else ""
    return f"<b>{count(len(odd))} of {count(known)}</b>, the farthest first:<br>{named}{link}"


def _compared(answer: Mapping[str, Any]) -> int:
    """Number of arms of which it is known whether they are odd."""
    return sum(row["odd"] in ("yes", "no") for row in answer["robots"])


def _sentences(row: Row) -> str:
    return "<br>".join(typeset_sentence(text) for text in row["why"].split("; "))


def typeset_sentence(text: str) -> str:
    """HTML of a sentence of the fleet as print sets it."""
    return esc(text.replace("+-", "\u00b1").replace(" %", "\u00a0%").replace("*", "\u00b7")).replace(" -", " \u2212")


def _why(odd: Sequence[Row]) -> str:
    kinds = Counter(row["causes"][0]["kind"] for row in odd if row["causes"])
    return join_words([f"{_cause_words(kind)} ({count(number)})" for kind, number in kinds.most_common()])


def _cause_words(kind: str) -> str:
    return CAUSES.get(kind, kind_words(kind))


def _sure(answer: Mapping[str, Any], rows: Sequence[Row]) -> str:
    pooling = answer["pooling"]
    if pooling is None or not pooling["n_tests"]:
        return ""
    unknown = sum(row["odd"] == "unknown" for row in rows)
    left = (
        f" Of {plural(unknown, 'arm')} nothing can be said: a type needs {count(pooling['least_arms'])} of them."
        if unknown
        else ""
    )
    return (
        f"In a fleet without odd arms the chance that any is named is at most {percent(pooling['false_alarms'])}, over "
        f"all {count(pooling['n_tests'])} tests.{left}"
    )


def _odd(odd: Sequence[Row], answer: Mapping[str, Any]) -> str:
    if not odd:
        return "<p>None.</p>" if _compared(answer) else "<p>No arm could be compared.</p>"
    rows = [
        [
            f'<th scope="row">{breakable(row["name"])}</th>',
            cell(esc(row["type"]), "place"),
            cell(_sentences(row), "text"),
            cell(typeset(f"{row['deviations']:.1f}")),
            cell("<br>".join(dict.fromkeys(_advice(cause) for cause in row["causes"])), "text"),
        ]
        for row in odd
    ]
    head = ["Arm", "Type", "Why <small>the cause that explains most first</small>", "Deviations", "What to do"]
    return (
        "<p>Each against the others of its type, which are compared without it. One deviation is how far arms of the "
        "type usually are from its mean, the arm\u2019s own uncertainty included.</p>\n"
        + table(head, rows, kind="stack named", label="Odd arms")
    )


def _advice(cause: Mapping[str, Any]) -> str:
    try:
        return with_code(advice(cause["kind"], cause["size"]))
    except KeyError:
        return UNKNOWN


def _arms(rows: Sequence[Row]) -> str:
    head = [
        f'<th scope="col"><button type="button">{title}</button></th>'
        for title in ("Arm", "Odd", "Deviations", "Error", "Weighted least squares", "Runs", "Type", "Why")
    ]
    body = [
        [
            f'<th scope="row">{breakable(row["name"])}</th>',
            cell(*_opinion(row)),
            _number(row["deviations"], "{:.1f}"),
            _share(row["error_percent"]),
            _share(row["wls_percent"]),
            _number(row["n_runs"], "{:.0f}"),
            cell(esc(row["type"] or DASH), "place"),
            cell(_sentences(row) if row["odd"] == "yes" else esc(row["status"]), "text"),
        ]
        for row in rows
    ]
    return (
        "<p>Errors are on test runs, over the torque\u2019s standard deviation, mean of the joints. "
        "A heading sorts.</p>\n"
        '<p class="sieve"><label>Show rows with <input type="search" data-sieve="arms" placeholder="name, type, joint, '
        'cause"></label> <label><input type="checkbox" data-odd="arms"> odd arms only</label> '
        '<output data-left="arms" aria-live="polite"></output></p>\n'
        + table(head, body, kind="sortable", label="All arms")
    )


def _opinion(row: Row) -> tuple[str, str]:
    return {
        "yes": ("\u25b2 odd", "worse word"),
        "no": ("no", "soft word"),
        "unknown": ("not known", "soft word"),
    }.get(row["odd"], ("\u2716 failed", "worse word"))


def _number(value: float | None, form: str) -> str:
    if value is None:
        return cell(DASH)
    return f'<td class="num" data-value="{float(value):.6g}">{typeset(form.format(value))}</td>'


def _share(value: float | None) -> str:
    if value is None or not np.isfinite(value):
        return cell(DASH)
    return f'<td class="num" data-value="{float(value):.6g}">{percent(value / 100)}</td>'


def _failed(rows: Sequence[Row]) -> str:
    failed = [row for row in rows if row["status"] == "failed"]
    body = [[f'<th scope="row">{breakable(row["name"])}</th>', cell(esc(row["message"]), "text")] for row in failed]
    return table(["Arm", "Why not"], body, kind="stack", label="Not identified") if failed else ""


def _settings(answer: Mapping[str, Any]) -> str:
    pooling = answer["pooling"]
    if pooling is None:
        return ""
    facts = [
        ("False alarms", f"at most {percent(pooling['false_alarms'])} for the whole fleet, of all tests together"),
        ("Tests", f"{count(pooling['n_tests'])}, each at {significant(pooling['limit'], 2)}"),
        ("Fewest arms", f"{count(pooling['least_arms'])} of a type, to have one named that is ten deviations off"),
        ("Type\u2019s mean and deviation", "restricted maximum likelihood of the arms that are not odd"),
        ("Written by", esc(versions())),
    ]
    listed = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in facts)
    return f'<dl class="facts">{listed}</dl>'
