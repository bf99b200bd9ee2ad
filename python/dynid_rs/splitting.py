"""What is learned from and what is kept aside, decided before anything is filtered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid_rs.findings import Finding
from dynid_rs.recording import Recording

LAST_PART = 1 / 3
"""Part of a lone run that is kept aside."""


@dataclass(frozen=True)
class Split:
    """Training and test runs; `finding` says how they were chosen where the user did not."""

    train: list[Recording]
    test: list[Recording]
    finding: Finding | None = None


def split_runs(runs: Sequence[Recording], test: Sequence[Recording], test_from: float | None = None) -> Split:
    """Split by the user's word, else keep the last whole run aside, else the last third of a lone run.

    Parameters
    ----------
    runs, test : sequence of Recording
        Runs to learn from, and runs to test on (may be empty).
    test_from : float, optional
        With one run and no test run: seconds after its start from which it is kept aside.

    Raises
    ------
    ValueError
        `test_from` with several runs or with test runs, or outside of the run.
    """
    if test_from is not None and (test or len(runs) != 1):
        raise ValueError("--test-from cuts a lone run; with --test or several runs there is nothing to cut")
    if test:
        return Split(list(runs), list(test))
    if len(runs) > 1:
        *train, last = runs
        message = f"no test run was named; {last.name}, the last one, was kept aside for testing"
        return Split(train, [last], Finding("test_run_chosen", "info", message, file=last.name))
    (run,) = runs
    start = run.duration * (1 - LAST_PART) if test_from is None else test_from
    if not 0 < start < run.duration:
        raise ValueError(f"--test-from must lie inside the run (0 to {run.duration:.3g} s), found {start:g}")
    row = int(np.searchsorted(run.t, run.t[0] + start))
    message = (
        f"there is one run; its first {start:.3g} s were learned from and the rest was kept aside for testing. "
        "A second run would test more"
    )
    first = replace(run.slice(None, row), name=f"{run.name} (first {start:.3g} s)")
    rest = replace(run.slice(row, None), name=f"{run.name} (after {start:.3g} s)")
    return Split([first], [rest], Finding("test_part_chosen", "info", message, file=run.name))
