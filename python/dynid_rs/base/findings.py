"""A finding: one fact about a run that its owner should know."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from dynid_rs.base.codes import mend_of
from dynid_rs.base.errors import DataError

Severity = Literal["info", "warning", "error"]
SEVERITIES: tuple[Severity, ...] = ("info", "warning", "error")


def joint_words(*names: str) -> str:
    """Call joints in a sentence: `joint elbow`, `joints 0, 2`, but `joint_1` as it is."""
    listed = ", ".join(names)
    if any("joint" in name.lower() for name in names):
        return listed
    return f"{'joint' if len(names) == 1 else 'joints'} {listed}"


@dataclass(frozen=True)
class Finding:
    """One fact about a run, with its place and its size.

    Parameters
    ----------
    code : str
        Stable name of the fact, e.g. ``"gap"``.
    severity : {"info", "warning", "error"}
        ``"error"`` means that a model learned from this run would be wrong.
    message : str
        One sentence for a person.
    file, column : str, optional
        Where it is; columns by signal and 0-based joint, e.g. ``"tau_2"``; `dynid inspect` and `dynid init` say the
        file's own.
    rows : tuple of int, optional
        Half-open range of 0-based data rows.
    value : float, optional
        Size of the fact, in `unit`.
    unit : str, optional
        Unit of `value`.
    line : int, optional
        1-based line of the first of `rows`, where the file is a text.
    """

    code: str
    severity: Severity
    message: str
    file: str | None = None
    column: str | None = None
    rows: tuple[int, int] | None = None
    value: float | None = None
    unit: str | None = None
    line: int | None = None

    def as_error(self) -> DataError:
        """Return the error of whoever cannot go on with such a run."""
        return DataError(
            f"{self.file}: {self.message}",
            code=self.code,
            file=self.file,
            column=self.column,
            row=None if self.rows is None else self.rows[0],
        )

    def to_json(self) -> dict[str, object]:
        """Fields that are known, ready for `json.dumps`; with the mend that belongs to the code."""
        fields: dict[str, object] = {"code": self.code, "severity": self.severity, "message": self.message}
        if self.file is not None:
            fields["file"] = self.file
        if self.column is not None:
            fields["column"] = self.column
        if self.rows is not None:
            fields["rows"] = list(self.rows)
        if self.value is not None:
            fields["value"] = self.value
        if self.unit is not None:
            fields["unit"] = self.unit
        if self.line is not None:
            fields["line"] = self.line
        mend = mend_of(self.code)
        if mend is not None:
            fields["mend"] = mend
        return fields


def told_once(findings: Iterable[Finding]) -> list[tuple[Finding, str]]:
    """The same fact about several joints or runs once: the first finding of it, and its sentence with the others."""
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.severity, finding.code), []).append(finding)
    told = []
    for first, *others in groups.values():
        also = [*(one.column for one in others), *(one.file for one in others)]
        named = ", ".join(dict.fromkeys(name for name in also if name and name not in (first.column, first.file)))
        told.append((first, f"{first.message} (also {named})" if named else first.message))
    return told


@contextmanager
def blaming(findings: Iterable[Finding]) -> Iterator[None]:
    """What is wrong with the runs is the error where it lets no model be fitted; nothing that comes of it is.

    Raises
    ------
    DataError
        The first finding that is an error, in the place of a ValueError of the body that names no data.
    """
    try:
        yield
    except DataError:
        raise
    except ValueError as error:
        for finding in findings:
            if finding.severity == "error":
                raise finding.as_error() from error
        raise
