"""The tables that `dynid diagnose` ends with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from dynid_rs.base.numbers import change, interval, percent_interval, significant
from dynid_rs.base.quoting import shown
from dynid_rs.base.units import torques_said, torques_told
from dynid_rs.base.wording import NO_INTERVAL, against_reference, lacks_interval, worse_than_least_squares
from dynid_rs.commands._console import console
from dynid_rs.commands._identify_view import finding_lines
from dynid_rs.diagnosis.wording import effect_words, tie_words, unexplained_words
from dynid_rs.report import REPORT_FILE


def show(result: dict[str, Any], directory: Path) -> None:
    """Print the verdict, errors before and after, effects with their ties, what is left, and where the report is."""
    out = console()
    out.print(Text(result["verdict"]))
    out.print(_errors(result))
    if worse := worse_than_least_squares(result):
        out.print(Text(worse))
    if lacks_interval(result):
        out.print(Text(f"-: {NO_INTERVAL}"))
    for entry in result["effects"]:
        out.print(Text(_effect(entry, result)), soft_wrap=True)
    for entry in result["unexplained"]:
        out.print(Text(unexplained_words(entry)))
    for sentence in result["next_experiment"]:
        out.print(Text(f"next: {sentence}"), soft_wrap=True)
    findings = result["data"]["findings"]
    for line in finding_lines(one for one in findings if one["severity"] != "info" or one["code"] == "signal_missing"):
        out.print(Text(line))
    out.print(Text(f"report: {directory / REPORT_FILE}"), soft_wrap=True)


def _errors(result: dict[str, Any]) -> Table:
    test, before, after = result["rmse"]["test"], "links and smooth friction", "with what was found"
    if against_reference(result):
        before, after = "the reference as it is", "with what has changed"
    title = (
        f"RMSE on test runs [{torques_said(torques_told(result))}]\n"
        f"WLS: weighted least squares, before: {before}, after: {after}"
    )
    table = Table(title=Text(title), title_justify="left")
    table.add_column("joint")
    for heading in ("WLS", "before", "after", "95 % interval", "change", "95 % interval", "floor"):
        table.add_column(heading, justify="right")
    for j, joint in enumerate(result["joints"]):
        before, after, floor = test["before"][j], test["after"][j], test["floor"][j]
        errors = (significant(error) for error in (test["wls"][j], before, after))
        moved = change(after, before), percent_interval(test["change_interval"][j])
        left = "unknown" if floor is None else significant(floor)
        table.add_row(Text(shown(joint)), *errors, interval(test["after_interval"][j]), *moved, left)
    return table


def _effect(entry: dict[str, Any], result: dict[str, Any]) -> str:
    text = f"{entry['rank']}. {effect_words(entry, result['joints'], intervals=True)}"
    return text + "".join(f"\n   {tie_words(tie, result['joints'])}" for tie in entry["ties"])
