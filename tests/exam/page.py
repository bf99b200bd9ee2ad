"""docs/measured/exam.md: goals, groups, kinds, intervals, and every case in which something went wrong."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from exam.draw import MOTIONS, NAMED, REPORTED, SIGN_LAWS
from exam.tally import GROUPS, Goal, Outcome, complaints, goals, harmed, has_false, mean, of_group, share, visible

INTRODUCTION = """# Exam

Written by `make exam`, in one go and with no hand in it: {n} simulated cases, each drawn from one seed (arm, motion,
sensors, what is hidden in it). The examiner (`tests/exam`) shares no line with the product: it has physics (on
Pinocchio), friction, noise and effects of its own, calls `dynid diagnose` as a user does, and compares `result.json`
with what it has hidden. {kind} {version}

*Noise* is what the torque channels and the encoders' steps leave to a right model, in a band of 6 Hz. The *size* of an
effect is the RMS of what rigid body, rotors, offsets and friction (its sign rounded in any of three ways) **cannot
imitate** of it, over that noise, on the joint that shows it most (ripple of more than 12 cycles a turn: over the noise
at full rate; gears: over the steps of two encoders). An effect is *seen* if an F test that is told kind, joint and
shape, and everything else that is hidden, gives it less than one chance in 100,000. A case is *clean* if less than 0.3
of the noise is left of everything in it.
`unknown` is never a false name. A right name needs kind and joint; an effect that is named as a tie only is found, and
what was named in its place is false. What is told as one or another kind ("spring or cylinder"), or as a law or another
function of the same angle, is `unknown`; the effect is found if it is among them, and counted in *as a tie only*.
"""
CHOICE = "Some of these seeds are below {0}: they are for choosing, and the figures are no report."
REPORT = "All seeds are {0} or more: nobody had looked at them. (Those below are for choosing.)"


def page(outcomes: list[Outcome], version: str, machine: str) -> str:
    """Return the page as Markdown."""
    outcomes = sorted(outcomes, key=lambda outcome: outcome["seed"])
    fresh = all(o["seed"] >= REPORTED for o in outcomes)
    parts = [
        INTRODUCTION.format(
            n=len(outcomes), kind=(REPORT if fresh else CHOICE).format(REPORTED), version=f"{version} {machine}".strip()
        ),
        goals_table(outcomes),
        "## Groups\n\n`elastic`: one encoder on gears that yield visibly, which no name of the catalogue can say. "
        "`hazy`: nothing that is visible alone, but more than 0.3 of the noise together.\n",
        _groups(outcomes, [(group, _in_group(group)) for group in GROUPS]),
        "## Conditions\n",
        _groups(outcomes, CONDITIONS),
        "## Kinds\n\nHidden effects that the oracle sees, alone or in mixtures.\n",
        _kinds(outcomes),
        "## Intervals\n",
        _intervals(outcomes),
        "## What went wrong\n\n`python tests/exam/run.py --seeds N --keep DIR` repeats one and leaves its files.\n",
        _failures(outcomes),
        f"## Seeds\n\n{', '.join(str(o['seed']) for o in outcomes)}\n",
    ]
    return "\n".join(parts)


def goals_table(outcomes: list[Outcome]) -> str:
    """Return the table of goals."""
    rows = [(goal.name, goal.wanted, _number(goal.reached), str(goal.over), _met(goal)) for goal in goals(outcomes)]
    return _table(("goal", "wanted", "reached", "over", "met"), rows)


FILES = ("near", "placeholder", "missing")


def _in_group(group: str) -> Callable[[Outcome], bool]:
    return lambda outcome: outcome["group"] == group


def _is(key: str, value: str) -> Callable[[Outcome], bool]:
    return lambda outcome: outcome["case"][key] == value


CONDITIONS: list[tuple[str, Callable[[Outcome], bool]]] = [
    *((f"motion: {motion}", _is("motion", motion)) for motion in MOTIONS),
    *((f"file's inertials: {file}", _is("file_inertials", file)) for file in FILES),
    *((f"sign: {law}", _is("sign_law", law)) for law in SIGN_LAWS),
    ("one training run", lambda o: o["case"]["n_train"] == 1),
    ("no test run given", lambda o: o["case"]["n_train"] == len(o["case"]["durations"])),
    ("two encoders", lambda o: o["case"]["n_encoders"] == 2),
    ("amperes", lambda o: o["case"]["current"]),
    ("coloured noise", lambda o: o["case"]["noise_corner"] > 0),
    ("torque in coarse steps", lambda o: o["case"]["quantum"] > 0),
    ("jittered or missing samples", lambda o: o["case"]["jitter"] > 0 or o["case"]["missing"] > 0),
    ("below 150 Hz", lambda o: o["case"]["rate"] < 150),
    ("temperature recorded", lambda o: o["case"]["temperature"]),
]
"""What cases may have in common, and whether one has it."""


def _met(goal: Goal) -> str:
    if goal.reached is None:
        return "-"
    return "yes" if goal.met else "**no**"


def _groups(outcomes: list[Outcome], tests: Iterable[tuple[str, Callable[[Outcome], bool]]]) -> str:
    rows = []
    for name, test in tests:
        cases = [o for o in outcomes if test(o)]
        if not cases:
            continue
        seen, worst = visible(cases), [max(o["harm"]) for o in cases if o["harm"]]
        rows.append(
            (
                name,
                str(len(cases)),
                _number(mean(effect["found"] for effect in seen)),
                str(len(seen)),
                _number(mean(len(o["false"]) for o in cases)),
                _number(share(cases, has_false)),
                str(sum(harmed(o) for o in cases)),
                _number(max(worst, default=None)),
                str(sum(o["failure"] is not None for o in cases)),
                f"{sorted(o['seconds'] for o in cases)[len(cases) // 2]:.0f}",
            )
        )
    head = ("", "cases", "recall", "over", "false a case", "with a false", "harmed", "worst", "failed", "s, median")
    return _table(head, rows)


def _kinds(outcomes: list[Outcome]) -> str:
    false: dict[str, int] = defaultdict(int)
    for outcome in outcomes:
        for name in outcome["false"]:
            false[name.split(" ", 1)[0]] += 1
    singles = [o for group in ("single", "elastic") for o in of_group(outcomes, group)]
    rows = []
    for kind in sorted({*NAMED, *false}):
        seen = [effect for effect in visible(outcomes) if effect["kind"] == kind]
        alone = [effect for effect in visible(singles) if effect["kind"] == kind]
        rows.append(
            (
                kind,
                _number(mean(effect["found"] for effect in alone)),
                str(len(alone)),
                _number(mean(effect["found"] for effect in seen)),
                str(len(seen)),
                str(sum(effect["tie"] for effect in seen)),
                str(false[kind]),
            )
        )
    return _table(("kind", "recall alone", "over", "recall", "over", "as a tie only", "named falsely"), rows)


def _intervals(outcomes: list[Outcome]) -> str:
    told: dict[tuple[str, str], list[bool]] = defaultdict(list)
    for outcome in outcomes:
        for one in outcome["intervals"]:
            told[one["kind"], one["parameter"]].append(one["covered"])
    rows = [(kind, name, str(len(hits)), _number(mean(hits))) for (kind, name), hits in sorted(told.items())]
    return _table(("kind", "parameter", "n", "covered"), rows)


def _failures(outcomes: list[Outcome]) -> str:
    lines = [f"* `{o['seed']}` {o['group']}: {'; '.join(wrong)}" for o in outcomes if (wrong := complaints(o))]
    return "\n".join([*lines, ""]) if lines else "Nothing.\n"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{float(value):.3g}"


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines: list[Any] = [head, tuple("---" for _ in head), *rows]
    return "\n".join(["| " + " | ".join(line) + " |" for line in lines] + [""])
