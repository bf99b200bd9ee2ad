"""What a minute of ordinary motion leaves open, and how much of it further motions settle; writes the page.

python tests/campaigns/next_experiment.py --seed N [--open 100] [--minutes 60] [--page docs/measured/next_experiment.md]
                                          [--keep FILE.json]

Arms and effects are drawn from the seed by the exam's generator until so many are open (a tie, a miss, or a wrong
name), or the time is over. Each is then moved on, in at most two motions of 20 s within the robot file's limits, as the
commands take them where none are given: as `dyn.next_experiment` designs them, at random, and as `FourierExcitation`
excites the parameters best. With --keep what was found stays in FILE, and the same command goes on where it broke off.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")
if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from exam.draw import REPORTED, stream
from exam.score import score

import dynid_rs as dyn
from campaigns import next_page
from campaigns.kept import commit, keep, read_kept
from campaigns.next_arm import Arm, Motion, draw_arm
from dynid_rs.diagnosis.open_questions import OpenQuestions
from dynid_rs.excitation import ExcitationLimits

Figures = dict[str, Any]

SECONDS, MOST_MOTIONS = 20.0, 2
LARGEST = 2**31
WAYS = ("designed", "random", "exciting")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for."""
    options = _parser().parse_args(arguments)
    invocation = {"seed": options.seed, "minutes": options.minutes}
    found = read_kept(options.keep, invocation, ("seed",), "cases")
    ends = time.monotonic() + 60 * options.minutes
    drawn = REPORTED + stream(options.seed, 61).choice(LARGEST - REPORTED, 20 * options.open, replace=False)
    seeds = drawn[len(found["cases"]) :].tolist()

    def enough() -> bool:
        return sum(case["open"] for case in found["cases"]) >= options.open or time.monotonic() > ends

    for case in examined(seeds, options.jobs, enough):
        found["cases"].append({**case, "commit": commit()})
        print(_told(case), flush=True)
        keep(options.keep, found)
    print(next_page.tables(found["cases"]))
    if options.page is not None:
        options.page.write_text(next_page.page(found["invocation"], found["cases"]), encoding="utf-8")
        print(f"page: {options.page}")
    return 0


def examined(seeds: Sequence[int], jobs: int, enough: Callable[[], bool]) -> Iterator[Figures]:
    """Cases in the order of their seeds, `jobs` at once; none begins once there are `enough`."""
    left, running = iter(seeds), deque[Future[Figures]]()
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        while True:
            running.extend(pool.submit(examine, seed) for seed in islice(left, 0 if enough() else jobs - len(running)))
            if not running:
                return
            yield running.popleft().result()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Campaign of the next experiment")
    parser.add_argument("--seed", type=int, required=True, help="from which arms and effects are drawn")
    parser.add_argument("--open", type=int, default=100, help="cases that a minute leaves open")
    parser.add_argument("--minutes", type=float, default=60.0, help="no case begins after them")
    parser.add_argument("--jobs", type=int, default=1, help="cases at once, each in a process of its own")
    parser.add_argument("--page", type=Path, help="write the tables to this Markdown file")
    parser.add_argument("--keep", type=Path, help="file in which figures stay; goes on where it broke off")
    return parser


def _told(case: Figures) -> str:
    ways = {way: [step["settled"] for step in case["ways"][way]] for way in case["ways"]}
    return f"{case['seed']} {case['effect']} {'open ' + str(ways) if case['open'] else case['failure'] or 'settled'}"


def examine(seed: int) -> Figures:
    """Draw a case; where its minute leaves it open, move on in every way."""
    case: Figures = {"seed": seed, "effect": None, "open": False, "failure": None, "ways": {}}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            arm = draw_arm(seed, Path(folder))
            if not arm.truth["effects"]:
                return case | {"failure": "no effect could be placed"}
            told = arm.truth["effects"][0]
            case |= {"effect": told["kind"], "ratio": told["ratio"], "motion": arm.truth["case"]["motion"]}
            robot = dyn.RobotModel.from_urdf(arm.robot)
            first = diagnosed(arm, robot, arm.runs)
            case["first"] = judged(arm, first)
            if case["first"]["settled"]:
                return case
            if first.asked is None:
                return case | {"failure": " ".join(finding.code for finding in first.findings)}
            case |= {"open": True, "questions": _questions(first.asked)}
            for way in WAYS:
                case["ways"][way] = list(_moved_on(arm, robot, first, way))
        except (ValueError, RuntimeError) as error:
            return case | {"failure": f"{type(error).__name__}: {error}", "open": False}
    return case


