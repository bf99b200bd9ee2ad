"""An answer of the program against what had to be said of a set."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from bad_data.story import Wanted

FOLLOWS = ("refused",)


@dataclass(frozen=True)
class Said:
    """One thing that was said: a finding, an effect, or the error that ended the command; `file` "" is of all runs."""

    severity: str
    code: str
    file: str
    column: str
    rows: tuple[int, int] | None
    line: int | None
    mend: str
    message: str

    def short(self) -> str:
        """The place and the name."""
        return f"{self.severity} {self.code} {self.file} {self.column}"


@dataclass
class Mark:
    """Whether it was found, and named right; `wrong` says what was not."""

    found: bool = False
    named: bool = False
    wrong: list[str] = field(default_factory=list)


def said_by(answer: dict[str, Any]) -> list[Said]:
    """Everything that `dynid inspect`, `identify` or `diagnose` has said with --json."""
    if "error" in answer:
        return [_said({**answer["error"], "severity": "error"}, "")]
    if "runs" not in answer:
        return [*(_said(finding, "") for finding in answer["data"]["findings"]), *_effects(answer)]
    found = [_said(finding, "") for finding in answer.get("robot_findings", [])]
    found += [_said(finding, "") for finding in answer.get("findings", [])]
    for run in answer["runs"]:
        name = re.split(r"[/\\]", run["path"])[-1]
        if "error" in run:
            found.append(_said({**run["error"], "severity": "error"}, name))
        found += [_said(finding, name) for finding in run.get("findings", [])]
    return found


def _effects(answer: dict[str, Any]) -> list[Said]:
    """What a diagnosis has found in the torque channels, joint by joint: it explains what others have to refuse."""
    found = []
    for effect in answer.get("effects", []):
        if effect["kind"] == "torque_delay":
            columns = [f"tau_{answer['joints'].index(joint)}" for joint in effect["joints"]]
            found += [Said("info", "torque_late", "", column, None, None, "fitted", "") for column in columns]
    return found


def _said(finding: dict[str, Any], file: str) -> Said:
    rows = finding.get("rows")
    if rows is None and finding.get("row") is not None:
        rows = [finding["row"], finding["row"] + 1]
    return Said(
        finding["severity"],
        finding.get("code", ""),
        finding.get("file", file),
        finding.get("column") or "",
        None if rows is None else (rows[0], rows[1]),
        finding.get("line"),
        finding.get("mend", ""),
        finding["message"],
    )


def judge(said: list[Said], wanted: Wanted) -> Mark:
    """Mark an answer: found if the right name was said, named if it was said of the right place and nothing misleads.

    Misleading is an error that is said of a file that is good, or that has a name which does not follow from the fault.
    """
    mark = Mark()
    right = [one for one in said if one.code in wanted.codes]
    mark.found = bool(right)
    placed = [one for one in right if not _misplaced(one, wanted)]
    if not right:
        mark.wrong.append(f"not found among: {'; '.join(one.short() for one in said if one.severity != 'info')}")
    elif not placed:
        mark.wrong.append(f"said of another place: {_misplaced(right[0], wanted)} ({right[0].short()})")
    allowed = {*wanted.codes, *wanted.also}
    for one in said:
        if one.severity == "error" and (one.code not in allowed or not _among(one.file, wanted)):
            mark.wrong.append(f"misleads: {one.short()}")
    mark.named = mark.found and not mark.wrong
    return mark


def _among(file: str, wanted: Wanted) -> bool:
    if not file:
        return wanted.everywhere
    return any(file == name or file.startswith(f"{name} (") for name in wanted.files)


def _misplaced(one: Said, wanted: Wanted) -> str:
    """What is wrong about the place of a finding with the right name; empty where nothing is."""
    if not _among(one.file, wanted):
        return f"file {one.file or '-'}"
    of_all = not one.file and not one.column and len(wanted.columns) > 1
    if wanted.columns and one.column not in wanted.columns and not of_all:
        return f"column {one.column or '-'}"
    if wanted.rows is not None and (one.rows is None or one.rows[1] <= wanted.rows[0] or wanted.rows[1] <= one.rows[0]):
        return f"rows {one.rows} for {wanted.rows}"
    if wanted.words and not any(word in one.message for word in wanted.words):
        return f"cause: {one.message}"
    if one.file.endswith(".csv") and one.rows is not None and one.line is None and "(line" not in one.message:
        return "no line"
    return "" if one.mend or ";" in one.message or ":" in one.message else "no mend"
