"""The sections of `dynid diagnose`'s page that are its own: errors, effects, sensors, what is left, what to do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynid_rs.base.units import torques_said, torques_told, unit_text
from dynid_rs.base.wording import NO_INTERVAL, against_reference, concluded, lacks_interval, worse_than_least_squares
from dynid_rs.report import bars, effect_cards, tables
from dynid_rs.report.figures import Figures
from dynid_rs.report.text import DASH, esc, file_names, significant, with_code, words

Result = Mapping[str, Any]
NOT_CONCLUDED = "Nothing is concluded: no physics can be read from these data before the error in them is mended."
SHOWN_INFO = ("signal_missing", "test_run_chosen", "test_part_chosen")
"""Findings that bear on the answer although nothing is wrong."""


def errors(result: Result) -> str:
    """Before and after per joint, with the key."""
    data = result["data"]
    method = f" The noise is {esc(result['floor_method'])}." if result.get("floor_method") else ""
    missing = f" {DASH}: {NO_INTERVAL}." if lacks_interval(result) else ""
    return (
        "<p>Root-mean-square torque error in percent of how much that joint\u2019s torque varies (its standard "
        "deviation), on runs that neither fitting nor choosing has touched. Shorter is better.</p>\n"
        f"{bars.bar_chart(result)}\n{_verdict(result)}{_worse(result)}"
        '<p class="note">Weighted least squares: rigid body, Coulomb and viscous friction, fitted once to the training '
        f"runs. {_before(result)} A change has a "
        "colour only where its 95 % interval leaves no doubt; intervals allow for errors that depend on their "
        f"neighbours in time.{method}{missing}</p>\n"
        f'<p class="note">Test: {file_names(data["test"])}. Train: {file_names(data["train"])}.</p>'
    )


def _before(result: Result) -> str:
    if against_reference(result):
        return "Reference: the model that was given, as it is; nothing of it was fitted to these runs."
    return "Declared model: what the robot file and the options say, fitted before anything was added."


def _verdict(result: Result) -> str:
    return f'<p class="verdict">{esc(result["verdict"])}</p>\n' if result.get("verdict") else ""


def _worse(result: Result) -> str:
    sentence = worse_than_least_squares(result)
    return f'<p class="note">{esc(sentence)}</p>\n' if sentence else ""


def effects(figures: Figures, result: Result) -> str:
    """Effects that were added, each with its curve."""
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
        above = bars.above_floor(result)
        more = " Where a bar ends above its dotted line, no signal in these runs explains the rest." if above else ""
        return f"<p>Nothing that could be told from noise.{more}</p>"
    return effect_cards.leftovers(figures, result)


def next_experiment(result: Result) -> str:
    """Which experiment would tell more."""
    items = "".join(f"<li>{with_code(item)}</li>" for item in result.get("next_experiment") or [])
    return f"<ul>{items}</ul>" if items else ""


def steps(result: Result) -> str:
    """What was added and dropped, in order; what one fit was made after has one number."""
    rows, number, before = [], 0, None
    for step in result.get("steps") or []:
        error = step.get("rmse_train")
        number += error is None or error != before
        before = error
        what = f"{step['action']} {words(step['kind'])}" if step.get("kind") else step["action"]
        rows.append(
            [
                f'<th scope="row">{number}</th>',
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
    unit = esc(unit_text(torques_said(torques_told(result))))
    shown = tables.table(head, rows, label="Steps of the search")
    at_once = " What was added or dropped at once has one number, and one fit behind it." if number < len(rows) else ""
    return f"<p>Training error per joint after each step [{unit}].{at_once}</p>{shown}" if rows else ""
