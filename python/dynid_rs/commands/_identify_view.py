"""The table that `dynid identify` ends with."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from dynid_rs.base.findings import Finding, told_once
from dynid_rs.base.numbers import interval, percent, significant
from dynid_rs.base.quoting import shown
from dynid_rs.base.units import torques_said, torques_told
from dynid_rs.base.wording import NO_INTERVAL, lacks_interval, worse_than_least_squares
from dynid_rs.commands._console import console
from dynid_rs.report import REPORT_FILE


def show(result: dict[str, Any], directory: Path) -> None:
    """Print errors per joint, the verdict, warnings, and where the report is."""
    out = console()
    unit = torques_said(torques_told(result))
    test = result["rmse"]["test"]
    title = f"RMSE on test runs [{unit}] (and of the torque's standard deviation)"
    table = Table(title=Text(title), title_justify="left")
    table.add_column("joint")
    for heading in ("torque std", "weighted least squares", "three loops", "95 % interval", "floor"):
        table.add_column(heading, justify="right")
    for j, joint in enumerate(result["joints"]):
        std = test["torque_std"][j]
        table.add_row(
            Text(shown(joint)),
            significant(std),
            _with_share(test["wls"][j], std),
            _with_share(test["after"][j], std),
            interval(test["after_interval"][j]),
            _with_share(test["floor"][j], std),
        )
    out.print(table)
    if lacks_interval(result):
        out.print(Text(f"-: {NO_INTERVAL}"))
    out.print(Text(result["verdict"]))
    if worse := worse_than_least_squares(result):
        out.print(Text(worse))
    if "physical" in result:
        out.print(Text(f"Physical set: {result['physical']['reason']}"))
    delay = result["encoder_delay"]
    if delay is not None:
        out.print(f"Link encoders come late by {_milliseconds(delay)} ms (removed first).")
    for entry in result["known"]:
        out.print(Text(_known(entry, result)))
    for line in finding_lines(finding for finding in result["data"]["findings"] if finding["severity"] != "info"):
        out.print(Text(line))
    out.print(Text(f"report: {directory / REPORT_FILE}"), soft_wrap=True)


def _milliseconds(delay: dict[str, Any]) -> str:
    """Delays joint by joint; a dash where none could be measured, and no minus before nothing."""
    pairs = zip(delay["value"], delay["measured"], strict=True)
    return ", ".join(f"{round(1e3 * value, 2) + 0.0:.2f}" if measured else "-" for value, measured in pairs)


def _known(entry: dict[str, Any], result: dict[str, Any]) -> str:
    """Test error of a known term's joint with and without it, under the prior's weights and without a prior."""
    std = result["rmse"]["test"]["torque_std"][result["joints"].index(entry["joint"])]
    alone, prior = entry["rmse_test_alone"], entry.get("rmse_test_with_prior")
    text = f"{entry['kind'].replace('_', ' ')} of {shown(entry['joint'])}, known: test error "
    if prior is not None:
        off = entry["relative_uncertainty"]
        text += (
            f"{_with_share(prior['with'], std)} with it, {_with_share(prior['without_same_weight'], std)} without it "
            f"under the same weight of the prior (links off by {100 * off['with']:.2g} %), "
            f"{_with_share(prior['without'], std)} under the weight that the evidence finds then "
            f"({100 * off['without']:.2g} %); without a prior "
        )
    return f"{text}{_with_share(alone['with'], std)} with it, {_with_share(alone['without'], std)} without it."


def finding_lines(findings: Iterable[dict[str, Any]]) -> list[str]:
    """Findings of a result for the terminal, one line of every kind, with the file where the sentence names none."""
    told = told_once(
        Finding(one["code"], one["severity"], one["message"], one.get("file"), one.get("column")) for one in findings
    )
    files = (None if one.file is None or one.file in one.message else one.file for one, _ in told)
    return [
        f"{one.severity}: {text if file is None else f'{shown(file)}: {text}'}"
        for (one, text), file in zip(told, files, strict=True)
    ]


def _with_share(error: float | None, std: float) -> str:
    if error is None:
        return "unknown"
    return f"{significant(error)} ({percent(error / std if std > 0 else None)})"
