"""What `dynid init` says of files and of what it took: nothing twice, and no mend that has been done."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dynid_rs.runs.readers import Run

MOST_NAMES = 4
"""Files that are listed by name before the rest are counted."""
MEND = re.compile(r"(?:; if so write in|: say so in) dynid\.toml")


def told(runs: Sequence[Run]) -> list[str]:
    """What is to be known of the files: the same of several once."""
    files: dict[str, list[str]] = {}
    for run in runs:
        for one in run.findings():
            if one.message:
                files.setdefault(one.message, []).append(run.recording.name)
    return [f"{_listed(list(dict.fromkeys(names)))}: {message}" for message, names in files.items()]


def _listed(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMES
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:MOST_NAMES])} and {more} more"


def fact(message: str) -> str:
    """A finding's sentence without its mend: that has been done where the finding is the evidence."""
    return MEND.split(message)[0]
