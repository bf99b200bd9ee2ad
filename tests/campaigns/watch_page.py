"""docs/measured/watch.md: marks, clean hours, changes by kind, and every case in which something went wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from campaigns.watch_arm import RATED, STEP, TOLERATED_LOAD, WARM, WELL
from campaigns.watch_changes import AT, CHANGES, ENDS, LATE, OFFSET, REACH, SLIPPED
from campaigns.watch_judge import Outcome

BY_HAND = "## Why"
DAY = 86400.0
SHARE = 0.95
FAULTS = ("channel frozen", "channel lost")
SMALL_LOAD = "load, 5 % of rated"
STOPPED = "stopped with an error"

Result = dict[str, Any]

INTRODUCTION = """# Watch

Written by `python tests/campaigns/watch.py --seed {seed} --cycles {cycles} --cases {cases}
--page docs/measured/watch.md` at commit {commit}. Arms, motions, encoders and torque channels are the exam's
(`tests/exam`), which shares no line with the product; the product sees a robot file and recordings at 1 kHz. Of the
exam's arms those are taken that a model can be right of: one or two encoders, 5 to 7 joints, nothing hidden, no sample
missing, torque in N m. Their noise is coloured, with a memory of 0.02 to 0.5 s, drawn per joint; its size is the
exam's, 0.2 to 4 % of the torque's deviation.

Every model is identified from twelve runs of 40 s; the healthy runs are others (*clean*: six of 100 s, cold, warming
and warm; *changes*: three of 80 s), and so are those that are watched. Everything is as it is by default, but for the
tolerated load: {tolerated} of the rated payload, which is taken to be {rated} of the arm's moving mass (the usual
0.1 kg would be more than 5 % of it on a small arm).
"""

ABOUT_CLEAN = """## Clean

{cycles:,} cycles, {hours:.2f} h of arms' time, in pieces of 60 to 200 s that go on from one another by `remembered`:
sums of harmonics, moves from point to point, stop and go, with rests; a break in which the arm cools down after every
seventh or so. Friction of every joint warms up within 10 to 30 min, from up to {warm} less (or more) than what the
model was learned at to as much more (or less). {expected:.3f} false alarms are promised at most on average; more than
{likely} would be less likely than one in twenty.

*Error*: what the model leaves of rows of a run that nothing else saw, as warm as those that it was learned from, over
what the channels' noise alone leaves of them (steps of encoders are in it too); worst joint. *Healthy*: the same of the
healthy runs, from cold to warm. *Grown*: what the clean rows leave over what is expected after the healthy ones, least
and greatest of the joints; the promise is about one, or less. *Watched*: rows in which some joint says something.
"""

ABOUT_CHANGES = """## Changes

{arms} arms, each kind once on each, in a run of its own of {ends:.0f} s with a motion of its own; the change begins at
{at:.0f} s, and friction is as warm as it was. The joint is drawn; that of a gain is one whose load varies more than its
friction (as in the exam). A constant torque is {offset:.0f} deviations of what the rows of its joint usually leave. A
load's centre is within {reach:.0f} cm of the last link's origin. A channel becomes late by {late} ms, noise and all, on
a joint that is chosen like a gain's. The encoder (of two the link's) slips by {slipped} rad on a joint on which that
makes at least as much as a constant torque somewhere on the arm. A channel that freezes stays where it was (right:
*frozen* on its joint); one that is lost shows 0 (right: *frozen*, or *gain*, of which it has lost all).

