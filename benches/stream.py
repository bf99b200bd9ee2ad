"""Streams runs that are made on the fly: samples per second from first to last, and peak memory.

`python benches/stream.py --gigabytes 2` makes and reduces 2 GB of signals (six joints, two encoders, 1 kHz) that are
never stored. A processor that others share does not run at one speed for so long, not even by its own clock: one run,
always the same, is done beside the others all along, and its time is the measure of theirs. What is known is written
to `--keep` tenth by tenth, and said on stderr. `--space` prints what
identification in memory takes per sample instead, which `archive/sample.py` estimates memory with.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from helpers.made_runs import MadeRun, arm
from helpers.processes import peak_bytes
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from dynid_rs import ThreeLoopIdentifier
from dynid_rs.archive import Archive, RunSource
from dynid_rs.archive.sample import KEPT_RATE, recording_bytes
from dynid_rs.archive.survey import Entry
from dynid_rs.archive.work import Unit, Work
from dynid_rs.identification.results import evaluate_runs, residual_table, summarise

N_PARTS = 10
CHECKS = 10
"""Times that the same run is done in a tenth."""


def peak() -> float:
    """Most memory of this process so far [MB]."""
    return peak_bytes() / 2**20


class Speed:
    """Samples per second of processor time and of the wall clock, tenth by tenth of a pass.

    `on_tenth` is called after every tenth.
    """

    def __init__(self, n_runs: int, n_samples: int, on_tenth: Callable[[], None]) -> None:
        self._n_runs, self._on_tenth, self._bar = n_runs, on_tenth, progress()
        self._edges = set(np.linspace(0, n_runs, N_PARTS + 1).astype(int)[1:].tolist())
        self._every = max(1, n_runs // (N_PARTS * CHECKS))
        self._n_samples, self._passes, self._phase, self._done = n_samples, {}, "", 0
        self._beside, self.aside = [], 0.0
        self._since = (time.perf_counter(), time.process_time())

    def __call__(self, words: str) -> None:
        phase, _, count = words.partition(": ")
        if phase not in ("reading", "reducing"):
            return
        if phase != self._phase:
            self._task = self._bar.add_task(phase, total=self._n_runs)
            # From the first run's end on: what comes before it is not the pass.
            self._phase, self._done, self._beside = phase, 1, []
            self._since = (time.perf_counter(), time.process_time())
        done = int(count.split()[0])
        self._bar.update(self._task, completed=done)
        if done in self._edges:
            now = (time.perf_counter(), time.process_time())
            wall, processor = (b - a for a, b in zip(self._since, now, strict=True))
            samples = (done - self._done) * self._n_samples
            per_same = samples / processor * float(np.mean(self._beside)) / self._n_samples
            self._passes.setdefault(phase, []).append((samples / wall, samples / processor, per_same, peak()))
            self._on_tenth()
            if not self._bar.console.is_terminal:
                print(f"{phase}: {done} of {self._n_runs} runs, {samples / processor:.0f} samples/s", file=sys.stderr)
            self._since, self._done, self._beside = now, done, []

    def beside(self, done: int, same: Callable[[], object]) -> None:
        """Do `same` where its turn has come after `done` runs; its time counts to none of them."""
        if done % self._every and done not in self._edges:
            return
        wall, processor = time.perf_counter(), time.process_time()
        same()
        taken = time.process_time() - processor
        self._beside.append(taken)
        self.aside += taken
        self._since = (self._since[0] + time.perf_counter() - wall, self._since[1] + taken)

    def figures(self) -> dict[str, dict[str, float]]:
        """Of every pass so far: samples per second of processor in its first and last tenth, and peak memory then [MB].

        `ratio`: of last to first, each by the speed of the processor at that time.
        """
        found = {}
        for phase, parts in self._passes.items():
            (_, first, slow, peak_first), (_, last, fast, peak_last) = parts[0], parts[-1]
            found[phase] = {"first": first, "last": last, "ratio": fast / slow}
            found[phase] |= {"peak_first": peak_first, "peak_last": peak_last}
        return found

    def stop(self) -> None:
        """No more progress."""
        self._bar.stop()

    def report(self) -> None:
        for phase, parts in self._passes.items():
            for k, (wall, processor, per_same, memory) in enumerate(parts):
                print(
                    f"  {phase} {10 * k:3d} to {10 * k + 10:3d} %: {wall:9.0f} samples/s, {processor:9.0f} per second "
                    f"of processor, {per_same:.3f} runs in the time of the same one, peak {memory:6.0f} MB"
                )
            for clock, name in enumerate(("wall clock", "processor", "beside the same run")):
                print(f"  {phase}, last tenth over first, {name}: {parts[-1][clock] / parts[0][clock]:.3f}")


def progress() -> Progress:
    """One line per pass, where somebody looks."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console, disable=not console.is_terminal)
    bar.start()
    return bar


