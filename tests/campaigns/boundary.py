"""Each argument of the compiled module spoiled in every way in turn: `python tests/campaigns/boundary.py`.

Every function is called in a process of its own, so that one that ends it does not end the others.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
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


def tried_alone(call: Call) -> tuple[int, list[str]]:
    """Number of tries and what was found, from a process that may die."""
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(reading)
        warnings.simplefilter("ignore")
        for where, wrong in faults_of(call):
            os.write(writing, json.dumps([where, wrong]).encode() + b"\n")
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        lines = [json.loads(line) for line in stream]
    _, status = os.waitpid(process, 0)
    found = [f"{where}: {wrong}" for where, wrong in lines if wrong is not None]
    died = [f"{lines[-1][0]}: the process died ({status})"] if status else []
    return sum(wrong is None for _, wrong in lines), found + died


def main() -> int:
    """Print the figures as JSON; 1 if something was found."""
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    with tempfile.TemporaryDirectory(prefix="boundary-") as temporary:
        os.chdir(temporary)  # whatever string is taken for a path names a file in here
        known = calls(Path(temporary))
        results = {name: tried_alone(call) for name, call in known.items()}
        os.chdir("/")
    found = {name: wrong for name, (_, wrong) in results.items() if wrong}
    print(json.dumps({"functions": len(known), "calls": sum(n for n, _ in results.values()), "found": found}, indent=2))
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
