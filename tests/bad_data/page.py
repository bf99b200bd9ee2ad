"""docs/measured/bad_data.md: figures of one seed, class by class, and the list of codes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bad_data.classes import ARMS, CLASSES

if TYPE_CHECKING:
    from bad_data.clean import Clean
    from bad_data.run import Result

PART = " (part "
"""What follows the file's name where a run is read in parts."""
HEAD = """# Bad data

What `dynid` says of recordings that are not what they seem: by name (`code`), file, column, rows, with its evidence
and its mend, the same in `inspect`, `identify`, `diagnose` and in their `--json`. Nothing is mended unasked: what is
not used (a velocity that contradicts its position) or left out (contacts, in `diagnose`) is said in the result.

Written by `python tests/bad_data/run.py --page docs/measured/bad_data.md`, a part of `make trust`. Arms, motions,
sensors and noise are the exam's (`tests/exam`), which shares no line with the program; what is spoiled is drawn in
`tests/bad_data`. Seeds below 1000 are for choosing; this page is of seed {seed}, drawn from the clock. The same again:
`{options}`.

## How often

{n_classes} classes, {n_variants} variants of each, {n_arms} groups of arms (of {joints} joints; every variant has an
arm and a motion of its own). *Found*: the right name is said. *Named right*: of the right file and column and, where
the fault has a place, of rows that touch it; where one name has several causes the message says which; and no error is
said of a good file, nor one that does not follow from the fault.

{table}

A false alarm is a warning or an error that is not true of a clean recording. Those are drawn as the exam's are, rests,
slow motion and rates from 20 Hz up included, with nothing hidden in them; that rows are missing, that stamps jitter,
that two joints move together and that the rate is low is true of some of them, and not counted. Cases with effects are
those of the exam: what an arm does that its model lacks is a diagnosis' matter, and no error that stops one.

## How it is told

* **One file by itself** (`runs/checks`, one small file per idea): cells, time, units, encoders, lost bits, lone
  samples, plateaus, velocities against positions. Where one cause makes several checks speak, the cause is said alone.
  An error there ends a diagnosis, and nothing is said of the arm.
* **The arm** (`sensors`, with a robot file): runs are explained by rigid links near the robot file's and
  friction that resists, with a variance of its own for every joint; then once more with one thing changed (a sign, two
  joints exchanged, a unit, a clock, gravity, a body carried on one run), in all runs or in one. The change under which
  the runs are most probable is said if it gains 30 nats: if nothing is wrong, a change gains k nats with a chance of
  exp(-k) at most, so that a thousand changes raise one alarm in ten billion sets, if errors were independent and
  Gaussian; since they are not, a change has to explain three quarters of what is unexplained as well.
* **Contacts** are bursts of what the declared model leaves. `diagnose` leaves them out from 6 standard deviations on;
  `inspect` and `identify`, which leave nothing out, say them from 12 on.
* Archives that are streamed (`--memory`) are checked file by file, not as a set.

## Codes

| code | found | evidence | mend |
| --- | --- | --- | --- |
{codes}
"""


def table(result: Result) -> str:
    """Class by class: found, named right; what other commands say; and false alarms by code."""
    told = result.told
    lines = ["| class | drawn | found | named right |", "| --- | --- | --- | --- |"]
    for name in CLASSES:
        of = [one for one in told if one.name == name]
        if of:
            found, named = sum(one.mark.found for one in of), sum(one.mark.named for one in of)
            lines.append(f"| {name} | {len(of)} | {found} | {named} |")
    found, named = sum(one.mark.found for one in told), sum(one.mark.named for one in told)
    lines += [f"| **all** | {len(told)} | {found} | {named} |", ""]
    lines += [f"That is what `dynid {command}` says of them." for command in sorted({one.command for one in told})]
    for command in sorted({one.command for one in result.alike}):
        of = [one for one in result.alike if one.command == command]
        found, named = sum(one.mark.found for one in of), sum(one.mark.named for one in of)
        lines.append(f"`dynid {command}`, asked the same: of {len(of)} {found} found, {named} named right.")
    n_runs, alarmed = recordings(result.clean)
    lines += ["", f"Clean recordings: {n_runs}, with a false alarm: {alarmed}. By code: {_by_code(result.clean)}."]
    effects, stopped = result.effects, sum(bool(one.alarms or one.failed) for one in result.effects)
    lines.append(f"Cases with effects: {len(effects)}, stopped by an error: {stopped}. By code: {_by_code(effects)}.")
    return "\n".join(lines)


def recordings(clean: Sequence[Clean]) -> tuple[int, int]:
    """How many recordings there are, and of how many something is said that is not true, or nothing can be said."""
    return sum(one.n_runs for one in clean), sum(_alarmed(one) for one in clean)


def _alarmed(one: Clean) -> int:
    """Recordings of a set with an alarm: all of them where it names no file, and where the command broke down."""
    files = {alarm.file.split(PART)[0] for alarm in one.alarms}
    return one.n_runs if one.failed or "" in files else len(files)


def _by_code(clean: Sequence[Clean]) -> str:
    codes = Counter(alarm.code for one in clean for alarm in one.alarms)
    return ", ".join(f"`{code}` {count}" for code, count in codes.most_common()) or "none"


def page(result: Result) -> str:
    """The page."""
    from dynid_rs.base.codes import CODES

    told, seed = result.told, result.seed
    rows = [f"| `{code}` | {one.found} | {one.evidence} | {one.mend} |" for code, one in CODES.items()]
    text, wrong = table(result), result.complaints()
    if wrong:
        text += "\n\nNot as it should be:\n\n" + "\n".join(f"* {line[:200].rstrip()}" for line in wrong)
    return HEAD.format(
        seed=seed,
        options=result.options,
        n_classes=len({one.name for one in told}),
        n_variants=len({one.variant for one in told}),
        n_arms=len({one.arm for one in told}),
        joints=", ".join(str(ARMS[arm]) for arm in sorted({one.arm for one in told})),
        table=text,
        codes="\n".join(rows),
    )
