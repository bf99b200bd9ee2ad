"""Build the fuzzer on stable Rust, replay the kept inputs and look for new ones: `python fuzz/run.py --seconds 60`.

Readers that are written in Python, `--target table` and others, are tried by the same means (Atheris is libFuzzer for
Python; `make fuzz-readers` installs it): a hundred times slower, so they are asked for by name.

`--executions 100000000` goes on until every way in was tried so often, over as many calls as that takes: what was done
to the same program is kept in `tally.json` beside what was found.

The counters of covered code come from LLVM's pass by way of stable compiler flags, the runtime is libFuzzer's (crate
libfuzzer-sys, built by the machine's C++ compiler). No more than the limits that `src/limits.rs` names.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
CORPUS = HERE / "corpus"
TARGETS = ("urdf", "robot_toml", "model", "datagrams", "memory", "lines", "watch_file", "remembered", "contact_file")
READERS = ("table", "json_lines", "config")
"""Ways in that are Python (`python/ways_in.py`)."""
READER, PACKAGE = HERE / "python" / "readers.py", HERE.parent / "python"
FLAGS = (
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
)
TALLY = threading.Lock()
SLICE, SLICE_OF_READERS = 2_000_000, 20_000
"""Executions between two notes in the tally."""
SHORT, LONG_EVERY = 512, 4
"""Most bytes of an input between two notes, but for every fourth time: long lines take three times as long."""
Program = tuple[Path, ...]
"""What is started: a program, or one and what it runs."""
TIMEOUT = 30
"""Wall clock, for what never ends; slowness is judged by the processor's time, in the program [s]."""


def built() -> Path:
    """Build; the program's path."""
    target = Path(os.environ.get("DYNID_FUZZ_TARGET", HERE / "target"))
    host = next(
        line.split()[1]
        for line in subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout.splitlines()
        if line.startswith("host:")
    )
    # A named target keeps the flags from build scripts and macros, which have no runtime to link to.
    command = ["cargo", "build", "--release", "--locked", "--quiet", "--target", host]
    environment = os.environ | {"RUSTFLAGS": " ".join(FLAGS), "CARGO_TARGET_DIR": str(target)}
    subprocess.run(command, cwd=HERE, env=environment, check=True)
    return target / host / "release" / "dynid-fuzz"


def fuzz(program: Program, target: str, limits: Sequence[str], work: Path) -> dict[str, Any]:
    """Replay what is kept, then look for more within limits of libFuzzer's; figures of the run."""
    found = work / target
    found.mkdir(parents=True, exist_ok=True)
    kept = CORPUS / target
    words = HERE / ("readers.dict" if target in READERS else "words.dict")
    command = [
        *map(str, (*program, found, kept)),
        *(*limits, f"-timeout={TIMEOUT}", "-rss_limit_mb=600", "-print_final_stats=1"),
        f"-artifact_prefix={work}/{target}-",
        f"-dict={words}",
    ]
    log = work / f"{target}.log"
    start = time.monotonic()
    with log.open("wb") as out:
        code = subprocess.run(
            command, env=os.environ | {"DYNID_TARGET": target}, stdout=out, stderr=subprocess.STDOUT, check=False
        ).returncode
    text = log.read_text(errors="replace")
    stats = {name: int(value) for name, value in re.findall(r"stat::(\w+):\s+(\d+)", text)}
    covered = re.findall(r"cov: (\d+)", text)
    return {
        "target": target,
        "executions": stats.get("number_of_executed_units", 0),
        "seconds": round(time.monotonic() - start, 1),
        "kept_inputs": len(list(kept.iterdir())),
        "covered_edges": int(covered[-1]) if covered else 0,
        "peak_rss_mb": stats.get("peak_rss_mb", 0),
        "failed": code != 0,
        "log": str(log),
    }


def fuzz_often(program: Program, target: str, executions: int, work: Path) -> dict[str, Any]:
    """Go on where the last call ended, until there are so many executions; figures of all calls together."""
    tally = work / "tally.json"
    part = SLICE if target in TARGETS else SLICE_OF_READERS
    while True:
        with TALLY:
            so_far = noted(program, target, tally)
        left = executions - so_far["executions"]
        if left <= 0:
            return so_far
        short = so_far["executions"] // part % LONG_EVERY != LONG_EVERY - 1
        limits = [f"-runs={min(left, part)}", *([f"-max_len={SHORT}"] if short else [])]
        figure = fuzz(program, target, limits, work) | {"program": digest(program)}
        figure["seconds"] = round(figure["seconds"] + so_far["seconds"], 1)
        figure["executions"] += so_far["executions"]
        figure["peak_rss_mb"] = max(figure["peak_rss_mb"], so_far["peak_rss_mb"])
        if figure["failed"]:
            return figure
        with TALLY:
            new = tally.with_suffix(".part")
            new.write_text(json.dumps(kept_in(tally) | {target: figure}, indent=2) + "\n")
            new.replace(tally)


