"""The tables that `dynid fleet` ends with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from dynid_rs.base.numbers import percent
from dynid_rs.base.quoting import shown
from dynid_rs.commands._console import console

MOST_ROWS = 60
"""Robots that a terminal shows one by one; of more it shows the odd ones and those that failed, and the tables have
all."""


def show(answer: dict[str, Any], folder: Path) -> None:
    """Print a row per robot, why robots failed, which arms are odd and why, and where the tables are."""
    out = console()
    rows = answer["robots"]
    listed = rows if len(rows) <= MOST_ROWS else [row for row in rows if row["odd"] == "yes"][:MOST_ROWS]
    if listed:
        out.print(_table(listed))
    if len(listed) < len(rows):
        out.print(Text(f"{len(rows)} robots; shown are {len(listed)} that are odd, the tables have all"))
    for row in rows:
        if row["status"] != "done":
            out.print(Text(f"{shown(row['name'])}: {row['message']}"), soft_wrap=True)
    _show_odd(out, answer)
    tables = "fleet.parquet, fleet.json, quantities.parquet"
    out.print(Text(f"tables: {folder / 'fleet.csv'}, {tables}"), soft_wrap=True)
    out.print(Text(f"report: {folder / 'fleet.html'}"), soft_wrap=True)


def _table(rows: list[dict[str, Any]]) -> Table:
    title = "Error on test runs over the torque's standard deviation, mean over joints"
    table = Table(title=Text(title), title_justify="left")
    table.add_column("robot")
    table.add_column("status")
    for heading in ("joints", "runs", "weighted least squares", "three loops", "best to worst joint", "odd"):
        table.add_column(heading, justify="right")
    for row in rows:
        if row["status"] == "failed":
            table.add_row(Text(shown(row["name"])), "failed", *6 * ("-",))
            continue
        table.add_row(
            Text(shown(row["name"])),
            row["status"],
            str(row["n_joints"]),
            str(row["n_runs"]),
            f"{row['wls_percent']:.1f} %",
            f"{row['error_percent']:.1f} %",
            f"{row['least_percent']:.1f} to {row['most_percent']:.1f} %",
            {"unknown": "-"}.get(row["odd"], row["odd"]),
        )
    return table


def _show_odd(out: Any, answer: dict[str, Any]) -> None:
    """Arms that are odd with their causes, or why none could be named."""
    pooling = answer["pooling"]
    if pooling is None:
        return
    rows = answer["robots"]
    known = sum(row["odd"] in ("yes", "no") for row in rows)
    for row in (row for row in rows if row["odd"] == "yes"):
        out.print(Text(f"{shown(row['name'])} is odd: {row['why']}"), soft_wrap=True)
    if known:
        said = f"{answer['odd']} of {known} arms are odd; chance of a false alarm in all at most"
        out.print(Text(f"{said} {percent(pooling['false_alarms'])}"), soft_wrap=True)
    for reason in dict.fromkeys(row["why"] for row in rows if row["odd"] == "unknown"):
        out.print(Text(reason), soft_wrap=True)
