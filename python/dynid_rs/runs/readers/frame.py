"""Runs as tables in memory: pandas, polars, Arrow, whatever gives its columns as an Arrow stream.

None of those libraries is imported: a table comes over the Arrow PyCapsule interface (``__arrow_c_stream__``), which
pyarrow, a dependency, takes from all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown, shown_ends
from dynid_rs.runs.readers.arrow import flat_columns, to_numbers, to_texts
from dynid_rs.runs.readers.table import Columns, Table, Texts, refuse_duplicates

KIND = "data frame"
INDEX = "__index_level_0__"
"""What Arrow calls pandas' index where that has no name."""


def is_frame(source: object) -> bool:
    """Whether a source is a table in memory, not the path of a file."""
    return hasattr(source, "__arrow_c_stream__") or hasattr(source, "__dataframe__")


def open_frame(frame: Any, name: str) -> Table:
    """Open a table in memory; its index, where it has one, is a column too, ``index`` if it has no name.

    Parameters
    ----------
    frame : pandas, polars or pyarrow table, or anything with ``__arrow_c_stream__``
        One row per sample; flat columns, or lists of one length per signal.
    name : str
        Name for messages.

    Raises
    ------
    DataError
        Columns twice; nothing that Arrow takes for a table.
    """
    table, notes = _arrow(frame, name)
    names = ["index" if column == INDEX else column for column in table.column_names]
    refuse_duplicates(names, name)
    table = table.rename_columns(names)
    flat = flat_columns(table.schema, lambda wanted: table.select(wanted).slice(0, 1))
    refuse_duplicates(tuple(flat.sources), name)

    def load(wanted: Sequence[str]) -> Columns:
        return to_numbers(table, flat, wanted, KIND, name)

    def texts(wanted: Sequence[str]) -> Texts:
        return to_texts(table, flat, wanted, KIND, name)

    found = tuple(flat.sources)
    return Table(name, KIND, found, table.num_rows, load, stamps=flat.stamps, notes=notes, texts=texts)


def _arrow(frame: Any, name: str) -> tuple[Any, tuple[str, ...]]:
    """The table, and what is said of columns that Arrow does not take (objects of several kinds)."""
    import pyarrow as pa

    try:
        return pa.table(frame), ()
    except (pa.ArrowException, TypeError, ValueError) as error:
        columns = getattr(frame, "columns", None)
        if columns is None or not hasattr(frame, "__getitem__") or len(set(columns)) < len(columns):
            raise DataError(
                f"{name}: is no table of numbers ({shown_ends(str(error))}); give a data frame with one row per sample "
                "and columns that have different names",
                code="not_a_table",
                file=name,
            ) from None
    good = [column for column in columns if _is_taken(frame[[column]])]
    left_out = ", ".join(shown(str(column)) for column in columns if column not in good)
    return pa.table(frame[good]), (f"columns that hold no numbers are not looked at: {left_out}",)


def _is_taken(column: Any) -> bool:
    import pyarrow as pa

    try:
        pa.table(column)
    except (pa.ArrowException, TypeError, ValueError):
        return False
    return True