*Right*, *one of two* (`A or B`, one of them right), *wrong*: the first name that is said. *s of motion*: from the
beginning to the right name, while the joint (of a load or a fault: any) moves within what the model was trained on;
half / 95 % of all cases; *s*: the same by the clock. *Settled*: right / wrong / withdrawn / not by the end. *Size
off*: of settled ones with the right name; half / 95 % of them. *Covered*: settled intervals of 95 % that hold the
truth. *More*: wrong names later in the same runs.
"""


def page(invocation: dict[str, Any], results: Sequence[Result], before: str) -> str:
    """The page as Markdown; what stands in `before` under `BY_HAND` was written by hand, and stays."""
    by_hand = before[before.index(BY_HAND) :] if BY_HAND in before else f"{BY_HAND}\n"
    parts = [
        INTRODUCTION.format(**invocation, tolerated=_percent(TOLERATED_LOAD), rated=f"1/{round(1 / RATED)}"),
        "## Marks\n",
        marks_table(results),
        _clean(results),
        _changes(results),
        "## What went wrong\n",
        _wrong(results),
        by_hand,
    ]
    return "\n".join(parts)


def of(results: Sequence[Result], work: str) -> list[Result]:
    """Results of a kind of work that came to an end."""
    return [one for one in results if one["work"] == work and one["failure"] is None]


def outcomes_of(results: Sequence[Result], *labels: str) -> list[Result]:
    """Outcomes of these changes, of all arms; those that stopped with an error have named none."""
    found = []
    for one in results:
        if one["work"] == "changes":
            silent = [Outcome(label, one["seed"], "").to_json() | {"motion_kind": STOPPED} for label in CHANGES]
            found += [o for o in (silent if one["failure"] else one["outcomes"]) if o["label"] in labels]
    return found


def marks_table(results: Sequence[Result]) -> str:
    """The issue's marks, beside what was reached."""
    rows = []
    clean = of(results, "clean")
    if clean:
        expected, alarms = promised(clean), sum(len(one["alarms"]) for one in clean)
        reached = f"{alarms} in {hours(clean):.2f} h; {expected:.3f} are promised at most, on average"
        rows.append(("false alarms: at most one a day", reached, alarms <= likely(expected)))
    if arms := of(results, "changes"):
        early, waited = sum(o["early"] for o in outcomes_of(results, *CHANGES)), len(arms) * len(CHANGES) * AT
        reached = f"{early} in {waited / 3600:.2f} h; {waited / DAY:.3f} are promised at most, on average"
        rows.append(("the same before a change begins", reached, early <= likely(waited / DAY)))
    friction = outcomes_of(results, "friction +20 %")
    if friction:
        part = [hit(o) and o["motion"] <= 60.0 for o in friction]
        rows.append(("friction +20 % named within 60 s of motion", _share(part), _enough(part)))
    load = outcomes_of(results, SMALL_LOAD)
    if load:
        part = [hit(o) and o["motion"] <= 2.0 for o in load]
        rows.append(("5 % of rated payload named within 2 s of motion", _share(part), _enough(part)))
    for label in (SMALL_LOAD, "load, 20 % of rated"):
        settled = [o for o in outcomes_of(results, label) if o["error"] is not None]
        if settled:
            part = [abs(o["error"]) <= 0.05 for o in settled]
            rows.append((f"{label}: settled mass within 5 %", _share(part), _enough(part)))
    fault = outcomes_of(results, *FAULTS)
    if fault:
        part = [hit(o) and o["time"] <= 0.1 for o in fault]
        rows.append(("a sensor fault named within 100 ms", _share(part), _enough(part)))
        part = [named for named, o in zip(part, fault, strict=True) if o["moved"]]
        rows.append(("the same, of arms that move as it begins", _share(part), _enough(part)))
    for words, labels in (("all kinds", tuple(CHANGES)), ("without sensor faults", _without_faults())):
        every = outcomes_of(results, *labels)
        if every:
            alone = [o["name"] == "right" for o in every]
            both = [hit(o) for o in every]
            reached = f"{_share(alone)} alone, {_share(both)} with one of two names"
            rows.append((f"right name in 95 %, {words}", reached, _enough(both)))
    told = [(mark, reached, "yes" if met else "**no**") for mark, reached, met in rows]
    return _table(("mark", "reached", "met"), told)


def hit(outcome: Result) -> bool:
    """Whether the right name was said, alone or as one of two."""
    return outcome["name"] in ("right", "either")


def hours(clean: Sequence[Result]) -> float:
    """Of arms' time."""
    return sum(one["cycles"] for one in clean) * STEP / 3600


def promised(clean: Sequence[Result]) -> float:
    """Expected number of alarms that is promised, at one a day."""
    return hours(clean) * 3600 / DAY


def likely(expected: float) -> int:
    """Alarms that such an expectation passes in no more than one of twenty such campaigns (Poisson)."""
    count, term = 0, math.exp(-expected)
    total = term
    while total < SHARE:
        count += 1
        term *= expected / count
        total += term
    return count


def within(times: Sequence[float | None], share: float) -> float:
    """Time within which this share is done; of one that never is (None), infinity."""
    ordered = sorted(math.inf if t is None else t for t in times)
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


def _without_faults() -> tuple[str, ...]:
    return tuple(label for label in CHANGES if label not in FAULTS)


