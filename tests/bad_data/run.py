"""What is found in bad recordings, class by class, and what is said of clean ones.

python tests/bad_data/run.py [--seed 1] [--classes wrap,sign] [--variants 0,1] [--arms 0,1,2] [--command inspect]
                             [--clean 200] [--page docs/bad_data.md] [--jobs 1]

Without --seed a fresh one is drawn from the clock, 1000 or more: those are for reporting. Seeds below 1000 are for
choosing. 23 classes, 5 variants, 3 arms (of five, six and seven joints), and 200 clean recordings.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # arms are worked on side by side
os.environ.setdefault("RAYON_NUM_THREADS", "1")
if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from bad_data.classes import ARMS, CLASSES, N_VARIANTS, draw_story, good_set
from bad_data.judge import Mark, Said, judge, said_by
from bad_data.sets import RunSet, clean_case, make_set
from bad_data.story import ROBOT, Story, Wanted

REPORTED, LARGEST = 1000, 2**24


@dataclass
class Told:
    """What came of one story."""

    name: str
    arm: int
    variant: int
    what: str
    mark: Mark
    said: list[Said] = field(default_factory=list)


@dataclass
class Clean:
    """What was said of the clean recordings of one seed, beyond what is true of them."""

    seed: int
    n_runs: int
    alarms: list[Said]
    failed: str = ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for; 1 where a class is not found and named in full, or clean runs raise alarms."""
    options = _parser().parse_args(arguments)
    seed = options.seed if options.seed is not None else REPORTED + time.time_ns() % (LARGEST - REPORTED)
    print(f"seed {seed}")
    places = [(arm, variant) for arm in options.arms for variant in options.variants]
    with ProcessPoolExecutor(options.jobs) as pool, _kept(options.keep) as keep:
        waiting = [pool.submit(_told, keep, seed, *place, options.classes, options.command) for place in places]
        told = [one for future in waiting for one in future.result()]
        clean = _clean(pool, keep, seed, options.clean)
    for one in sorted(told, key=lambda one: (list(CLASSES).index(one.name), one.arm, one.variant)):
        if not one.mark.named:
            print(f"{one.name} arm {one.arm} variant {one.variant} ({one.what}): {' | '.join(one.mark.wrong)}")
    for one in clean:
        for alarm in one.alarms:
            print(f"clean {one.seed}: {alarm.short()}: {alarm.message}")
        if one.failed:
            print(f"clean {one.seed}: {one.failed}")
    from bad_data.page import page, table

    print(table(told, clean))
    if options.page is not None:
        options.page.write_text(page(seed, told, clean), encoding="utf-8")
    return int(not all(one.mark.named for one in told) or any(one.alarms for one in clean))


def _parser() -> argparse.ArgumentParser:
    def numbers(text: str) -> list[int]:
        return [int(part) for part in text.split(",")]

    parser = argparse.ArgumentParser(description="Bad recordings: found, and named right?")
    parser.add_argument("--seed", type=int, help="a fresh one by default")
    parser.add_argument("--classes", type=lambda text: text.split(","), default=list(CLASSES))
    parser.add_argument("--variants", type=numbers, default=list(range(N_VARIANTS)))
    parser.add_argument("--arms", type=numbers, default=list(range(len(ARMS))))
    parser.add_argument("--command", choices=("inspect", "identify", "diagnose"), default="inspect")
    parser.add_argument("--clean", type=int, default=200, help="how many clean recordings")
    parser.add_argument("--page", type=Path, help="write the tables to this Markdown file")
    parser.add_argument("--keep", type=Path, help="folder of marks; the same command goes on where it broke off")
    parser.add_argument("--jobs", type=int, default=1, help="arms side by side")
    return parser


@contextmanager
def _kept(folder: Path | None) -> Iterator[Path]:
    """The folder that keeps marks, or one for now."""
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix="bad-data-") as temporary:
        yield Path(temporary)


