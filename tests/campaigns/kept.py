"""Figures of a campaign that goes on where an earlier call broke off."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

Figures = dict[str, Any]


def read_kept(path: Path | None, invocation: Figures, same: tuple[str, ...], entries: str) -> Figures:
    """What an earlier call has kept at `path`; else nothing yet, of this invocation and commit.

    Raises
    ------
    SystemExit
        What is kept there is of another invocation: the values that are named in `same` differ.
    """
    now = commit()  # of the code that runs, whatever is checked out meanwhile
    if path is not None and path.exists():
        kept: Figures = json.loads(path.read_text(encoding="utf-8"))
        if any(kept["invocation"][name] != invocation[name] for name in same):
            raise SystemExit(f"error: {path} is of another {' or '.join(same)}; give another file")
        return kept
    return {"invocation": {**invocation, "commit": now}, entries: []}


def commits_of(invocation: Figures, entries: Iterable[Figures]) -> str:
    """Commits at which entries were found, in their order; one that does not say is of that of the first call."""
    return ", ".join(dict.fromkeys(entry.get("commit", invocation["commit"]) for entry in entries)) or str(
        invocation["commit"]
    )


@cache
def commit() -> str:
    """The commit of this checkout, and whether it was changed."""
    command = ["git", "describe", "--always", "--dirty"]
    here = Path(__file__).resolve().parent
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=here).stdout.strip()


def keep(path: Path | None, found: Figures) -> None:
    """Write the figures, if they are to be kept."""
    if path is not None:
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
