"""What is found in bad recordings, class by class, and what is said of clean ones.

python tests/bad_data/run.py [--seed 1] [--classes wrap,sign] [--variants 0,1] [--arms 0,1,2] [--command inspect]
                             [--alike 23] [--clean 200] [--effects 100] [--page docs/measured/bad_data.md] [--keep DIR]

Without --seed a fresh one is drawn from the clock, 1000 or more: those are for reporting. Seeds below 1000 are for
choosing. 23 classes, 5 variants, 3 arms (of five, six and seven joints), each asked of all commands; 200 clean
recordings; 100 cases of the exam with effects in them.
"""

from __future__ import annotations

import argparse
import functools
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

from bad_data.ask import COMMANDS, answer
from bad_data.classes import ARMS, CLASSES, N_VARIANTS, draw_story, good_set
from bad_data.clean import Clean, tell_clean, tell_effects
from bad_data.judge import Mark, Said, judge, said_by
from bad_data.sets import RunSet
from bad_data.story import ROBOT

REPORTED, LARGEST = 1000, 2**24


@dataclass
class Told:
    """What came of one story."""

    name: str
    arm: int
    variant: int
    command: str
    what: str
    mark: Mark
    said: list[Said] = field(default_factory=list)

    def complaint(self) -> str:
        """What was not told right."""
        return f"{self.name} arm {self.arm} variant {self.variant} ({self.what}): {' | '.join(self.mark.wrong)}"


@dataclass
class Result:
    """Everything of one seed: stories told to one command, some of them to the others, and what was wrong with none."""

    seed: int
    told: list[Told]
    alike: list[Told]
    clean: list[Clean]
    effects: list[Clean]
    options: str = ""

    def complaints(self) -> list[str]:
        """One line for everything that is not as it should be."""
        order = list(CLASSES)
        lines = [one.complaint() for one in sorted(self.told, key=lambda one: order.index(one.name)) if one.mark.wrong]
        lines += [f"{one.command}: {one.complaint()}" for one in self.alike if one.mark.wrong]
        for one in (*self.clean, *self.effects):
            lines += [f"{one.group} {one.seed}: {alarm.short()}: {alarm.message}" for alarm in one.alarms]
            lines += [f"{one.group} {one.seed}: {one.failed}"] * bool(one.failed)
        return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for; 1 where a class is not found and named in full, or clean runs raise alarms."""
    options = _parser().parse_args(arguments)
    seed = options.seed if options.seed is not None else REPORTED + time.time_ns() % (LARGEST - REPORTED)
    print(f"seed {seed}")
    places = [(arm, variant) for arm in options.arms for variant in options.variants]
    with ProcessPoolExecutor(options.jobs) as pool, _kept(options.keep) as keep:
        waiting = [pool.submit(_told, keep, seed, *place, options.classes, options.command) for place in places]
        told = [one for future in waiting for one in future.result()]
        others = [command for command in COMMANDS if command != options.command]
        names = options.classes[: options.alike]
        waiting = [pool.submit(_told, keep, seed, *place, names, command) for command in others for place in places]
        alike = [one for future in waiting for one in future.result()]
        first = 100_000 + 1000 * seed
        clean = _until(pool, keep, tell_clean, first, lambda found: sum(one.n_runs for one in found) >= options.clean)
        effects = _until(pool, keep, tell_effects, first, lambda found: len(_with_effects(found)) >= options.effects)
    chosen = f"--classes '{','.join(options.classes)}' " if options.classes != list(CLASSES) else ""
    drawn = f"--seed {seed} {chosen}--variants {_text(options.variants)} --arms {_text(options.arms)}"
    counts = f"--alike {options.alike} --clean {options.clean} --effects {options.effects}"
    result = Result(seed, told, alike, clean, _with_effects(effects), f"{drawn} {counts}")
    for line in result.complaints():
        print(line)
    from bad_data.page import page, table

    print(table(result))
    if options.page is not None:
        options.page.write_text(page(result), encoding="utf-8")
    return int(bool(result.complaints()))


def _text(numbers: Sequence[int]) -> str:
    return ",".join(str(number) for number in numbers)


def _with_effects(found: Sequence[Clean]) -> list[Clean]:
    return [one for one in found if one.group != "clean"]


def _parser() -> argparse.ArgumentParser:
    def numbers(text: str) -> list[int]:
        return [int(part) for part in text.split(",")]

    parser = argparse.ArgumentParser(description="Bad recordings: found, and named right?")
    parser.add_argument("--seed", type=int, help="a fresh one by default")
    parser.add_argument("--classes", type=lambda text: text.split(","), default=list(CLASSES))
    parser.add_argument("--variants", type=numbers, default=list(range(N_VARIANTS)))
    parser.add_argument("--arms", type=numbers, default=list(range(len(ARMS))))
    parser.add_argument("--command", choices=COMMANDS, default="inspect")
    parser.add_argument("--alike", type=int, default=len(CLASSES), help="how many classes are asked of all commands")
    parser.add_argument("--clean", type=int, default=200, help="how many clean recordings")
    parser.add_argument("--effects", type=int, default=100, help="how many cases of the exam with effects in them")
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
            paths = story.write(Path(folder))
            said = said_by(answer(command, Path(folder) / ROBOT, paths, Path(folder) / "out"))
            mark = judge(said, story.wanted)
        except Exception as error:  # a traceback is the worst answer
            said, mark = [], Mark(wrong=[f"{type(error).__name__}: {error}"])
    return Told(name, arm, variant, command, story.what, mark, said)


def _until(
    pool: ProcessPoolExecutor,
    keep: Path,
    work: Callable[[int], Clean],
    first: int,
    enough: Callable[[list[Clean]], bool],
) -> list[Clean]:
    """What comes of seeds from `first` on, until it is enough."""
    found: list[Clean] = []
    number = first
    while not enough(found):
        waiting = [pool.submit(_clean_once, keep, work, number + k) for k in range(2)]
        number += len(waiting)
        for future in waiting:
            one = future.result()
            if not enough(found):
                found.append(one)
    return found


def _clean_once(keep: Path, work: Callable[[int], Clean], seed: int) -> Clean:
    return _once(keep / f"{work.__name__}_{seed}.mark", lambda: work(seed))


if __name__ == "__main__":
    raise SystemExit(main())
