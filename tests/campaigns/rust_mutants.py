"""Changes to Rust by cargo-mutants: drawn from a seed, made in a copy of the checkout, tried by the crates' tests.

What is in dynid-core is tried by the tests of dynid-offline and dynid-io too, which stand on it. A change that does not
compile is none, and the next one drawn takes its place.
"""

from __future__ import annotations

import json
import os
import random
import re
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
PART = 10
"""Changes of a crate that one run of cargo-mutants tries."""

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
    now = {_text(one): one["name"] for one in _listed()}
    while True:
        tried = [change for change in changes if change["result"] in COUNTED]
        last = changes.index(tried[-1]) if tried else -1
        missing = count - len(tried)
        open_ = [c for c in changes[: last + 1] if c["result"] == "open"]
        open_ += [c for c in changes[last + 1 :] if c["result"] == "open"][: max(missing - len(open_), 0)]
        if not open_:
            return
        package = open_[0]["part"]
        part = [change for change in open_ if change["part"] == package][:PART]
        for change in part:
            if _text(change) not in now:
                done(change, {"result": "gone"})
        there = {now[_text(change)]: change for change in part if _text(change) in now}
        results: dict[str, str] = {}
        for crate in TRIED_BY[package]:
            lives = [name for name in there if results.get(name, "survived") == "survived"]
            results |= _tried(package, crate, lives)
        for name, result in results.items():
            done(there[name], {"name": name, "result": result})


def _text(change: Outcome) -> str:
    """What it is called without its line and column, which move."""
    return re.sub(r":\d+:\d+: ", ": ", str(change["name"]), count=1)


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


def _tried(package: str, by: str, names: Sequence[str]) -> dict[str, str]:
    """What became of changes to a crate in the tests of another, or its own."""
    if not names:
        return {}
    output = KEPT / "cargo"
    shutil.rmtree(output, ignore_errors=True)
    # Without --in-place every run would build in another folder, and build all of it.
    _cargo(
        *("--in-place", "--package", package, "--output", str(output), "--profile", "release"),
        *("--baseline", "skip", "--timeout", str(SECONDS), "--build-timeout", str(SECONDS), "--colors", "never"),
        f"--test-package={by}",
        *(f"--re=^{re.escape(name)}$" for name in names),
    )
    results = {}
    for one in json.loads((output / "mutants.out" / "outcomes.json").read_text())["outcomes"]:
        if isinstance(one["scenario"], dict):
            results[one["scenario"]["Mutant"]["name"]] = RESULTS[one["summary"]]
    if set(results) != set(names):
        raise SystemExit(f"error: cargo-mutants tried {len(results)} of {len(names)} changes; see {output}")
    return results
