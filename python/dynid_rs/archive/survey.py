"""First pass: what every run holds, without keeping it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.archive.overlaps import marks_of
from dynid_rs.archive.runs import RunSource
from dynid_rs.archive.sample import Piece, pieces_of, recording_bytes, run_key, work_space
from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.clocks import Clock
from dynid_rs.runs.checks.repeats import Keys
from dynid_rs.runs.facts import RunFacts, check_facts
from dynid_rs.runs.splitting import repeated

Entry = tuple[dict[str, Any], Mapping[str, NDArray[Any]]]
"""What is kept of a unit of work: plain data for JSON, and arrays."""
MOST_FINDINGS = 5
"""More findings of one kind than this are counted, not listed."""


@dataclass(frozen=True, eq=False)
class Survey:
    """A run that was read and dropped again.

    `key`: hash of its samples; `n_bytes`, `work_space`: memory of its signals, and that learning from it would take;
    `pieces`: what a sample may take; `marks`: a few rows, by which runs with samples in common are found.
    """

    facts: RunFacts
    key: str
    n_samples: int
    n_bytes: int
    work_space: int
    findings: tuple[Finding, ...]
    pieces: tuple[Piece, ...]
    marks: Keys

    def to_entry(self) -> Entry:
        """Plain data and arrays."""
        facts = {name: getattr(self.facts, name) for name in ("name", "joints", "torque_unit", "has_motor_encoder")}
        facts["clock"] = asdict(self.facts.clock)
        cells = [piece.cells for piece in self.pieces]
        plain = {
            "facts": facts,
            "key": self.key,
            "n_samples": self.n_samples,
            "n_bytes": self.n_bytes,
            "work_space": self.work_space,
            "findings": [asdict(finding) for finding in self.findings],
            "pieces": [(piece.start, piece.stop, piece.key, piece.n_bytes, len(piece.cells)) for piece in self.pieces],
        }
        arrays = {name: getattr(self.facts, name) for name in ("moves", "lowest", "highest")}
        return plain, arrays | {"cells": np.concatenate(cells), "marks": self.marks}

    @staticmethod
    def from_entry(entry: Entry) -> Survey:
        """Inverse of `to_entry`."""
        plain, arrays = entry
        facts = plain["facts"] | {"joints": tuple(plain["facts"]["joints"]), "clock": Clock(**plain["facts"]["clock"])}
        facts |= {name: arrays[name] for name in ("moves", "lowest", "highest")}
        places = [field.name for field in fields(Finding)]
        findings = [Finding(**{name: finding[name] for name in places}) for finding in plain["findings"]]
        findings = [_with_rows(finding) for finding in findings]
        edges = np.cumsum([size for *_, size in plain["pieces"]])[:-1]
        cells = np.split(arrays["cells"], edges)
        pieces = [
            Piece(start, stop, key, own, n_bytes)
            for (start, stop, key, n_bytes, _), own in zip(plain["pieces"], cells, strict=True)
        ]
        numbers = {name: plain[name] for name in ("key", "n_samples", "n_bytes", "work_space")}
        more: dict[str, Any] = {"pieces": tuple(pieces), "marks": arrays["marks"]}
        return Survey(RunFacts(**facts), findings=tuple(findings), **more, **numbers)


def _with_rows(finding: Finding) -> Finding:
    if finding.rows is None:
        return finding
    start, stop = finding.rows
    return Finding(**(asdict(finding) | {"rows": (start, stop)}))


def survey_run(source: RunSource) -> Entry:
    """Read one run and say what it holds: a unit of work.

    Raises
    ------
    DataError, OSError
        It cannot be read, or is no run of this robot.
    """
    recording, findings = source.read()
    pieces = pieces_of(recording)
    return Survey(
        RunFacts.of(recording),
        run_key([piece.key for piece in pieces]),
        recording.n_samples,
        recording_bytes(recording),
        work_space(recording),
        tuple(findings),
        tuple(pieces),
        marks_of(recording),
    ).to_entry()


def check_surveys(robot: _core.RobotModel, surveys: Sequence[Survey], tested: Mapping[str, str]) -> None:
    """Refuse runs that no model of `robot` can be learned from, as `check_training_runs` does.

    `tested`: key to name of the test runs.

    Raises
    ------
    DataError
        Runs of another robot or kind, a joint that never moves, samples that are there twice.
    """
    check_facts(robot, [survey.facts for survey in surveys])
    seen: dict[str, str] = {}
    for survey in surveys:
        name = survey.facts.name
        if survey.key in seen:
            raise repeated(name, seen[survey.key], is_test=False, was_test=False)
        if survey.key in tested:
            raise repeated(tested[survey.key], name, is_test=True, was_test=False)
        seen[survey.key] = name


def gathered_findings(findings: Sequence[Finding]) -> list[Finding]:
    """Findings of many runs: the first of every kind, and how many more there are."""
    kinds: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        kinds.setdefault((finding.code, finding.severity), []).append(finding)
    gathered = []
    for (code, _), alike in kinds.items():
        gathered += alike[:MOST_FINDINGS]
        if len(alike) > MOST_FINDINGS:
            last = alike[-1]
            message = f"{len(alike) - MOST_FINDINGS} more findings of this kind, the last: {last.message}"
            gathered.append(Finding(code, last.severity, message, last.file))
    return gathered
