"""docs/measured/contacts.md and its figure: marks, delays against false alarms by kind of threshold, hand guiding."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.contacts_arm import (
    CLEAN,
    KNOWN,
    LEVELS,
    LITTLE,
    MARK,
    METHODS,
    PROMISED,
    PUSHED,
    SECONDS,
    STEP,
    TIME_CONSTANT,
    TRAINED_SECONDS,
)
from campaigns.guiding import DRIFT, LEFT
from campaigns.kept import commits_of

FloatArray = NDArray[np.float64]
Result = dict[str, Any]

WITHIN = 0.020
"""The mark [s]."""
ALLOWED = (100.0, 10.0, 1.0)
"""False alarms per hour at which delays are told."""
BY_HAND = "## What it says"
COLOURS = {
    "identified": "C0",
    "identified, parameters known": "C9",
    "as before": "0.5",
    "constant": "C3",
    "rated": "C1",
}

INTRODUCTION = """# Contacts and hand guiding

Written by `python tests/campaigns/contacts.py --seed {seed} --arms {arms} --page docs/measured/contacts.md` with
`DYNID_DATA` set (commit {commit}). Arms, motions, encoders and torque channels are the exam's (`tests/exam`), which
shares no line with the product, at 1 kHz with coloured noise, as on [the watch's page](watch.md), with nothing hidden.
The product sees a robot file and recordings of positions and torques, so every delay holds that of the causal filter
(7 ms).

A model is identified from three runs of {trained:.0f} s; six healthy runs of {length:.0f} s set every threshold; then
the arm works in {clean} clean runs of {length:.0f} s, for false alarms, and is pushed in {pushed} others, every 2 s:
every third time by a step of {mark:.0%} of rated torque, else by steps and half-sines (50 to 300 ms) of 2 to 50 %, on
a joint or by a force at the end of a link. A push is torque in the channel: the controller holds the motion. Rated
torque of a joint is the greatest that three runs of its work need; amplitudes are those of the joint that is
pushed most. *{known}*: training and healthy runs move as the arm works. *{little}*: they are slow and in phase, and
the arm works like the others. The observer's time constant is {time:.0f} ms.

Thresholds, all on the same runs: **identified**, what `MomentumObserver.fit` learns, with `parameter_directions`;
**identified, parameters known**, the same without directions; **as before**, the deviation that the model expects and
a correlation time, which is what there is without `contact.json`; **constant**, per joint a multiple of the greatest
that healthy runs showed; **rated**, one share of rated torque for all joints. All are multiplied by a level that is
swept. A false alarm is a second of a clean run in which the level was passed. A push counts as missed if nothing
passed during it and 50 ms after, or if an alarm was on in the 0.1 s before.
"""


def write(path: Path, invocation: dict[str, Any], results: Sequence[Result]) -> None:
    """Write the page and the figure beside it; what stands under `BY_HAND` was written by hand, and stays."""
    before = path.read_text(encoding="utf-8") if path.exists() else ""
    by_hand = before[before.index(BY_HAND) :] if BY_HAND in before else f"{BY_HAND}\n"
    head = INTRODUCTION.format(
        **{**invocation, "commit": commits_of(invocation, results)},
        trained=TRAINED_SECONDS,
        length=SECONDS,
        clean=CLEAN,
        pushed=PUSHED,
        mark=MARK,
        known=KNOWN,
        little=LITTLE,
        time=1e3 * TIME_CONSTANT,
    )
    picture = path.parent / "figures" / "contacts.svg"
    draw(results, picture)
    figure = "![Delay and missed pushes against false alarms](figures/contacts.svg)\n"
    path.write_text("\n".join([head, figure, tables(results), by_hand]), encoding="utf-8")


def tables(results: Sequence[Result]) -> str:
    """All tables as Markdown."""
    good = [one for one in results if one["failure"] is None]
    parts = []
    for knowledge in (KNOWN, LITTLE):
        own = [one for one in good if one["work"] == "push" and one["knowledge"] == knowledge]
        if own:
            parts += [f"## {knowledge[0].upper()}{knowledge[1:]}\n", _delays(own), _promised(own)]
    guided = [one for one in good if one["work"] == "guide"]
    if guided:
        parts += ["## Hand guiding\n", _guided(guided)]
    parts += [part for one in good if one["work"] == "measured" for part in _measured(one)]
    failures = [one for one in results if one["failure"] is not None]
    parts += [f"Arm {one['seed']} ({one['work']}) stopped: {one['failure']}.\n" for one in failures]
    return "\n".join(parts)


def curve(own: Sequence[Result], method: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """False alarms per hour (n_levels,), delays of the mark's steps (n_levels, n) [s], pushes missed (n_levels,)."""
    hours = sum(one["seconds"] for one in own) / 3600
    false = np.sum([one["false"][method] for one in own], axis=0) / hours
    step = 1 / own[0].get("rate", 1 / STEP)

    def delays(pushes: list[Result]) -> FloatArray:
        return np.array([[np.inf if k is None else k * step for k in p["delays"][method]] for p in pushes]).T

    pushes = [push for one in own for push in one["pushes"]]
    marks = [push for push in pushes if push["amplitude"] == MARK]
    return false, delays(marks), np.mean(np.isinf(delays(pushes)), axis=1)


def _delays(own: Sequence[Result]) -> str:
    pushes = [push for one in own for push in one["pushes"]]
    marks = sum(push["amplitude"] == MARK for push in pushes)
    hours = sum(one["seconds"] for one in own) / 3600
    rows = []
    for method in METHODS:
        false, delays, missed = curve(own, method)
        for allowed in ALLOWED:
            if allowed * hours < 1:
                continue  # as little time cannot tell
            places = np.flatnonzero(false <= allowed)
            if not len(places):
                rows.append([method, f"{allowed:g}", "-", "never", "-", "-", "-"])
                continue
            k = places[0]
            told = np.sort(delays[k])
            half, most = (_milliseconds(told[int(np.ceil(q * len(told))) - 1]) for q in (0.5, 0.9))
            share = f"{np.mean(delays[k] <= WITHIN):.0%}"
            rows.append([method, f"{allowed:g}", f"{LEVELS[method][k]:.2g}", share, half, most, f"{missed[k]:.0%}"])
    head = [
        "thresholds",
        "false alarms an hour, at most",
        "level",
        "10 % within 20 ms",
        "median",
        "90 %",
        "missed, all",
    ]
    about = (
        f"{len(own)} arms, {hours:.2f} clean hours, {len(pushes)} pushes, {marks} of them steps of {MARK:.0%}; the "
        "lowest level that keeps the false alarms. Delays are those of the steps of 10 %; a "
        "missed one is later than all.\n"
    )
    return about + "\n" + _table(head, rows)


def _promised(own: Sequence[Result]) -> str:
    hours = sum(one["seconds"] for one in own) / 3600
    rows = []
    for promised in PROMISED:
        seen = sum(one["promised"][str(promised)] for one in own)
        arms = [one["promised"][str(promised)] / (one["seconds"] / 3600) for one in own]
        rows.append([f"{promised:g}", f"{seen / hours:.3g}", f"{np.median(arms):.3g}", f"{max(arms):.3g}"])
    head = ["promised an hour", "seconds with a contact, an hour", "median arm", "worst arm"]
    return "What `false_contacts_per_hour` promises, and what the clean runs held:\n\n" + _table(head, rows)


def _guided(guided: Sequence[Result]) -> str:
    rows = []
    for name in guided[0]["rules"]:
        drifts = np.array([x for one in guided for x in one["rules"][name]["drift"]])
        needed = np.array([np.inf if x is None else x for one in guided for x in one["rules"][name]["needed"]])
        half, most = (np.sort(needed)[int(np.ceil(q * len(needed))) - 1] for q in (0.5, 0.9))
        share = [f"{x:.1%}" if np.isfinite(x) else "more than rated" for x in (half, most)]
        gone = f"{np.count_nonzero(drifts > DRIFT)} of {len(drifts)}"
        rows.append([name, gone, f"{np.median(drifts):.4f}", f"{drifts.max():.3f}", *share])
    head = ["dead zone", "drifted", "way, median [rad]", "way, most [rad]", "hand, median", "hand, 90 %"]
    about = (
        f"{len(guided)} arms, trained little, `dynid-estimator --observe --contacts --guide` in the loop: the arm is "
        f"left to itself for {LEFT:.0f} s in poses anywhere, and has drifted if a joint went further than {DRIFT} "
        "rad; then a hand pushes one joint more and more until it "
        "follows. *Hand*: torque of the rated one that it took.\n"
    )
    return about + "\n" + _table(head, rows)


def _measured(one: Result) -> list[str]:
    rows = []
    for method, seen in one["at_rest"].items():
        if method == "rated":
            continue
        still, hand = np.array(seen["still"]), np.array(seen["hand"])
        level = float(np.max(still))
        rows.append([method, f"{np.mean(still > 1):.0%}", f"{np.mean(hand > 1):.0%}", f"{np.mean(hand > level):.0%}"])
    head = ["thresholds", "still, alarmed", "pushed, alarmed", "pushed, beyond all of still"]
    about = (
        f"A measured UR10e (currents, {one['rate']:.0f} Hz, time constant 50 ms; runs named in "
        "`tests/campaigns/contacts_measured.py`). The pushes of this table are synthetic: the drawn torque is added to "
        "the measured current of runs in which nothing touches "
        "the arm. At this rate the mark cannot be judged: the filter "
        "alone is two samples late, 21 ms.\n"
    )
    hand = (
        "In one run a hand pushed the arm, which stood; nobody wrote down when, and most of its seconds may hold "
        "no push. Share of seconds beyond the "
        "thresholds (level 1; *identified* asks for one false contact an hour), in nine "
        "runs in which it stood untouched and in that one:\n"
    )
    return ["## On measured runs\n", about, _delays([one]), hand, _table(head, rows)]


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if np.isfinite(seconds) else "missed"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines) + "\n"


