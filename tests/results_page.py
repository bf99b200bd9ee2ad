"""Write docs/measured/results.md: what the plain command says of every measured arm, nothing given but robot and runs.

python tests/results_page.py [NAME...]            prints the rows
python tests/results_page.py --write              writes the page, all arms
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from helpers import data
from helpers.measured_sets import SETS, Measured, relative

PAGE = data.ROOT / "docs" / "measured" / "results.md"
HEAD = """# What `dynid diagnose` says of measured arms

Every line is one call of the plain command, `dynid diagnose ROBOT RUNS [--test RUN] -o DIR`, with no further option,
run, shift or cut; `python tests/results_page.py --write` wrote the page from the answers. Errors are of runs that
nothing was fitted to, joint by joint, in the band in which torques are compared, over the standard deviation of the
measured torque there. These runs are not blind: constants of the package were set while their errors were in view.
One run alone is split: the first two thirds are learned from, the rest is tested on.

| arm | weighted least squares | declared | after | names |
|---|---|---|---|---|
"""
NOTHING = "nothing to add"


def row(arm: Measured, result: dict[str, Any]) -> str:
    """One line of the table."""
    cells = [" ".join(f"{error:.3f}" for error in relative(result, key)) for key in ("wls", "before", "after")]
    return f"| {arm.title} | {' | '.join(cells)} | {names(result)} |"


def names(result: dict[str, Any]) -> str:
    """Kinds with their joints, in the order of the answer; errors in the data instead, where there are any."""
    errors = [finding["message"] for finding in result["data"]["findings"] if finding["severity"] == "error"]
    if errors:
        return "; ".join(errors)
    told: dict[str, list[str]] = {}
    for effect in result["effects"]:
        where = "all" if len(effect["joints"]) == len(result["joints"]) else "-".join(effect["joints"])
        told.setdefault(effect["kind"].replace("_", " "), []).append(where)
    return "; ".join(f"{kind} ({', '.join(places)})" for kind, places in told.items()) or NOTHING


def main(arguments: Sequence[str]) -> int:
    """Run what the arguments ask for; 1 if an arm has no answer."""
    write = "--write" in arguments
    wanted = [argument for argument in arguments if argument != "--write"]
    unknown = sorted(set(wanted) - set(SETS))
    if unknown or (write and wanted):
        sys.stderr.write(f"error: arms are {', '.join(SETS)}; --write takes all of them\n")
        return 2
    if not data.place().is_dir():
        sys.stderr.write(f"error: no measured data at {data.place()}; set DYNID_DATA to the folder that holds it\n")
        return 2
    rows, failed = [], 0
    with tempfile.TemporaryDirectory(prefix="results-") as folder:
        for name in wanted or SETS:
            try:
                rows.append(row(SETS[name], SETS[name].answer("diagnose", Path(folder) / name)))
            except RuntimeError as error:
                failed += 1
                rows.append(f"| {SETS[name].title} | | | | no answer: {str(error).splitlines()[-1]} |")
            print(rows[-1], flush=True)
    if write:
        PAGE.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")
    return int(failed > 0)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
