"""`dynid fleet`: many robots identified, one table out."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Annotated, Any

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import EXIT_NO, goes_on, print_json, run_command
from dynid_rs.commands._steps import Step

FILES = ("fleet.csv", "fleet.parquet", "fleet.json")
AGAIN = "the same command goes on with the others, and writes the table"
ROWS = ".rows"
"""Folder of the rows, one file per robot, so that a fleet goes on where it broke off."""


@run_command
def fleet(
    robots: Annotated[Path, typer.Argument(metavar="FLEET", help="TOML or CSV: one robot per entry")],
    output: _options.Output,
    cache: _options.Cache = None,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", help="Robots at the same time; -1: one per core")] = 1,
    force: Annotated[
        bool, typer.Option("--force", help="Replace finished results that this fleet did not write")
    ] = False,
    json_output: _options.Json = False,
) -> int:
    """Identify many robots: DIR/NAME holds each one's results, DIR/fleet.csv, .parquet and .json one row per robot.

    A robot that cannot be identified is said in its row and stops no other. What is done and has not changed is
    not done again, what has changed is; finished results of other commands are left alone without --force. Ends with
    1 if any robot failed, or is no better than weighted least squares.
    """
    from dynid_rs.archive.work import Work
    from dynid_rs.base.held import clear_leftovers
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._fleet_file import read_fleet
    from dynid_rs.commands._fleet_rows import Place, as_json, is_done, rows_of, shared_key
    from dynid_rs.commands._given import opened_work
    from dynid_rs.commands._output import check_absent, check_folder, check_not_read

    check_folder(output, FILES)
    opened_work(cache, jobs)
    members = read_fleet(robots, output)
    check_not_read([output / name for name in FILES], [robots])
    if not force and not (output / ROWS).is_dir():
        check_absent(output / name for name in FILES)
    shared = shared_key()
    places = [Place(member, output / ROWS, shared, cache, force) for member in members]
    rows: list[dict[str, Any]] = []

    def said() -> str:
        for place in places:
            clear_leftovers(place.robot.output)  # processes that are killed clear nothing
        return f"{sum(map(is_done, places))} of {len(members)} robots are done and kept; {AGAIN}"

    with goes_on(said), progress(Step(1, "0 of ")) as say:
        say(f"0 of {len(members)} robots")
        for row in rows_of(places, Work(n_jobs=jobs)):
            rows.append(row)
            say(f"{len(rows)} of {len(members)} robots")
    answer = as_json(members, rows)
    _write(output, rows, answer)
    if json_output:
        print_json(answer)
    else:
        from dynid_rs.commands._fleet_view import show

        show(answer, output)
    return 0 if answer["done"] == len(members) else EXIT_NO


def _write(output: Path, rows: list[dict[str, Any]], answer: dict[str, Any]) -> None:
    from dynid_rs.base.files import filled_together, write_json, write_table, write_text
    from dynid_rs.commands._fleet_rows import COLUMNS, table_of

    text = io.StringIO()
    writer = csv.DictWriter(text, list(COLUMNS), extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with filled_together(output) as folder:
        write_text(folder / "fleet.csv", text.getvalue())
        write_table(folder / "fleet.parquet", table_of(rows))
        write_json(folder / "fleet.json", answer)
