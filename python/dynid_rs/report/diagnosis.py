"""The page of `dynid diagnose`: what an engineer reads in a minute, and the sections of identify folded below."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynid_rs.base.wording import NO_INTERVAL, concluded, kinds_said, lacks_interval, worse_than_least_squares
from dynid_rs.report import before_after, effect_cards, error_table, tables
from dynid_rs.report.figures import Figures
from dynid_rs.report.text import (
    DASH,
    count,
    esc,
    file_names,
    geometric_mean,
    percent,
    plural,
    ratio,
    significant,
    unit_text,
    words,
)

Result = Mapping[str, Any]
NOT_CONCLUDED = "Nothing is concluded: no physics can be read from these data before the error in them is mended."
SHOWN_INFO = ("signal_missing", "test_run_chosen", "test_part_chosen")
"""Findings that bear on the answer although nothing is wrong."""


def is_diagnosis(result: Result) -> bool:
    """Whether `dynid diagnose` wrote it."""
    return result.get("steps") is not None


def head(result: Result) -> str:
    """Robot, verdict, the worst finding and the four numbers of the first glance."""
    bad = [f for f in result["data"].get("findings") or [] if f["severity"] == "error"]
    alert = f'<p class="alert"><b>\u2716 {esc(bad[0]["message"])}</b> <a href="#sensors">More</a></p>' if bad else ""
    return (
        f'<p class="eyebrow">What the torque model lacks, {plural(len(result["joints"]), "joint")}</p>\n'
        f'<h1>{esc(result["robot"])}</h1>\n<p class="verdict">{esc(result.get("verdict") or "")}</p>\n'
        f"{alert}{_tiles(result)}\n"
    )


def _tiles(result: Result) -> str:
    test, data, joints = result["rmse"]["test"], result["data"], result["joints"]
    unknown = [None] * len(joints)
    floors, bounds = test.get("floor") or unknown, test.get("after_interval") or unknown
    reached = [error_table.at_floor(*row) for row in zip(test["after"], bounds, floors, strict=True)]
    left = geometric_mean([ratio(a, b) for a, b in zip(test["after"], test["before"], strict=True)])
    effects = [entry for entry in result.get("effects") or [] if kinds_said(entry)]
    ties = sum(1 for entry in effects if entry.get("ties"))
    samples = data.get("n_samples") or {}
    tiles = [
        (
            "Effects found",
            str(len(effects)),
            plural(ties, "tie") if ties else "no ties" if effects else _none(result),
        ),
        (
            "Error after",
            DASH if left is None else f"{percent(abs(1 - left))} {'less' if left <= 1 else 'more'}",
            "than before, on unseen runs, average over joints",
        ),
        (
            "Joints at the floor",
            f"{sum(map(bool, reached))} of {len(joints)}" if any(r is not None for r in reached) else DASH,
            "no model could do better there",
        ),
        (
            "Runs",
            f"{len(data['train'])} + {len(data['test'])}",
            f"train + test; {count(samples.get('train'))} + {count(samples.get('test'))} samples",
        ),
    ]
    cells = (
        f'<dl class="tile"><dt>{name}</dt><dd>{value}</dd><dd class="under">{under}</dd></dl>'
        for name, value, under in tiles
    )
    return f'<div class="tiles">{"".join(cells)}</div>'


def _none(result: Result) -> str:
    """Why there are no effects."""
    if not concluded(result):
        return "nothing is concluded"
    return "nothing to add" if result.get("nothing_to_add") else "nothing with a name"


def errors(result: Result) -> str:
    """Before and after per joint, with the key."""
    data = result["data"]
    method = f" Floor: {esc(result['floor_method'])}." if result.get("floor_method") else ""
    missing = f" {DASH} {NO_INTERVAL}." if lacks_interval(result) else ""
    return (
        f"<p>Root-mean-square torque error in {esc(unit_text(result['torque_unit']))}, and in percent of the joint's "
        "torque standard deviation, on runs that neither fitting nor choosing has touched.</p>\n"
        f"{before_after.before_after_table(result)}\n{before_after.key()}\n"
        f'<p class="note next">Intervals allow for errors that depend on their neighbours in time. \u25cf the error '
        f"reaches the floor, below which no model can go.{method}{missing}</p>\n"
        f"{_worse(result)}"
        f'<p class="note">Test: {file_names(data["test"])}. Train: {file_names(data["train"])}.</p>'
    )


def _worse(result: Result) -> str:
    sentence = worse_than_least_squares(result)
    return f'<p class="note">{esc(sentence)}</p>\n' if sentence else ""


def effects(figures: Figures, result: Result) -> str:
    """Effects that were added, each with its plot."""
    if not concluded(result):
        return f"<p>{NOT_CONCLUDED}</p>"
    if not result.get("effects"):
        return "<p>Nothing was added: no effect of the catalogue lowers the error on runs that were left out.</p>"
    return effect_cards.effect_cards(figures, result)


def sensors(result: Result) -> str:
    """What was found in the data that bears on the answer."""
    shown = [f for f in result["data"].get("findings") or [] if f["severity"] != "info" or f.get("code") in SHOWN_INFO]
    return tables.findings_table(shown) if shown else "<p>Nothing was found wrong with sensors and clocks.</p>"


def left(figures: Figures, result: Result) -> str:
    """What the model with effects still leaves, beyond noise."""
    if not concluded(result):
        return f"<p>{NOT_CONCLUDED}</p>"
    if not result.get("unexplained"):
        return "<p>Nothing that could be told from noise.</p>"
    return effect_cards.leftovers(figures, result)


def next_experiment(result: Result) -> str:
    """Which experiment would tell more."""
    return effect_cards.sentences(result["next_experiment"]) if result.get("next_experiment") else ""


def steps(result: Result) -> str:
    """What was added and dropped, in order."""
    rows = []
    for k, step in enumerate(result.get("steps") or [], 1):
        error = step.get("rmse_train")
        what = f"{step['action']} {words(step['kind'])}" if step.get("kind") else step["action"]
        rows.append(
            [
                f'<th scope="row">{k}</th>',
                tables.cell(esc(what), "text"),
                tables.cell(esc(", ".join(step.get("joints") or [])), "text"),
                *(
                    [tables.cell(significant(e)) for e in error]
                    if error
                    else [tables.cell(DASH)] * len(result["joints"])
                ),
            ]
        )
    head = ["Step", "What", "Where", *(esc(joint) for joint in result["joints"])]
    unit = esc(unit_text(result["torque_unit"]))
    return f"<p>Training error per joint after each step [{unit}].</p>{tables.table(head, rows)}" if rows else ""
