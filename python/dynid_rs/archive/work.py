"""Units of work: pure functions of a source, looked up before they are done, kept when they are done."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from functools import cache as remembered
from pathlib import Path

from dynid_rs import __version__, _core
from dynid_rs.archive.cache import Cache
from dynid_rs.archive.fingerprint import fingerprint
from dynid_rs.archive.runs import RunSource
from dynid_rs.archive.survey import Entry
from dynid_rs.findings import Finding

Unit = Callable[..., Entry]


class Work:
    """Does units of work in order.

    Parameters
    ----------
    cache : Cache, optional
        Where their results are kept, and looked for first.
    """

    def __init__(self, cache: Cache | None = None) -> None:
        self._cache = cache
        self._not_kept: list[str] = []

    def map(self, unit: Unit, sources: Sequence[RunSource], *arguments: object) -> Iterator[Entry]:
        """Results of ``unit(source, *arguments)`` in the order of `sources`, one at a time."""
        # What all sources share is hashed once.
        shared = None if self._cache is None else fingerprint(program(), unit.__name__, arguments)
        for source in sources:
            entry, complaint = done(unit, source, arguments, shared, self._cache)
            if complaint is not None:
                self._not_kept.append(complaint)
            yield entry

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


@remembered
def program() -> str:
    """Fingerprint of this program: another one may give other numbers."""
    state = hashlib.sha256(__version__.encode())
    package = Path(__file__).parents[1]
    for path in [Path(_core.__file__), *sorted(package.rglob("*.py"))]:
        state.update(path.read_bytes())
    return state.hexdigest()