def _once(path: Path, work: Callable[[], Any]) -> Any:
    """What `work` gives, done once for a file."""
    if not path.exists():
        done = pickle.dumps(work())
        path.with_suffix(".part").write_bytes(done)
        path.with_suffix(".part").replace(path)
    return pickle.loads(path.read_bytes())


def _told(keep: Path, seed: int, arm: int, variant: int, names: Sequence[str], command: str) -> list[Told]:
    told = []
    made = functools.cache(lambda: good_set(seed, arm, variant))
    for name in names:
        path = keep / f"{command}_{seed}_{arm}_{variant}_{name.replace(' ', '_')}.mark"
        told.append(_once(path, lambda name=name: tell(name, made(), arm, variant, command)))
    return told


def tell(name: str, made: RunSet, arm: int, variant: int, command: str) -> Told:
    """Tell a story to the program."""
    story = draw_story(name, made, variant)
    with tempfile.TemporaryDirectory(prefix="bad-data-") as folder:
        try:
            said = said_by(answer(command, story, Path(folder)))
            mark = judge(said, story.wanted)
        except Exception as error:  # a traceback is the worst answer
            said, mark = [], Mark(wrong=[f"{type(error).__name__}: {error}"])
    return Told(name, arm, variant, story.what, mark, said)


def answer(command: str, story: Story, folder: Path) -> dict[str, Any]:
    """What a command says of a story, as JSON; tracebacks are raised."""
    from typer.testing import CliRunner

    from dynid_rs.cli import app

    paths, robot = story.write(folder), folder / ROBOT
    if command == "inspect":
        arguments = ["inspect", *paths, "--robot", robot, "--json"]
    else:
        arguments = [command, robot, *paths[:-1], "--test", paths[-1], "-o", folder / "out", "--json"]
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return json.loads(result.stdout)


def _clean(pool: ProcessPoolExecutor, keep: Path, seed: int, count: int) -> list[Clean]:
    """Sets of clean recordings, until there are `count` recordings."""
    found: list[Clean] = []
    number = 0
    while sum(one.n_runs for one in found) < count:
        seeds = [100_000 + 1000 * seed + number + k for k in range(2)]
        waiting = [pool.submit(_clean_once, keep, k) for k in seeds]
        number += len(waiting)
        for future in waiting:
            if sum(one.n_runs for one in found) < count:
                found.append(future.result())
    return found


def _clean_once(keep: Path, seed: int) -> Clean:
    return _once(keep / f"clean_{seed}.mark", lambda: tell_clean(seed))


def tell_clean(seed: int) -> Clean:
    """Tell the program clean runs of one arm."""
    made = make_set(clean_case(seed))
    story = Story("clean", made, Wanted((), ()))
    with tempfile.TemporaryDirectory(prefix="bad-data-") as folder:
        try:
            said = said_by(answer("inspect", story, Path(folder)))
        except Exception as error:
            return Clean(seed, made.n_runs, [], f"{type(error).__name__}: {error}")
    true = true_of(made)
    return Clean(seed, made.n_runs, [one for one in said if one.severity != "info" and one.code not in true])


def true_of(made: RunSet) -> set[str]:
    """Warnings that are true of a clean recording: the exam loses rows, jitters, and moves poorly now and then."""
    case, true = made.case, set()
    if case.missing:
        true |= {"gap"}
    if case.jitter:
        true |= {"jitter"}
    if any(together(s.dq) for s in made.world.runs):
        true |= {"joints_together"}
    if case.rate < 40.0 * 1.05:
        true |= {"sampling_rate"}
    return true


def together(dq: np.ndarray) -> bool:
    """Whether the true speeds of two joints (n, n_joints) are proportional, nearly."""
    moving = dq[:, np.ptp(dq, axis=0) > 0]
    correlation = np.abs(np.corrcoef(moving.T)) - np.eye(moving.shape[1])
    return bool(correlation.max() > 0.97)


if __name__ == "__main__":
    raise SystemExit(main())
