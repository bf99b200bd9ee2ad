"""Which tests run a line of the package, nearest first: by what their files import, and then as coverage saw it.

A file is run once without a change; its time and what each of its tests runs are kept in build/mutants until it or the
module changes. Lines that only another process runs are not seen. All times are the processor's.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from campaigns.drawn import PACKAGE, ROOT

TESTS = ROOT / "tests"
KEPT = ROOT / "build" / "mutants"
LONGEST = 200.0
"""Seconds after which a test file without a change is given up: nobody runs it after each change either."""
WAITING = 30
"""Times its seconds that a process may take by the clock: it waits for something that does not come."""
NOT_OF_THE_CODE = ("house", "campaigns", "whole/test_campaigns.py")
"""Tests that read the sources, build, or are this."""
PASSED, FAILED, TOO_LONG = 0, 1, -1


def nearest(module: str) -> Iterator[Path]:
    """Test files from which imports lead to a module of the package: by their steps, its own folder first, by size."""
    wanted, own = PACKAGE / module, TESTS / Path(module).parent
    steps: dict[Path, int] = {}
    for test in TESTS.rglob("test_*.py"):
        if str(test.relative_to(TESTS)).startswith(NOT_OF_THE_CODE):
            continue
        seen, edge, distance = {test}, {test}, 0
        while edge and wanted not in edge:
            edge = {file for known in edge for file in _imported(known)} - seen
            seen |= edge
            distance += 1
        if wanted in edge:
            steps[test] = distance
    yield from sorted(steps, key=lambda test: (steps[test], test.parent != own, test.stat().st_size))


@cache
def _imported(path: Path) -> frozenset[Path]:
    """Files of the package and of the tests that a file imports, wherever the import stands."""
    found: set[Path] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            late = _late() if node.module == "dynid_rs" else {}
            names += [f"dynid_rs.{late[alias.name]}" for alias in node.names if alias.name in late]
        else:
            continue
        for name in names:
            parts = name.split(".")
            for root in (TESTS, PACKAGE.parent):
                for file in (root.joinpath(*parts).with_suffix(".py"), root.joinpath(*parts, "__init__.py")):
                    if file.exists() and file != PACKAGE / "__init__.py":
                        found.add(file)
    return frozenset(found - {path})


@cache
def _late() -> dict[str, str]:
    """Names of the package's face, and where they live."""
    for node in ast.walk(ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "_LATE":
            late: dict[str, str] = ast.literal_eval(node.value)
            return late
    raise LookupError("python/dynid_rs/__init__.py has no _LATE: say here where its names live now")


def tests_of(test: Path, module: str, lines: Sequence[int], copy: Path) -> tuple[list[str], float]:
    """Tests of a file that run one of the lines (first, last) of a module, as pytest calls them; the file's seconds.

    All of them where a fixture or an import does, or where one may use what another has made; none where the file
    fails without a change.
    """
    known = _looked(test, module, copy)
    if known["code"] != PASSED:
        return [], 0.0
    by_line = known["lines"].get(module, {})
    places = {place for line in range(lines[0], lines[1] + 1) for place in by_line.get(str(line), ())}
    contexts = {known["contexts"][place] for place in places}
    own = {context.removeprefix(f"{test.stem}.") for context in contexts if context.startswith(f"{test.stem}.")}
    if contexts and (len(own) < len(contexts) or "cache" in test.read_text(encoding="utf-8")):
        return [str(test)], known["seconds"]
    return [f"{test}::{name.replace('.', '::')}" for name in sorted(own)], known["seconds"]


def _looked(test: Path, module: str, copy: Path) -> Any:
    """What is known of a test file, from build/mutants or from a run of it under coverage."""
    place = KEPT / f"{test.relative_to(TESTS).with_suffix('').as_posix().replace('/', '.')}.json"
    known = json.loads(place.read_text()) if place.exists() else {}
    now = hashlib.sha256((PACKAGE / module).read_bytes()).hexdigest()
    own = hashlib.sha256(test.read_bytes()).hexdigest()
    if known.get("test") == own and known["modules"].get(module) == now:
        return known
    from coverage import CoverageData

    data, settings = KEPT / f"{os.getpid()}.coverage", KEPT / f"{os.getpid()}.ini"
    data.unlink(missing_ok=True)
    settings.write_text(f"[run]\ndynamic_context = test_function\nsource = {copy / PACKAGE.name}\ndata_file = {data}\n")
    code, seconds, _ = run([str(test)], copy, LONGEST, ["-m", "coverage", "run", f"--rcfile={settings}"])
    names: dict[str, int] = {}
    lines: dict[str, dict[int, list[int]]] = {}
    if data.exists():
        read = CoverageData(str(data))
        read.read()
        for file in read.measured_files():
            lines[str(Path(file).relative_to(copy / PACKAGE.name))] = {
                line: [names.setdefault(context, len(names)) for context in contexts]
                for line, contexts in read.contexts_by_lineno(file).items()
            }
    data.unlink(missing_ok=True)
    settings.unlink()
    modules = {
        str(path.relative_to(PACKAGE)): hashlib.sha256(path.read_bytes()).hexdigest() for path in PACKAGE.rglob("*.py")
    }
    known = {"test": own, "code": code, "seconds": seconds, "modules": modules}
    place.write_text(json.dumps({**known, "contexts": list(names), "lines": lines}))
    print(f"  {test.name} without a change: {code}, {seconds:.0f} s", file=sys.stderr, flush=True)
    return json.loads(place.read_text())


def run(tests: Sequence[str], copy: Path, limit: float, before: Sequence[str] = ()) -> tuple[int, float, str]:
    """Run tests on a copy of the package until the first failure: 0, 1, or -1 past the limit [s]; seconds; output."""
    options = ["-q", "-x", "-p", "no:cacheprovider", "--timeout=0"]
    command = [sys.executable, *before, "-m", "pytest", *options, *tests]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(copy), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HYPOTHESIS_STORAGE_DIRECTORY": str(KEPT / "hypothesis"),
    }
    most = int(limit) + 1
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment,
            stdout=said,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most)),
        )
        late = threading.Event()
        clock = threading.Timer(WAITING * most, lambda: (late.set(), _end(process.pid)))
        clock.start()
        try:
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = code = os.waitstatus_to_exitcode(status)
        finally:  # whatever it started ends with it, and it with the campaign
            clock.cancel()
            _end(process.pid)
        said.seek(0)
        text = said.read().decode(errors="replace")
    if late.is_set() or code in (-signal.SIGXCPU, -signal.SIGKILL):
        code = TOO_LONG
    return (code if code in (PASSED, TOO_LONG) else FAILED), usage.ru_utime + usage.ru_stime, text


def passes_without(said: str, copy: Path) -> bool:
    """Whether the test that failed, by pytest's output, passes in the copy as it is now."""
    failed = [
        line.split(" ", 1)[1].split(" - ")[0] for line in said.splitlines() if line.startswith(("FAILED ", "ERROR "))
    ]
    return bool(failed) and run(failed[:1], copy, LONGEST)[0] == PASSED


def _end(group: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)
