"""`make blind`: runs the cases, prints and stores what came out.

python tests/blind/run.py [--quick] [--only N,N-M] [--kind K] [--ratio R] [--group G] [--jobs J] [--fresh] [--keep]
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # processes share the machine

from cases import GROUPS, Case, all_cases
from page import goals_table, page
from suite import KEPT, run_cases
from tally import tally

from dynid_rs.files import atomic_path, write_json


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for; 1 if the program gave up on a case."""
    options = _parser().parse_args(arguments)
    chosen = _chosen(options)
    if not chosen:
        sys.stderr.write("error: no case is like that; --list shows all of them\n")
        return 2
    if options.list:
        print("\n".join(case.label for case in chosen))
        return 0
    outcomes = []
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("", total=len(chosen))
        for outcome in run_cases(
            chosen, kept=options.kept, jobs=options.jobs, fresh=options.fresh, keep_files=options.keep
        ):
            outcomes.append(outcome)
            progress.update(task, advance=1, description=outcome["label"])
            if len(chosen) <= MANY or options.verbose:
                progress.console.print(_line(outcome), markup=False, highlight=False)
    figures = tally(outcomes)
    write_json(options.kept / "blind.json", figures)
    print("\n".join(goals_table(figures["goals"])))
    for label, text in (*figures["impossible"], *figures["errors"]):
        print(f"{label}: {text}")
    print(f"every figure: {options.kept / 'blind.json'}; every case: {options.kept}/NUMBER.json")
    if options.page is not None:
        with atomic_path(options.page) as temporary:
            temporary.write_text(page(figures), encoding="utf-8")
        print(f"page: {options.page}")
    return 1 if figures["errors"] else 0


MANY = 40
"""More cases than this are not printed one by one."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Blind suite of dynid diagnose")
    parser.add_argument("--quick", action="store_true", help="the short selection")
    parser.add_argument("--only", default="", help="numbers, as in 17,40-45")
    parser.add_argument("--kind", help="cases with this kind in them")
    parser.add_argument("--ratio", type=float, help="cases with this ratio in them")
    parser.add_argument("--group", choices=GROUPS, help="cases of one group")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--fresh", action="store_true", help="do not use results of earlier runs with the same code")
    parser.add_argument("--keep", action="store_true", help="leave runs, truth and report under KEPT/files/NUMBER")
    parser.add_argument("--kept", type=Path, default=KEPT, help="folder of results")
    parser.add_argument("--page", type=Path, help="also write the tables to this Markdown file")
    parser.add_argument("--list", action="store_true", help="list the cases and stop")
    parser.add_argument("--verbose", action="store_true", help="a line for every case")
    return parser


def _chosen(options: argparse.Namespace) -> list[Case]:
    numbers = {n for part in options.only.split(",") if part for n in _range(part)}
    return [
        case
        for case in all_cases().values()
        if (not numbers or case.number in numbers)
        and (not options.quick or case.quick)
        and (options.group is None or case.group == options.group)
        and (options.kind is None or any(put.kind == options.kind for put in case.puts))
        and (options.ratio is None or any(put.ratio == options.ratio for put in case.puts))
    ]


def _range(part: str) -> range:
    first, _, last = part.partition("-")
    return range(int(first), int(last or first) + 1)


def _line(outcome: dict) -> str:
    if "score" not in outcome:
        return f"{outcome['label']}: {outcome.get('impossible') or outcome['error']}"
    score = outcome["score"]
    found = sum(effect["found"] for effect in score["effects"])
    parts = [f"{found}/{len(score['effects'])} found"] if score["effects"] else []
    parts += [f"wrongly named {', '.join(' at '.join(place) for place in score['false'])}"] if score["false"] else []
    if score["unknown"]:
        parts.append(f"signals {', '.join(score['unknown']['signals'][:4]) or 'none'}")
    if score["contact"]:
        parts.append(f"windows {sum(score['contact']['found']['train'])}/{len(score['contact']['found']['train'])}")
    worst = max((ratio for ratio in score["after_over_oracle"] if ratio is not None), default=float("nan"))
    parts += [f"after/oracle {worst:.3f}", f"{score['seconds']:.1f} s"]
    return f"{outcome['label']}: {'; '.join(parts)}"


if __name__ == "__main__":
    raise SystemExit(main())
