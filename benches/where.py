"""Where a command's seconds are: processor time of its steps, each less what other steps do inside of it.

Writes docs/measured/seconds.md. Every command runs in a process of its own; steps are functions that are wrapped before
it begins, which costs microseconds a call.
"""

from __future__ import annotations

import argparse
import builtins
import functools
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
sys.path.insert(0, str(ROOT / "benches"))

STEPS = {
    "reading and checking runs": ["archive.runs:RunFile.read", "runs.readers.reading:count_parts"],
    "channels: is each what it is called": ["sensors:channels_of"],
    "contacts": ["sensors.contact:find_contacts", "sensors:contacts_beside"],
    "whole fits: friction's shape": ["identification.loops:Loops.fit_friction"],
    "whole fits: links and all linear terms": ["identification.loops:Loops.fit_links"],
    "whole fits: third loop": ["identification.loops:Loops.fit_residual"],
    "whole fits: the rest": ["identification.three_loops:ThreeLoopIdentifier.fit"],
    "columns of the catalogue": ["diagnosis.hypotheses:Catalogue.of", "diagnosis.hypotheses:Catalogue.__post_init__"],
    "the fit as a linear model": ["diagnosis.beside:Beside.of"],
    "scores to second order": ["regression.linear_model:LinearModel.screen_beside"],
    "evidence with the noise estimated anew": ["diagnosis.beside:Beside.evidence_for"],
    "shapes between the grid's": ["diagnosis.shapes:polished"],
    "parts that are left out": ["diagnosis.trials:helps", "diagnosis.trials:shows_everywhere"],
    "rivals and open questions": ["diagnosis.rivals:contest", "diagnosis.open_questions:open_questions"],
    "ripple, and what is left": ["diagnosis.ripple:find_ripple", "diagnosis.unexplained:unexplained"],
    "results and report": ["commands._identifier:write_results", "identification.results:summarise"],
}
OTHER, IMPORTS = "everything else", "imports"
INTRODUCTION = """# Where a command's seconds are

What `make bench` (`benches/where.py`) measured: seconds of the processor, all threads together, each step less what
other steps do inside of it. How long whole commands take, and how much memory, stands in [Benchmarks](benchmarks.md).
"""


class Clock:
    """Seconds of the processor by step, the innermost that runs."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self._running = [OTHER]
        self._since = 0.0

    def wrapped(self, label: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function as a step."""

        @functools.wraps(function)
        def step(*args: Any, **kwargs: Any) -> Any:
            self.calls[label] = self.calls.get(label, 0) + 1
            self._switch()
            self._running.append(label)
            try:
                return function(*args, **kwargs)
            finally:
                self._switch()
                self._running.pop()

        return step

    def _switch(self) -> None:
        now = time.process_time()
        label = self._running[-1]
        self.seconds[label] = self.seconds.get(label, 0.0) + now - self._since
        self._since = now

    def finished(self) -> dict[str, tuple[int, float]]:
        """Calls and seconds of every step that there was."""
        self._switch()
        return {label: (self.calls.get(label, 0), seconds) for label, seconds in self.seconds.items()}


def traced(arguments: Sequence[str]) -> dict[str, tuple[int, float]]:
    """Run `dynid` in this process; only the main thread's steps are told apart."""
    clock = Clock()
    builtins.__import__ = clock.wrapped(IMPORTS, builtins.__import__)
    for label, places in STEPS.items():
        for place in places:
            module, path = place.split(":")
            *owners, name = path.split(".")
            owner: Any = importlib.import_module(f"dynid_rs.{module}")
            for part in owners:
                owner = getattr(owner, part)
            plain = vars(owner)[name]
            if isinstance(plain, staticmethod):
                setattr(owner, name, staticmethod(clock.wrapped(label, plain.__func__)))
                continue
            step = clock.wrapped(label, plain)
            for holder in [owner, *(held for key, held in sys.modules.items() if key.startswith("dynid_rs"))]:
                for key in [key for key, value in vars(holder).items() if value is plain]:
                    setattr(holder, key, step)
    from dynid_rs.__main__ import main

    sys.argv[1:] = arguments
    try:
        main()
    except SystemExit as end:
        if end.code not in (0, 1, None):
            raise
    return clock.finished()


def table(title: str, arguments: Sequence[str]) -> str:
    """The table of a command, its steps by their seconds."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        own = [sys.executable, __file__, "--answer", str(answer), "--", *arguments, "-o", str(Path(folder) / "out")]
        subprocess.run(own, check=True, stdout=subprocess.DEVNULL)
        found = json.loads(answer.read_text())
    total = sum(seconds for _, seconds in found.values())
    lines = [f"## {title}", "", f"{total:.2f} s of the processor.", "", "| step | calls | s | % |", "|---|--:|--:|--:|"]
    for label, (calls, seconds) in sorted(found.items(), key=lambda item: -item[1][1]):
        counted = "" if label in (OTHER, IMPORTS) else calls
        lines.append(f"| {label} | {counted} | {seconds:.2f} | {100 * seconds / total:.0f} |")
    print("\n".join(lines), flush=True)
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--answer", type=Path, help="run one command here and put its steps there")
    parser.add_argument("command", nargs="*")
    options = parser.parse_args()
    if options.answer is not None:
        options.answer.write_text(json.dumps(traced(options.command)))
        return
    from commands import MEASURED
    from helpers import data
    from helpers.measured_sets import COMMAND, SETS

    page = [INTRODUCTION]
    with tempfile.TemporaryDirectory() as folder:
        made = [sys.executable, "-c", COMMAND, "simulate", "-o", folder, "--runs", "5"]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
        *train, test = (f"{folder}/run_{k}.parquet" for k in range(5))
        given = [f"{folder}/robot.urdf", *train, "--test", test]
        page.append(table("`dynid identify`, simulated laboratory", ["identify", *given]))
        page.append(table("`dynid diagnose`, simulated laboratory", ["diagnose", *given]))
    if data.place().is_dir():
        arm = SETS[MEASURED]
        # Without the interpreter before them and the folder behind them.
        page.append(table(f"`dynid identify`, {arm.title}", arm.command(Path(), "identify")[3:-2]))
        page.append(table(f"`dynid diagnose`, {arm.title}", arm.command(Path(), "diagnose")[3:-2]))
    page.append(f"Machine: {os.cpu_count()} cores, load of the last five minutes {os.getloadavg()[1]:.1f}.\n")
    (ROOT / "docs" / "measured" / "seconds.md").write_text("\n".join(page), encoding="utf-8")


if __name__ == "__main__":
    main()
