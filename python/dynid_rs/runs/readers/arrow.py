"""Columns of Arrow tables, as Parquet and Feather hold them: flat, or a list of one length per row."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.arrow_arrays import to_numpy
from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.table import MAX_WIDTH, Columns, Texts, as_numbers, damaged


@dataclass
class FlatColumns:
    """Columns of a table by the name that a run's reader gives them.

    `sources`: name -> column of the table, and place in its lists, None for a flat column; `stamps`: moments.
    """

    sources: dict[str, tuple[str, int | None]] = field(default_factory=dict)
    stamps: frozenset[str] = frozenset()

    def width(self, column: str) -> int:
        """Numbers per row of a column of the table."""
        return sum(name == column for name, _ in self.sources.values())


def flat_columns(schema: Any, first_rows: Callable[[list[str]], Any]) -> FlatColumns:
    """Name the columns of a table: ``q`` with three numbers per row gives ``q_0``, ``q_1``, ``q_2``.

    Parameters
    ----------
    schema : pyarrow.Schema
        Of the table.
    first_rows : callable
        Columns -> a table with some rows of them: lists whose length is not in the type are as long as the first.
    """
    import pyarrow as pa

    flat, stamps = FlatColumns(), []
    listed = [f.name for f in schema if _is_list(f.type) and _is_flat(f.type.value_type)]
    open_ended = [name for name in listed if not pa.types.is_fixed_size_list(schema.field(name).type)]
    sample = first_rows(open_ended) if open_ended else None
    for column in schema:
        name, kind = str(column.name), column.type
        if name in listed:
            size = kind.list_size if pa.types.is_fixed_size_list(kind) else _length(sample, name)
            if 0 < size <= MAX_WIDTH:
                flat.sources |= {f"{name}_{k}": (name, k) for k in range(size)}
                continue
        flat.sources[name] = (name, None)
        if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
            stamps.append(name)
    flat.stamps = frozenset(stamps)
    return flat


def to_numbers(table: Any, flat: FlatColumns, wanted: Sequence[str], kind: str, file: str) -> Columns:
    """Numbers of the wanted columns of a table that was read; moments as whole nanoseconds.

    Raises
    ------
    DataError
        A list of another length than the first, damage, no numbers.
    """
    return {name: as_numbers(values, file, name) for name, values in _values(table, flat, wanted, kind, file)}


def to_texts(table: Any, flat: FlatColumns, wanted: Sequence[str], kind: str, file: str) -> Texts:
    """Cells of the wanted columns as text; raises as `to_numbers` does."""
    return {name: [str(value) for value in values] for name, values in _values(table, flat, wanted, kind, file)}


def _values(
    table: Any, flat: FlatColumns, wanted: Sequence[str], kind: str, file: str
) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in wanted:
        source, place = flat.sources[name]
        try:
            column = table.column(source)
            values = _to_numpy(column) if place is None else _part(column, place, flat.width(source))
        except _UnlikeRows as unlike:
            raise DataError(
                f"{file}, row {unlike.row + 1}, column {shown(source)}: holds {unlike.length} values, "
                f"the first row {flat.width(source)}; write one value per joint in every row",
                code="length",
                file=file,
                column=source,
                row=unlike.row,
            ) from None
        except Exception as error:
            raise damaged(kind, error, file) from None
        yield name, values


class _UnlikeRows(Exception):
    def __init__(self, row: int, length: int) -> None:
        super().__init__(row, length)
        self.row, self.length = row, length


def _is_list(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind))


def _is_flat(kind: Any) -> bool:
    """Whether values are numbers, or names."""
    import pyarrow as pa

    return any(of(kind) for of in (pa.types.is_floating, pa.types.is_integer, pa.types.is_string))


def _length(sample: Any, name: str) -> int:
    import pyarrow.compute as pc

    column = sample.column(name)
    return int(pc.list_value_length(column[:1])[0].as_py() or 0) if len(column) else 0


def _part(column: Any, place: int, width: int) -> NDArray[Any]:
    import pyarrow as pa
    import pyarrow.compute as pc

    if not pa.types.is_fixed_size_list(column.type):
        lengths = to_numpy(pc.fill_null(pc.list_value_length(column), 0))
        if np.any(lengths != width):
            row = int(np.flatnonzero(lengths != width)[0])
            raise _UnlikeRows(row, int(lengths[row]))
    return to_numpy(pc.list_element(column, place))


def _to_numpy(column: Any) -> NDArray[Any]:
    import pyarrow as pa

    if pa.types.is_timestamp(column.type):
        return to_numpy(column.cast(pa.timestamp("ns")).cast(pa.int64()))
    if pa.types.is_duration(column.type):
        return to_numpy(column.cast(pa.duration("ns")).cast(pa.int64()))
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if pa.types.is_decimal(column.type):
        column = column.cast(pa.float64())
    return to_numpy(column)
