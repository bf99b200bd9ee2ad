"""What is wrong, or worth knowing, about one run."""

from __future__ import annotations

from collections.abc import Iterable

from dynid_rs.base.findings import SEVERITIES, Finding
from dynid_rs.runs.checks.channels import check_channels
from dynid_rs.runs.checks.derivatives import check_derivatives
from dynid_rs.runs.checks.encoders import check_encoders
from dynid_rs.runs.checks.excitation import check_excitation
from dynid_rs.runs.checks.limits import Limited, check_limits, check_magnitudes
from dynid_rs.runs.checks.motion import moving_joints
from dynid_rs.runs.checks.timing import check_timing, relative_jitter
from dynid_rs.runs.checks.torque import check_drive_torque
from dynid_rs.runs.recording import OptionalSignal, Recording

__all__ = ["check_recording", "contradicting_signals", "moving_joints", "refused_sources", "relative_jitter", "severity_order"]

_SOURCES: tuple[OptionalSignal, ...] = ("dq", "ddq", "dq_motor")


def check_recording(rec: Recording, robot: Limited | None = None) -> list[Finding]:
    """Look for everything that would spoil a model learned from this run.

    Parameters
    ----------
    rec : Recording
        The run.
    robot : robot model, optional
        With it, positions are compared with its limits (`lower`, `upper`).

    Returns
    -------
    list of Finding
        Errors first, then warnings, then information.

    Raises
    ------
    ValueError
        Robot and recording have different numbers of joints.
    """
    if robot is not None and len(robot.lower) != rec.n_joints:
        raise ValueError(f"{rec.name}: the run has {rec.n_joints} joints, the robot has {len(robot.lower)}")
    damaged = list(check_magnitudes(rec))
    if damaged:  # the other checks would only compare absurd numbers with each other
        return damaged
    timing = list(check_timing(rec))
    if any(finding.severity == "error" for finding in timing):  # speeds, delays and rests would all be wrong
        return sorted(timing, key=severity_order)
    findings = [
        *timing,
        *check_drive_torque(rec, robot),
        *check_channels(rec),
        *check_limits(rec, robot),
        *check_derivatives(rec),
        *check_encoders(rec),
        *check_excitation(rec),
    ]
    broken = {finding.column for finding in findings if finding.code == "position_jump"}
    findings = [finding for finding in findings if not _follows(finding, broken)]
    if rec.torque_unit == "A":
        findings.append(
            Finding(
                "torque_in_ampere",
                "info",
                "torque is a motor current: every result is in A; with a drive gain in N m/A it is in N m",
                rec.name,
            )
        )
    return sorted(findings, key=severity_order)


def severity_order(finding: Finding) -> int:
    """Key that sorts findings: errors first, then warnings, then information."""
    return -SEVERITIES.index(finding.severity)


def _follows(finding: Finding, broken: set[str | None]) -> bool:
    """Whether a finding only says that the two encoders of a joint differ, of which one jumps."""
    joint = (finding.column or "").rpartition("_")[2]
    return finding.code == "motor_disagrees" and bool({f"q_{joint}", f"q_motor_{joint}"} & broken)


def contradicting_signals(rec: Recording) -> tuple[OptionalSignal, ...]:
    """`refused_sources` of a run's findings, without the others."""
    # Where numbers are damaged, they are all that `check_recording` finds.
    return () if list(check_magnitudes(rec)) else refused_sources(check_derivatives(rec))


def refused_sources(findings: Iterable[Finding]) -> tuple[OptionalSignal, ...]:
    """Signals that contradict the position they belong to; for `Recording.without`."""
    codes = {finding.code for finding in findings}
    return tuple(signal for signal in _SOURCES if f"{signal}_disagrees" in codes)
