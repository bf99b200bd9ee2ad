"""The table that `dynid fleet` ends with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from dynid_rs.base.quoting import shown
from dynid_rs.commands._console import console


def show(answer: dict[str, Any], folder: Path) -> None:
    """Print a row per robot, why robots failed, and where the tables are."""
    out = console()
    title = "Error on test runs over the torque's standard deviation, mean over joints"
    table = Table(title=Text(title), title_justify="left")
    table.add_column("robot")
    table.add_column("status")
    for heading in ("joints", "runs", "weighted least squares", "three loops", "best to worst joint"):
        table.add_column(heading, justify="right")
    for row in answer["robots"]:
        if row["status"] == "failed":
            table.add_row(Text(shown(row["name"])), "failed", *5 * ("-",))
            continue
        table.add_row(
            Text(shown(row["name"])),
            row["status"],
            str(row["n_joints"]),
            str(row["n_runs"]),
            f"{row['wls_percent']:.1f} %",
            f"{row['error_percent']:.1f} %",
            f"{row['least_percent']:.1f} to {row['most_percent']:.1f} %",
        )
    out.print(table)
    for row in answer["robots"]:
        if row["status"] != "done":
            out.print(Text(f"{shown(row['name'])}: {row['message']}"), soft_wrap=True)
    out.print(Text(f"tables: {folder / 'fleet.csv'}, fleet.parquet, fleet.json"), soft_wrap=True)
