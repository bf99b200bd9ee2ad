"""What `dynid watch` answers: lines for people, one object for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dynid_rs.base.changes import FROZEN
from dynid_rs.base.findings import Finding, told_once
from dynid_rs.base.numbers import percent
from dynid_rs.base.quoting import shown
from dynid_rs.commands._run import said_of

if TYPE_CHECKING:
    from dynid_rs.model.watch import Watched


def has_changed(watched: Sequence[Watched]) -> bool | None:
    """Whether something has; None where no joint of any run could be watched, or no run was named."""
    changed = any(change.said != "withdrawn" for run in watched for change in run.changes)
    return changed if changed or any(run.watched.any() for run in watched) else None


def answer(
    watched: Sequence[Watched], joints: Sequence[str], findings: Sequence[Finding], errors: Sequence[Exception]
) -> dict[str, Any]:
    """As `--json` prints it; `errors` are of a run that could not be watched."""
    return {
        "format": "dynid-watch",
        "version": 1,
        "joints": list(joints),
        "changed": has_changed(watched),
        "runs": [
            {
                "run": run.name,
                "before": [change.to_json() for change in run.before],
                "changes": [change.to_json() for change in run.changes],
                "rows": len(run.t),
                "watched": run.watched.mean(axis=0).tolist() if len(run.t) else [0.0] * len(joints),
            }
            for run in watched
        ],
        "findings": [finding.to_json() for finding in findings],
        **said_of(errors),
    }


def lines(watched: Sequence[Watched], joints: Sequence[str], findings: Sequence[Finding]) -> list[str]:
    """One line per change, and what was not seen."""
    said = []
    for run in watched:
        nothing = "nothing new" if run.before else "nothing has changed"
        nothing = nothing if run.watched.any() else "could not be watched"
        said.append(f"{shown(run.name)}:" if run.changes else f"{shown(run.name)}: {nothing}")
        said += [f"  stood before: {change.place}{change.what}" for change in run.before]
        said += [f"  {change}" for change in run.changes]
        frozen = {change.joint for change in (*run.before, *run.changes) if change.kind == FROZEN}
        share = run.watched.mean(axis=0) if len(run.t) else [0.0] * len(joints)
        pairs = zip(joints, share, strict=True)
        unseen = [shown(joint) for joint, part in pairs if part == 0 and joint not in frozen]
        if unseen:
            said.append(
                f"  not watched, for they never move as in the runs that model and watch know: {', '.join(unseen)}"
            )
        elif min(share) < 0.5:
            said.append(f"  watched in {percent(float(min(share)))} of the run only, of the joint that moves least")
    return [*said, *(f"{one.severity}: {text}" for one, text in told_once(findings) if one.severity != "info")]