def _clean(results: Sequence[Result]) -> str:
    clean = of(results, "clean")
    if not clean:
        return ""
    rows = [
        (
            str(one["seed"]),
            f"{one['joints']}, {one['encoders']}",
            f"{one['mass']:.0f}",
            f"{min(one['memory']):.2f} to {max(one['memory']):.2f}",
            f"{max(one['error']):.2f}",
            f"{max(one['healthy']):.2f}",
            f"{min(one['grown']):.2f} to {max(one['grown']):.2f}",
            f"{one['cycles']:,}",
            str(one["pieces"]),
            _percent(one["moved"]),
            str(len(one["alarms"])),
            str(sum(became == "withdrawn" for *_, became in one["alarms"])),
        )
        for one in clean
    ]
    head = ("arm", "joints, encoders", "kg", "memory [s]", "error", "healthy", "grown", "cycles", "pieces", "watched")
    expected = promised(clean)
    cycles = sum(one["cycles"] for one in clean)
    said = [f"* arm {one['seed']}, {t:.0f} s: {what}; {became}" for one in clean for t, what, became in one["alarms"]]
    about = ABOUT_CLEAN.format(
        cycles=cycles, hours=hours(clean), warm=_percent(WARM), expected=expected, likely=likely(expected)
    )
    return "\n".join([about, _table((*head, "false alarms", "of them withdrawn"), rows), *said, ""])


def _changes(results: Sequence[Result]) -> str:
    arms = [one for one in results if one["work"] == "changes"]
    if not arms:
        return ""
    rows = []
    for label in CHANGES:
        cases = outcomes_of(results, label)
        count = {name: sum(o["name"] == name for o in cases) for name in ("right", "either", "wrong", "none")}
        times = [_halves([o[clock] if hit(o) else None for o in cases]) for clock in ("motion", "time")]
        errors = sorted(abs(o["error"]) for o in cases if o["error"] is not None)
        covered = [o["covered"] for o in cases if o["covered"] is not None]
        became = [sum(o["settled"] == name for o in cases) for name in ("right", "wrong", "withdrawn", "none")]
        rows.append(
            (
                label,
                str(len(cases)),
                *(str(n) for n in count.values()),
                *times,
                " / ".join(map(str, became)),
                f"{_percent(within(errors, 0.5), 1)} / {_percent(within(errors, SHARE), 1)}" if errors else "-",
                _share(covered) if covered else "-",
                str(sum(o["more"] for o in cases)),
            )
        )
    head = ("change", "cases", "right", "one of two", "wrong", "no name", "s of motion", "s", "settled", "size off")
    late, slipped = (" to ".join(f"{size:g}" for size in sizes) for sizes in (LATE, SLIPPED))
    about = ABOUT_CHANGES.format(
        arms=len(arms), ends=ENDS, at=AT, offset=OFFSET, reach=100 * REACH, late=late, slipped=slipped
    )
    return "\n".join([about, _table((*head, "covered", "more"), rows), *_identified(results), ""])


def _halves(times: Sequence[float | None]) -> str:
    return " / ".join("never" if math.isinf(t) else f"{t:.1f}" for t in (within(times, 0.5), within(times, SHARE)))


def _identified(results: Sequence[Result]) -> list[str]:
    """Arms whose models are poor, or that stopped with an error: none is left out silently."""
    there = [one for one in results if one["failure"] is None]
    poor = [f"{one['seed']} ({max(one['error']):.1f})" for one in there if max(one["error"]) > WELL]
    failed = [f"* arm {one['seed']}: {one['failure']}" for one in results if one["failure"]]
    return [
        f"Not identified well (error of more than {WELL:g} on some joint), and counted all the same: {len(poor)} of",
        f"{len(there)} arms{', ' if poor else ''}{', '.join(poor)}. Stopped with an error: {len(failed)}.",
        *failed,
    ]


def _wrong(results: Sequence[Result]) -> str:
    lines = []
    for label in CHANGES:
        for o in outcomes_of(results, label):
            where = f"* {label}, arm {o['seed']}{', ' + o['joint'] if o['joint'] else ''}, {o['motion_kind']}"
            if o["name"] == "none":
                lines.append(f"{where}: no name")
            elif o["name"] == "wrong":
                lines.append(f"{where}: {o['said']}; settled: {o['settled']}")
            elif o["settled"] in ("wrong", "withdrawn"):
                lines.append(f"{where}: {o['said']}; then {o['settled']}")
            if o["more"] and hit(o):
                lines.append(f"{where}: later {o['more']} more, {o['next_said']}")
            if o["early"]:
                lines.append(f"{where}: {o['early']} named before the beginning")
    return "\n".join([*lines, ""]) if lines else "Nothing.\n"


def _enough(part: Sequence[bool]) -> bool:
    return sum(part) >= SHARE * len(part)


def _percent(part: float, digits: int = 0) -> str:
    return f"{100 * part:.{digits}f} %"


def _share(part: Sequence[bool]) -> str:
    return f"{sum(part)} of {len(part)}"


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join(["| " + " | ".join(line) + " |" for line in lines] + [""])
