"""Figures of many cases, and the goals that they are held against."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

HARMED, TOO_SLOW = 1.05, 60.0
"""A joint is worse from this ratio of errors on; a case is slow from these seconds on."""
GROUPS = ("clean", "single", "mixture", "outside", "elastic", "hazy")
Outcome = dict[str, Any]


@dataclass(frozen=True)
class Goal:
    """One line of the table: `reached` is None where there was nothing to count."""

    name: str
    wanted: str
    reached: float | None
    over: int
    met: bool


def goals(outcomes: list[Outcome]) -> list[Goal]:
    """Every goal of the exam."""
    clean, outside = (of_group(outcomes, group) for group in ("clean", "outside"))
    mixtures = of_group(outcomes, "mixture")
    worst = [max(o["harm"]) for o in outcomes if o["harm"]]
    covered = [told["covered"] for o in outcomes for told in o["intervals"]]
    names = sum(o["right"] + len(o["false"]) for o in mixtures)
    return [
        _most("clean cases with a false name", share(clean, has_false), 0.02, len(clean)),
        _most("false names a case, all cases", mean(len(o["false"]) for o in outcomes), 0.1, len(outcomes)),
        _most(
            "cases with a joint more than 1.05 times worse than declared",
            mean(ratio > HARMED for ratio in worst), 0.01, len(worst),
        ),
        _most("worst joint, error after over before", max(worst, default=None), 1.2, len(worst)),
        _recall("recall, single effects from 1 times the noise", 0.95, outcomes, "single", 1.0, float("inf")),
        _recall("recall, single effects from 0.3 to 1 times the noise", 0.8, outcomes, "single", 0.3, 1.0),
        _recall("recall in mixtures", 0.95, outcomes, "mixture", 0.3, float("inf")),
        _least("precision in mixtures", sum(o["right"] for o in mixtures) / names if names else None, 0.97, names),
        _most("outside cases with a wrong name", share(outside, has_false), 0.05, len(outside)),
        _least("95 % intervals that cover, at least", mean(covered), 0.93, len(covered)),
        _most("95 % intervals that cover, at most", mean(covered), 0.97, len(covered)),
        _most("cases that ended in a traceback or without a result", float(_failed(outcomes)), 0.0, len(outcomes)),
        _most("cases above 60 s", float(sum(o["seconds"] > TOO_SLOW for o in outcomes)), 0.0, len(outcomes)),
    ]  # fmt: skip


def of_group(outcomes: Iterable[Outcome], group: str) -> list[Outcome]:
    """Cases of one group."""
    return [o for o in outcomes if o["group"] == group]


def visible(outcomes: Iterable[Outcome], low: float = 0.3, high: float = float("inf")) -> list[dict[str, Any]]:
    """Hidden effects with a name that the oracle sees, of these sizes over the noise."""
    told = [effect for o in outcomes for effect in o["effects"]]
    return [effect for effect in told if effect["named"] and effect["seen"] and low <= effect["ratio"] < high]


def has_false(outcome: Outcome) -> bool:
    """Whether anything was named that is not there."""
    return bool(outcome["false"])


def harmed(outcome: Outcome) -> bool:
    """Whether a joint got worse."""
    return bool(outcome["harm"]) and max(outcome["harm"]) > HARMED


def share(outcomes: list[Outcome], test: Callable[[Outcome], bool]) -> float | None:
    """Share of the cases of which something is true."""
    return mean(test(outcome) for outcome in outcomes)


def mean(values: Iterable[float]) -> float | None:
    """Mean, or None of nothing."""
    listed = list(values)
    return sum(listed) / len(listed) if listed else None


def complaints(outcome: Outcome) -> list[str]:
    """What went wrong in a case, one phrase each."""
    told = []
    if outcome["failure"]:
        told.append(f"{outcome['failure']}: {outcome.get('message', '')}".rstrip(": "))
    told += [f"false: {name}" for name in outcome["false"]]
    told += [
        f"missed: {effect['kind']} at {', '.join(effect['joints'])} ({effect['ratio']:.2g})"
        for effect in outcome["effects"]
        if effect["named"] and effect["seen"] and effect["ratio"] >= 0.3 and not effect["found"]
    ]
    if harmed(outcome):
        told.append(f"a joint {max(outcome['harm']):.2f} times worse")
    if outcome["seconds"] > TOO_SLOW:
        told.append(f"{outcome['seconds']:.0f} s")
    return told


def _failed(outcomes: list[Outcome]) -> int:
    return sum(o["failure"] is not None for o in outcomes)


def _recall(name: str, wanted: float, outcomes: list[Outcome], group: str, low: float, high: float) -> Goal:
    seen = visible(of_group(outcomes, group), low, high)
    return _least(name, mean(effect["found"] for effect in seen), wanted, len(seen))


def _most(name: str, reached: float | None, bound: float, over: int) -> Goal:
    return Goal(name, f"at most {bound:g}", reached, over, reached is None or reached <= bound)


def _least(name: str, reached: float | None, bound: float, over: int) -> Goal:
    return Goal(name, f"at least {bound:g}", reached, over, reached is None or reached >= bound)
