"""How many threads there are, for the compiled module and for what calls it side by side.

A number that no machine has would be waited for without end.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextvars import ContextVar, copy_context
from typing import TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_ASKED_BY = ("RAYON_NUM_THREADS", "RAYON_RS_NUM_CPUS")
"""Variables that the compiled module's pool of threads looks at."""
MOST = 1024
"""More threads than this, and than there are processors, are asked for by mistake."""


def limit() -> str | None:
    """Take an absurd number of threads out of the environment; returns a sentence, or None where there is none."""
    told = None
    for name in _ASKED_BY:
        asked = os.environ.get(name, "")
        if not (asked.isascii() and asked.isdigit()):
            continue  # the pool takes it for none
        if len(asked) > len(str(MOST)) * 4 or int(asked) > max(MOST, os.cpu_count() or 1):
            del os.environ[name]
            told = f"{name} asks for more than {MOST} threads; as many are used as there are processors"
    return told


_BESIDE_OTHERS: ContextVar[bool] = ContextVar("beside_others", default=False)
"""Whether this is one of several that run side by side already: all processors are busy then."""


def side_by_side(work: Callable[[Item], Answer], items: Iterable[Item]) -> list[Answer]:
    """Answers to every item, in their order, on as many threads as the compiled module has.

    For work that is mostly the compiled module's or numpy's, which other threads need not wait for. What an item's work
    changes, no other one's may see: then the answers are the same on any number of threads.
    """
    from concurrent.futures import ThreadPoolExecutor  # what it brings along would delay every `--help`

    items = list(items)
    n_threads = min(len(items), _n_threads())
    if n_threads < 2 or _BESIDE_OTHERS.get():
        return [work(item) for item in items]
    context = copy_context()
    context.run(_BESIDE_OTHERS.set, True)
    with ThreadPoolExecutor(n_threads) as pool:
        return list(pool.map(lambda item: context.copy().run(work, item), items))


def _n_threads() -> int:
    """As the compiled module's pool of threads counts: what is asked for, else the processors of this process."""
    for name in _ASKED_BY:
        asked = os.environ.get(name, "")[:5]  # what is longer is more than anybody has
        if asked.isascii() and asked.isdigit() and int(asked) > 0:
            return int(asked)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
