"""`dynid fleet`: many robots identified, one table and one report out, the odd ones named."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import EXIT_NO, goes_on, print_json, run_command
from dynid_rs.commands._steps import Step

AGAIN = "the same command goes on with the others, and writes the table"


@run_command
def fleet(
    robots: Annotated[Path, typer.Argument(metavar="FLEET", help="TOML or CSV: one robot per entry")],
    output: _options.Output,
    cache: _options.Cache = None,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", help="Robots at the same time; -1: one per core")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers identify the robots, as tcp://host:8786"),
    ] = None,
    false_alarms: Annotated[
        float,
        typer.Option(metavar="P", help="Probability that any arm of a fleet without odd arms is called odd"),
    ] = 0.05,
    force: Annotated[
        bool, typer.Option("--force", help="Replace finished results that this fleet did not write")
    ] = False,
    json_output: _options.Json = False,
) -> int:
    """Identify many robots, compare arms of one type, name the odd ones: one table, one report.

    DIR/NAME holds each robot's results; DIR/fleet.csv, .parquet and .json one row per robot, quantities.parquet one per
    arm and quantity; fleet.html shows which arms are odd and why, all arms, and what arms of one type share.
    A robot that cannot be identified is said in its row and stops no other. What is done and has not changed is
    not done again, what has changed is; finished results of other commands are left alone without --force. Ends with
    1 if any robot failed, or is no better than weighted least squares.
    """
    from dynid_rs.commands._cluster import on_cluster
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._fleet_run import FleetRun

    if scheduler is not None and jobs != 1:
        raise ValueError("--scheduler and --jobs exclude each other: the cluster says how many work")
    run = FleetRun(
        robots,
        output,
        cache=cache,
        n_jobs=jobs if scheduler is None else None,
        force=force,
        false_alarms=false_alarms,
    )
    n_robots = len(run.members)

    def said() -> str:
        return f"{run.n_done()} of {n_robots} robots are done and kept; {AGAIN}"

    with goes_on(said), progress(Step(1, "0 of ")) as say, on_cluster(scheduler):
        say(f"0 of {n_robots} robots")
        answer, _ = run.run(lambda done: say(f"{done} of {n_robots} robots"))
    if json_output:
        print_json(answer)
    else:
        from dynid_rs.commands._fleet_view import show

        show(answer, output)
    return 0 if answer["done"] == n_robots else EXIT_NO
