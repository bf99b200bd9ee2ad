"""`dynid report`: write the HTML report again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid_rs.commands._run import print_json, run_command


@run_command
def report(
    directory: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder with result.json and residuals.parquet", show_default=False),
    ],
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Write DIR/report.html again, from DIR/result.json and DIR/residuals.parquet."""
    from dynid_rs.report import write_report

    path = write_report(directory)
    if json_output:
        print_json({"report": str(path)})
    else:
        typer.echo(path)
    return 0
