"""Runs as Feather (Arrow's own file format), also as a stream of record batches."""

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

_FILE, _STREAM = b"ARROW1", b"\xff\xff\xff\xff"


def open_feather(path: str | Path) -> Table:
    """Open a Feather or Arrow IPC file: one row per sample; flat columns, or lists of one length per signal.

    Raises
    ------
    DataError
        Neither, damaged, columns twice, too large.
    OSError
        The file cannot be opened.
    """
    file = file_name(path)
    place = check_readable(path)
    with place.open("rb") as stream:
        head = stream.read(64)
    if head.startswith(b"FEA1"):
        raise DataError(
            f"{file}: is Feather version 1, which nobody writes any more; write it again as version 2 or as Parquet",
            code="not_feather",
            file=file,
        )
    if not head.startswith((_FILE, _STREAM)):
        raise not_of_kind("a Feather file (Arrow IPC)", head, file, "not_feather")
    # Compressed buffers say their size before they are unpacked, and pyarrow takes memory for one batch at a time.
    refuse_too_large(place.stat().st_size, file)
    try:
        schema, first = _schema(place, is_file=head.startswith(_FILE))
        refuse_duplicates([str(name) for name in schema.names], file)
        flat = flat_columns(schema, lambda wanted: first)
    except DataError:
        raise
    except Exception as error:
        raise damaged("Feather", error, file) from None
    refuse_duplicates(tuple(flat.sources), file)

    def read(wanted: Sequence[str]) -> Any:
        whole = list(dict.fromkeys(flat.sources[name][0] for name in wanted))
        try:
            return _read(place, whole, file, is_file=head.startswith(_FILE))
        except DataError:
            raise
        except Exception as error:
            raise damaged("Feather", error, file) from None

    def load(wanted: Sequence[str]) -> Columns:
        return to_numbers(read(wanted), flat, wanted, "Feather", file)

    def texts(wanted: Sequence[str]) -> Texts:
        return to_texts(read(wanted), flat, wanted, "Feather", file)

    return Table(file, "Feather", tuple(flat.sources), None, load, stamps=flat.stamps, texts=texts)


def _opened(place: Path, is_file: bool) -> Any:
    import pyarrow as pa

    source = arrow_file(place)
    return pa.ipc.open_file(source) if is_file else pa.ipc.open_stream(source)


def _schema(place: Path, *, is_file: bool) -> tuple[Any, Any]:
    """Schema, and the first batch."""
    import pyarrow as pa

    with _opened(place, is_file) as reader:
        batches = _batches(reader, is_file)
        first = next(batches, None)
        return reader.schema, pa.table(first) if first is not None else reader.schema.empty_table()


def _batches(reader: Any, is_file: bool) -> Any:
    return (reader.get_batch(k) for k in range(reader.num_record_batches)) if is_file else iter(reader)


def _read(place: Path, whole: list[str], file: str, *, is_file: bool) -> Any:
    import pyarrow as pa

    kept, size = [], 0
    with _opened(place, is_file) as reader:
        schema = pa.schema([reader.schema.field(name) for name in whole])
        for batch in _batches(reader, is_file):
            size += batch.nbytes
            refuse_too_large(size, file)
            kept.append(batch.select(whole))
    return pa.Table.from_batches(kept, schema)
