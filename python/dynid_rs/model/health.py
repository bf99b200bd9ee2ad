"""The health page: runs that were watched, as one page for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from os import PathLike
from pathlib import Path

import numpy as np

from dynid_rs.base.findings import Finding
from dynid_rs.base.units import angle_units, torques_said
from dynid_rs.model.standing import relative, standing
from dynid_rs.model.units import load_unit, torque_units
from dynid_rs.model.watch import Tolerated, Watch, Watched
from dynid_rs.report.health import write_health
from dynid_rs.report.health_source import Health, HealthRun
from dynid_rs.runs.recording import FloatArray


def health_page(
    watch: Watch,
    runs: Sequence[Watched],
    path: str | PathLike[str],
    *,
    findings: Sequence[Finding] = (),
    goes_on: bool = False,
) -> Path:
    """Write a page that says whether a model still holds, what has changed and when, and what to do.

    One HTML file that opens offline, of less than 2 MB whatever the length of the runs: what is left over what is
    expected is drawn in bins, each with its mean, its smallest and its largest row. Runs stand on the clock where their
    times are Unix time, else one after the other.

    Parameters
    ----------
    watch : Watch
        Has watched them.
    runs : sequence of Watched
        In the order in which they were recorded, at least one.
    path : str or path-like
        Of the page; a file there is replaced, whole or not at all.
    findings : sequence of Finding
        About the data, as `inspect` gives them.
    goes_on : bool
        Whether every run was watched with what the one before it had shown (``watch(run, remembered=)``); runs before
        which something stood were.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ValueError
        There is no run.
    OSError
        The place cannot be written, or something that is no file is there; the text is a sentence.
    """
    if not runs:
        raise ValueError("health_page: no run was watched; give one at least")
    robot, state = watch.model.robot, standing(watch, runs[-1])
    shown = [HealthRun(run.name, run.t, relative(run), run.changes) for run in runs]
    learned = () if hasattr(watch, "inflation_") else None
    health = Health(
        robot=robot.name,
        torque_unit=torques_said(torque_units(watch.model)),
        joints=tuple(robot.joint_names),
        runs=shown,
        standing=state.changes,
        expected=_usual(runs, robot.n_joints),
        residual=state.residual,
        row=watch.row,
        false_alarms_per_day=watch.false_alarms_per_day,
        tolerated=asdict(watch.tolerated or Tolerated()),
        healthy=getattr(watch, "healthy_", learned),
        findings=[finding.to_json() for finding in findings],
        angle_unit=" or ".join(sorted(set(angle_units(robot.joint_kinds)), reverse=True)),
        load_unit=load_unit(watch.model.torque_unit),
        goes_on=goes_on or any(run.before for run in runs),
    )
    return write_health(Path(path), health)


def _usual(runs: Sequence[Watched], n: int) -> FloatArray:
    """Median deviation of the rows in which a joint was watched (n,); NaN where there is none."""
    usual = np.full(n, np.nan)
    for j in range(n):
        own = np.concatenate([run.deviation[run.watched[:, j], j] for run in runs])
        if own.size:
            usual[j] = np.median(own)
    return usual