class Beside(Work):
    """Work in this process, with one unit of the same run after every few."""

    def __init__(self, speed: Speed, same: MadeRun) -> None:
        super().__init__()
        self._speed, self._same = speed, same

    def map(self, unit: Unit, sources: Sequence[RunSource], *arguments: object) -> Iterator[Entry]:
        for done, entry in enumerate(super().map(unit, sources, *arguments), start=1):
            self._speed.beside(done, lambda: unit(self._same, *arguments))
            yield entry


def keep(path: Path | None, figures: dict[str, object]) -> None:
    """Write figures, so that what is there is whole whenever it ends."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_suffix(".new")
        new.write_text(json.dumps(figures), encoding="utf-8")
        new.replace(path)


def stream(gigabytes: float, duration: float, memory: int, *, as_json: bool, kept: Path | None = None) -> None:
    one = recording_bytes(MadeRun(0, duration).recording())
    n_runs = max(2 * N_PARTS, round(1e9 * gigabytes / one))
    sources = [MadeRun(seed, duration) for seed in range(n_runs)]
    n_samples = int(duration * sources[0].rate)
    started = time.process_time()
    if not as_json:
        print(
            f"{n_runs} runs of {duration:g} s, {n_runs * one / 1e9:.2f} GB of signals, memory limit {memory / 1e9:g} GB"
        )
    figures: dict[str, object] = {"runs": n_runs, "gigabytes": 1e-9 * n_runs * one}
    speed = Speed(n_runs, n_samples, lambda: keep(kept, figures | speed.figures()))
    work = Beside(speed, MadeRun(n_runs, duration))
    archive = Archive(arm(), sources, memory=memory, work=work, on_progress=speed)
    archive.check()
    sample = archive.sample()
    surveyed = peak()
    learned = archive.fit(ThreeLoopIdentifier(arm(), residual=None), sample, None)
    rate = 60e-9 * n_runs * one / (time.process_time() - started - speed.aside)
    speed.stop()
    figures |= {"gigabytes_per_minute": rate, "rmse": learned.rmse.tolist()} | speed.figures()
    keep(kept, figures)
    if as_json:
        print(json.dumps(figures))
        return
    speed.report()
    print(f"  {rate:.2f} GB per minute of processor, both passes, making the runs included")
    print(f"  peak after the first pass {surveyed:.0f} MB, at the end {peak():.0f} MB; sample of {len(sample)} pieces")
    print(f"  error on all runs [N m]: {' '.join(f'{x:.3g}' for x in learned.rmse)}")


def space() -> None:
    """Peak memory of identification in memory per joint and sample at 200 Hz."""
    MadeRun(0).recording()
    recordings = [MadeRun(seed, 60.0).read()[0] for seed in range(8)]
    before = peak()
    identifier = ThreeLoopIdentifier(arm()).fit(recordings[:-1])
    train = evaluate_runs(identifier.model_, recordings[:-1], identifier.raw_runs_)
    test = evaluate_runs(identifier.model_, recordings[-1:], [identifier.states(recordings[-1])])
    summarise(identifier, train, test, [])
    residual_table(identifier.model_, train, test)
    n_kept = sum(recording.duration for recording in recordings) * KEPT_RATE
    print(f"{1e6 * 1.048576 * (peak() - before) / (n_kept * recordings[0].n_joints):.0f} bytes per joint and sample")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=2.0)
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--memory", type=float, default=0.5, help="limit in GB")
    parser.add_argument("--space", action="store_true")
    parser.add_argument("--json", action="store_true", help="for benches/scale.py")
    parser.add_argument("--keep", type=Path, help="JSON file of what is known so far")
    options = parser.parse_args()
    if options.space:
        space()
    else:
        memory = int(1e9 * options.memory)
        stream(options.gigabytes, options.duration, memory, as_json=options.json, kept=options.keep)


if __name__ == "__main__":
    main()
