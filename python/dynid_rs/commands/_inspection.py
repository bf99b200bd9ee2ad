"""One run file as `dynid inspect` sees it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks import check_recording
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
