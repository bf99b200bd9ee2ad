"""Several recordings at once: parts that continue each other are joined, all others stay runs of their own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.notebook import html_table
from dynid_rs.runs.cells import MAX_GAP_STEPS

if TYPE_CHECKING:
    from dynid_rs.runs.recording import Recording


class Recordings(Sequence["Recording"]):
    """Recordings of one arm, in order; whatever takes a list of recordings takes them.

    Between two of them there is a gap that nothing reaches across: each is filtered, differentiated and split on its
    own, as files are.
    """

    def __init__(self, recordings: Iterable[Recording] = ()) -> None:
        self._all = tuple(recordings)

    @overload
    def __getitem__(self, key: int) -> Recording: ...
    @overload
    def __getitem__(self, key: slice) -> Recordings: ...
    def __getitem__(self, key: int | slice) -> Recording | Recordings:
        return Recordings(self._all[key]) if isinstance(key, slice) else self._all[key]

    def __len__(self) -> int:
        return len(self._all)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self._all)

    @property
    def n_samples(self) -> int:
        """Number of rows of all of them."""
        return sum(recording.n_samples for recording in self)

    @property
    def duration(self) -> float:
        """Time that was recorded [s]: gaps between them do not count."""
        return float(sum(recording.duration for recording in self))

    def to_dataframe(self, kind: str = "pandas") -> Any:
        """One table of all rows, as `Recording.to_dataframe` makes it, with the run's name in the column ``run``.

        A signal that some of the runs lack is missing (null) there.
        """
        import pyarrow as pa

        from dynid_rs.runs.frames import as_kind, to_table

        tables = []
        for recording in self:
            table = to_table(recording)
            tables.append(table.add_column(0, "run", pa.array([recording.name] * len(table))))
        return as_kind(pa.concat_tables(tables, promote_options="default"), kind)

    def __repr__(self) -> str:
        lines = "".join(f"\n  {recording!r}" for recording in self)
        noun = "recording" if len(self) == 1 else "recordings"
        return f"{len(self)} {noun}, {self.duration:.4g} s in all{':' if lines else ''}{lines}"

    def _repr_html_(self) -> str:
        rows = [
            [r.name, f"{r.duration:.4g}", f"{r.rate:.4g}", str(r.n_samples), str(r.n_joints), r.torque_unit]
            for r in self
        ]
        head = ("run", "duration [s]", "rate [Hz]", "samples", "joints", "torque unit")
        return html_table(head, rows, title=f"{len(self)} recordings, {self.duration:.4g} s in all")


def joined(recordings: Sequence[Recording]) -> Recordings:
    """Recordings in the order given; where one continues the one before it, both are one.

    It continues it where it holds the same signals and begins no more than 10 median steps after it ended: as much as
    a single recording may hold.

    Raises
    ------
    ValueError
        None are given.
    DataError
        They are of different arms, or their torque has different units.
    """
    if not recordings:
        raise ValueError("concat: no recording is given; give at least one")
    for one in recordings:
        if not hasattr(one, "median_step"):
            raise ValueError(f"concat: expected a list of recordings, got one of {type(one).__name__}")
    first = recordings[0]
    for other in recordings[1:]:
        _refuse_another_arm(first, other)
    found = [first]
    for recording in recordings[1:]:
        if _continues(found[-1], recording):
            found[-1] = _appended(found[-1], recording)
        else:
            found.append(recording)
    return Recordings(found)


def _refuse_another_arm(first: Recording, other: Recording) -> None:
    if other.joints != first.joints or other.torque_unit != first.torque_unit:
        what = [f"{r.name} has the joints {', '.join(r.joints)} and torque in {r.torque_unit}" for r in (first, other)]
        raise DataError(
            f"{' and '.join(what)}; concatenate runs of one arm in one unit", code="mixed_runs", file=other.name
        )


def _signals(recording: Recording) -> tuple[str, ...]:
    return recording.signals


def _continues(first: Recording, then: Recording) -> bool:
    gap = float(then.t[0] - first.t[-1])
    longest = MAX_GAP_STEPS * max(first.median_step, then.median_step)
    rates_agree = abs(first.median_step / then.median_step - 1) < 0.5
    return _signals(first) == _signals(then) and 0 < gap <= longest and rates_agree


def _appended(first: Recording, then: Recording) -> Recording:
    signals = {name: np.concatenate([getattr(first, name), getattr(then, name)]) for name in ("t", *_signals(first))}
    name = first.name if first.name == then.name else f"{first.name} + {then.name}"
    lines = first.first_line is not None and then.first_line == first.first_line + first.n_samples
    changes: dict[str, Any] = {**signals, "name": name, "first_line": first.first_line if lines else None}
    return replace(first, **changes)
