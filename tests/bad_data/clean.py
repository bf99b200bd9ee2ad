"""Recordings in which nothing is wrong: what is said of them that is not true?

Two kinds, both drawn by the exam: clean recordings, of which no warning may be said but what is true of them; and
recordings of arms with effects of the catalogue or beyond it, which a diagnosis is for: no error may stop it.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from exam.case import ROBOT, write_case

from bad_data.ask import answer
from bad_data.judge import Said, said_by
from bad_data.sets import RunSet, clean_case, make_set
from bad_data.story import Story, Wanted


@dataclass
class Clean:
    """What was said of the recordings of one seed, beyond what is true of them; `group` as the exam has it."""

    seed: int
    group: str
    n_runs: int
    alarms: list[Said]
    failed: str = ""


def tell_clean(seed: int) -> Clean:
    """Tell the program clean runs of one arm."""
    made = make_set(clean_case(seed))
    with tempfile.TemporaryDirectory(prefix="bad-data-") as folder:
        paths = Story("clean", made, Wanted((), ())).write(Path(folder))
        said, failed = _asked(paths)
    true = true_of(made)
    alarms = [one for one in said if one.severity != "info" and one.code not in true]
    return Clean(seed, "clean", made.n_runs, alarms, failed)


def tell_effects(seed: int) -> Clean:
    """Tell the program the exam's case of a seed, as it is drawn: whatever is an error stops a diagnosis."""
    with tempfile.TemporaryDirectory(prefix="bad-data-") as folder:
        truth = write_case(seed, Path(folder))
        said, failed = _asked([Path(folder) / name for name in (*truth["train"], *truth["test"])])
    alarms = [one for one in said if one.severity == "error"]
    return Clean(seed, truth["group"], len(truth["train"]) + len(truth["test"]), alarms, failed)


def _asked(paths: list[Path]) -> tuple[list[Said], str]:
    try:
        return said_by(answer("inspect", paths[0].parent / ROBOT, paths, paths[0].parent / "out")), ""
    except Exception as error:  # a traceback is the worst answer
        return [], f"{type(error).__name__}: {error}"


def true_of(made: RunSet) -> set[str]:
    """Warnings that are true of a clean recording: the exam loses rows, jitters, and moves poorly now and then."""
    case, true = made.case, set()
    if case.missing:
        true |= {"gap"}
    if case.jitter:
        true |= {"jitter"}
    if any(together(s.dq) for s in made.world.runs):
        true |= {"joints_together"}
    if case.rate < 40.0 * 1.05:
        true |= {"sampling_rate"}
    return true


def together(dq: np.ndarray) -> bool:
    """Whether the true speeds of two joints (n, n_joints) are proportional, nearly."""
    moving = dq[:, np.ptp(dq, axis=0) > 0]
    correlation = np.abs(np.corrcoef(moving.T)) - np.eye(moving.shape[1])
    return bool(correlation.max() > 0.97)
