"""Small changes to the code, and whether a test fails: `python tests/campaigns/mutants.py --rust 60 --python 60`.

A change ("mutant") that no test notices is a claim that cannot fail. Which ones are tried is drawn from `--seed`.
Rust's are those of cargo-mutants in dynid-core, dynid-io and dynid-offline; Python's those of `drawn.py`. Each is made
in a copy; the checkout stays as it is. A test that does not end has noticed too.

What was drawn and what became of it is kept in build/mutants, and a campaign that was stopped goes on there; `--again`
tries those again that lived, in the code and by the tests as they are now. One whose line is gone no longer counts. A
campaign from the beginning: remove that folder.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from campaigns import drawn, reach, rust_mutants

OPEN, KILLED, TIMEOUT, SURVIVED, GONE = "open", "killed", "timeout", "survived", "gone"
COUNTED = (KILLED, TIMEOUT, SURVIVED)
MOST = 100
"""Changes that are drawn; the first of them are tried."""
FIRST = 2
"""Test files that are run whole, before it is looked which ones run the line at all."""
PATIENCE = 300.0
"""Seconds of test files, as they take without a change, after which a change has lived."""
SLOWER, LEAST = 5.0, 20.0
"""Tests that take so many times the seconds of their file, and so many more, do not end."""

Outcome = dict[str, Any]
Done = Callable[[Outcome, dict[str, Any]], None]
"""Takes a change and what became of it."""


def tried(mutant: drawn.Mutant, copy: Path) -> dict[str, Any]:
    """Run the tests that reach it, the nearest first, until one fails that does not without the change."""
    place = copy / drawn.PACKAGE.name / mutant.module
    source = place.read_text(encoding="utf-8")

    def run(names: Sequence[str], limit: float) -> tuple[int, float, str]:
        place.write_text(drawn.changed(mutant), encoding="utf-8")
        try:
            return reach.run(names, copy, limit)
        finally:
            place.write_text(source, encoding="utf-8")

    tests, passed, spent = list(reach.nearest(mutant.module)), set(), 0.0
    for test in tests[:FIRST]:  # most changes die here, and cost less than to look which lines the tests run
        code, seconds, said = run([str(test)], reach.LONGEST)
        if code == reach.FAILED and reach.passes_without(said, copy):
            return {"result": KILLED, "by": str(test.relative_to(reach.TESTS))}
        if code == reach.PASSED:
            passed.add(test)
            spent += seconds
    for test in tests:
        if test in passed or spent > PATIENCE:
            continue
        names, seconds = reach.tests_of(test, mutant.module, mutant.statement, copy)
        if names:
            code = run(names, SLOWER * seconds + LEAST)[0]
            spent += seconds
            if code != reach.PASSED:
                return {"result": KILLED if code == reach.FAILED else TIMEOUT, "by": str(test.relative_to(reach.TESTS))}
    return {"result": SURVIVED}


def draw_python(seed: int) -> tuple[list[Outcome], int]:
    """Changes in their order, and the number of places that they were drawn from."""
    mutants, places = drawn.draw(seed, MOST)
    return [{"name": mutant.name, "part": mutant.module.split("/")[0], **asdict(mutant)} for mutant in mutants], places


def try_python(changes: list[Outcome], count: int, done: Done) -> None:
    """Try those of the first `count` that are open."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as temporary:
        copy = Path(temporary)
        shutil.copytree(drawn.PACKAGE, copy / drawn.PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"))
        for change in changes[:count]:
            if change["result"] == OPEN:
                now = drawn.located(drawn.Mutant(**{name: change[name] for name in drawn.Mutant.__dataclass_fields__}))
                done(change, {"result": GONE} if now is None else {"name": now.name, **asdict(now), **tried(now, copy)})


def campaign(
    language: str,
    seed: int,
    count: int,
    again: bool,
    draw: Callable[[int], tuple[list[Outcome], int]],
    try_: Callable[[list[Outcome], int, Done], None],
) -> dict[str, Any]:
    """Figures of one language."""
    place = reach.KEPT / f"{language}-{seed}.drawn"
    if not place.exists():
        changes, places = draw(seed)
        place.write_text(json.dumps({"of": places, "changes": [{**change, "result": OPEN} for change in changes]}))
    record = json.loads(place.read_text())
    for change in record["changes"][:count]:
        if again and change["result"] == SURVIVED:
            change["result"] = OPEN

    def done(change: Outcome, result: dict[str, Any]) -> None:
        change |= result
        place.write_text(json.dumps(record, indent=1))
        print(f"{change['result']} {change['name']} {change.get('by', '')}", file=sys.stderr, flush=True)

    try_(record["changes"], count, done)
    return summed([change for change in record["changes"] if change["result"] in COUNTED][:count], record["of"])


def summed(changes: list[Outcome], places: int) -> dict[str, Any]:
    """How many were tried, drawn from how many, and what became of them, by crate or room."""
    parts: dict[str, Counter[str]] = {}
    for change in changes:
        parts.setdefault(change["part"], Counter())[change["result"]] += 1
    return {
        "drawn": len(changes),
        "of": places,
        "killed": sum(change["result"] != SURVIVED for change in changes),
        "timeouts": sum(change["result"] == TIMEOUT for change in changes),
        "parts": {name: dict(sorted(counts.items())) for name, counts in sorted(parts.items())},
        "survived": [change["name"] for change in changes if change["result"] == SURVIVED],
    }


def told(figures: dict[str, Any]) -> str:
    """Figures in words."""
    share = 100 * figures["killed"] / max(figures["drawn"], 1)
    parts = ", ".join(
        f"{name} {sum(counts.values()) - counts.get(SURVIVED, 0)} of {sum(counts.values())}"
        for name, counts in figures["parts"].items()
    )
    return f"{figures['killed']} of {figures['drawn']} killed ({share:.0f} %), drawn from {figures['of']:,}: {parts}"


def said(figures: dict[str, Any]) -> str:
    """One sentence for docs/measured/trust.md."""
    parts = [f"{name.capitalize()} {told(figures[name])}" for name in ("rust", "python") if name in figures]
    return "; ".join(parts)


def main() -> int:
    """Print the figures as JSON, and each outcome as it comes to standard error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rust", type=int, default=60, help="changes to Rust; 0: none")
    parser.add_argument("--python", type=int, default=60, help="changes to Python; 0: none")
    parser.add_argument("--again", action="store_true", help="those that lived are tried again")
    options = parser.parse_args()
    if options.python > MOST:
        parser.error(f"--python: at most {MOST} are drawn from a seed, got {options.python}; take another seed too")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # tests that run end too
    reach.KEPT.mkdir(parents=True, exist_ok=True)
    figures: dict[str, Any] = {"seed": options.seed}
    for language, count, draw, try_ in (
        ("python", options.python, draw_python, try_python),
        ("rust", options.rust, rust_mutants.draw, rust_mutants.try_),
    ):
        if count:
            figures[language] = campaign(language, options.seed, count, options.again, draw, try_)
            print(f"{language}: {told(figures[language])}", file=sys.stderr, flush=True)
    print(json.dumps(figures, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