def _moved_on(arm: Arm, robot: dyn.RobotModel, first: dyn.Diagnosis, way: str) -> Iterator[Figures]:
    """One motion after the other until the case is settled: what was said before it, and what came out.

    A way that stops with an error leaves the case as it was, which is not settled.
    """
    found, runs, outcome = first, list(arm.runs), judged(arm, first)
    for k in range(MOST_MOTIONS):
        try:
            motion, said = _planned(arm, found, robot, way, k)
            runs.append(arm.record(motion, SECONDS, f"{way}_{k}", k))
            found = diagnosed(arm, robot, runs)
        except (ValueError, RuntimeError) as error:
            yield {**outcome, "failure": f"{type(error).__name__}: {error}"}
            return
        outcome = judged(arm, found)
        yield {**outcome, **said}
        if outcome["settled"]:
            return


def _planned(arm: Arm, found: dyn.Diagnosis, robot: dyn.RobotModel, way: str, k: int) -> tuple[Motion, Figures]:
    """The k-th motion of a way, and what is said of it beforehand."""
    limits, start, seed = ExcitationLimits.of_robot(robot), arm.limits["middle"], 10 * arm.truth["seed"] + k
    options = {"duration": SECONDS, "start": start, "criterion": "condition", "random_state": seed}
    if way == "designed":
        began = time.process_time()
        designed = dyn.next_experiment(found, limits, max_iter=60, **options)
        chances = [chance.right for chance in designed.expected.chances]
        return designed.trajectory.evaluate, {
            "chances": chances,
            "times": designed.random_times,
            "cpu_s": time.process_time() - began,
        }
    design = dyn.FourierExcitation(**options).fit(robot, limits)
    if way == "exciting":
        return design.trajectory_.evaluate, {}
    problem, rng, x = design.problem(), np.random.default_rng(seed), None
    while x is None:
        x = problem.drawn(rng)
    return problem.series.trajectory(x, problem.start).evaluate, {}


def limits_of(arm: Arm, position: Any = None) -> ExcitationLimits:
    """What the arm's minute of ordinary motion used; other `position` limits (2, n_joints), if given."""
    used = arm.limits
    both: Callable[[str], Any] = lambda name: np.array([[-1.0], [1.0]]) * used[name]  # noqa: E731
    position = used["middle"] + both("position") if position is None else position
    return ExcitationLimits(position=position, velocity=both("velocity"), acceleration=both("acceleration"))


def diagnosed(arm: Arm, robot: dyn.RobotModel, runs: Sequence[Path]) -> dyn.Diagnosis:
    """As `dynid diagnose` does, from the files."""
    return dyn.diagnose(robot, [dyn.read_recording(path) for path in runs], [dyn.read_recording(arm.test)])


def judged(arm: Arm, found: dyn.Diagnosis) -> Figures:
    """Settled: the effect has its name, told apart from others, and no other name is false."""
    marks = score(arm.truth, found.result, 0.0, None)
    (effect,) = marks["effects"][:1]
    return {
        "settled": bool(effect["found"] and not effect["tie"] and not marks["false"]),
        "named": bool(effect["found"] and not effect["tie"]),
        "tie": bool(effect["tie"]),
        "false": len(marks["false"]),
    }


def _questions(asked: OpenQuestions) -> list[Figures]:
    """What the diagnosis says is open."""
    return [
        {"kind": asked.candidates[q.candidates[0]].kind, "tie": bool(q.second.candidates), "log_odds": q.log_odds}
        for q in asked.questions
    ]


if __name__ == "__main__":
    sys.exit(main())
