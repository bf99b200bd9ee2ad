"""Each argument of the compiled module spoiled in every way in turn: `python tests/campaigns/boundary.py`.

Every function is called in a process of its own, so that one that ends it does not end the others.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from helpers.boundary_calls import Call, calls
from helpers.spoiled import ENDLESS, LONGEST, NO_ARRAYS, REFUSALS, as_array, outcome, spoiled_arrays


def alternatives(value: Any) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Everything else that an argument might be, and the same for each of its parts."""
    yield from NO_ARRAYS.items()
    numbers = as_array(value)
    if numbers is not None:
        yield from spoiled_arrays(numbers).items()
    if isinstance(value, list | tuple):
        for k, part in enumerate(value):
            yield f"without {k}", lambda k=k: [*value[:k], *value[k + 1 :]]
            for name, way in alternatives(part):
                yield f"{k}: {name}", lambda k=k, way=way: type(value)([*value[:k], way(), *value[k + 1 :]])


def faults_of(call: Call) -> Iterator[tuple[str, str | None]]:
    """Each try, and what is wrong with its outcome."""
    for place, value in call.arguments.items():
        for name, way in alternatives(value):
            try:
                other = way()
            except (TypeError, ValueError, IndexError):
                continue  # this value cannot be spoiled this way
            if place in ENDLESS and isinstance(other, int):
                other = min(other, 1000)
            where = ascii(f"{place}, {name}")[:150]
            yield where, None
            start = time.thread_time()
            try:
                error = outcome(call, {**call.arguments, place: other})
            except BaseException as panic:
                yield where, f"{type(panic).__name__}: {ascii(str(panic))[:200]}"
                continue
            if time.thread_time() - start > LONGEST:
                yield where, f"{time.thread_time() - start:.1f} s"
            sentence = error is None or (isinstance(error, REFUSALS) and 0 < len(str(error).strip()) < 4000)
            if not sentence and not isinstance(error, OSError):
                yield where, f"{type(error).__name__}: {ascii(str(error))[:200]}"


def try_one(name: str) -> None:
    """Print each try of a function, and what is wrong with it; a line of JSON each."""
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    with tempfile.TemporaryDirectory(prefix="boundary-") as temporary:
        os.chdir(temporary)  # whatever string is taken for a path names a file in here
        call = calls(Path(temporary))[name]
        with os.fdopen(os.dup(1), "w", buffering=1) as out:  # what a call prints itself goes to nobody
            with open(os.devnull, "w") as nobody:
                os.dup2(nobody.fileno(), 1)
            for tried in faults_of(call):
                out.write(json.dumps(tried) + "\n")
        os.chdir("/")


def tried_alone(name: str) -> tuple[int, list[str]]:
    """Number of tries and what was found, from a process that may die. Not a fork: threads would be missing in it."""
    done = subprocess.run([sys.executable, __file__, "--one", name], stdout=subprocess.PIPE, text=True, check=False)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    found = [f"{where}: {wrong}" for where, wrong in lines if wrong is not None]
    last = lines[-1][0] if lines else "before the first try"
    died = [f"{last}: the process died ({done.returncode})"] if done.returncode else []
    return sum(wrong is None for _, wrong in lines), found + died


def main() -> int:
    """Print the figures as JSON; 1 if something was found."""
    if sys.argv[1:2] == ["--one"]:
        try_one(sys.argv[2])
        return 0
    with tempfile.TemporaryDirectory(prefix="boundary-") as temporary:
        names = list(calls(Path(temporary)))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        results = dict(zip(names, pool.map(tried_alone, names), strict=True))
    found = {name: wrong for name, (_, wrong) in results.items() if wrong}
    print(json.dumps({"functions": len(names), "calls": sum(n for n, _ in results.values()), "found": found}, indent=2))
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
