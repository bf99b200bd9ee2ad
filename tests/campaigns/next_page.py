"""docs/measured/next_experiment.md: how many open cases each way of moving on settles, and what was said beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from campaigns.kept import commits_of

Result = dict[str, Any]

WAYS = {
    "designed": "designed (`dyn.next_experiment`)",
    "random": "random",
    "exciting": "condition-optimal (`dyn.FourierExcitation`)",
}

INTRODUCTION = """# Next experiment

Written by `python tests/campaigns/next_experiment.py --seed {seed} --minutes {minutes:g}
--page docs/measured/next_experiment.md` at commit {commit}. Arms, effects, sensors and noise are drawn by the exam's
generator (`tests/exam`), which shares no line with the product: one effect of a kind that seconds of motion can show,
of .3 to .5 times the noise by what the declared model leaves of it in a minute of ordinary motion (two runs of 30 s:
harmonics, moves, stop and go, poor motion); where such an effect cannot be made so small it is larger, and where an arm
shows none of its kind another one stands in, of any kind of the exam. *Open* are the cases in which the effect has no
name after that minute, is told as one of two, or stands beside a false name. They are moved on by at most two motions
of 20 s within the robot file's limits, with the accelerations that the commands take where none are given, and
diagnosed anew on all runs. *Settled*: the effect is named, told apart, and nothing else is.

"""


def page(invocation: Result, cases: Sequence[Result]) -> str:
    """Return the whole page."""
    head = INTRODUCTION.format(**{**invocation, "commit": commits_of(invocation, cases)})
    return head + tables(cases) + "\n\n" + _kinds(cases) + "\n\n" + _said(cases) + "\n"


def tables(cases: Sequence[Result]) -> str:
    """Drawn, open, and settled by way."""
    open_ = [case for case in cases if case["open"]]
    failed = [case for case in cases if case["failure"]]
    head = (
        f"{len(cases)} cases drawn, {len(failed)} of them without an effect that could be placed or with data "
        f"that was refused; {len(open_)} open after a minute, {sum(c['first']['tie'] for c in open_)} of them told as "
        "one of two."
    )
    rows = [
        "| motions after the minute | settled by the first | by two | with a false name at the end |",
        "|---|---|---|---|",
    ]
    for way, words in WAYS.items():
        done = [case["ways"][way] for case in open_ if case["ways"].get(way)]
        first = sum(steps[0]["settled"] for steps in done)
        end = sum(steps[-1]["settled"] for steps in done)
        false = sum(steps[-1]["false"] > 0 for steps in done)
        rows.append(f"| {words} | {_share(first, len(done))} | {_share(end, len(done))} | {false} of {len(done)} |")
    return "\n\n".join([head, "\n".join(rows), *_stopped(open_)])


def _stopped(open_: Sequence[Result]) -> list[str]:
    """Ways that ended with an error: what they left is not settled."""
    lines = [
        f"* {case['seed']}, {way}: {steps[-1]['failure']}"
        for case in open_
        for way, steps in case["ways"].items()
        if steps and steps[-1].get("failure")
    ]
    return ["Stopped with an error, and counted as not settled:\n\n" + "\n".join(lines)] if lines else []


def _kinds(cases: Sequence[Result]) -> str:
    open_ = [case for case in cases if case["open"]]
    rows = ["| effect | open | designed | random | condition-optimal |", "|---|---|---|---|---|"]
    for kind in sorted({case["effect"] for case in open_}):
        own = [case for case in open_ if case["effect"] == kind]
        counts = [sum(case["ways"][way][-1]["settled"] for case in own if case["ways"].get(way)) for way in WAYS]
        rows.append(f"| {kind} | {len(own)} | " + " | ".join(map(str, counts)) + " |")
    return "\n".join(rows)


def _said(cases: Sequence[Result]) -> str:
    """What was said before the first designed motion."""
    first = [case["ways"]["designed"][0] for case in cases if case["open"] and case["ways"].get("designed")]
    asked = sum(any(q["kind"] == case["effect"] for q in case["questions"]) for case in cases if case["open"])
    planned = [step for step in first if "cpu_s" in step]
    times = [step["times"] for step in planned if step["times"] is not None]
    if not planned:
        return "Nothing was open." if not first else "No motion could be designed."
    said = f"In {asked} of {len(first)} open cases the effect's kind is among the questions that are said to be open. "
    if times:
        said += (
            f"Random motion is said to need {np.median(times):.2g} times as long as the designed one to tell as much "
            f"(median; {np.quantile(times, 0.9):.2g} at the 90th percentile). "
        )
    return said + f"A design takes {np.median([step['cpu_s'] for step in planned]):.0f} s of the processor (median)."


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole}" + (f" ({100 * part / whole:.0f} %)" if whole else "")
