"""Right, wrong or silent: what was said of a run beside what was put into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

import dynid_rs as dyn
from campaigns.watch_arm import ROW
from campaigns.watch_changes import Truth

WORDS = {"offset": "constant torque", "slip": "encoder slip"}
"""A kind as people say it, where that is not its name."""


@dataclass(frozen=True)
class Outcome:
    """What became of one case.

    `name` is that of the first change that was named after the beginning: "right", "either" (one of two that were
    said), "wrong" or "none"; `motion` and `time` are seconds from the beginning to it, of the joint's motion and of
    the clock. `settled` is that of what it became: "right", "wrong", "withdrawn" or "none"; `error` is that of the
    settled size, relative, and `covered` whether its 95 % interval holds the truth. `moved` is whether the arm moves
    all the time as the change begins: at rest no channel tells anything. `early` were named before the beginning,
    `more` later and wrongly; what was said first of those stands in `next_said`.
    """

    label: str
    seed: int
    joint: str
    name: str = "none"
    said: str = ""
    motion: float | None = None
    time: float | None = None
    settled: str = "none"
    error: float | None = None
    covered: bool | None = None
    moved: bool = True
    early: int = 0
    more: int = 0
    next_said: str = ""

    def to_json(self) -> dict[str, object]:
        """As it is kept."""
        return asdict(self)


def is_named(change: dyn.Change, truth: Truth, joints: Sequence[str]) -> bool:
    """Whether kind and joint are right."""
    return change.kind in truth.kinds and (truth.joint is None or change.joint == joints[truth.joint])


def judge(label: str, seed: int, truth: Truth, joints: Sequence[str], watched: dyn.Watched, begun: float) -> Outcome:
    """Return the outcome of a run in which `truth` began at `begun` [s], by the run's stamps.

    The first row begins some samples after the run, so that rows do not tell when that was.
    """
    joint = "" if truth.joint is None else joints[truth.joint]
    named = [change for change in watched.changes if change.said == "named"]
    late = [change for change in named if change.t >= begun]
    early = len(named) - len(late)
    moved = bool(watched.watched.any(axis=1)[np.abs(watched.t - begun) < 1.5 * ROW].all())
    if not late:
        return Outcome(label, seed, joint, moved=moved, early=early)
    first, *others = late
    of_arm = truth.joint is None or "frozen" in truth.kinds
    moves = watched.watched.any(axis=1) if of_arm else watched.watched[:, truth.joint]
    rows = moves & (watched.t - begun > ROW / 2) & (watched.t <= first.t)  # those that lie behind the beginning
    wrong = [change for change in others if not is_named(change, truth, joints)]
    settled, error, covered = _settled(first, truth, joints, watched.changes)
    return Outcome(
        label,
        seed,
        joint,
        _named(first, truth, joints),
        str(first),
        float(ROW * np.count_nonzero(rows)),
        float(first.t - begun),
        settled,
        error,
        covered,
        moved,
        early,
        len(wrong),
        str(wrong[0]) if wrong else "",
    )


def _named(first: dyn.Change, truth: Truth, joints: Sequence[str]) -> str:
    if is_named(first, truth, joints):
        return "right" if first.either is None else "either"
    joint = "" if truth.joint is None else joints[truth.joint]
    others = ["a load" if kind == "load" else f"{WORDS.get(kind, kind)} of {joint}" for kind in truth.kinds]
    return "either" if first.either in others else "wrong"


def _settled(
    first: dyn.Change, truth: Truth, joints: Sequence[str], changes: Sequence[dyn.Change]
) -> tuple[str, float | None, bool | None]:
    """What became of the name: the next change that is not named anew."""
    frozen = first.kind == "frozen"
    later = [change for change in changes if change.said != "named" and change.t > first.t]
    became = [change for change in later if (change.kind == "frozen") == frozen]
    if not became:
        return "none", None, None
    last = became[0]
    if last.said == "withdrawn":
        return "withdrawn", None, None
    if not is_named(last, truth, joints):
        return "wrong", None, None
    if truth.size is None:
        return "right", None, None
    low, high = last.interval
    return "right", last.size / truth.size - 1, bool(low <= truth.size <= high)
