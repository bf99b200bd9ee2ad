"""One row per robot of a fleet: identified, or looked up where nothing has changed, or the reason why not."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid_rs.archive.fingerprint import fingerprint
from dynid_rs.base import interrupt
from dynid_rs.commands._fleet_file import FleetRobot
from dynid_rs.commands._run import sentence

if TYPE_CHECKING:
    from dynid_rs.archive.survey import Entry
    from dynid_rs.archive.work import Work
    from dynid_rs.commands._job import Job

COLUMNS: dict[str, type] = {
    "name": str,
    "status": str,
    "message": str,
    "n_joints": int,
    "n_runs": int,
    "n_samples": int,
    "n_test_runs": int,
    "error_percent": float,
    "least_percent": float,
    "most_percent": float,
    "wls_percent": float,
    "type": str,
    "odd": str,
    "deviations": float,
    "why": str,
    "output": str,
}
"""Of the table: errors on test runs over the torque's standard deviation, mean, least and most over the joints; then
what the others of its type say of the arm (`_fleet_pooled.py`)."""
STATUS = ("done", "no", "failed")
"""As the exit codes of `dynid identify`."""


@dataclass(frozen=True)
class Place:
    """A robot and the folder in which its row is kept; with `force` any finished result is replaced.

    `home`: what relative paths are relative to, in whichever process and on whichever machine.
    """

    robot: FleetRobot
    rows: Path
    shared: str
    cache: Path | None
    force: bool = False
    home: Path = Path()

    @property
    def name(self) -> str:
        """Of the robot."""
        return self.robot.name

    @property
    def row(self) -> Path:
        """File of the row."""
        return self.home / self.rows / f"{self.name}.json"

    @property
    def output(self) -> Path:
        """Folder of the robot's results."""
        return self.home / self.robot.output


def rows_of(
    places: Sequence[Place], work: Work, unit: Callable[[Place], Entry] | None = None
) -> Iterator[dict[str, Any]]:
    """Rows in order; a robot whose process keeps dying is a row too."""
    unit = identify_one if unit is None else unit
    done = 0
    try:
        for row, _ in work.map(unit, places):  # type: ignore[arg-type]
            done += 1
            yield row
        return
    except ChildProcessError:
        pass
    # One after the other, so that a death has one name; what was done is looked up.
    for place in places[done:]:
        try:
            yield next(work.map(unit, [place]))[0]  # type: ignore[list-item]
        except ChildProcessError:
            yield failed(place.robot, "its process died again and again (out of memory, or killed)")


def identify_one(place: Place) -> Entry:
    """Row of a robot: a unit of work. Whatever is wrong with this robot stops no other."""
    from dynid_rs.base.files import write_json
    from dynid_rs.commands._identifier import MODEL_FILE, RESULT_FILE
    from dynid_rs.commands._output import check_unfinished
    from dynid_rs.model.robot_file import made_urdf

    robot = place.robot
    try:
        job = robot.job(place.home)
        # A xacro source or a MuJoCo model may be made of more files than the one that is named.
        made = made_urdf(job.robot, xacro=job.xacro)
        read = [_content(path) for path in job.inputs]
        key = fingerprint(place.shared, robot.options, str(robot.output), read, made)
        kept = _kept(place.row, key)
        if kept is not None and all((place.output / name).is_file() for name in (MODEL_FILE, RESULT_FILE)):
            return kept, {}
        if not (place.force or place.row.exists()):  # what another command has finished is not ours to replace
            check_unfinished(place.output, RESULT_FILE)
        place.row.parent.mkdir(parents=True, exist_ok=True)
        with _begun(place.row):
            row = _identified(place, job)
        write_json(place.row, {"key": key, "row": row})
    except Exception as error:
        interrupt.check()  # what fails after one has not failed of itself
        if isinstance(error, ValueError | OSError):
            return failed(robot, sentence(error)), {}
        # Our own bug, on this robot alone.
        return failed(robot, f"an error of the program: {type(error).__name__}: {sentence(error)}"), {}
    return row, {}


@contextmanager
def _begun(row: Path) -> Iterator[None]:
    """Mark a robot as the fleet's own: after a kill its folder may hold results, and no row tells of them."""
    from dynid_rs.base.files import write_json

    if row.exists():
        yield
        return
    write_json(row, {"key": "begun"})
    try:
        yield
    except Exception:
        row.unlink(missing_ok=True)
        raise


def _identified(place: Place, job: Job) -> dict[str, Any]:
    from dynid_rs.commands._given import opened_work
    from dynid_rs.commands._job import exit_code
    from dynid_rs.pooling.arm import ArmEstimate

    cache = None if place.cache is None else place.home / place.cache
    identifier, result = job.identified(lambda: opened_work(cache, 1), lambda words: None)
    test, data = result["rmse"]["test"], result["data"]
    std = np.asarray(test["torque_std"])
    known = std > 0
    share, baseline = (100 * np.asarray(test[name])[known] / std[known] for name in ("after", "wls"))
    joints = zip(result["joints"], test["after"], test["wls"], test["torque_std"], strict=True)
    return {
        "name": place.name,
        "status": "no" if exit_code(result) else "done",
        "message": result["verdict"],
        "n_joints": len(result["joints"]),
        "n_runs": len(data["train"]),
        "n_samples": data["n_samples"]["train"],
        "n_test_runs": len(data["test"]),
        "error_percent": float(share.mean()),
        "least_percent": float(share.min()),
        "most_percent": float(share.max()),
        "wls_percent": float(baseline.mean()),
        "output": str(place.robot.output),
        "torque_unit": result["torque_unit"],
        "estimate": ArmEstimate.of(place.name, identifier, result).to_json(),
        "joints": [dict(zip(("joint", "rmse", "wls", "torque_std"), joint, strict=True)) for joint in joints],
    }


def failed(robot: FleetRobot, message: str) -> dict[str, Any]:
    """Row of a robot that could not be identified."""
    nothing = dict.fromkeys(COLUMNS)
    return nothing | {"name": robot.name, "status": "failed", "message": message, "output": str(robot.output)}


def table_of(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Columns of the table, numbers that are not known as NaN."""
    table = {}
    for column, kind in COLUMNS.items():
        values = [row[column] for row in rows]
        if kind is not str:
            values = [np.nan if value is None else float(value) for value in values]
        table[column] = np.array(values, dtype=object if kind is str else np.float64)
    return table


def shared_key() -> str:
    """What every row depends on beside its own robot."""
    from dynid_rs.archive.work import program

    return program()


def is_done(place: Place) -> bool:
    """Whether the row of a robot is kept."""
    return _kept(place.row) is not None


def _kept(path: Path, key: str | None = None) -> dict[str, Any] | None:
    """Row in a file; None where there is none, or it is of another key."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return dict(content["row"]) if key is None or content["key"] == key else None
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _content(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return "unreadable"  # the identification says why
