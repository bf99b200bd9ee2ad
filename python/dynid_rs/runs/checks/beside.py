"""What runs say of each other, whatever the arm: another unit of time, samples that are there twice."""

from __future__ import annotations

from collections.abc import Sequence

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.clocks import Clock, clock_findings
from dynid_rs.runs.checks.repeats import repeat_findings
from dynid_rs.runs.recording import Recording


def beside_each_other(runs: Sequence[Recording], findings: Sequence[Sequence[Finding]]) -> list[list[Finding]]:
    """Findings of each run with what it says beside the others, which comes first.

    Parameters
    ----------
    runs : sequence of Recording
        Of one arm.
    findings : sequence of sequence of Finding
        Of every run by itself. What the others' clocks tell of a run takes the place of what it told alone.
    """
    found = [list(own) for own in findings]
    for at, finding in clock_findings([Clock.of(run) for run in runs]).items():
        told = finding.code, finding.severity
        found[at] = [finding, *(own for own in found[at] if (own.code, own.severity) != told)]
    for at, finding in repeat_findings(runs).items():
        found[at].insert(0, finding)
    return found
