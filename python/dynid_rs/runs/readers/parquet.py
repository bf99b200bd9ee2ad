"""Runs as Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dynid_rs.base.arrow_files import arrow_file
from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import file_name
from dynid_rs.runs.readers.arrow import flat_columns, to_numbers, to_texts
from dynid_rs.runs.readers.table import Columns, Table, Texts, damaged, not_of_kind, refuse_duplicates, refuse_too_large

_MAGIC = b"PAR1"
_SHORTEST = 12  # magic, length of the footer, magic


def open_parquet(path: str | Path) -> Table:
    """Open a Parquet file: one row per sample; flat columns, or lists of one length per signal.

    Raises
    ------
    DataError
        Not Parquet, damaged, columns twice, too large.
    OSError
        The file cannot be opened.
    """
    file = file_name(path)
    place = check_readable(path)
    with place.open("rb") as stream:
        head = stream.read(64)
        size = place.stat().st_size
        stream.seek(-min(4, size), 2)
        tail = stream.read(4)
    if head[:4] != _MAGIC:
        raise not_of_kind("a Parquet file", head, file, "not_parquet")
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
        with pq.ParquetFile(arrow_file(place)) as parquet:
            schema = parquet.schema_arrow
            n_rows = int(parquet.metadata.num_rows)
            refuse_duplicates([str(name) for name in schema.names], file)
            flat = flat_columns(schema, lambda wanted: _first_row(parquet, wanted))
    except DataError:
        raise
    except Exception as error:
        raise damaged("Parquet", error, file) from None
    refuse_duplicates(tuple(flat.sources), file)
    if n_rows < 0:
        raise damaged("Parquet", ValueError(f"it declares {n_rows} rows"), file)

    def read(wanted: Sequence[str]) -> Any:
        whole = list(dict.fromkeys(flat.sources[name][0] for name in wanted))
        refuse_too_large(8 * n_rows * max(len(wanted), sum(flat.width(name) for name in whole)), file)
        try:
            with pq.ParquetFile(arrow_file(place), page_checksum_verification=True) as parquet:
                return parquet.read(columns=whole)
        except Exception as error:
            raise damaged("Parquet", error, file) from None

    def load(wanted: Sequence[str]) -> Columns:
        return to_numbers(read(wanted), flat, wanted, "Parquet", file)

    def texts(wanted: Sequence[str]) -> Texts:
        return to_texts(read(wanted), flat, wanted, "Parquet", file)

    return Table(file, "Parquet", tuple(flat.sources), n_rows, load, stamps=flat.stamps, texts=texts)


def _first_row(parquet: Any, wanted: list[str]) -> Any:
    import pyarrow as pa

    batch = next(parquet.iter_batches(batch_size=1, columns=wanted), None)
    return parquet.schema_arrow.empty_table() if batch is None else pa.table(batch)
