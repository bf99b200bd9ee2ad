"""`dynid identify`: measured runs and a robot in; a torque model, its errors on unseen runs, a report out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import goes_on, print_json, run_command


@run_command
def identify(
    robot: _options.Robot,
    runs: _options.Runs,
    output: _options.Output,
    test: _options.Test = None,
    test_from: _options.TestFrom = None,
    config: _options.Config = None,
    gravity: _options.Gravity = None,
    base: _options.Base = None,
    tip: _options.Tip = None,
    xacro: _options.Xacro = False,
    drive_gain: _options.DriveGain = None,
    weighting: _options.Weighting = "joint_variance",
    prior: _options.Prior = "auto",
    known: _options.Known = None,
    friction: Annotated[
        list[Path] | None, typer.Option(metavar="RUN", help="Run of the friction experiment; repeat for more")
    ] = None,
    friction_law: _options.FrictionLaw = None,
    residual: Annotated[
        str, typer.Option(help="Third loop on: auto, load_free_deflection, deflection, joint_state or none")
    ] = "auto",
    compensator: Annotated[str, typer.Option(help="Third loop by: mixture or rbf")] = "mixture",
    cutoff: _options.Cutoff = None,
    physical: Annotated[
        bool, typer.Option("--physical", help="Also masses and inertias that bodies can have, for `dynid export`")
    ] = False,
    memory: _options.Memory = "4GB",
    cache: _options.Cache = None,
    jobs: _options.Jobs = 1,
    force: _options.Force = False,
    json_output: _options.Json = False,
) -> int:
    """Identify friction, link dynamics and residual of an arm from measured runs.

    DIR then holds model.json (for `dynid estimate` and `dynid-estimator`), result.json, residuals.parquet
    and report.html. Ends with 1 if the data has an error in it or the model is no better than weighted least
    squares.
    """
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._given import opened_work
    from dynid_rs.commands._job import STEPS, Job, exit_code

    job = Job(
        robot=robot,
        runs=tuple(runs),
        output=output,
        test=tuple(test or ()),
        test_from=test_from,
        config=config,
        gravity=gravity,
        base=base,
        tip=tip,
        xacro=xacro,
        drive_gain=drive_gain,
        weighting=weighting,
        prior=prior,
        known=known,
        friction=tuple(friction or ()),
        friction_law=friction_law,
        residual=residual,
        compensator=compensator,
        cutoff=cutoff,
        physical=physical,
        memory=memory,
        force=force,
    )
    with goes_on(_after_interrupt(output, cache)), progress(*STEPS) as say:
        result = job.run(lambda: opened_work(cache, jobs), say)
    if json_output:
        print_json(result)
    else:
        from dynid_rs.commands._identify_view import show

        show(result, output)
    return exit_code(result)


def _after_interrupt(output: Path, cache: Path | None) -> Callable[[], str]:
    """What is left and how to go on: streamed runs are kept one by one, everything else begins again."""
    from dynid_rs.archive.cache import Cache
    from dynid_rs.commands._identifier import RESULT_FILE
    from dynid_rs.commands._output import after_interrupt

    said = after_interrupt(output / RESULT_FILE)

    def with_cache() -> str:
        kept = 0 if cache is None else len(Cache(cache).entries())
        return said() if not kept else f"{said()}, from the {kept} intermediate results that {cache} keeps"

    return with_cache
