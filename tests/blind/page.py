"""The suite's figures as Markdown: goals, kinds by ratio, what was missed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cases import DURATION, N_TEST, N_TRAIN, RATE
from power import FAMILY_LEVEL, N_CANDIDATES

Json = Mapping[str, Any]
MOST_MISSES = 60


def page(figures: Json) -> str:
    """Text of `docs/blind.md`."""
    parts = [
        "# Blind suite",
        "",
        f"Written by `make blind`. {figures['n_cases']} simulated cases on arms with 4, 6 and 7 joints, {N_TRAIN} "
        f"training and {N_TEST} test runs of {DURATION:g} s at {RATE:g} Hz. `dynid diagnose` is given the runs and "
        "the robot file; what was put in is compared afterwards. A ratio is the part of the effect that the declared "
        "model cannot absorb over the torque noise (RMS, before any filter).",
        "",
        *goals_table(figures["goals"]),
        "",
        "An effect counts as found if its kind is named at its joints, whatever else is named; places that were "
        "named only as a tie do not count. Intervals are those of parameters whose truth has a number.",
        "",
        "## One effect",
        "",
        "`first`: the first effect of the report is right. `or tie`: found, or named as a tie. `false`: places that "
        "were named wrongly, over all cases of the row. `error / interval`: RMS of a parameter's error over half its "
        f"interval. `power`: mean probability that an F-test which is told kind, joint and shape sees it in the band, "
        f"at {100 * FAMILY_LEVEL:g} % for {N_CANDIDATES} candidates: nobody can be expected to find more. `reached`: "
        "the least ratio that was possible on any joint, where that is less than the wanted one.",
        "",
        *_table(
            [
                "kind",
                "ratio",
                "n",
                "recall",
                "or tie",
                "first",
                "power",
                "false",
                "after / oracle",
                "worst",
                "error / interval",
                "s",
                "reached",
            ],
            [_single_cells(row) for row in figures["single"]],
        ),
        "",
        *_table(
            ["ratio", "recall", "power"],
            [
                [f"{ratio:g}", _number(_mean(rows, "recall")), _number(_mean(rows, "power"))]
                for ratio in dict.fromkeys(row["ratio"] for row in figures["single"])
                if (rows := [row for row in figures["single"] if row["ratio"] == ratio])
            ],
        ),
        "",
        "## Between two encoders",
        "",
        "They leave next to no torque, so their size is a multiple of the laboratory's own (`docs/simulation.md`).",
        "",
        *_table(
            ["kind", "n", "recall", "first", "false", "error / interval"],
            [
                [
                    row["kind"],
                    row["n"],
                    _number(row["recall"]),
                    _number(row["top1"]),
                    row["false"],
                    _number(row["error_over_half_width"]),
                ]
                for row in figures["gear"]
            ],
        ),
        "",
        "## Groups",
        "",
        *_table(
            [
                "group",
                "n",
                "recall",
                "precision",
                "first",
                "first or tie",
                "cases with a false name",
                "gave up",
                "s",
                "worst s",
            ],
            [
                [
                    group,
                    row["n"],
                    _number(row["recall"]),
                    _number(row["precision"]),
                    _number(row["top1"]),
                    _number(row["top1_or_tie"]),
                    row["cases_with_false"],
                    row["errors"],
                    _number(row["seconds"], 1),
                    _number(row["seconds_worst"], 1),
                ]
                for group, row in figures["groups"].items()
            ],
        ),
        "",
        "## Outside the catalogue",
        "",
        "`right`: said to be unknown, with every signal that is in the formula among the leading ones (one more than "
        "there are), and no name of the catalogue forced on it. `removed`: of the error that a model without the "
        "effect has over one that is told the effect's torque.",
        "",
        *_table(
            ["law", "ratio", "n", "said", "right signals", "forced names", "right", "removed"],
            [
                [
                    row["kind"],
                    f"{row['ratio']:g}",
                    row["n"],
                    _number(row["said"]),
                    _number(row["right_signals"]),
                    row["forced"],
                    _number(row["right"]),
                    _number(row["share_removed"]),
                ]
                for row in figures["outside"]
            ],
        ),
        "",
        "## Intervals",
        "",
        *_table(
            ["kind", "parameter", "n", "covered", "error / interval"],
            [
                [
                    row["kind"],
                    row["parameter"],
                    row["n"],
                    _number(row["covered"]),
                    _number(row["error_over_half_width"]),
                ]
                for row in figures["coverage"]
            ],
        ),
        "",
        *_misses(figures),
    ]
    return "\n".join(parts).rstrip() + "\n"


def goals_table(goals: Iterable[Json]) -> list[str]:
    """The goals, as lines of a table."""
    marks = {True: "yes", False: "**no**", None: "-"}
    return _table(
        ["goal", "wanted", "reached", "over", "met"],
        [[g["goal"], f"{g['sense']} {g['wanted']:g}", _number(g["value"], 3), g["n"], marks[g["met"]]] for g in goals],
    )


def _single_cells(row: Json) -> list[Any]:
    reached = row["least_reached"]
    less = "" if reached is None or reached > 0.97 * row["ratio"] else f"{reached:.2g}"
    return [
        row["kind"], f"{row['ratio']:g}", row["n"], _number(row["recall"]), _number(row["or_tie"]),
        _number(row["top1"]), _number(row["power"]), row["false"], _number(row["after_over_oracle"], 3),
        _number(row["after_over_oracle_worst"], 3), _number(row["error_over_half_width"]),
        _number(row["seconds"], 1), less,
    ]  # fmt: skip


def _misses(figures: Json) -> list[str]:
    lines = []
    for title, entries in (("Not possible", figures["impossible"]), ("Gave up", figures["errors"])):
        if entries:
            lines += [f"## {title}", "", *(f"* `{label}`: {text}" for label, text in entries), ""]
    misses = [miss for miss in figures["misses"] if miss["error"] is None]
    if misses:
        lines += ["## Missed or wrong", "", "`python tests/blind/run.py --only NUMBER --keep` repeats one.", ""]
        lines += [f"* `{miss['label']}`: {_what(miss)}" for miss in misses[:MOST_MISSES]]
        if len(misses) > MOST_MISSES:
            lines += [f"* and {len(misses) - MOST_MISSES} more"]
    return lines


def _what(miss: Json) -> str:
    parts = []
    if miss["not_found"]:
        parts.append("not found: " + "; ".join(miss["not_found"]))
    if miss["false"]:
        parts.append("wrongly named: " + "; ".join(miss["false"]))
    if miss["unknown"]:
        wanted = ", ".join(" or ".join(group) for group in miss["unknown"]["wanted"])
        parts.append(f"depends on {wanted}; named {', '.join(miss['unknown']['signals'][:4]) or 'nothing'}")
    return "; ".join(parts)


def _mean(rows: Sequence[Json], name: str) -> float | None:
    pairs = [(row[name], row["n"]) for row in rows if row[name] is not None]
    return sum(value * n for value, n in pairs) / sum(n for _, n in pairs) if pairs else None


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[str]:
    return [
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
        *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows),
    ]
