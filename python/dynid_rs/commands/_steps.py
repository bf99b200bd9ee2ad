"""How far a command is: which step, of how many, and about how long it still takes."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

_PART = re.compile(r"\b(\d+) of (\d+)\b")
"""Words such as "search 3 of 12 finished" tell how much of their step is done."""
EARLY_SECONDS, EARLY_SHARE = 1.0, 0.05
"""Before this nothing is said of the time that is left: a guess would jump."""


@dataclass(frozen=True)
class Step:
    """Part of a command.

    Parameters
    ----------
    share : float
        Its usual time over that of the others, in any unit.
    begins : str
        How the words begin that open it; other words belong to the step that is open.
    """

    share: float
    begins: tuple[str, ...]

    def __init__(self, share: float, *begins: str) -> None:
        object.__setattr__(self, "share", share)
        object.__setattr__(self, "begins", begins)


@dataclass
class Steps:
    """Where in a plan a command is.

    Parameters
    ----------
    plan : sequence of Step
        In their order; steps that do not come are passed over.
    clock : callable
        Seconds since some instant.
    """

    plan: Sequence[Step]
    clock: Callable[[], float] = time.monotonic
    words: str = ""
    _at: int = field(default=-1, init=False)
    _done: float = field(default=0.0, init=False)
    _begin: float = field(default=0.0, init=False)
    _heard: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._begin = self._heard = self.clock()

    def say(self, words: str) -> None:
        """Hear what is being done now."""
        self.words, self._heard = words, self.clock()
        for place in range(max(self._at, 0), len(self.plan)):
            if words.startswith(self.plan[place].begins):
                self._at = place
                break
        before = sum(step.share for step in self.plan[: max(self._at, 0)])
        part = _PART.search(words)
        inside = self.plan[self._at].share * int(part[1]) / max(int(part[2]), 1) if part and self._at >= 0 else 0.0
        self._done = (before + inside) / sum(step.share for step in self.plan) if self.plan else 0.0

    @property
    def seconds_left(self) -> float | None:
        """By the share that is done and the time it took; None while that says little."""
        taken = self._heard - self._begin
        if taken < EARLY_SECONDS or self._done < EARLY_SHARE:
            return None
        return max(taken / self._done - (self.clock() - self._begin), 0.0)

    def line(self) -> str:
        """One line for people."""
        place = "" if self._at < 0 else f"step {self._at + 1} of {len(self.plan)}: "
        left = self.seconds_left
        return place + self.words + ("" if left is None else f" (about {shown_time(left)} left)")


def shown_time(seconds: float) -> str:
    """In the unit that a person would say."""
    if seconds < 90:
        return f"{max(round(seconds), 1)} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