def draw(results: Sequence[Result], path: Path) -> None:
    """Draw delays and missed pushes over false alarms, a column per kind of training."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    good = [one for one in results if one["failure"] is None and one["work"] == "push"]
    plt.rcParams["svg.hashsalt"] = "contacts"
    figure, axes = plt.subplots(2, 2, figsize=(9, 6), sharex=True, sharey="row", constrained_layout=True)
    for column, knowledge in zip(axes.T, (KNOWN, LITTLE), strict=True):
        own = [one for one in good if one["knowledge"] == knowledge]
        least = 3600 / sum(one["seconds"] for one in own)
        column[0].set_title(knowledge)
        for method in METHODS:
            false, delays, missed = curve(own, method)
            shown = np.maximum(false, least / 2)
            told = np.sort(delays, axis=1)
            for q, style in ((0.5, "-"), (0.9, "--")):
                late = 1e3 * told[:, int(np.ceil(q * told.shape[1])) - 1]
                label = method if q == 0.5 else None
                column[0].plot(shown, late, style, color=COLOURS[method], label=label)
            column[1].plot(shown, 100 * missed, color=COLOURS[method])
        column[0].axhline(1e3 * WITHIN, color="0.8", linewidth=0.8)
        column[1].set_xlabel("false alarms per hour (left end: none)")
    axes[0, 0].set_xscale("log")
    axes[0, 0].set_ylim(0, 60)
    axes[0, 0].set_ylabel("delay of a step of 10 % [ms]\nmedian, 90 % dashed")
    axes[1, 0].set_ylabel("missed, pushes of 2 to 50 % [%]")
    axes[0, 1].legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
