"""`make trust`: runs the campaigns and writes their figures into docs/measured/trust.md, each beside its command.

python tests/campaigns/page.py [--only kills] [--quick]

Figures are kept in docs/measured/trust.json, so that one campaign can be run again alone. What stands in the page below
its figures is written by hand, and stays.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from campaigns import mutants

ROOT = Path(__file__).resolve().parents[2]
PAGE, FIGURES = ROOT / "docs" / "measured" / "trust.md", ROOT / "docs" / "measured" / "trust.json"
BY_HAND = "## Found on the way"
PYTHON = "python"

MOSTLY = 50.0
"""Where so many runs [%] get an interval, how often it holds is a figure."""

Figures = Any


@dataclass(frozen=True)
class Campaign:
    """A command, and what its output says.

    Parameters
    ----------
    title : str
        What is tried.
    command : str
        As a reader would type it, in the repository's folder.
    quick : str
        The same in minutes.
    read : function of str
        Figures from standard output.
    say : function of figures
        One sentence.
    finds : bool
        Whether the figures hold what was found; where they do not, the sentence is true after an end with 0 alone.
    """

    title: str
    command: str
    quick: str
    read: Callable[[str], Figures]
    say: Callable[[Figures], str]
    finds: bool = False


def _fuzzed(text: str) -> Figures:
    return [
        {"target": target, "executions": int(n.replace(",", "")), "edges": int(edges.replace(",", "")), "mb": int(mb)}
        for target, n, edges, mb in re.findall(
            r"(?m)^(\w+)\s+([\d,]+) executions in .*?, ([\d,]+) edges, (\d+) MB", text
        )
    ]


def _said_fuzzed(figures: Figures) -> str:
    each = ", ".join(f"{figure['target']} {figure['executions']:,}" for figure in figures)
    return (
        f"executions: {each}; at most {max(figure['mb'] for figure in figures)} MB; no crash, none above 1 s or 512 MB"
    )


def _passed(text: str) -> Figures:
    return {"passed": int(re.findall(r"(\d+) passed", text)[-1])}


def _streams(text: str) -> Figures:
    return {"streams": int(re.findall(r"(\d+) streams: ", text)[-1])}


def _told(text: str) -> Figures:
    drawn, found, named = re.findall(r"\*\*all\*\* \| (\d+) \| (\d+) \| (\d+)", text)[-1]
    runs, alarmed = re.findall(r"Clean recordings: (\d+), with a false alarm: (\d+)", text)[-1]
    cases, stopped = re.findall(r"Cases with effects: (\d+), stopped by an error: (\d+)", text)[-1]
    numbers = {"drawn": drawn, "found": found, "named": named, "clean": runs, "alarmed": alarmed}
    figures: Figures = {name: int(value) for name, value in (numbers | {"cases": cases, "stopped": stopped}).items()}
    others = re.findall(r"`dynid (\w+)`, asked the same: of (\d+) (\d+) found, (\d+) named right", text)
    figures["others"] = {
        command: {"drawn": int(drawn), "found": int(found), "named": int(named)}
        for command, drawn, found, named in others
    }
    return figures


def _said_told(figures: Figures) -> str:
    others = [
        f"`{command}` {of['found']} and {of['named']} of {of['drawn']}" for command, of in figures["others"].items()
    ]
    return (
        f"of {figures['drawn']} {figures['found']} found, {figures['named']} named right by `inspect`"
        f"{''.join(f', {other}' for other in others)}; false alarms on {figures['alarmed']} of {figures['clean']} "
        f"clean recordings; {figures['stopped']} of {figures['cases']} arms with effects stopped by an error"
    )


def _found(figures: Figures) -> str:
    return (
        "nothing found" if not figures["found"] else f"**{len(figures['found'])} found, see docs/measured/trust.json**"
    )


def _covered(text: str) -> Figures:
    """Of the cases in which most runs get an interval: how often the rarest and the most frequent hold [%]."""
    cases = [line.strip("| ").split(" | ")[-4:] for line in text.splitlines() if line.startswith("| ")][1:]
    figures = {}
    for what, place in (("error", 0), ("change", 2)):
        often = [float(case[place + 1]) for case in cases if float(case[place]) >= MOSTLY]
        right = sum(93 <= held <= 97 for held in often)
        figures[what] = {"of": len(cases), "said": len(often), "right": right, "from": min(often), "to": max(often)}
    return figures


def _said_covered(figures: Figures) -> str:
    each = [
        f"of {what} {f['from']:.1f} to {f['to']:.1f} %, {f['right']} of {f['said']} cases within 93 to 97 (in "
        f"{f['of'] - f['said']} more most runs are too short for their memory and get none)"
        for what, f in (("an error", figures["error"]), ("its change", figures["change"]))
    ]
    return "; ".join(each)


CAMPAIGNS = {
    "fuzz": Campaign(
        "Bytes of strangers into every reader in Rust: robot files, models, datagrams, shared memory, standard input",
        f"{PYTHON} fuzz/run.py --executions 100000000",
        "make fuzz SECONDS_EACH=20",
        _fuzzed,
        _said_fuzzed,
    ),
    "readers": Campaign(
        "The same into readers that are Python: tables with rules or without, JSON lines, `dynid.toml`",
        "make fuzz-readers SECONDS_EACH=3600",
        "make fuzz-readers SECONDS_EACH=20",
        _fuzzed,
        _said_fuzzed,
    ),
    "boundary": Campaign(
        "Every function of the compiled module, each argument spoiled in every way in turn",
        f"{PYTHON} tests/campaigns/boundary.py",
        f"{PYTHON} tests/campaigns/boundary.py",
        json.loads,
        lambda f: f"{f['calls']:,} calls of {f['functions']} functions; {_found(f)}",
        finds=True,
    ),
    "hostile": Campaign(
        "Hostile URDFs, models, logs and configs: judged right, with their place, within 50 ms of the processor",
        f"{PYTHON} -m pytest -q tests/whole/test_hostile.py",
        f"{PYTHON} -m pytest -q tests/whole/test_hostile.py",
        _passed,
        lambda f: f"all {f['passed']}",
    ),
    "kills": Campaign(
        "kill -9 at random instants of identify, diagnose, excite, fleet, simulate and a streamed identify",
        f"{PYTHON} tests/campaigns/kills.py --count 500",
        f"{PYTHON} tests/campaigns/kills.py --count 24",
        json.loads,
        lambda f: (
            f"{f['trials']} trials, {f['killed']} killed before their end, {f['with_new_results']} with new results; "
            f"{_found(f)}"
        ),
        finds=True,
    ),
    "faults": Campaign(
        "Each write, fsync, rename, link, mkdir, unlink and lock refused in turn by the system",
        f"{PYTHON} tests/campaigns/faults.py --count 200",
        f"{PYTHON} tests/campaigns/faults.py --count 20",
        json.loads,
        lambda f: f"{f['injected']} injected of {f['of']} there are; {_found(f)}",
        finds=True,
    ),
    "bad_data": Campaign(
        "Recordings spoiled in 23 ways: found, by the right name, file and column; clean ones, and arms with effects "
        "([bad_data.md](bad_data.md))",
        f"{PYTHON} tests/bad_data/run.py --page docs/measured/bad_data.md",
        f"{PYTHON} tests/bad_data/run.py --variants 0 --arms 0 --alike 0 --clean 20 --effects 5",
        _told,
        _said_told,
        finds=True,
    ),
    "online": Campaign(
        "Random streams with faults: finite, right status within 2 cycles, clean within 10, then a fresh one's bits",
        "DYNID_STREAMS=1000000 cargo test --release -p dynid-core --test faults -- --nocapture",
        "cargo test --release -p dynid-core --test faults -- --nocapture",
        _streams,
        lambda f: f"{f['streams']:,} streams, none failed",
    ),
    "mutants": Campaign(
        "Small changes to Rust, drawn from a seed: a test fails, or does not end",
        f"{PYTHON} tests/campaigns/mutants.py --seed 1 --rust 60 --python 0",
        f"{PYTHON} tests/campaigns/mutants.py --seed 1 --rust 4 --python 0",
        json.loads,
        mutants.said,
    ),
    "mutants_python": Campaign(
        "The same to the Python that decides",
        f"{PYTHON} tests/campaigns/mutants.py --seed 1 --rust 0 --python 60",
        f"{PYTHON} tests/campaigns/mutants.py --seed 1 --rust 0 --python 4",
        json.loads,
        mutants.said,
    ),
    "intervals": Campaign(
        "95 % intervals of an error and of its change on simulated runs of 15, 30 and 60 s, five kinds of error with "
        "memories of 0 to 5 s: how many hold the truth",
        f"{PYTHON} tests/error_interval_coverage.py --own 1000",
        f"{PYTHON} tests/error_interval_coverage.py --own 100 0",
        _covered,
        _said_covered,
    ),
    "determinism": Campaign(
        "Another call, process, hash seed, number of threads: the same bytes; order of runs, BLAS kernel: roundings "
        "(torques within 1e-12 of the largest, coefficients within 1e-10; 5e-14 and 3e-11 were reached)",
        f"{PYTHON} -m pytest -q tests/whole/test_determinism.py",
        f"{PYTHON} -m pytest -q tests/whole/test_determinism.py",
        _passed,
        lambda f: f"all {f['passed']}",
    ),
}


def run(campaign: Campaign, quick: bool) -> Figures:
    """Run it; its figures. Where there are none, or it failed and they do not say of what, the program ends."""
    command = campaign.quick if quick else campaign.command
    typed = re.sub(rf"(?<![\w-]){PYTHON} ", f"{sys.executable} ", command)  # not the option --python
    environment = os.environ | {"PYTHONPATH": str(ROOT / "python")}
    done = subprocess.run(typed, shell=True, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    failed = f"error: {command} ended with {done.returncode}"
    if done.returncode not in ((0, 1) if campaign.finds else (0,)):
        raise SystemExit(f"{failed}:\n{done.stdout[-2000:]}")
    try:
        return {"command": command, "figures": campaign.read(done.stdout)}
    except (ValueError, IndexError):
        raise SystemExit(f"{failed} and no figures:\n{done.stdout[-2000:]}") from None


def page(kept: dict[str, Any], by_hand: str) -> str:
    """The page: figures, and below what people wrote."""
    rows = [
        f"| {CAMPAIGNS[name].title} | {CAMPAIGNS[name].say(kept[name]['figures'])} | `{kept[name]['command']}` |"
        for name in CAMPAIGNS
        if name in kept
    ]
    return "\n".join(
        [
            "# Trust: what was tried against it",
            "",
            "Nothing that is read may do harm, nothing that is written may be lost. `make trust` writes the figures",
            "(one campaign again: `python tests/campaigns/page.py --only kills`); who is trusted, and who not, stands",
            "in [SECURITY.md](../explanation/security.md).",
            "",
            "| tried | figure | command |",
            "|---|---|---|",
            *rows,
            "",
            by_hand,
        ]
    )


def main() -> int:
    """Run what was asked for, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=CAMPAIGNS, action="append", help="may be repeated")
    parser.add_argument("--quick", action="store_true", help="minutes instead of hours")
    parser.add_argument("--render", action="store_true", help="write the page from the figures that are kept")
    options = parser.parse_args()
    kept = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    for name in [] if options.render else options.only or CAMPAIGNS:
        kept[name] = run(CAMPAIGNS[name], options.quick)
        FIGURES.write_text(json.dumps(kept, indent=1) + "\n")
        print(f"{name}: {CAMPAIGNS[name].say(kept[name]['figures'])}", flush=True)
    text = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    by_hand = text[text.index(BY_HAND) :] if BY_HAND in text else f"{BY_HAND}\n"
    PAGE.write_text(page(kept, by_hand), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