def noted(program: Program, target: str, tally: Path) -> dict[str, Any]:
    """What earlier calls did to this program by this way in: another program has everything before it."""
    before: dict[str, Any] = kept_in(tally).get(target, {})
    nothing = {"target": target, "executions": 0, "seconds": 0.0, "peak_rss_mb": 0}
    return before if before.get("program") == digest(program) else nothing


def kept_in(tally: Path) -> dict[str, Any]:
    """Figures by their targets."""
    return dict(json.loads(tally.read_text())) if tally.exists() else {}


@functools.cache
def digest(program: Program) -> str:
    """What tells programs apart; the same sources, but for their tests, give the same one in the same folder."""
    files = sorted([*PACKAGE.rglob("*.py"), *READER.parent.glob("*.py")]) if READER in program else program
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


def said(program: Program, target: str, log: str) -> str:
    """The sentence a failure ended with, and how to see it again."""
    text = Path(log).read_text(errors="replace")
    panics = re.findall(r"panicked at [^\n]*\n[^\n]*|(?m:^\w+(?:Error|Exception)\b.*)", text)
    artifacts = re.findall(r"Test unit written to (\S+)", text)
    again = f"; again: DYNID_TARGET={target} {' '.join(map(str, program))} {artifacts[-1]}" if artifacts else ""
    return f"{panics[-1] if panics else text[-400:]}{again}"


def keep(program: Program, target: str, work: Path, most_bytes: int) -> None:
    """Put the smallest inputs that cover what all found ones do into the corpus, `most_bytes` of them."""
    small = work / f"{target}-small"
    shutil.rmtree(small, ignore_errors=True)
    small.mkdir(parents=True)
    command = [*map(str, program), "-set_cover_merge=1", f"-timeout={TIMEOUT}", str(small), str(CORPUS / target)]
    environment = os.environ | {"DYNID_TARGET": target}
    subprocess.run([*command, str(work / target)], env=environment, capture_output=True, check=True)
    seeds = [path for path in (CORPUS / target).iterdir() if path.name.startswith("seed_")]
    left = most_bytes - sum(path.stat().st_size for path in seeds)
    for path in (CORPUS / target).iterdir():
        if path not in seeds:
            path.unlink()
    for path in sorted(small.iterdir(), key=lambda path: (path.stat().st_size, path.name)):
        left -= path.stat().st_size
        if left >= 0:
            shutil.copy(path, CORPUS / target / path.name[:16])


def main() -> int:
    """Run, print one line per target, and with `--json` write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="per target, building not counted")
    parser.add_argument("--executions", type=int, help="until there are so many per target, earlier calls included")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="targets at once")
    parser.add_argument("--target", choices=TARGETS + READERS, action="append", help="only this one (may be repeated)")
    parser.add_argument("--work", type=Path, default=HERE / "work", help="what is found, and the logs")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--keep", type=int, metavar="BYTES", help="afterwards keep so much per target in the corpus")
    options = parser.parse_args()
    targets = options.target or TARGETS
    program = (built(),) if set(targets) & set(TARGETS) else ()
    options.work.mkdir(parents=True, exist_ok=True)
    figures = []
    programs = dict.fromkeys(TARGETS, program) | dict.fromkeys(READERS, (Path(sys.executable), READER))

    def tried(target: str) -> dict[str, Any]:
        if options.executions:
            return fuzz_often(programs[target], target, options.executions, options.work)
        return fuzz(programs[target], target, [f"-max_total_time={options.seconds}"], options.work)

    with ThreadPoolExecutor(options.jobs) as pool:  # a way in has one thread
        for figure in pool.map(tried, targets):
            target = str(figure["target"])
            figures.append(figure)
            print(
                f"{target:11}{figure['executions']:>12,} executions in {figure['seconds']} s, "
                f"{figure['covered_edges']:,} edges, {figure['peak_rss_mb']} MB",
                flush=True,
            )
            if figure["failed"]:
                print(f"error: {target}: {said(programs[target], target, str(figure['log']))}", file=sys.stderr)
            elif options.keep:
                keep(programs[target], target, options.work, options.keep)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
    return int(any(figure["failed"] for figure in figures))


if __name__ == "__main__":
    sys.exit(main())
