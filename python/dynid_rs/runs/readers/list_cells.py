"""Cells of a text that hold lists, as pandas writes them: refused with the mend where a signal is missing for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown, shown_names
from dynid_rs.runs.readers.guess import guess
from dynid_rs.runs.readers.table import Table


@contextmanager
def lists_explained(table: Table, joints: Sequence[str] = ("0",)) -> Iterator[None]:
    """Say of a missing column that the file has it as lists, unless its other columns can be mapped.

    Raises
    ------
    DataError
        `list_cells` in place of `missing_column`; any other error as it came.
    """
    try:
        yield
    except DataError as error:
        if error.code != "missing_column" or not table.lists or _can_be_mapped(table, joints):
            raise
        name = shown(table.lists[0])
        raise DataError(
            f"{table.file}: the cells of {shown_names(table.lists)} hold lists, expected one number in each; write one "
            f"column per joint ({name}_0, {name}_1, ...), or Parquet, which keeps lists (pandas: DataFrame.to_parquet)",
            code="list_cells",
            file=table.file,
            column=name,
        ) from None


def _can_be_mapped(table: Table, joints: Sequence[str]) -> bool:
    """Whether position and torque are among the columns under other names: lists beside them are nobody's concern."""
    by_name = guess(table.names, joints, table.units).columns
    return "q" in by_name and ("tau" in by_name or "current" in by_name)
