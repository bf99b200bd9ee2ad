"""Findings in the words of a file: channels by its own columns, not by signal and joint."""

from __future__ import annotations

import re
from dataclasses import replace

from dynid_rs.base.findings import Finding
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.columns import ColumnMap

_CHANNEL = re.compile(r"(?<![\w./-])(d{0,2}q(?:_motor)?|q_reference|tau|temperature)_(\d+)(?![\w.]*\w)")


def in_file_words(finding: Finding, columns: ColumnMap) -> Finding:
    """Return a finding of a check, which calls channels `tau_2`, with the columns that these were read from.

    Once only: columns of a file may be called `q_1` too, and be those of joint 0.
    """

    def own(signal: str, joint: str) -> str | None:
        read = "current" if signal == "tau" and signal not in columns.signals else signal
        names = columns.signals.get(read, ())
        return names[int(joint)] if int(joint) < len(names) else None

    def said(found: re.Match[str]) -> str:
        name = own(*found.groups())
        return found[0] if name is None else shown(name)

    channel = _CHANNEL.fullmatch(finding.column or "")
    column = columns.time if finding.column == "t" else channel and own(*channel.groups())
    return replace(finding, message=_CHANNEL.sub(said, finding.message), column=column or finding.column)
