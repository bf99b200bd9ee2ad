"""Units of work: pure functions of a source, looked up before they are done, kept when they are done.

Done here one after the other, by processes of this machine, or by the user's cluster:
``joblib.parallel_config(backend="dask")`` around the call is all that takes. The results come in the order of the
sources, so the number of processes and which of them did what changes nothing.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from functools import cache as remembered
from multiprocessing import TimeoutError as NoAnswer
from pathlib import Path
from typing import Any

from dynid_rs import _core
from dynid_rs.archive.cache import Cache
from dynid_rs.archive.fingerprint import fingerprint
from dynid_rs.archive.pages import keep_pages
from dynid_rs.archive.runs import RunSource
from dynid_rs.archive.survey import Entry
from dynid_rs.base import interrupt
from dynid_rs.base.findings import Finding

Unit = Callable[..., Entry]

UNITS_AHEAD = 16
"""Units per process that are handed out at a time: results wait for their turn, and memory has to stay flat."""
MOST_DEATHS = 2
"""A batch in which a process dies is done again so many times."""
LONGEST_UNIT = 3600.0
"""A unit that gives no answer for so long [s] is lost: Dask gives up a run that killed four workers without a word."""
RUST_THREADS = "RAYON_NUM_THREADS"


class Work:
    """Does units of work in order.

    Parameters
    ----------
    cache : Cache, optional
        Where their results are kept, and looked for first.
    n_jobs : int or None
        Processes; 1 is this one, -1 as many as there are cores. None: whatever `joblib.parallel_config` says.
    """

    def __init__(self, cache: Cache | None = None, n_jobs: int | None = 1) -> None:
        if n_jobs is not None and n_jobs < 1 and n_jobs != -1:
            raise ValueError(f"n_jobs must be at least 1, -1 for all cores or None, found {n_jobs}")
        self._cache, self._n_jobs = cache, n_jobs
        self._not_kept: list[str] = []

    def map(self, unit: Unit, sources: Sequence[RunSource], *arguments: object) -> Iterator[Entry]:
        """Results of ``unit(source, *arguments)`` in the order of `sources`, one at a time.

        Raises
        ------
        ChildProcessError
            Processes keep dying; the text is a sentence.
        """
        # What all sources share is hashed once.
        shared = None if self._cache is None else fingerprint(program(), unit.__name__, arguments)
        calls = ((unit, source, arguments, shared, self._cache) for source in sources)
        for entry, complaint in self._done(list(calls)):
            if complaint is not None:
                self._not_kept.append(complaint)
            yield entry

    def _done(self, calls: list[tuple[Any, ...]]) -> Iterator[tuple[Entry, str | None]]:
        if self._n_jobs == 1 or (self._n_jobs is None and _nobody_else()):
            yield from (done(*call) for call in calls)
            return
        from joblib import effective_n_jobs

        size = UNITS_AHEAD * effective_n_jobs(self._n_jobs)
        for first in range(0, len(calls), size):
            yield from self._batch(calls[first : first + size])

    def _batch(self, calls: list[tuple[Any, ...]]) -> list[tuple[Entry, str | None]]:
        from joblib import Parallel, delayed

        interrupt.check()  # the import is done
        deaths = 0
        while True:
            try:
                with Parallel(n_jobs=self._n_jobs, batch_size=1, timeout=LONGEST_UNIT) as parallel:
                    with interrupt.deaf_children():  # the processes start here
                        parallel(delayed(int)() for _ in range(2))
                    return list(parallel(delayed(_elsewhere)(_this_process(), *call) for call in calls))
            except (BrokenExecutor, NoAnswer) as error:
                interrupt.check()  # processes that a terminal interrupts with this one die of it
                deaths += 1
                if deaths > MOST_DEATHS or isinstance(error, NoAnswer):
                    raise ChildProcessError(
                        f"a process that worked on {calls[0][1].name} or one of the {len(calls) - 1} runs after it "
                        "died again and again or gave no answer (out of memory, or killed); use fewer --jobs, and "
                        "with --cache nothing that is done is done again"
                    ) from None

    def findings(self) -> list[Finding]:
        """One warning where results could not be kept: they are right, but would be made again."""
        if not self._not_kept:
            return []
        message = (
            f"{len(self._not_kept)} intermediate results could not be kept and would be made again "
            f"({self._not_kept[0]})"
        )
        return [Finding("cache_not_written", "warning", message)]


def done(
    unit: Unit, source: RunSource, arguments: tuple[object, ...], shared: str | None, cache: Cache | None
) -> tuple[Entry, str | None]:
    """Result of a unit, from the cache if it is there; and why it could not be kept, where it could not."""
    keep_pages()
    if cache is None or shared is None:
        return unit(source, *arguments), None
    key = fingerprint(shared, source.content())
    kept = cache.get(key)
    if kept is not None:
        return kept, None
    entry = unit(source, *arguments)
    try:
        cache.put(key, entry)
    except OSError as error:  # a full disk must not cost the answer
        return entry, str(error)
    return entry, None


def _elsewhere(home: tuple[str, int], *call: Any) -> tuple[Entry, str | None]:
    """`done` in a process that may be one of many: one thread each, or they would stand in each other's way."""
    from threadpoolctl import threadpool_limits

    if _this_process() != home:
        interrupt.hear()
        os.environ.setdefault(RUST_THREADS, "1")  # read when Rust's pool is first used
    with threadpool_limits(limits=1, user_api="blas"):
        return done(*call)


def _nobody_else() -> bool:
    """Whether joblib was told of nobody who could do the work beside this process."""
    from joblib import effective_n_jobs
    from joblib.parallel import get_active_backend

    backend, _ = get_active_backend()
    return effective_n_jobs(None) == 1 and type(backend).__name__ != "DaskDistributedBackend"


def _this_process() -> tuple[str, int]:
    return platform.node(), os.getpid()


@remembered
def program() -> str:
    """Fingerprint of this program: another one may give other numbers."""
    state = hashlib.sha256(_core.__version__.encode())
    package = Path(__file__).parents[1]
    for path in [Path(_core.__file__), *sorted(package.rglob("*.py"))]:
        state.update(path.read_bytes())
    return state.hexdigest()
