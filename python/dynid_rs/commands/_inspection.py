"""One run file as `dynid inspect` sees it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks import check_recording
from dynid_rs.runs.checks.clocks import Clock, clock_findings
from dynid_rs.runs.readers import Config, Run, read_run


@dataclass(frozen=True)
class Inspection:
    """One file: what was read and found, or why it could not be read."""

    path: Path
    run: Run | None = None
    findings: tuple[Finding, ...] = ()
    error: Exception | None = None


def inspect_run(path: Path, robot: Any | None, config: Config) -> Inspection:
    """Read and check one file; what the file did wrong is kept, not raised."""
    try:
        run = read_run(path, robot, config)
        notes = [Finding("column_ignored", "info", note, run.recording.name) for note in run.columns.notes]
        return Inspection(path, run, (*check_recording(run.recording, robot), *notes))
    except (ValueError, OSError) as error:
        return Inspection(path, error=error)


def compared(inspections: Sequence[Inspection]) -> list[Inspection]:
    """Add what runs say of each other: a run whose time is in another unit than that of the rest."""
    result, clocks = list(inspections), {}
    for k, inspection in enumerate(inspections):
        if inspection.run is not None:
            clocks[k] = Clock.of(inspection.run.recording)
    places = list(clocks)
    for at, finding in clock_findings(list(clocks.values())).items():
        inspection = inspections[places[at]]
        others = [f for f in inspection.findings if (f.code, f.severity) != (finding.code, finding.severity)]
        result[places[at]] = replace(inspection, findings=(finding, *others))
    return result
