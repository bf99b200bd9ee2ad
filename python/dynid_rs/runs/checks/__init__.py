"""What is wrong, or worth knowing, about one run."""

from __future__ import annotations

from collections.abc import Iterable

from dynid_rs.base.findings import SEVERITIES, Finding
from dynid_rs.runs.checks.bits import check_bits
from dynid_rs.runs.checks.channels import check_channels
from dynid_rs.runs.checks.derivatives import check_derivatives
from dynid_rs.runs.checks.encoders import check_encoders
from dynid_rs.runs.checks.excitation import check_excitation
from dynid_rs.runs.checks.limits import Limited, check_limits, check_magnitudes
from dynid_rs.runs.checks.motion import moving_joints, with_lines
from dynid_rs.runs.checks.spikes import check_spikes
from dynid_rs.runs.checks.timing import check_timing, gaps, relative_jitter
from dynid_rs.runs.checks.torque import check_drive_torque
from dynid_rs.runs.recording import OptionalSignal, Recording

__all__ = [
    "check_recording",
    "contradicting_signals",
    "contradictions",
    "gaps",
    "is_damage",
    "moving_joints",
    "refused_sources",
    "relative_jitter",
    "severity_order",
]

_BROKEN = ("stuck", "position_jump", "wrapped", "lost_bits")
"""Findings on a position that make everything that is compared with it look wrong."""
_REACH = ("position_limits", "encoder_offset", "encoder_delay")
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
        return with_lines(rec, damaged)
    timing = list(check_timing(rec))
    if any(finding.severity == "error" for finding in timing):  # speeds, delays and rests would all be wrong
        return with_lines(rec, sorted(timing, key=severity_order))
    findings = [
        *timing,
        *check_drive_torque(rec, robot),
        *check_spikes(rec),
        *check_bits(rec),
        *check_channels(rec),
        *check_limits(rec, robot),
        *check_derivatives(rec),
        *check_encoders(rec),
        *check_excitation(rec),
    ]
    findings = _without_consequences(findings)
    if rec.torque_unit == "A":
        findings.append(
            Finding(
                "torque_in_ampere",
                "info",
                "torque is a motor current: every result is in A; with a drive gain in N m/A it is in N m",
                rec.name,
            )
        )
    return with_lines(rec, sorted(findings, key=severity_order))


def is_damage(finding: Finding) -> bool:
    """Whether a finding is an error that makes whatever is fitted to its run, or compared with it, look wrong.

    A run that rests all the time does not: others may move.
    """
    return finding.severity == "error" and finding.code != "joint_never_moves"


def severity_order(finding: Finding) -> int:
    """Key that sorts findings: errors first, then warnings, then information."""
    return -SEVERITIES.index(finding.severity)


def _without_consequences(findings: list[Finding]) -> list[Finding]:
    """Findings less those that only say once more, in other words, what another one says."""
    if any(f.code in ("units_degrees", "units_mixed", "units_length") and f.severity == "error" for f in findings):
        # Angles 57 times too large reach, jump and travel too far, and lengths 1000 times.
        return [f for f in findings if f.code not in (*_BROKEN, "position_limits", "encoder_offset")]
    broken = {_joint(finding) for finding in findings if finding.code in _BROKEN and "q" in _signal(finding)}
    coarse = {finding.column for finding in findings if finding.code == "lost_bits"}
    findings = [f for f in findings if f.column not in coarse or f.code not in ("stuck", "saturated", "position_jump")]
    return [
        finding
        for finding in findings
        if not ((finding.code.startswith(("motor_", "dq_")) or finding.code in _REACH) and _joint(finding) in broken)
    ]


def _signal(finding: Finding) -> str:
    return (finding.column or "").rpartition("_")[0].removeprefix("d")


def _joint(finding: Finding) -> str:
    return (finding.column or "").rpartition("_")[2]


def contradicting_signals(rec: Recording) -> tuple[OptionalSignal, ...]:
    """`refused_sources` of a run's findings, without the others."""
    return refused_sources(contradictions(rec))


def contradictions(rec: Recording) -> list[Finding]:
    """Findings of `check_recording` on signals that contradict the position they belong to."""
    # Where numbers are damaged, they are all that `check_recording` finds.
    found = [] if list(check_magnitudes(rec)) else with_lines(rec, list(check_derivatives(rec)))
    return [finding for finding in found if refused_sources([finding])]


def refused_sources(findings: Iterable[Finding]) -> tuple[OptionalSignal, ...]:
    """Signals that contradict the position they belong to; for `Recording.without`."""
    codes = {finding.code for finding in findings}
    return tuple(signal for signal in _SOURCES if f"{signal}_disagrees" in codes)
