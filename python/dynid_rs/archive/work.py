"""Units of work: pure functions of a source, done one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from dynid_rs.archive.runs import RunSource
from dynid_rs.archive.survey import Entry


class Work:
    """Does units of work in order."""

    def map(
        self, unit: Callable[..., Entry], sources: Sequence[RunSource], *arguments: object, label: str
    ) -> Iterator[Entry]:
        """Results of ``unit(source, *arguments)`` in the order of `sources`, one at a time."""
        del label
        for source in sources:
            yield unit(source, *arguments)
