"""A fleet from its file to its table: robots identified here or on a cluster, then pooled here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynid_rs.commands._fleet_file import FleetRobot
    from dynid_rs.commands._fleet_rows import Place
    from dynid_rs.pooling.fleet import Fleet

FILES = ("fleet.csv", "fleet.parquet", "fleet.json", "quantities.parquet", "fleet.html")
ROWS = ".rows"
"""Folder of the rows, one file per robot, so that a fleet goes on where it broke off."""


class FleetRun:
    """Robots of a file and the folder of their results; nothing is done before `run`.

    Parameters
    ----------
    robots, output : Path
        File of the fleet, and folder of the results.
    cache : Path, optional
        Where results of streamed runs are kept.
    n_jobs : int or None
        Robots at the same time; None: whatever `joblib.parallel_config` says.
    force : bool
        Replace finished results that this fleet did not write.
    false_alarms : float
        As `Fleet` takes it.

    Raises
    ------
    ValueError, OSError
        The file is no fleet, the folder cannot be used, or it holds tables that no fleet wrote.
    """

    def __init__(
        self,
        robots: Path,
        output: Path,
        *,
        cache: Path | None = None,
        n_jobs: int | None = 1,
        force: bool = False,
        false_alarms: float = 0.05,
    ) -> None:
        from dynid_rs.archive.work import Work
        from dynid_rs.commands._fleet_file import read_fleet
        from dynid_rs.commands._fleet_rows import Place, shared_key
        from dynid_rs.commands._given import opened_work
        from dynid_rs.commands._output import check_absent, check_folder, check_not_read

        if not 0 < false_alarms < 1:
            raise ValueError(f"--false-alarms must be a probability between 0 and 1, found {false_alarms}")
        check_folder(output, FILES)
        opened_work(cache, 1 if n_jobs is None else n_jobs)
        self.members: list[FleetRobot] = read_fleet(robots, output)
        places = {(output / name).absolute(): name for name in FILES}
        for member in self.members:
            if (taken := places.get(member.output.absolute())) is not None:
                raise ValueError(
                    f"{robots}: the results of robot {member.name!r} would stand where the fleet's own {taken} does; "
                    "give it another name or output"
                )
        check_not_read([output / name for name in FILES], [robots])
        if not force and not (output / ROWS).is_dir():
            check_absent(output / name for name in FILES)
        shared = shared_key()
        self.places: list[Place] = [
            Place(member, output / ROWS, shared, cache, force, Path.cwd()) for member in self.members
        ]
        self._output, self._false_alarms, self._work = output, false_alarms, Work(n_jobs=n_jobs)

    def run(self, say: Callable[[int], None] = lambda done: None) -> tuple[dict[str, Any], Fleet | None]:
        """Identify, pool, write the tables and the page.

        Returns the content of `fleet.json`, and the fleet where there is any arm. `say` is told how many robots are
        done.
        """
        from dynid_rs.commands._fleet_pooled import as_json, pooled, taken_estimate, with_verdicts
        from dynid_rs.commands._fleet_rows import rows_of

        rows: list[dict[str, Any]] = []
        arms = []
        for row, member in zip(rows_of(self.places, self._work), self.members, strict=True):
            estimate = taken_estimate(row, member)
            if estimate is not None:
                arms.append(estimate)
            rows.append(row)
            say(len(rows))
        fleet = pooled(arms, self._false_alarms)
        rows = with_verdicts(rows, fleet)
        answer = as_json(self.members, rows, fleet)
        self._write(rows, answer, fleet)
        return answer, fleet

    def n_done(self) -> int:
        """Robots whose rows are kept, once what processes that were killed have left behind is cleared."""
        from dynid_rs.base.held import clear_leftovers
        from dynid_rs.commands._fleet_rows import is_done

        for place in self.places:
            clear_leftovers(place.output)  # processes that are killed clear nothing
        return sum(map(is_done, self.places))

    def _write(self, rows: list[dict[str, Any]], answer: dict[str, Any], fleet: Fleet | None) -> None:
        import csv
        import io

        from dynid_rs.base.files import filled_together, write_json, write_table, write_text
        from dynid_rs.commands._fleet_pooled import quantity_table
        from dynid_rs.commands._fleet_rows import COLUMNS, table_of
        from dynid_rs.report.fleet import write_fleet_page

        text = io.StringIO()
        writer = csv.DictWriter(text, list(COLUMNS), extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        quantities = quantity_table(fleet)
        with filled_together(self._output) as folder:
            write_text(folder / "fleet.csv", text.getvalue())
            write_table(folder / "fleet.parquet", table_of(rows))
            write_table(folder / "quantities.parquet", quantities)
            write_json(folder / "fleet.json", answer)
            write_fleet_page(folder / "fleet.html", answer, quantities)


def identify_fleet(
    robots: str | Path,
    output: str | Path,
    *,
    cache: str | Path | None = None,
    n_jobs: int | None = None,
    force: bool = False,
    false_alarms: float = 0.05,
) -> Fleet:
    """Identify many robots and pool what arms of one type share: what `dynid fleet` does, from Python.

    Every robot is a unit of joblib's work. With `n_jobs` None the surrounding ``joblib.parallel_config`` says who does
    it: within ``parallel_config(backend="dask")`` it is the cluster of the current ``dask.distributed.Client``, whose
    workers see the same files under the same paths. Results are those of one process, bit for bit on processors that
    are alike, also where a worker dies on the way.

    Parameters
    ----------
    robots : str or Path
        File of the fleet, TOML or CSV.
    output : str or Path
        Folder of the results and tables.
    cache : str or Path, optional
        Where results of streamed runs are kept.
    n_jobs : int or None
        Robots at the same time; -1: one per core; None: as joblib is told.
    force : bool
        Replace finished results that this fleet did not write.
    false_alarms : float
        Probability that any arm of a fleet without odd arms is called odd.

    Raises
    ------
    ValueError, OSError
        The file is no fleet, a folder cannot be used, or no robot could be identified; the text is a sentence.
    """
    kept = None if cache is None else Path(cache)
    run = FleetRun(Path(robots), Path(output), cache=kept, n_jobs=n_jobs, force=force, false_alarms=false_alarms)
    _, fleet = run.run()
    if fleet is None:
        raise ValueError(f"{robots}: no robot could be identified; {Path(output) / 'fleet.csv'} says why")
    return fleet
