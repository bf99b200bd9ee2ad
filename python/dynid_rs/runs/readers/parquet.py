"""Runs as Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.table import (
    Columns,
    Table,
    as_numbers,
    looks_like,
    refuse_duplicates,
    refuse_too_large,
)

_MAGIC = b"PAR1"
_SHORTEST = 12  # magic, length of the footer, magic


def open_parquet(path: str | Path) -> Table:
    """Open a Parquet file: one row per sample, one flat column per signal and joint.

    Raises
    ------
    DataError
        Not Parquet, damaged, columns twice, too large.
    OSError
        The file cannot be opened.
    """
    file = Path(path).name
    place = check_readable(path)
    with place.open("rb") as stream:
        head = stream.read(64)
        size = place.stat().st_size
        stream.seek(-min(4, size), 2)
        tail = stream.read(4)
    if head[:4] != _MAGIC:
        raise DataError(
            f"{file}: expected a Parquet file, but {looks_like(head)}; "
            "give the file the suffix of its format or write it again",
            code="not_parquet",
            file=file,
        )
    if size < _SHORTEST or tail != _MAGIC:
        raise DataError(
            f"{file}: this Parquet file is cut off (its end is missing); copy or record it again",
            code="truncated",
            file=file,
        )
    import pyarrow.parquet as pq

    # Damaged files come back from pyarrow as errors of half a dozen classes, OSError among them; here they
    # are all the same fact. The file itself was opened above.
    try:
        with pq.ParquetFile(place) as parquet:
            names = tuple(str(name) for name in parquet.schema_arrow.names)
            n_rows = int(parquet.metadata.num_rows)
    except Exception as error:
        raise _damaged(file, error) from None
    refuse_duplicates(names, file)
    if n_rows < 0:
        raise _damaged(file, ValueError(f"it declares {n_rows} rows"))

    def load(wanted: Sequence[str]) -> Columns:
        refuse_too_large(8 * n_rows * len(wanted), file)
        try:
            with pq.ParquetFile(place, page_checksum_verification=True) as parquet:
                table = parquet.read(columns=list(wanted))
                arrays = {name: _to_numpy(table.column(name)) for name in wanted}
        except Exception as error:
            raise _damaged(file, error) from None
        return {name: as_numbers(values, file, name) for name, values in arrays.items()}

    return Table(file, "Parquet", names, n_rows, load)


def _to_numpy(column: Any) -> Any:
    import pyarrow as pa

    if pa.types.is_timestamp(column.type):
        import pyarrow.compute as pc

        # Seconds since the first row: as float64 since 1970 only a quarter of a microsecond would be left.
        ticks = column.cast(pa.timestamp("ns")).cast(pa.int64())
        return pc.subtract(ticks, ticks[0]).cast(pa.float64()).to_numpy() * 1e-9 if len(ticks) else np.zeros(0)
    if pa.types.is_decimal(column.type) or pa.types.is_dictionary(column.type):
        column = column.cast(pa.float64())
    return column.to_numpy()


def _damaged(file: str, error: Exception) -> DataError:
    reason = shown(" ".join(str(error).split()) or type(error).__name__, 160)
    return DataError(
        f"{file}: this Parquet file is damaged ({reason}); copy or record it again", code="damaged", file=file
    )
