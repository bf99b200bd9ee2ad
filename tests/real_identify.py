"""Write docs/measured/identified.md: `dynid identify` on every measured arm, per joint, against weighted least squares.

python tests/real_identify.py [NAME...]           prints the rows
python tests/real_identify.py --write             writes the page, all arms
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from helpers import data
from helpers.measured_sets import IDENTIFIED, Measured, relative

PAGE = data.ROOT / "docs" / "measured" / "identified.md"
WORSE, BETTER = 1.05, 0.95
"""Ratios of errors beyond which a joint counts as worse, and as better, than weighted least squares."""
STAGES = ("friction", "links", "residual")
HEAD = """# What `dynid identify` gains on measured arms

Every arm is one call of the plain command, `dynid identify ROBOT RUNS [--test RUN] -o DIR`, with no further option;
`python tests/real_identify.py --write` wrote the page from the answers. Weighted least squares is the paper's baseline:
rigid body, Coulomb and viscous friction, no prior. Errors are of runs that nothing was fitted to, in the band in
which torques are compared, over the standard deviation of the measured torque there. These runs are not blind:
constants of the package were set while their errors were in view. One run alone is split: the first two thirds are
learned from, the rest is tested on.

"""
TABLE = """
## Per arm

Joint by joint: errors of both, the model's over that of weighted least squares, and the joints on which the third loop
was kept.

| arm | weighted least squares | three loops | ratio | third loop |
|---|---|---|---|---|
"""
JOINTS = """
## Joints that are worse than weighted least squares

Error over that of weighted least squares after each loop: with the first loop's friction beside the baseline's links,
with the links fitted anew under the weak prior, with the third loop.

| arm | joint | friction | links | residual |
|---|---|---|---|---|
"""


def ratios(result: dict[str, Any], stage: str = "residual") -> np.ndarray:
    """Test error after a loop over that of weighted least squares, (n_joints,)."""
    test = result["loops"]["test"]
    return np.array(test[stage]) / np.array(test["wls"])


def row(arm: Measured, result: dict[str, Any]) -> str:
    """One line of the table of arms."""
    cells = [_numbers(relative(result, key), 3) for key in ("wls", "after")]
    kept = [str(result["joints"].index(joint) + 1) for joint in result["residual"]["kept_on"]]
    return f"| {arm.title} | {' | '.join(cells)} | {_numbers(ratios(result), 2)} | {' '.join(kept) or 'none'} |"


def worse(arm: Measured, result: dict[str, Any]) -> list[str]:
    """One line per joint that is worse than weighted least squares."""
    after = [ratios(result, stage) for stage in STAGES]
    joints = np.flatnonzero(after[-1] > WORSE)
    return [f"| {arm.title} | {j + 1} | {' | '.join(f'{stage[j]:.2f}' for stage in after)} |" for j in joints]


def summary(results: Iterable[dict[str, Any]]) -> str:
    """Say in one sentence on how many joints the model is worse, how bad the worst is, and where it is better."""
    found = [ratios(result) for result in results]
    every = np.concatenate(found)
    return (
        f"On {np.sum(every > WORSE)} of {len(every)} joints of {len(found)} sets the three loops leave more than "
        f"{WORSE} of the error of weighted least squares, {every.max():.2f} on the worst; on {np.sum(every < BETTER)} "
        f"they leave less than {BETTER}. The ratio's geometric mean is {np.exp(np.mean(np.log(every))):.3f}.\n"
    )


def _numbers(values: Iterable[float], digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)


def main(arguments: Sequence[str]) -> int:
    """Run what the arguments ask for; 1 if an arm has no answer."""
    write = "--write" in arguments
    wanted = [argument for argument in arguments if argument != "--write"]
    unknown = sorted(set(wanted) - set(IDENTIFIED))
    if unknown or (write and wanted):
        sys.stderr.write(f"error: arms are {', '.join(IDENTIFIED)}; --write takes all of them\n")
        return 2
    if not data.place().is_dir():
        sys.stderr.write(f"error: no measured data at {data.place()}; set DYNID_DATA to the folder that holds it\n")
        return 2
    answers: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(prefix="identified-") as folder:
        for name in wanted or IDENTIFIED:
            try:
                answers[name] = IDENTIFIED[name].answer("identify", Path(folder) / name)
            except RuntimeError as error:
                sys.stderr.write(f"error: {error}\n")
                continue
            print(row(IDENTIFIED[name], answers[name]), flush=True)
    if len(answers) < len(wanted or IDENTIFIED):
        return 1
    said = summary(answers.values())
    lines = [line for name, result in answers.items() for line in worse(IDENTIFIED[name], result)]
    print("\n".join(["", *lines, "", said]), end="")
    if write:
        rows = [row(IDENTIFIED[name], result) for name, result in answers.items()]
        PAGE.write_text("".join([HEAD, said, TABLE, *_lines(rows), JOINTS, *_lines(lines)]), encoding="utf-8")
    return 0


def _lines(rows: Iterable[str]) -> list[str]:
    return [f"{line}\n" for line in rows]


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
