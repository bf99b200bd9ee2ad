"""docs/measured/loop.md: experiments, seconds, names and held-out errors of the loop and of the other ways."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from campaigns.kept import commits_of
from campaigns.loop_ways import ENOUGH, MOST, SECONDS

Result = dict[str, Any]

WAYS = {
    "loop": "loop (`dynid excite --after`)",
    "exciting": "condition-optimal (`dynid excite`)",
    "random": "random",
}

INTRODUCTION = """# The loop

Written by `make loop SEED={seed} ARMS={arms}` (`python tests/campaigns/loop.py`) at commit {commit}. Arms, effects,
sensors and noise are drawn by the exam's generator (`tests/exam`), which shares no line with the product: none to three
effects of .3 to 3 times the noise by what the declared model leaves of them in a minute of ordinary motion. Nothing is
recorded at first, and nobody tells the product what is hidden. Every step is a command: `dynid excite`, `dynid
diagnose`, `dynid excite --after`, and so on, in motions of {seconds:g} s within the positions, speeds and accelerations
that the minute used, until `dynid excite --after` says that nothing more needs to be recorded, {most} motions at most.
Its first motion is condition-optimal.

*Error*: root mean square of what the model (`dynid estimate`) leaves of a run of ordinary motion that nothing else has
seen, below 6 Hz where a joint moves, over the oracle's; quadratic mean over the joints, in brackets the worst joint.
The *oracle* is told kinds, places and shapes of everything that is hidden, and the true motion; it fits coefficients
and the declared model to {most} condition-optimal motions.

"""


def page(invocation: Result, arms: Sequence[Result]) -> str:
    """Return the whole page."""
    about = {**invocation, "commit": commits_of(invocation, arms)}
    return INTRODUCTION.format(**about, seconds=SECONDS, most=MOST) + tables(arms) + "\n"


def tables(arms: Sequence[Result]) -> str:
    """Marks, then a row for every arm and way."""
    whole = [arm for arm in arms if arm["failure"] is None]
    parts = [_marks(arms), _ways(whole), _each(whole)]
    failed = [f"* {arm['seed']}: {arm['failure']}" for arm in arms if arm["failure"] is not None]
    return "\n\n".join([part for part in parts if part] + (["Not finished:\n\n" + "\n".join(failed)] if failed else []))


def told(arm: Result) -> str:
    """One line while the campaign runs."""
    if arm["failure"] is not None:
        return f"{arm['seed']}: {arm['failure']}"
    ends = ", ".join(f"{way} {steps[-1]['seconds']:g} s {steps[-1]['error']:.3g}" for way, steps in arm["ways"].items())
    return f"{arm['seed']} ({', '.join(arm['kinds']) or 'nothing hidden'}): {ends}"


def seconds_needed(steps: Sequence[Result]) -> float:
    """Of motion until a model is as good as the oracle; infinite where it never is."""
    return min((step["seconds"] for step in steps if step["error"] <= ENOUGH), default=np.inf)


def _marks(arms: Sequence[Result]) -> str:
    """Of all arms: one that was not finished has reached nothing."""
    if not arms:
        return "No arm was drawn."
    whole = [arm for arm in arms if arm["failure"] is None]
    good = sum(arm["ways"]["loop"][-1]["error"] <= ENOUGH for arm in whole)
    halves = 0
    for arm in whole:
        own, other = (seconds_needed(arm["ways"][way]) for way in ("loop", "exciting"))
        halves += np.isfinite(own) and own <= other / 2
    n = len(arms)
    return "\n".join(
        [
            "| mark | reached | met |",
            "|---|---|---|",
            f"| the loop ends with an error within 5 % of the oracle's | {good} of {n} arms | {_met(good == n)} |",
            "| it is within 5 % after at most half the seconds that condition-optimal motion needs | "
            f"{halves} of {n} arms | {_met(halves == n)} |",
        ]
    )


def _ways(arms: Sequence[Result]) -> str:
    """All arms together: when the loop ended, and the seconds until a model is as good as the oracle."""
    rows = [
        "| way | s until within 5 %: median | within 5 % at all | error when the loop ended: median, worst | "
        "right names | false names |",
        "|---|---|---|---|---|---|",
    ]
    for way, words in WAYS.items():
        then = [arm["ways"][way][len(arm["ways"]["loop"]) - 1] for arm in arms]
        needed = [seconds_needed(arm["ways"][way]) for arm in arms]
        errors = [step["error"] for step in then]
        if not then:
            continue
        middle = float(np.median(needed))
        rows.append(
            f"| {words} | {f'{middle:g}' if np.isfinite(middle) else f'over {MOST * SECONDS:g}'} | "
            f"{sum(np.isfinite(needed))} of {len(arms)} | {np.median(errors):.3g}, {max(errors):.3g} | "
            f"{sum(step['right'] for step in then)} of {sum(step['hidden'] for step in then)} | "
            f"{sum(step['false'] for step in then)} |"
        )
    return "\n".join(rows)


def _each(arms: Sequence[Result]) -> str:
    rows = [
        "| arm | hidden | way | experiments | s | right | false | error (worst joint) | s until within 5 % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for arm in arms:
        n = len(arm["ways"]["loop"])
        for way in WAYS:
            step, needed = arm["ways"][way][n - 1], seconds_needed(arm["ways"][way])
            first = way == "loop"
            ended = " (said so)" if first and not step["wanted"] else ""
            rows.append(
                f"| {arm['seed'] if first else ''} | {_hidden(arm) if first else ''} | {way} | {n}{ended} | "
                f"{step['seconds']:g} | {step['right']} of {step['hidden']} | {step['false']} | "
                f"{step['error']:.3g} ({step['worst']:.3g}) | {f'{needed:g}' if np.isfinite(needed) else '-'} |"
            )
    return "\n".join(rows)


def _hidden(arm: Result) -> str:
    return ", ".join(kind.replace("_", " ") for kind in arm["kinds"]) or "nothing"


def _met(met: bool) -> str:
    return "yes" if met else "**no**"
