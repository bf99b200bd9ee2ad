"""Changes to Rust by cargo-mutants: drawn from a seed, made in a copy of the checkout, tried by the crates' tests.

What is in dynid-core is tried by the tests of dynid-offline and dynid-io too, which stand on it. A change that does not
compile is none, and the next one drawn takes its place.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
from collections.abc import Callable, Sequence
from typing import Any

from campaigns.drawn import ROOT
from campaigns.reach import KEPT

TRIED_BY = {
    "dynid-core": ("dynid-core", "dynid-offline", "dynid-io"),
    "dynid-offline": ("dynid-offline",),
    "dynid-io": ("dynid-io",),
}
"""Crates, and those whose tests are run for a change in them."""
RESULTS = {"CaughtMutant": "killed", "MissedMutant": "survived", "Timeout": "timeout", "Unviable": "unviable"}
COUNTED = ("killed", "timeout", "survived")
SECONDS = 1800
"""By the clock, after which a build or the tests do not end: cargo-mutants knows no other. A tenth of it is usual."""
COPY = KEPT / "rust"
Outcome = dict[str, Any]


def draw(seed: int) -> tuple[list[Outcome], int]:
    """All changes that there are, in their order, and their number."""
    if shutil.which("cargo-mutants") is None:
        raise SystemExit("error: cargo-mutants is missing; get it with cargo install --locked cargo-mutants")
    _copied()
    everything = _listed()
    return random.Random(seed).sample(everything, len(everything)), len(everything)


def try_(changes: list[Outcome], count: int, done: Callable[[Outcome, dict[str, Any]], None]) -> None:
    """Try what is open until `count` that compile have been tried."""
    _copied()
    everything = _listed()
    now = {package: [one["name"] for one in everything if one["part"] == package] for package in TRIED_BY}
    for change in changes:
        if sum(other["result"] in COUNTED for other in changes) >= count:
            return
        if change["result"] == "open":
            at = located(change["name"], now[change["part"]])
            if at is None:
                done(change, {"result": "gone"})
                continue
            result = "survived"
            for crate in TRIED_BY[change["part"]]:
                if result == "survived":
                    result = _tried(change["part"], at, len(now[change["part"]]), crate)
            done(change, {"name": now[change["part"]][at], "result": result})


def located(name: str, names: Sequence[str]) -> int | None:
    """Where a change stands among those there are now: the one of its words nearest to its line and column."""
    words, place = _parsed(name)
    alike = [(_parsed(other)[1], k) for k, other in enumerate(names) if _parsed(other)[0] == words]
    return min(alike, key=lambda one: [abs(a - b) for a, b in zip(one[0], place, strict=True)], default=(None, None))[1]


def _parsed(name: str) -> tuple[str, tuple[int, int]]:
    """A change's file and words, and its line and column."""
    file, line, column, words = name.split(":", 3)
    return f"{file}:{words}", (int(line), int(column))


def _copied() -> None:
    """Bring the copy up to the checkout; what has not changed keeps its time, and is not built again."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    files = {name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()}
    for name in files:
        old, new = COPY / name, (ROOT / name).read_bytes()
        if not old.exists() or old.read_bytes() != new:
            old.parent.mkdir(parents=True, exist_ok=True)
            old.write_bytes(new)
            shutil.copymode(ROOT / name, old)
    for path in COPY.rglob("*"):
        if path.is_file() and str(path.relative_to(COPY)) not in files:
            path.unlink()


def _cargo(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"CARGO_TARGET_DIR": str(KEPT / "target"), "CARGO_INCREMENTAL": "1"}
    return subprocess.run(
        ["cargo", "mutants", "--dir", str(COPY), *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )


def _listed() -> list[Outcome]:
    """All changes that there are: crate and name."""
    packages = [argument for name in TRIED_BY for argument in ("--package", name)]
    listed = _cargo("--list", "--json", *packages)
    return [{"part": one["package"], "name": one["name"]} for one in json.loads(listed.stdout)]


def _tried(package: str, at: int, among: int, by: str) -> str:
    """What became of change number `at` of all to a crate in the tests of another, or its own."""
    output = KEPT / "cargo"
    shutil.rmtree(output, ignore_errors=True)
    # Without --in-place every change would be built in another folder, and all of it. A shard of one change is that
    # change; patterns of names let others through.
    _cargo(
        *("--in-place", "--package", package, f"--test-package={by}", "--output", str(output), "--profile", "release"),
        *("--sharding", "round-robin", "--shard", f"{at}/{among}", "--baseline", "skip", "--colors", "never"),
        *("--timeout", str(SECONDS), "--build-timeout", str(SECONDS)),
    )
    done = json.loads((output / "mutants.out" / "outcomes.json").read_text())["outcomes"]
    (summary,) = (one["summary"] for one in done if isinstance(one["scenario"], dict))
    return RESULTS[summary]
